"""Attitude and heading from gyroscope, accelerometer and magnetometer: a direction cosine matrix filter.

The gyroscope carries the matrix from sample to sample by an exact rotation. A flapping airframe is shaken by
several g, so no single accelerometer sample says where down is; but its velocity is periodic, so the mean of the
specific force over the wing's period, taken in the earth frame that the gyroscope carries, is gravity plus the
acceleration of the flight path, and the airspeed tells the latter. What remains corrects the tilt and the gyro
bias once a block; the magnetometer, averaged in the same frame, corrects the heading alone.

The mean is weighted by a triangle over two blocks: up over the last one, down over the present one. A block is
one measured wing period, or a fixed time when the wings rest. Against a plain mean over one block this squares
the suppression of whatever the block does not hold a whole number of periods of.

The direction cosine matrix is that of the instrumentation suite of Gerdes et al. 2017; the averaging is ours.
"""

from __future__ import annotations

from math import atan2, cos, exp, hypot, isfinite, pi, sin, sqrt
from typing import Annotated, NamedTuple

from avionics.estimation.direction_cosines import (
    Matrix,
    Vector,
    cross,
    euler,
    multiply,
    norm,
    orthonormalised,
    quaternion,
    rotate,
    rotate_back,
    rotation,
    unit,
)
from avionics.messages import Attitude, ImuSample
from avionics.quantities import Quantity

GRAVITY = 9.80665
"""m/s^2; standard gravity"""

LONGEST_STEP = 0.25
"""s; a longer gap between samples is bridged with the rates for this long, and the block starts anew"""

STEEPEST = 0.5
"""-; cosine of the pitch up to which the path is taken as level along the heading, the nose being up by the angle
of attack"""

ZERO: Vector = (0.0, 0.0, 0.0)


class AhrsGains(NamedTuple):
    """What the filter is tuned with: one set for every vehicle, and for recordings without a wing."""

    fixed_block: Annotated[float, Quantity("s", 0.1, 10.0)] = 1.5
    """s; length of a block when no wing period is measured"""
    tilt_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 2.0
    """s; time constant of the tilt correction with fixed blocks"""
    flapping_tilt_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 4.0
    """s; time constant of the tilt correction while flapping; gusts and manoeuvres fall in it"""
    tilt_limit: Annotated[float, Quantity("rad", 0.01, 3.2)] = 0.1
    """rad; a larger disagreement counts as this, acceleration being likelier than so wrong an attitude, until it has
    lasted for the time constant of the correction"""
    settling: Annotated[float, Quantity("s", 0.0, 60.0)] = 5.0
    """s; after the start, in which the limit is not applied and no bias is learned from corrections"""
    gravity_tolerance: Annotated[float, Quantity("-", 0.01, 1.0)] = 0.2
    """-; share by which the mean specific force may differ from 1 g before it counts for nothing"""
    heading_time: Annotated[float, Quantity("s", 0.5, 120.0)] = 10.0
    """s; time constant of the heading correction"""
    bias_time: Annotated[float, Quantity("s", 5.0, 10000.0)] = 25.0
    """s; integral time of the gyro bias against tilt and heading corrections"""
    bias_limit: Annotated[float, Quantity("rad/s", 0.0, 0.2)] = 0.05
    """rad/s; largest gyro bias that is believed, each axis"""
    gyro_delay: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.5
    """-; age of a gyro sample in sample intervals: 0.5 when it is the mean over the last interval"""
    field_tolerance: Annotated[float, Quantity("-", 0.01, 1.0)] = 0.1
    """-; share by which the field's strength may differ from the reference"""
    dip_tolerance: Annotated[float, Quantity("rad", 0.01, 1.6)] = 0.17
    """rad; by which the field's dip may differ from the reference"""
    field_time: Annotated[float, Quantity("s", 1.0, 1000.0)] = 20.0
    """s; time constant with which the reference of strength and dip follows the accepted field"""
    field_patience: Annotated[float, Quantity("s", 1.0, 10000.0)] = 60.0
    """s; a field that was refused for so long without a break becomes the reference"""
    declination: Annotated[float, Quantity("rad", -pi, pi)] = 0.0
    """rad; of the magnetic field, east is positive"""
    rest_rate: Annotated[float, Quantity("rad/s", 0.0, 0.1)] = 0.03
    """rad/s; RMS deviation of the rates over a block under which the vehicle may be at rest"""
    rest_accel: Annotated[float, Quantity("m/s^2", 0.0, 2.0)] = 0.3
    """m/s^2; RMS deviation of the specific force over a block under which the vehicle may be at rest"""
    rest_airspeed: Annotated[float, Quantity("m/s", 0.0, 20.0)] = 5.0
    """m/s; above it the vehicle flies, however smoothly"""
    rest_time: Annotated[float, Quantity("s", 0.1, 60.0)] = 2.0
    """s; time constant of the gyro bias at rest"""


