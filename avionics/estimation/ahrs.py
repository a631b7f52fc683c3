"""Attitude and heading reference system: a direction cosine matrix filter.

The gyroscope propagates the matrix from sample to sample by an exact rotation. The accelerations of a flapping
airframe reach several g, so that a single accelerometer sample does not measure gravity. The velocity, however, is
periodic. The mean specific force over the wing period, in the earth frame propagated by the gyroscope, is gravity
plus the acceleration of the flight path, which follows from the airspeed. The remainder corrects the tilt and the
gyro bias once a block. The magnetometer, averaged in the same frame, corrects the heading only.

The mean has triangular weights over two blocks: rising over the last one, falling over the present one. A block is
one measured wing period, or a fixed time if the wings are at rest. In comparison with a plain mean over one block,
this squares the attenuation of components that are not periodic in the block. The mean passes a first-order low-pass
of half the time constant of the tilt correction, so that both together are a Butterworth filter of second order. A
low-pass of the force in the frame of the gyroscope is the method of VQF (Laidig and Seel, Information Fusion 91,
2023); here it is a part of the proportional and integral correction of Mahony et al. 2008.

The direction cosine matrix is that of the instrumentation suite of Gerdes et al. 2017; the averaging is original.
"""

from __future__ import annotations

from math import atan2, cos, exp, hypot, isfinite, pi, sin, sqrt
from typing import Annotated, Final, NamedTuple

from avionics.estimation import razor, velocity_aiding
from avionics.limits import clip
from avionics.messages import Attitude, GpsFix, ImuSample
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.records import constructor
from wingbeat.rotations import (
    Matrix,
    Vector,
    cross,
    dcm_from_rotation_vector,
    euler_from_dcm,
    multiply,
    norm,
    orthonormalize,
    quaternion_from_dcm,
    rotate,
    rotate_back,
    unit,
)
from wingbeat.units import Quantity

LONGEST_STEP: Final = 0.25
"""s; maximum propagation over a gap between samples; after a longer gap a new block begins"""

STEEPEST: Final = 0.5
"""-; minimum cosine of the pitch in the projection of the airspeed; the path is taken as level along the heading,
because the pitch is mostly angle of attack"""

TILT_NOISE_SLOPE: Final = 3.0
"""-; weight of the tilt residual of a block in its noise: accelerations of the path last for many blocks"""

AVERAGES, RAZOR = 0, 1
"""Values of `AhrsGains.method`."""