class Block(NamedTuple):
    """Integrals over the present block, earth axes but for the rates."""

    span: float = 0.0
    """s; since the block began"""
    force: Vector = ZERO
    """m/s; of the specific force"""
    force_moment: Vector = ZERO
    """m; of the specific force times the time since the block began"""
    travel: Vector = ZERO
    """m; of the velocity through the air: the airspeed along the heading"""
    field: Vector = ZERO
    """gauss s; of the magnetic field"""
    turn: Vector = ZERO
    """rad; of the measured rates, body axes"""
    rate_square: float = 0.0
    """rad^2/s; of the rates' square"""
    force_square: float = 0.0
    """m^2/s^3; of the specific force's square"""


class Correction(NamedTuple):
    """What changes once a block."""

    bias: Vector = ZERO
    """rad/s; gyro bias, body axes"""
    joined: float = 0.0
    """s; length of the last block, 0 when the next cannot be joined to it"""
    force: Vector = ZERO
    """m/s; integral of the last block's specific force, weighted by a ramp from 0 to 1, earth axes"""
    velocity: Vector = ZERO
    """m/s; mean velocity through the air over the last block, earth axes"""
    age: float = 0.0
    """s; in closed blocks since the start"""
    doubt: float = 0.0
    """s; for which the disagreement has exceeded its limit"""
    field: Vector = ZERO
    """reference of the magnetic field: strength in gauss (0: no magnetometer), dip in rad, 0"""
    refused: Vector = ZERO
    """field that is being refused: strength in gauss, dip in rad, and s since one was accepted"""
    tilt_error: float = 0.0
    """rad; last disagreement of the mean specific force with down"""
    heading_error: float = 0.0
    """rad; last disagreement of the field with magnetic north"""
    window: float = 0.0
    """s; length of the last block"""


class AhrsState(NamedTuple):
    """What the filter remembers."""

    time_us: int
    """us; of the last sample"""
    r: Matrix
    """-; r_ned_from_frd"""
    rates: Vector
    """rad/s; last measured rates, body axes"""
    force: Vector
    """m/s^2; last specific force, earth axes"""
    block: Block
    """present block"""
    correction: Correction
    """what the blocks before it left"""


def start(gains: AhrsGains, imu: ImuSample) -> AhrsState:
    """State from the first sample: down from the accelerometer, north from the magnetometer (TRIAD).

    A specific force or field without a direction counts as level, and as heading north without magnetometer.
    """
    force = (imu.accel_x, imu.accel_y, imu.accel_z)
    field = (imu.mag_x, imu.mag_y, imu.mag_z)
    if not isfinite(sum(imu)):
        force, field = (0.0, 0.0, -GRAVITY), ZERO
    r = triad(force, field, gains.declination)
    north, east, down = rotate(r, field)
    strength, dip = norm(field), atan2(down, hypot(north, east))
    rates = (imu.gyro_x, imu.gyro_y, imu.gyro_z) if isfinite(sum(imu)) else ZERO
    correction = Correction(field=(strength, dip, 0.0), refused=(strength, dip, 0.0))
    return AhrsState(imu.time_us, r, rates, rotate(r, force), Block(), correction)


def triad(force: Vector, field: Vector, declination: float) -> Matrix:
    """r_ned_from_frd from a specific force (m/s^2) and a magnetic field (any unit), both in body axes."""
    up = unit(force) or (0.0, 0.0, -1.0)
    down = (-up[0], -up[1], -up[2])
    east = unit(cross(down, field)) or unit(cross(down, (1.0, 0.0, 0.0))) or (0.0, 1.0, 0.0)
    magnetic: Matrix = (*cross(east, down), *east, *down)
    return multiply(rotation(0.0, 0.0, declination), magnetic)


def step(
    gains: AhrsGains, state: AhrsState, imu: ImuSample, frequency: float = 0.0, airspeed: float = 0.0
) -> tuple[AhrsState, Attitude]:
    """One IMU sample on.

    Args:
        gains: tuning.
        state: what the last step or `start` returned.
        imu: sample; one that is not finite, or not later than the last, changes nothing.
        frequency: Hz; measured flapping frequency, 0 when the wings rest.
        airspeed: m/s; true, from the pitot, 0 without one.
    """
    dt = (imu.time_us - state.time_us) * 1e-6
    if dt <= 0.0 or not isfinite(sum(imu)):
        return state, attitude(state)
    if dt > LONGEST_STEP:
        state, dt = _resumed(state), LONGEST_STEP
    correction = state.correction
    rates = (imu.gyro_x, imu.gyro_y, imu.gyro_z)
    r = multiply(state.r, _turn(gains.gyro_delay - 0.5, state.rates, rates, correction.bias, dt))
    force = rotate(r, (imu.accel_x, imu.accel_y, imu.accel_z))
    field = rotate(r, (imu.mag_x, imu.mag_y, imu.mag_z))
    speed = airspeed / max(STEEPEST, hypot(r[0], r[3]))
    velocity = (speed * r[0], speed * r[3], 0.0)
    length = 1.0 / frequency if frequency > 0.0 else gains.fixed_block
    before = state.block.span
    if before + dt < length:
        block = _extended(state.block, dt, _between(state.force, force, 0.5), velocity, field, rates)
    else:
        share = max(0.0, (length - before) / dt)
        before_end = _between(state.force, force, 0.5 * share)
        after_end = _between(state.force, force, 0.5 + 0.5 * share)
        full = _extended(state.block, share * dt, before_end, velocity, field, rates)
        block = _extended(Block(), (1.0 - share) * dt, after_end, velocity, field, rates)
        r, correction = _corrected(gains, r, correction, full, frequency > 0.0, airspeed)
    state = AhrsState(imu.time_us, r, rates, force, block, correction)
    return state, attitude(state)


def _resumed(state: AhrsState) -> AhrsState:
    """The state after a gap: a block with a hole is no mean."""
    return state._replace(block=Block(), correction=state.correction._replace(joined=0.0))


def _turn(lead: float, old: Vector, rates: Vector, bias: Vector, dt: float) -> Matrix:
    """Rotation over one interval; the mean rate in it is extrapolated by ``lead`` intervals from two samples."""
    return rotation(
        (rates[0] + lead * (rates[0] - old[0]) - bias[0]) * dt,
        (rates[1] + lead * (rates[1] - old[1]) - bias[1]) * dt,
        (rates[2] + lead * (rates[2] - old[2]) - bias[2]) * dt,
    )


def _between(a: Vector, b: Vector, share: float) -> Vector:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))


def _extended(block: Block, dt: float, force: Vector, velocity: Vector, field: Vector, rates: Vector) -> Block:
    """The block with ``dt`` seconds more, over which ``force`` is the mean specific force."""
    span, impulse, moment, travel, magnetic, turn, rate_square, force_square = block
    x, y, z = force
    fx, fy, fz = x * dt, y * dt, z * dt
    time = span + 0.5 * dt
    p, q, r = rates
    return Block(
        span + dt,
        (impulse[0] + fx, impulse[1] + fy, impulse[2] + fz),
        (moment[0] + fx * time, moment[1] + fy * time, moment[2] + fz * time),
        (travel[0] + velocity[0] * dt, travel[1] + velocity[1] * dt, travel[2] + velocity[2] * dt),
        (magnetic[0] + field[0] * dt, magnetic[1] + field[1] * dt, magnetic[2] + field[2] * dt),
        (turn[0] + p * dt, turn[1] + q * dt, turn[2] + r * dt),
        rate_square + (p * p + q * q + r * r) * dt,
        force_square + (x * x + y * y + z * z) * dt,
    )


def _corrected(
    gains: AhrsGains, r: Matrix, last: Correction, block: Block, flapping: bool, airspeed: float
) -> tuple[Matrix, Correction]:
    """Matrix and memory at the end of a block."""
    length = block.span
    age = last.age + length
    rising = _scaled(block.force_moment, 1.0 / length)
    velocity = _scaled(block.travel, 1.0 / length)
    time = gains.flapping_tilt_time if flapping else gains.tilt_time
    trusting = age > gains.settling and last.doubt < time
    x, y, share = _tilt(gains, _gravity(last, block, rising, velocity), trusting)
    gain = share * _gain(length, time, age)
    tilt = rotation(gain * x, gain * y, 0.0)
    field = rotate(tilt, _scaled(block.field, 1.0 / length))
    reference, refused = _field_test(gains, last, field, length)
    heading_error = _wrapped(gains.declination - atan2(field[1], field[0])) if refused[2] == 0.0 else 0.0
    turn = rotation(0.0, 0.0, _gain(length, gains.heading_time, age) * heading_error)
    r = orthonormalised(multiply(turn, multiply(tilt, r)))
    if not flapping and airspeed < gains.rest_airspeed and _resting(gains, block):
        bias = _between(last.bias, _scaled(block.turn, 1.0 / length), _gain(length, gains.rest_time, age))
    elif age < gains.settling:
        bias = last.bias
    else:
        error = (x * share / time, y * share / time, heading_error / gains.heading_time)
        bias = _sum(last.bias, _scaled(rotate_back(r, error), -length / gains.bias_time))
    doubt = last.doubt + length if share > 0.0 and hypot(x, y) >= gains.tilt_limit else 0.0
    # A block seen through a grossly wrong matrix cannot be joined to the next one.
    joined = length if gain * hypot(x, y) < gains.tilt_limit else 0.0
    corrected = Correction(
        _limited(bias, gains.bias_limit), joined, rotate(turn, rotate(tilt, rising)),
        rotate(turn, rotate(tilt, velocity)), age, doubt, reference, refused, hypot(x, y), heading_error, length,
    )  # fmt: skip
    return r, corrected