ZERO: Vector = (0.0, 0.0, 0.0)
NO_TIME: Matrix = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
IDENTITY: Matrix = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class AhrsGains(NamedTuple):
    """Parameters of the filter: one set for all vehicles and for recordings."""

    method: Annotated[int, Quantity("-", 0, 1)] = 0
    """-; 0: averages over blocks and GPS; 1: the corrections of `razor`, for comparison"""
    fixed_block: Annotated[float, Quantity("s", 0.1, 10.0)] = 1.5
    """s; block length without a measured wing period"""
    tilt_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 2.25
    """s; time constant of the tilt correction with fixed blocks. Default: chosen on trials of BROAD, see
    docs/validation/estimation.md"""
    flapping_tilt_time: Annotated[float, Quantity("s", 0.5, 60.0)] = 4.0
    """s; time constant of the tilt correction while flapping; averages over gusts and maneuvers"""
    tilt_limit: Annotated[float, Quantity("rad", 0.01, 3.2)] = 0.1
    """rad; limit of the tilt correction, because an acceleration is likelier than an attitude error of this size;
    ends once exceeded for the time constant of the correction"""
    settling: Annotated[float, Quantity("s", 0.0, 60.0)] = 5.0
    """s; time after the start without the tilt limit and without bias estimation"""
    gravity_tolerance: Annotated[float, Quantity("-", 0.01, 1.0)] = 0.2
    """-; relative difference of the mean specific force from 1 g at which its weight reaches 0"""
    heading_time: Annotated[float, Quantity("s", 0.5, 120.0)] = 10.0
    """s; time constant of the heading correction"""
    bias_time: Annotated[float, Quantity("s", 5.0, 10000.0)] = 25.0
    """s; shortest integral time of the gyro bias for tilt and heading corrections"""
    bias_limit: Annotated[float, Quantity("rad/s", 0.0, 0.2)] = 0.05
    """rad/s; maximum difference of the gyro bias from the offset of the last alignment, each axis"""
    gyro_delay: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.5
    """-; delay of a gyro sample in sample intervals: 0.5 for a mean over the last interval"""
    accel_delay: Annotated[float, Quantity("-", 0.0, 2.0)] = 0.5
    """-; delay of an accelerometer sample in sample intervals"""
    field_tolerance: Annotated[float, Quantity("-", 0.01, 1.0)] = 0.1
    """-; maximum relative difference of the field strength from its reference"""
    dip_tolerance: Annotated[float, Quantity("rad", 0.01, 1.6)] = 0.17
    """rad; maximum difference of the field dip from its reference"""
    field_time: Annotated[float, Quantity("s", 1.0, 1000.0)] = 20.0
    """s; time constant of the field reference for accepted measurements"""
    mag_timeout: Annotated[float, Quantity("s", 1.0, 10000.0, formerly="field_patience")] = 60.0
    """s; duration of rejection after which a constant field becomes the reference"""
    declination: Annotated[float, Quantity("rad", -pi, pi)] = 0.0
    """rad; magnetic declination, positive east"""
    rest_rate: Annotated[float, Quantity("rad/s", 0.0, 0.1)] = 0.03
    """rad/s; maximum RMS deviation of the rates over a block at rest"""
    rest_accel: Annotated[float, Quantity("m/s^2", 0.0, 2.0)] = 0.3
    """m/s^2; maximum RMS deviation of the specific force over a block at rest"""
    rest_airspeed: Annotated[float, Quantity("m/s", 0.0, 20.0)] = 5.0
    """m/s; airspeed above which rest detection is inhibited"""
    rest_time: Annotated[float, Quantity("s", 0.1, 60.0)] = 2.0
    """s; time constant of the gyro bias at rest"""
    rest_noise: Annotated[float, Quantity("rad/s", 1e-6, 0.1)] = 0.001
    """rad/s; one sigma of the mean rate of a block at rest"""
    gyro_walk: Annotated[float, Quantity("rad/s^0.5", 1e-5, 0.1)] = 0.001
    """rad/s^0.5; random walk of the attitude from the gyro noise"""
    bias_walk: Annotated[float, Quantity("rad/s^1.5", 1e-6, 0.1)] = 0.0002
    """rad/s^1.5; random walk of the gyro bias. Default: chosen, 0.01 deg/s per root second of warm-up"""
    tilt_noise: Annotated[float, Quantity("rad", 0.001, 1.0)] = 0.05
    """rad; one sigma of the tilt of a block: path accelerations not included in the airspeed"""
    field_noise: Annotated[float, Quantity("rad", 0.001, 1.0)] = 0.2
    """rad; one sigma of the magnetic heading of a block"""
    heading_limit: Annotated[float, Quantity("rad", 0.01, 3.2)] = 0.25
    """rad; gate of the magnetic heading with GPS aiding, in addition to three sigma of the heading"""
    disturbed_time: Annotated[float, Quantity("s", 0.0, 60.0)] = 1.0
    """s; duration of rejection after which the magnetometer is reported as disturbed"""
    level_error: Annotated[float, Quantity("rad", 0.0, 0.2)] = 0.004
    """rad; one sigma of tilt errors outside the covariance: mounting, scale. Default: fitted to roll and pitch errors
    in flight, see docs/validation/estimation.md"""
    compass_error: Annotated[float, Quantity("rad", 0.0, 0.5)] = 0.005
    """rad; one sigma of unobservable heading errors: mounting of the inertial sensors, 0.3 degrees"""
    gps_noise: Annotated[float, Quantity("m/s", 0.01, 10.0)] = 0.15
    """m/s; one sigma of the GPS velocity, each axis"""
    gps_gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovation gate of the GPS velocity in standard deviations"""
    gps_timeout: Annotated[float, Quantity("s", 0.1, 60.0, formerly="gps_patience")] = 2.0
    """s; time without an accepted fix after which the airspeed replaces the GPS"""
    gps_delay: Annotated[float, Quantity("s", 0.0, 1.0)] = 0.15
    """s; delay of a fix at its arrival"""
    razor_tilt: Annotated[float, Quantity("1/s", 0.0, 100.0)] = 5.12
    """1/s; method 1: proportional gain of the tilt"""
    razor_tilt_rate: Annotated[float, Quantity("1/s^2", 0.0, 100.0)] = 0.256
    """1/s^2; method 1: integral gain of the tilt"""
    razor_yaw: Annotated[float, Quantity("1/s", 0.0, 100.0)] = 1.2
    """1/s; method 1: proportional gain of the heading"""
    razor_yaw_rate: Annotated[float, Quantity("1/s^2", 0.0, 100.0)] = 0.001
    """1/s^2; method 1: integral gain of the heading"""
    field_strength: Annotated[float, Quantity("gauss", 0.0, 2.0)] = 0.0
    """gauss; local geomagnetic field strength, 0 if unknown"""
    field_dip: Annotated[float, Quantity("rad", -0.5 * pi, 0.5 * pi)] = 0.0
    """rad; local inclination of the field, positive down"""


class Block(NamedTuple):
    """Integrals over the present block, in earth axes except for the rates."""

    span: float = 0.0
    """s; time since the block began"""
    force: Vector = ZERO
    """m/s; integral of the specific force"""
    force_moment: Vector = ZERO
    """m; integral of the specific force times the time since the block began"""
    travel: Vector = ZERO
    """m; integral of the velocity through the air: airspeed along the heading"""
    field: Vector = ZERO
    """gauss s; integral of the magnetic field"""
    turn: Vector = ZERO
    """rad; integral of the measured rates, body axes"""
    rate_square: float = 0.0
    """rad^2/s; integral of the squared rates"""
    force_square: float = 0.0
    """m^2/s^3; integral of the squared specific force"""
    attitude: Matrix = NO_TIME
    """s; integral of r_ned_from_frd"""


class Correction(NamedTuple):
    """Results of the closed blocks, updated once a block."""

    bias: Vector = ZERO
    """rad/s; gyro bias, body axes"""
    joined: float = 0.0
    """s; length of the last block, 0 if the next one cannot be combined with it"""
    force: Vector = ZERO
    """m/s; integral of the specific force over the last block, weighted by a ramp from 0 to 1, earth axes"""
    velocity: Vector = ZERO
    """m/s; mean velocity through the air over the last block, earth axes"""
    age: float = 0.0
    """s; duration of all closed blocks since the start"""
    is_degraded: float = 0.0
    """s; time for which the tilt residual has exceeded its limit"""
    impulse: Vector = ZERO
    """m/s; integral of the specific force over all blocks, earth axes"""
    attitude: Matrix = NO_TIME
    """s; integral of r_ned_from_frd over all blocks"""
    field: Vector = ZERO
    """gauss, rad, -; reference of the magnetic field: strength (0: no magnetometer), dip, 0"""
    refused: Vector = ZERO
    """gauss, rad, s; rejected field: strength, dip, time since the last accepted field"""
    tilt_error: float = 0.0
    """rad; last difference between the mean specific force and vertical"""
    heading_error: float = 0.0
    """rad; last difference between the field and magnetic north"""
    window: float = 0.0
    """s; length of the last block"""
    tilt_sigma: float = 0.0
    """rad; one sigma of the tilt about each horizontal axis, including unobservable errors"""
    heading_sigma: float = 0.0
    """rad; one sigma of the heading, including unobservable errors"""
    disturbed: int = 0
    """-; 1 if the magnetic field has been rejected for longer than `AhrsGains.disturbed_time`"""
    aided: int = 0
    """-; 1 while the GPS corrects the tilt"""
    offset: Vector = ZERO
    """rad/s; gyro offset of the last alignment at rest, body axes"""
    accel_offset: Vector = ZERO
    """m/s^2; estimated accelerometer offset, body axes"""
    iron: Vector = ZERO
    """gauss; estimated hard iron, body axes"""
    lean: Vector = ZERO
    """m/s^2; low-passed difference between the mean specific force and 1 g upward, earth axes"""


class AhrsState(NamedTuple):
    """State of the filter."""

    time_us: int
    """us; time of the last sample"""
    r: Matrix
    """-; r_ned_from_frd"""
    rates: Vector
    """rad/s; last measured rates, body axes"""
    force: Vector
    """m/s^2; specific force of the last sample, earth axes"""
    block: Block
    """present block"""
    correction: Correction
    """results of the previous blocks"""
    aid: velocity_aiding.State
    """covariance of the errors and velocity over ground"""


class Flight(NamedTuple):
    """Further inputs at the end of a block."""

    time_us: int
    """us; end of the block"""
    flapping: bool
    """-; True if the block is a wing period"""
    airspeed: float
    """m/s; airspeed at the end of the block"""
    aided: bool = False
    """-; True if the GPS corrects the tilt"""
    heading_limit: float = pi
    """rad; gate of the magnetic heading"""


class View(NamedTuple):
    """Measurements of a block."""

    length: float
    """s; length of the block"""
    age: float
    """s; duration of all closed blocks since the start"""
    time: float
    """s; time constant of the tilt correction"""
    north: float
    """rad; rotation about north that levels the mean force, limited"""
    east: float
    """rad; rotation about east that levels the mean force, limited"""
    trust: float
    """-; weight of the tilt, from 0 to 1"""
    gain: float
    """-; fraction of the tilt error that is corrected"""
    lean: Vector
    """m/s^2; as `Correction.lean`"""
    tilt: Matrix
    """-; rotation by the corrected fraction"""
    rising: Vector
    """m/s; integral of the force, weighted by a ramp from 0 to 1, earth axes"""
    velocity: Vector
    """m/s; mean velocity through the air, earth axes"""
    reference: Vector
    """gauss, rad, -; as `Correction.field`"""
    refused: Vector
    """gauss, rad, s; as `Correction.refused`"""
    heading_error: float
    """rad; rotation about down that aligns the field, 0 if the field is rejected"""


def start(gains: AhrsGains, imu: ImuSample) -> AhrsState:
    """Return the state after the first sample (TRIAD).

    Down follows from the accelerometer and north from the magnetometer. A specific force without a direction counts
    as level; without a field the heading is north.
    """
    force = (imu.accel_x, imu.accel_y, imu.accel_z)
    field = (imu.mag_x, imu.mag_y, imu.mag_z)
    if not isfinite(sum(imu)):
        force, field = (0.0, 0.0, -STANDARD_GRAVITY), ZERO
    r = triad(force, field, gains.declination)
    north, east, down = rotate(r, field)
    strength, dip = norm(field), atan2(down, hypot(north, east))
    rates = (imu.gyro_x, imu.gyro_y, imu.gyro_z) if isfinite(sum(imu)) else ZERO
    correction = Correction(
        field=(strength, dip, 0.0), refused=(strength, dip, 0.0),
        tilt_sigma=velocity_aiding.START_TILT, heading_sigma=velocity_aiding.START_HEADING,
    )  # fmt: skip
    return AhrsState(
        imu.time_us, r, rates, rotate(r, force), Block(), correction, velocity_aiding.start(imu.time_us, r)
    )


def align(gains: AhrsGains, imu: ImuSample, span: float) -> AhrsState:
    """Return the state after a standstill from the means of its samples.

    The means give level, heading and gyro offset. This is the coarse alignment of a strapdown system at rest (Groves
    2013, 5.6.2).

    Args:
        gains: parameters.
        imu: mean rates, specific force and field of the standstill, with the time of its end.
        span: s; duration of the standstill.
    """
    state = start(gains, imu)
    rate = state.rates
    aid, errors = velocity_aiding.gravity_updated(state.aid, (imu.accel_x, imu.accel_y, imu.accel_z))
    correction = state.correction._replace(bias=rate, offset=rate, age=span, window=span, accel_offset=errors.accel)
    r = orthonormalize(multiply(dcm_from_rotation_vector(*errors.turn), state.r))
    return state._replace(r=r, correction=correction, aid=aid)


def aligned(gains: AhrsGains, state: AhrsState, rate: Vector) -> bool:
    """Return whether ``rate`` (rad/s) at rest is in the range of the bias estimator."""
    return max(abs(a - b) for a, b in zip(rate, state.correction.offset, strict=True)) < gains.bias_limit


def triad(force: Vector, field: Vector, declination: float) -> Matrix:
    """Return r_ned_from_frd from a specific force (m/s^2) and a magnetic field.

    Both are in body axes; the unit of the field is arbitrary.
    """
    up = unit(force) or (0.0, 0.0, -1.0)
    down = (-up[0], -up[1], -up[2])
    east = unit(cross(down, field)) or unit(cross(down, (1.0, 0.0, 0.0))) or (0.0, 1.0, 0.0)
    magnetic: Matrix = (*cross(east, down), *east, *down)
    return multiply(dcm_from_rotation_vector(0.0, 0.0, declination), magnetic)


_new_ahrs_state: Final = constructor(AhrsState)


def step(
    gains: AhrsGains,
    state: AhrsState,
    imu: ImuSample,
    frequency: float = 0.0,
    airspeed: float = 0.0,
    fix: GpsFix | None = None,
) -> tuple[AhrsState, Attitude]:
    """Propagate the attitude estimate by one IMU sample.

    Args:
        gains: parameters.
        state: result of the last step or of `start`.
        imu: sample; a sample that is not finite, or not later than the last one, is ignored.
        frequency: Hz; measured flapping frequency, 0 with the wings at rest.
        airspeed: m/s; true airspeed of the pitot, 0 without one.
        fix: GPS fix received since the last step, if any.
    """
    dt = (imu.time_us - state.time_us) * 1e-6
    if dt <= 0.0 or not isfinite(sum(imu)):
        return state, attitude(state)
    if dt > LONGEST_STEP:
        state, dt = _resumed(state), LONGEST_STEP
    rates = (imu.gyro_x, imu.gyro_y, imu.gyro_z)
    if gains.method == RAZOR:
        return _razor_step(gains, state, imu, rates, dt)
    correction, aid = state.correction, state.aid
    angles = _angles(gains.gyro_delay - 0.5, state.rates, rates, correction.bias, dt)
    r = multiply(state.r, dcm_from_rotation_vector(*angles))
    force, velocity, field = vectors = _in_earth_axes(gains.accel_delay, r, angles, imu, correction, airspeed)
    length = 1.0 / frequency if frequency > 0.0 else gains.fixed_block
    if state.block.span + dt < length:
        block = _extended(state.block, dt, _between(state.force, force, 0.5), velocity, field, rates, r)
    else:
        full, block = _divided(state, length, dt, vectors, rates, r)
        flight = Flight(imu.time_us, frequency > 0.0, airspeed)
        r, correction, aid = _corrected(gains, r, correction, full, flight, aid)
    if fix is not None and velocity_aiding.is_usable(fix):
        r, correction, block, aid = _fixed(gains, r, correction, block, aid, fix)
    elif aid.past and imu.time_us - aid.past[-1].time_us >= velocity_aiding.HISTORY_STEP_US:
        aid = velocity_aiding.remember(aid, gains.gps_delay, imu.time_us, _sum(correction.impulse, block.force))
    state = _new_ahrs_state(imu.time_us, r, rates, force, block, correction, aid)
    return state, attitude(state)


def _in_earth_axes(
    delay: float, r: Matrix, angles: Vector, imu: ImuSample, correction: Correction, airspeed: float
) -> tuple[Vector, Vector, Vector]:
    """Return specific force, velocity through the air and field in earth axes.

    Units are m/s^2, m/s (level component) and gauss.
    """
    (ax, ay, az), (mx, my, mz) = correction.accel_offset, correction.iron
    force = rotate(r, _earlier(delay, angles, (imu.accel_x - ax, imu.accel_y - ay, imu.accel_z - az)))
    speed = airspeed / max(STEEPEST, hypot(r[0], r[3]))
    return force, (speed * r[0], speed * r[3], 0.0), rotate(r, (imu.mag_x - mx, imu.mag_y - my, imu.mag_z - mz))


def _divided(
    state: AhrsState, length: float, dt: float, vectors: tuple[Vector, Vector, Vector], rates: Vector, r: Matrix
) -> tuple[Block, Block]:
    """Return the block completed to ``length`` (s) and the next block.

    The next block contains the rest of the interval ``dt`` (s).
    """
    force, velocity, field = vectors
    share = max(0.0, (length - state.block.span) / dt)
    before_end = _between(state.force, force, 0.5 * share)
    after_end = _between(state.force, force, 0.5 + 0.5 * share)
    return (
        _extended(state.block, share * dt, before_end, velocity, field, rates, r),
        _extended(Block(), (1.0 - share) * dt, after_end, velocity, field, rates, r),
    )


def _razor_step(
    gains: AhrsGains, state: AhrsState, imu: ImuSample, rates: Vector, dt: float
) -> tuple[AhrsState, Attitude]:
    """Advance method 1, which provides no uncertainty."""
    chosen = razor.Gains(
        gains.razor_tilt, gains.razor_tilt_rate, gains.razor_yaw, gains.razor_yaw_rate, gains.declination
    )
    accel, field = (imu.accel_x, imu.accel_y, imu.accel_z), (imu.mag_x, imu.mag_y, imu.mag_z)
    r, bias = razor.step(chosen, state.r, state.correction.bias, rates, (accel, field), dt)
    correction = state.correction._replace(bias=bias, window=dt, tilt_sigma=pi, heading_sigma=pi)
    state = state._replace(
        time_us=imu.time_us, r=r, rates=rates, force=rotate(r, accel), block=Block(), correction=correction
    )
    return state, attitude(state)


def _resumed(state: AhrsState) -> AhrsState:
    """Return the state after a gap; the incomplete block is discarded."""
    impulse = _sum(state.correction.impulse, state.block.force)
    attitude = _grown(state.correction.attitude, state.block.attitude, 1.0)
    aid = state.aid._replace(accepted_us=-1, agreed=0, past=())
    return state._replace(
        block=Block(),
        correction=state.correction._replace(joined=0.0, impulse=impulse, attitude=attitude, lean=ZERO),
        aid=aid,
    )


def _angles(lead: float, old: Vector, rates: Vector, bias: Vector, dt: float) -> Vector:
    """Return the rotation (rad) over one interval.

    The mean rate is extrapolated by ``lead`` intervals from two samples.
    """
    (a, b, c), (p, q, r), (x, y, z) = old, rates, bias
    return ((p + lead * (p - a) - x) * dt, (q + lead * (q - b) - y) * dt, (r + lead * (r - c) - z) * dt)


def _earlier(share: float, angles: Vector, v: Vector) -> Vector:
    """Transform a body vector from ``share`` of an interval ago to present body axes."""
    (a, b, c), (x, y, z) = angles, v
    return (x - share * (b * z - c * y), y - share * (c * x - a * z), z - share * (a * y - b * x))


def _between(a: Vector, b: Vector, share: float) -> Vector:
    return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))


_new_block: Final = constructor(Block)


def _extended(
    block: Block, dt: float, force: Vector, velocity: Vector, field: Vector, rates: Vector, attitude: Matrix
) -> Block:
    """Extend the block by ``dt`` (s) with the mean specific force ``force``."""
    span, impulse, moment, travel, magnetic, turn, rate_square, force_square, turned = block
    x, y, z = force
    fx, fy, fz = x * dt, y * dt, z * dt
    time = span + 0.5 * dt
    p, q, r = rates
    return _new_block(
        span + dt,
        (impulse[0] + fx, impulse[1] + fy, impulse[2] + fz),
        (moment[0] + fx * time, moment[1] + fy * time, moment[2] + fz * time),
        (travel[0] + velocity[0] * dt, travel[1] + velocity[1] * dt, travel[2] + velocity[2] * dt),
        (magnetic[0] + field[0] * dt, magnetic[1] + field[1] * dt, magnetic[2] + field[2] * dt),
        (turn[0] + p * dt, turn[1] + q * dt, turn[2] + r * dt),
        rate_square + (p * p + q * q + r * r) * dt,
        force_square + (x * x + y * y + z * z) * dt,
        _grown(turned, attitude, dt),
    )  # fmt: skip


def _grown(sum_: Matrix, r: Matrix, dt: float) -> Matrix:
    """Return ``sum_ + r dt``."""
    a, b, c, d, e, f, g, h, i = r
    s0, s1, s2, s3, s4, s5, s6, s7, s8 = sum_
    return (
        s0 + a * dt, s1 + b * dt, s2 + c * dt, s3 + d * dt, s4 + e * dt, s5 + f * dt, s6 + g * dt, s7 + h * dt,
        s8 + i * dt,
    )  # fmt: skip


def _fixed(
    gains: AhrsGains, r: Matrix, last: Correction, block: Block, aid: velocity_aiding.State, fix: GpsFix
) -> tuple[Matrix, Correction, Block, velocity_aiding.State]:
    """Return the matrix and the filter state after a GPS fix."""
    impulse, attitude = _sum(last.impulse, block.force), _grown(last.attitude, block.attitude, 1.0)
    aid = velocity_aiding.remember(aid, gains.gps_delay, fix.time_us, impulse)
    if last.age < gains.settling:
        return r, last, block, aid
    noise = _noise(gains)
    p = velocity_aiding.carried(aid, noise, fix.time_us, impulse, attitude)
    aid, errors = velocity_aiding.fixed(aid, p, noise, fix)
    r = orthonormalize(multiply(dcm_from_rotation_vector(*errors.turn), r))
    iron = _sum(last.iron, errors.iron)
    if errors.realigned:
        iron = _sum(iron, _iron(gains, r, last, block, errors.turn[2]))
        velocity_aiding.iron_known(p, r, _compass(gains, last.field))
        last, block = last._replace(joined=0.0, impulse=impulse, attitude=attitude, lean=ZERO), Block()
    aid = velocity_aiding.kept(aid, p, fix.time_us, impulse, attitude)
    bias = _limited(_sum(last.bias, errors.bias), last.offset, gains.bias_limit)
    accel = _sum(last.accel_offset, errors.accel)
    return r, last._replace(bias=bias, accel_offset=accel, iron=iron), block, aid


def _iron(gains: AhrsGains, r: Matrix, last: Correction, block: Block, turn: float) -> Vector:
    """Return the hard iron (gauss, body axes) that explains the field of ``block``.

    The field is in earth axes before the rotation ``turn`` (rad).
    """
    strength, dip, _ = last.field
    if block.span == 0.0 or strength == 0.0:
        return ZERO
    x, y, z = rotate(dcm_from_rotation_vector(0.0, 0.0, turn), _scaled(block.field, 1.0 / block.span))
    level = strength * cos(dip)
    north, east = level * cos(gains.declination), level * sin(gains.declination)
    return rotate_back(r, (x - north, y - east, z - strength * sin(dip)))


def _compass(gains: AhrsGains, reference: Vector) -> velocity_aiding.Compass:
    strength, dip, _ = reference
    return velocity_aiding.Compass(gains.declination, strength * cos(dip), strength * sin(dip))


def _noise(gains: AhrsGains) -> velocity_aiding.Noise:
    return velocity_aiding.Noise(
        gains.gyro_walk, gains.bias_walk, gains.gps_noise, gains.gps_gate, gains.gps_timeout, gains.gps_delay
    )


def _corrected(
    gains: AhrsGains, r: Matrix, last: Correction, block: Block, flight: Flight, aid: velocity_aiding.State
) -> tuple[Matrix, Correction, velocity_aiding.State]:
    """Return the matrix and the filter state at the end of a block."""
    impulse, attitude = _sum(last.impulse, block.force), _grown(last.attitude, block.attitude, 1.0)
    p = velocity_aiding.carried(aid, _noise(gains), flight.time_us, impulse, attitude)
    if velocity_aiding.agreeing(aid, gains.gps_timeout, flight.time_us):
        limit = gains.heading_limit + 3.0 * aid.heading_sigma
        flight = Flight(flight.time_us, flight.flapping, flight.airspeed, True, limit)
    view = _view(gains, last, block, flight)
    if flight.aided:
        turn, errors, aid = _by_compass(gains, r, view, aid, p)
        bias = _sum(last.bias, errors.bias)
    else:
        turn, bias, p = _by_view(gains, r, last, view, p)
        errors = velocity_aiding.NOTHING
    if not flight.flapping and flight.airspeed < gains.rest_airspeed and _resting(gains, last.offset, block):
        gain = _gain(view.length, gains.rest_time, view.age)
        bias = _between(last.bias, _scaled(block.turn, 1.0 / view.length), gain)
        p = velocity_aiding.rested(p, gain, gains.rest_noise)
    aid = velocity_aiding.kept(aid, p, flight.time_us, impulse, attitude)
    tilt_sigma, heading_sigma = _sigmas(gains, aid)
    disturbed = int(view.reference[0] > 0.0 and view.refused[2] >= gains.disturbed_time)
    sure = (tilt_sigma, heading_sigma, disturbed, int(flight.aided))
    limited = _limited(bias, last.offset, gains.bias_limit)
    corrected = _cached(gains, last.is_degraded, view, turn, (limited, impulse, attitude, sure))
    return (
        orthonormalize(multiply(turn, r)),
        corrected._replace(
            offset=last.offset,
            accel_offset=_sum(last.accel_offset, errors.accel),
            iron=_sum(last.iron, errors.iron),
            lean=view.lean,
        ),
        aid,
    )


def _sigmas(gains: AhrsGains, aid: velocity_aiding.State) -> tuple[float, float]:
    """Return one sigma of tilt and heading (rad).

    The covariance includes the hard iron, and the tilt error that the dip of the field projects into heading.
    """
    tilt = hypot(aid.tilt_sigma, gains.level_error)
    return tilt, hypot(aid.heading_sigma, gains.compass_error)


def _view(gains: AhrsGains, last: Correction, block: Block, flight: Flight) -> View:
    length = block.span
    age = last.age + length
    rising, velocity = _scaled(block.force_moment, 1.0 / length), _scaled(block.travel, 1.0 / length)
    time = gains.flapping_tilt_time if flight.flapping else gains.tilt_time
    trusting = age > gains.settling and last.is_degraded < time
    north, east, down = _gravity(last, block, rising, velocity)
    lean = _between(last.lean, (north, east, down + STANDARD_GRAVITY), _gain(length, 0.5 * time, age))
    x, y, trust = _tilt(gains, (lean[0], lean[1], lean[2] - STANDARD_GRAVITY), trusting)
    gain = 0.0 if flight.aided else trust * _gain(length, time, age)
    tilt = dcm_from_rotation_vector(gain * x, gain * y, 0.0)
    field = rotate(tilt, _scaled(block.field, 1.0 / length))
    reference, refused = _field_test(gains, last, field, length)
    heading_error = _wrapped(gains.declination - atan2(field[1], field[0]))
    if abs(heading_error) > flight.heading_limit:
        reference, refused = last.field, (refused[0], refused[1], last.refused[2] + length)
    if refused[2] > 0.0:
        heading_error = 0.0
    return View(length, age, time, x, y, trust, gain, lean, tilt, rising, velocity, reference, refused, heading_error)


def _by_compass(
    gains: AhrsGains, r: Matrix, view: View, aid: velocity_aiding.State, p: velocity_aiding.Array
) -> tuple[Matrix, velocity_aiding.Errors, velocity_aiding.State]:
    """Return rotation and errors of the field measurement during GPS aiding.

    The covariance ``p`` is updated in place.
    """
    if view.refused[2] != 0.0:
        return IDENTITY, velocity_aiding.NOTHING, aid
    compass = _compass(gains, view.reference)
    aid, errors = velocity_aiding.headed(aid, p, r, compass, view.heading_error, gains.field_noise)
    return dcm_from_rotation_vector(*errors.turn), errors, aid


def _by_view(
    gains: AhrsGains, r: Matrix, last: Correction, view: View, p: velocity_aiding.Array
) -> tuple[Matrix, Vector, velocity_aiding.Array]:
    """Return rotation, gyro bias and covariance of a block without GPS.

    The gains are fixed.
    """
    compass = _gain(view.length, gains.heading_time, view.age) if view.refused[2] == 0.0 else 0.0
    turn = multiply(dcm_from_rotation_vector(0.0, 0.0, compass * view.heading_error), view.tilt)
    learned = 0.0 if view.age < gains.settling else view.length / gains.bias_time
    error = (view.north, view.east, view.heading_error)
    # The covariance takes the errors of blocks as independent, which those of short blocks are not.
    correlation = sqrt(max(1.0, gains.fixed_block / view.length))
    is_degraded = correlation * hypot(gains.tilt_noise, TILT_NOISE_SLOPE * hypot(view.north, view.east))
    shares = (view.gain, view.gain, compass)
    tilt_limit = learned * view.trust / view.time
    limits = (tilt_limit, tilt_limit, learned / gains.heading_time if compass > 0.0 else 0.0)
    p, x = velocity_aiding.relaxed(
        p, r, _compass(gains, view.reference), shares, limits, error, (is_degraded, is_degraded, gains.field_noise)
    )
    return turn, _sum(last.bias, x), p


def _cached(
    gains: AhrsGains,
    is_degraded: float,
    view: View,
    turn: Matrix,
    known: tuple[Vector, Vector, Matrix, tuple[float, float, int, int]],
) -> Correction:
    """Return the correction record for the next block.

    Vectors are in axes after the correction. ``is_degraded`` is the value of the last block. ``known`` contains bias,
    impulse, and the last fields of `Correction`: sigmas, disturbed, aided.
    """
    size, (bias, impulse, attitude, sure) = hypot(view.north, view.east), known
    is_degraded = is_degraded + view.length if view.trust > 0.0 and size >= gains.tilt_limit else 0.0
    # Do not combine blocks if the attitude error exceeds tilt_limit.
    joined = view.length if view.gain * size < gains.tilt_limit else 0.0
    return Correction(
        bias, joined, rotate(turn, view.rising), rotate(turn, view.velocity), view.age, is_degraded, impulse,
        attitude, view.reference, view.refused, size, view.heading_error, view.length, *sure,
    )  # fmt: skip


def _gravity(last: Correction, block: Block, rising: Vector, velocity: Vector) -> Vector:
    """Return the mean specific force (m/s^2, earth axes) without path acceleration.

    The weight rises from 0 to 1 over the last block and falls over this one. Integration by parts then gives the
    weighted integral of the acceleration as the difference of the mean velocities of the blocks.
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
    """Return the rotation about north and east (rad) that levels ``gravity``.

    The rotation is limited. The third value is its weight from 0 to 1.
    """
    north, east, down = gravity
    level = hypot(north, east)
    angle = atan2(level, -down)
    strength = sqrt(level * level + down * down)
    share = max(0.0, 1.0 - abs(strength / STANDARD_GRAVITY - 1.0) / gains.gravity_tolerance)
    if level == 0.0:
        return 0.0, 0.0, share
    if trusting:
        angle = min(angle, gains.tilt_limit)
    return -east / level * angle, north / level * angle, share