def _gravity(last: Correction, block: Block, rising: Vector, velocity: Vector) -> Vector:
    """Mean specific force in m/s^2 without the acceleration of the flight path, earth axes.

    With the weight rising from 0 to 1 over the last block and falling over this one, the weighted integral of
    the acceleration is, by parts, the difference of the two blocks' mean velocities.
    """
    fx, fy, fz = block.force
    if last.joined == 0.0:
        return _scaled(block.force, 1.0 / block.span)
    whole = 0.5 * (last.joined + block.span)
    (ax, ay, az), (bx, by, bz) = last.force, rising
    (ux, uy, uz), (vx, vy, vz) = last.velocity, velocity
    return (
        (ax + fx - bx - (vx - ux)) / whole,
        (ay + fy - by - (vy - uy)) / whole,
        (az + fz - bz - (vz - uz)) / whole,
    )


def _tilt(gains: AhrsGains, gravity: Vector, trusting: bool) -> tuple[float, float, float]:
    """Rotation about north and east in rad that turns ``gravity`` up, limited; and its weight from 0 to 1."""
    north, east, down = gravity
    level = hypot(north, east)
    angle = atan2(level, -down)
    strength = sqrt(level * level + down * down)
    share = max(0.0, 1.0 - abs(strength / GRAVITY - 1.0) / gains.gravity_tolerance)
    if level == 0.0:
        return 0.0, 0.0, share
    if trusting:
        angle = min(angle, gains.tilt_limit)
    return -east / level * angle, north / level * angle, share


def _gain(length: float, time: float, age: float) -> float:
    """Share of an error to take off after ``length`` s: of a mean that forgets at first, of a low-pass later."""
    return max(1.0 - exp(-length / time), min(1.0, 2.0 * length / age))


def _field_test(gains: AhrsGains, last: Correction, field: Vector, length: float) -> tuple[Vector, Vector]:
    """Reference and refused field after a block's mean ``field``; the latter ends in 0 when it was accepted."""
    if last.field[0] == 0.0:
        return last.field, (0.0, 0.0, 1.0)
    level = hypot(field[0], field[1])
    strength, dip = hypot(level, field[2]), atan2(field[2], level)
    if _alike(gains, strength, dip, last.field):
        gain = _gain(length, gains.field_time, last.age + length)
        reference = _between(last.field, (strength, dip, 0.0), gain)
        return reference, (strength, dip, 0.0)
    gain = 1.0 - exp(-length / gains.field_time)
    settled = _between(last.refused, (strength, dip, 0.0), gain)
    refused = last.refused[2] + length
    if refused > gains.field_patience and _alike(gains, strength, dip, settled):
        return (settled[0], settled[1], 0.0), (strength, dip, 0.0)
    return last.field, (settled[0], settled[1], refused)


def _alike(gains: AhrsGains, strength: float, dip: float, reference: Vector) -> bool:
    return (
        abs(strength - reference[0]) < gains.field_tolerance * reference[0]
        and abs(dip - reference[1]) < gains.dip_tolerance
    )


def _resting(gains: AhrsGains, block: Block) -> bool:
    """True when neither rates nor specific force moved during the block, and the rates may be a bias."""
    span = block.span
    turn = _scaled(block.turn, 1.0 / span)
    rate_variance = block.rate_square / span - norm(turn) ** 2
    force_variance = block.force_square / span - (norm(block.force) / span) ** 2
    return (
        rate_variance < gains.rest_rate**2
        and force_variance < gains.rest_accel**2
        and max(abs(turn[0]), abs(turn[1]), abs(turn[2])) < gains.bias_limit
    )


def _scaled(v: Vector, factor: float) -> Vector:
    return (v[0] * factor, v[1] * factor, v[2] * factor)


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _limited(v: Vector, limit: float) -> Vector:
    return (max(-limit, min(limit, v[0])), max(-limit, min(limit, v[1])), max(-limit, min(limit, v[2])))


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))


def attitude(state: AhrsState) -> Attitude:
    """The message of a state."""
    r, rates, correction = state.r, state.rates, state.correction
    roll, pitch, yaw = euler(r)
    w, x, y, z = quaternion(r)
    bx, by, bz = correction.bias
    return Attitude(
        state.time_us, roll, pitch, yaw, rates[0] - bx, rates[1] - by, rates[2] - bz, w, x, y, z, bx, by, bz,
        state.force[2] + GRAVITY, correction.tilt_error, correction.heading_error, correction.window,
    )  # fmt: skip