def _gain(length: float, time: float, age: float) -> float:
    """Return the fraction of an error to correct after ``length`` (s).

    The gain is that of a fading mean at first, and that of a low-pass filter later.
    """
    return max(1.0 - exp(-length / time), min(1.0, 2.0 * length / age))


def _field_test(gains: AhrsGains, last: Correction, field: Vector, length: float) -> tuple[Vector, Vector]:
    """Return the reference and the rejected field after a block with mean ``field``.

    The last element of the rejected field is 0 if the field was accepted.
    """
    if last.field[0] == 0.0:
        return last.field, (0.0, 0.0, 1.0)
    level = hypot(field[0], field[1])
    strength, dip = hypot(level, field[2]), atan2(field[2], level)
    if _is_consistent(gains, strength, dip, last.field):
        gain = _gain(length, gains.field_time, last.age + length)
        reference = _between(last.field, (strength, dip, 0.0), gain)
        return reference, (strength, dip, 0.0)
    gain = 1.0 - exp(-length / gains.field_time)
    settled = _between(last.refused, (strength, dip, 0.0), gain)
    refused = last.refused[2] + length
    if refused > gains.mag_timeout and _is_consistent(gains, strength, dip, settled):
        return (settled[0], settled[1], 0.0), (strength, dip, 0.0)
    return last.field, (settled[0], settled[1], refused)


def _is_consistent(gains: AhrsGains, strength: float, dip: float, reference: Vector) -> bool:
    return (
        abs(strength - reference[0]) < gains.field_tolerance * reference[0]
        and abs(dip - reference[1]) < gains.dip_tolerance
    )


def _resting(gains: AhrsGains, offset: Vector, block: Block) -> bool:
    """Return whether the vehicle was at rest during the block.

    Rates and specific force must be constant, and the rates within the range of a bias.
    """
    span = block.span
    turn = _scaled(block.turn, 1.0 / span)
    rate_variance = block.rate_square / span - norm(turn) ** 2
    force_variance = block.force_square / span - (norm(block.force) / span) ** 2
    return (
        rate_variance < gains.rest_rate**2
        and force_variance < gains.rest_accel**2
        and max(abs(turn[0] - offset[0]), abs(turn[1] - offset[1]), abs(turn[2] - offset[2])) < gains.bias_limit
    )


def _scaled(v: Vector, factor: float) -> Vector:
    return (v[0] * factor, v[1] * factor, v[2] * factor)


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _limited(v: Vector, center: Vector, limit: float) -> Vector:
    (x, y, z), (a, b, c) = v, center
    return (clip(x, a - limit, a + limit), clip(y, b - limit, b + limit), clip(z, c - limit, c + limit))


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))


_new_attitude: Final = constructor(Attitude)


def attitude(state: AhrsState) -> Attitude:
    """Return the attitude message of a state."""
    time_us, r, (rate_x, rate_y, rate_z), force, _, correction, _ = state
    roll, pitch, yaw = euler_from_dcm(r)
    w, x, y, z = quaternion_from_dcm(r)
    bx, by, bz = correction.bias
    return _new_attitude(
        time_us, roll, pitch, yaw, rate_x - bx, rate_y - by, rate_z - bz, w, x, y, z, bx, by, bz,
        force[2] + STANDARD_GRAVITY, correction.tilt_error, correction.heading_error, correction.window,
        correction.tilt_sigma, correction.heading_sigma, correction.disturbed, correction.aided,
    )  # fmt: skip
