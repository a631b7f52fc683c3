"""Attitude aiding by GPS velocity: a Kalman filter of the errors of `ahrs`.

The specific force in earth axes without gravity propagates the velocity from fix to fix. An error of tilt or heading
rotates the force, so that the velocity innovation measures the attitude error:

    du/dt = theta x f - R da,    dtheta/dt = -R db

Here u is the error of the propagated velocity, theta the small rotation about earth axes that corrects the attitude,
f the specific force in earth axes, and da and db the errors of the accelerometer offset and the gyro bias in body
axes. These are the error equations of inertial navigation in local axes (Groves, Principles of GNSS, Inertial, and
Multisensor Integrated Navigation Systems, 2nd ed., 14.2) without the rotation of the earth.

At rest the accelerometer offset is equivalent to a tilt, and the hard iron dm to a heading error: neither is
observable. Both rotate with the vehicle, tilt and heading errors do not, so that a change of heading separates them.
A launch makes only the heading observable.

Unlike the airspeed, the ground velocity is valid in gusts, sideslip and during the launch. Flapping requires no
averaging, because the force between two fixes is integrated sample by sample.

The covariance is also propagated without fixes, as the uncertainty of the attitude. Scalar updates in plain NumPy are
used, because a general update would cost more than the rest of a tick.
"""

from __future__ import annotations

from math import atan2, cos, hypot, isfinite, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.messages import GpsFix
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.rotations import Matrix, Vector

Array = NDArray[np.float64]

VELOCITY, ROTATION, TILT, HEADING, BIAS = slice(0, 2), slice(2, 5), slice(2, 4), 4, slice(5, 8)
ACCEL, IRON = slice(8, 10), slice(10, 12)
CONSIDERED = slice(8, 12)
STATES = 12
"""north and east components of u in m/s; theta about north, east and down in rad; db about the body axes in rad/s; da
and dm along body x and y in m/s^2 and gauss"""
UNITY: Array = np.eye(STATES)
POSITION_FIX = 2
"""minimum `GpsFix.fix_type` of a velocity that is used"""
HISTORY_STEP_US = 20_000
"""us; interval of the impulse history for delayed fixes"""
CONFIRMATIONS = 3
"""-; number of fixes that must agree with a new velocity before they replace the block averages"""
START_TILT, START_HEADING, START_BIAS = 0.05, 0.15, 0.01
"""rad, rad, rad/s; standard deviations after the first sample"""
START_ACCEL, START_IRON = 0.12, 0.006
"""m/s^2, gauss; standard deviations of accelerometer offset and hard iron, each axis"""
ACCEL_WALK, IRON_WALK = 0.002, 0.0001
"""m/s^2.5, gauss/s^0.5; random walk of both"""
FLAPPING_ACCEL, FLAPPING_IRON = 0.1, 0.006
"""m/s^2, gauss; standard deviations of the changes of both when flapping begins or ends, each axis: vibration, and
the field of the drive current; chosen on flights with vibration, see docs/validation/estimation.md"""
LAUNCH_SPEED = 3.0
"""m/s; ground speed that separates rest and flight: after a launch from rest the course indicates the heading"""
SPEED_AGREEMENT = 0.25
"""-; maximum relative difference between the propagated speed and the speed of a fix if only the heading is wrong"""
TURN_AGREEMENT = 0.2
"""rad; maximum difference between the heading errors of two successive fixes"""
SET_IRON = 0.005
"""gauss; standard deviation of a hard iron set from a mean field, each axis"""
LEAST_HORIZONTAL = 0.05
"""gauss; horizontal field below which the hard iron is not estimated"""
ZERO: Vector = (0.0, 0.0, 0.0)


class Noise(NamedTuple):
    """Noise parameters; equal to the fields of `ahrs.AhrsGains` with the same names."""

    gyro_walk: float
    """rad/s^0.5; random walk of the attitude"""
    bias_walk: float
    """rad/s^1.5; random walk of the gyro bias"""
    gps_noise: float
    """m/s; one sigma of the GPS velocity, each axis"""
    gps_gate: float
    """-; innovation gate of the GPS velocity in standard deviations"""
    gps_timeout: float
    """s; time without an accepted fix after which the velocity is reset"""
    gps_delay: float
    """s; delay of a fix at its arrival"""


class Moment(NamedTuple):
    """Integral of the specific force at one time."""

    time_us: int
    """us; since boot"""
    impulse: Vector
    """m/s; integral since boot, earth axes"""


class State(NamedTuple):
    """State of the error filter."""

    covariance: tuple[float, ...]
    """SI; covariance of the 12 errors, row by row"""
    time_us: int
    """us; time of the covariance"""
    impulse: Vector = ZERO
    """m/s; integral of the specific force up to that time, earth axes"""
    attitude: Matrix = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """s; integral of r_ned_from_frd up to that time"""
    past: tuple[Moment, ...] = ()
    """impulse history, oldest first; empty before the first fix"""
    offset: tuple[float, float] = (0.0, 0.0)
    """m/s; north and east difference between ground velocity and impulse"""
    accepted_us: int = -1
    """us; time of the last accepted fix, -1 before the first"""
    agreed: int = 0
    """-; number of consecutively accepted fixes since the velocity was set"""
    tilt_sigma: float = START_TILT
    """rad; one sigma of the tilt about a horizontal axis"""
    heading_sigma: float = START_HEADING
    """rad; one sigma of the heading"""
    turn: float = 0.0
    """rad; heading error indicated by the last rejected fix, 0 if none"""
    speed: float = 0.0
    """m/s; ground speed of the last accepted fix"""


class Errors(NamedTuple):
    """Corrections of the attitude and the sensor offsets."""

    turn: Vector
    """rad; rotation about earth axes"""
    bias: Vector
    """rad/s; correction of the gyro bias, body axes"""
    accel: Vector
    """m/s^2; correction of the accelerometer offset, body axes"""
    iron: Vector
    """gauss; correction of the hard iron, body axes"""
    realigned: bool = False
    """True if ``turn`` is not small: the heading is reset and the impulse history is invalid"""


class Compass(NamedTuple):
    """Reference of the magnetic heading measurement."""

    declination: float
    """rad; east is positive"""
    horizontal: float
    """gauss; horizontal field strength"""
    vertical: float = 0.0
    """gauss; vertical field, positive down"""


NOTHING = Errors(ZERO, ZERO, ZERO, ZERO)


def start(time_us: int, r: Matrix) -> State:
    """Return the state before the first fix.

    The matrix ``r`` was leveled by the accelerometer, so that its offset is correlated with the tilt.
    """
    variances = [
        1.0, 1.0, *2 * [START_TILT**2], START_HEADING**2, *3 * [START_BIAS**2], *2 * [START_ACCEL**2],
        *2 * [START_IRON**2],
    ]  # fmt: skip
    j = UNITY.copy()
    j[2:4, ACCEL] = _tilt_of_offset(r)
    p = (j * variances).dot(j.T)
    return State(tuple(p.ravel().tolist()), time_us)


def _tilt_of_offset(r: Matrix) -> Array:
    """Return the tilt per accelerometer offset after leveling at rest.

    The matrix (2, 2) relates the tilt about north and east (rad) to offsets along body x and y (m/s^2).
    """
    (nx, ny, _), (ex, ey, _) = r[0:3], r[3:6]
    return np.array(((ex, ey), (-nx, -ny))) / STANDARD_GRAVITY


def remember(state: State, gps_delay: float, time_us: int, impulse: Vector) -> State:
    """Store the impulse (m/s, earth axes) for fixes that arrive later."""
    kept = 2 + round(gps_delay * 1e6 / HISTORY_STEP_US)
    return state._replace(past=(*state.past, Moment(time_us, impulse))[-kept:])


def carried(state: State, noise: Noise, time_us: int, impulse: Vector, attitude: Matrix) -> Array:
    """Return the covariance propagated to ``time_us`` (us).

    ``impulse`` (m/s) and ``attitude`` (s) are the integrals of the specific force and of r_ned_from_frd at that time:
    a vehicle that turns through 90 degrees has its bias about another earth axis at the end than at the start.
    """
    p = np.array(state.covariance).reshape(STATES, STATES)
    dt = (time_us - state.time_us) * 1e-6
    (x, y, z), (x0, y0, z0) = impulse, state.impulse
    f = UNITY.copy()
    f[0, 3], f[0, 4], f[1, 2], f[1, 4] = z - z0, -(y - y0), -(z - z0), x - x0
    turned = np.subtract(state.attitude, attitude).reshape(3, 3)
    f[ROTATION, BIAS], f[VELOCITY, ACCEL] = turned, turned[0:2, 0:2]
    p = f.dot(p).dot(f.T)
    rotation, bias = noise.gyro_walk**2 * dt, noise.bias_walk**2 * dt
    accel, iron = ACCEL_WALK**2 * dt, IRON_WALK**2 * dt
    p.reshape(-1)[:: STATES + 1] += (
        0.0, 0.0, rotation, rotation, rotation, bias, bias, bias, accel, accel, iron, iron
    )  # fmt: skip
    return np.asarray(p)


def kept(state: State, p: Array, time_us: int, impulse: Vector, attitude: Matrix) -> State:
    """Return the state with the covariance ``p`` at ``time_us`` (us)."""
    flat = tuple((0.5 * (p + p.T)).ravel().tolist())
    tilt, heading = sqrt(0.5 * (p.item(2, 2) + p.item(3, 3))), sqrt(p.item(4, 4))
    _, _, _, _, past, offset, accepted_us, agreed, _, _, turn, speed = state
    return State(flat, time_us, impulse, attitude, past, offset, accepted_us, agreed, tilt, heading, turn, speed)


def disturb(p: Array) -> None:
    """Add the variance of the offsets that change when flapping begins or ends to the covariance, in place."""
    p.reshape(-1)[:: STATES + 1][CONSIDERED] += (*2 * [FLAPPING_ACCEL**2], *2 * [FLAPPING_IRON**2])


def is_usable(fix: GpsFix) -> bool:
    """Return whether a fix has a finite velocity and a position."""
    return isfinite(fix.v_north + fix.v_east) and fix.fix_type >= POSITION_FIX


def fixed(state: State, p: Array, noise: Noise, fix: GpsFix) -> tuple[State, Errors]:
    """Update the state with a fix; ``p`` at its arrival is updated in place.

    A fix beyond the gate has no effect. After ``gps_timeout`` without an
    accepted fix the next one resets the velocity. After a launch from rest, two rejected fixes with the propagated
    speed and the same difference of course rotate the heading by that difference (similar to the yaw reset of EKF2 to
    the GPS course).
    """
    impulse = _impulse_at(state, fix.time_us - round(noise.gps_delay * 1e6))
    velocity, variance = (fix.v_north - impulse[0], fix.v_east - impulse[1]), noise.gps_noise**2
    speed = hypot(fix.v_north, fix.v_east)
    if state.accepted_us < 0 or (fix.time_us - state.accepted_us) * 1e-6 > noise.gps_timeout:
        p[VELOCITY, :] = p[:, VELOCITY] = 0.0
        p[0, 0] = p[1, 1] = variance
        return state._replace(offset=velocity, accepted_us=fix.time_us, agreed=0, speed=speed), NOTHING
    north, east = velocity[0] - state.offset[0], velocity[1] - state.offset[1]
    gate = noise.gps_gate**2
    if north**2 > gate * (p.item(0, 0) + variance) or east**2 > gate * (p.item(1, 1) + variance):
        return _turned(state, p, noise, fix, impulse)
    update = _updated if state.agreed >= CONFIRMATIONS else _considered
    x = update(p, 0, north, variance)
    x += update(p, 1, east - float(x[1]), variance)
    return _applied(state._replace(accepted_us=fix.time_us, agreed=state.agreed + 1, turn=0.0, speed=speed), x)


def _turned(state: State, p: Array, noise: Noise, fix: GpsFix, impulse: Vector) -> tuple[State, Errors]:
    """Rotate the heading to the course of a launch after a second consistent fix.

    A heading error rotates the velocity gained since rest; a change of course in flight does not.
    """
    north, east = state.offset[0] + impulse[0], state.offset[1] + impulse[1]
    carried_speed, speed = hypot(north, east), hypot(fix.v_north, fix.v_east)
    no_launch = state.speed > LAUNCH_SPEED or min(carried_speed, speed) < LAUNCH_SPEED
    if no_launch or abs(carried_speed - speed) > SPEED_AGREEMENT * speed:
        return state._replace(turn=0.0), NOTHING
    turn = _wrapped(atan2(fix.v_east, fix.v_north) - atan2(east, north))
    if state.turn == 0.0 or abs(_wrapped(turn - state.turn)) > TURN_AGREEMENT:
        return state._replace(turn=turn), NOTHING
    for part in (VELOCITY, slice(HEADING, HEADING + 1), IRON):
        p[part, :] = p[:, part] = 0.0
    p[0, 0] = p[1, 1] = noise.gps_noise**2
    p[HEADING, HEADING] = 2.0 * (noise.gps_noise / speed) ** 2
    state = state._replace(accepted_us=-1, agreed=0, past=(), turn=0.0)
    return state, Errors((0.0, 0.0, turn), ZERO, ZERO, ZERO, True)


def iron_known(p: Array, r: Matrix, compass: Compass) -> None:
    """Update the covariance in place after a reset of the hard iron.

    The hard iron was set so that the compass agrees with the heading of ``r``.
    """
    if compass.horizontal < LEAST_HORIZONTAL:
        return
    j = _iron_row(r, compass) * compass.horizontal
    p[IRON, :] = p[HEADING] * j[:, np.newaxis]
    p[:, IRON] = p[IRON, :].T
    p[IRON, IRON] = np.outer(j, j) * p.item(HEADING, HEADING) + np.eye(2) * SET_IRON**2


def _iron_row(r: Matrix, compass: Compass) -> Array:
    """Return the magnetic east direction in body axes, x and y."""
    s, c = -sin(compass.declination), cos(compass.declination)
    return np.array((s * r[0] + c * r[3], s * r[1] + c * r[4]))


def agreeing(state: State, gps_timeout: float, time_us: int) -> bool:
    """Return whether recent, confirmed fixes correct the tilt."""
    return state.agreed >= CONFIRMATIONS and (time_us - state.accepted_us) * 1e-6 < gps_timeout


def headed(
    state: State, p: Array, r: Matrix, compass: Compass, heading_error: float, sigma: float
) -> tuple[State, Errors]:
    """Update the state with a magnetic heading; ``p`` is updated in place.

    ``heading_error`` (rad) is the measured rotation about down, ``sigma`` (rad) its noise. Tilt and accelerometer
    offset are considered but not corrected (Schmidt-Kalman): a disturbed field must not tilt the vehicle.
    """
    h = _heading_row(r, compass)
    ph = p.dot(h)
    k = ph / (float(h.dot(ph)) + sigma**2)
    k[TILT] = 0.0
    k[ACCEL] = 0.0
    p[:] = _joseph(p, h[np.newaxis], k[:, np.newaxis], np.array((sigma,)))
    return _applied(state, k * heading_error)


def _heading_row(r: Matrix, compass: Compass) -> Array:
    """Return the measurement row of the magnetic heading.

    A tilt about magnetic north rotates the vertical field into the east direction.
    """
    h = np.zeros(STATES)
    h[HEADING] = 1.0
    if compass.horizontal >= LEAST_HORIZONTAL:
        slope = compass.vertical / compass.horizontal
        h[TILT] = -slope * cos(compass.declination), -slope * sin(compass.declination)
        h[IRON] = _iron_row(r, compass) / -compass.horizontal
    return h


def relaxed(
    p: Array, r: Matrix, compass: Compass, shares: Vector, limits: Vector, error: Vector, sigmas: Vector
) -> tuple[Array, Vector]:
    """Return the covariance and the gyro bias correction after attitude corrections with fixed gains (Joseph form).

    The bias has the gain of the Kalman filter: the covariance between attitude and bias tells about which body axis
    the rate was that an attitude error came from, which the attitude at the end of a turn does not.

    Args:
        p: covariance before.
        r: r_ned_from_frd.
        compass: reference of the magnetic heading.
        shares: corrected fractions of the measured rotation about north, east and down.
        limits: 1/s; greatest gain of the bias for each of the three measurements.
        error: rad; measured rotation about north, east and down.
        sigmas: rad; noise of the three measurements.
    """
    h = UNITY[ROTATION].copy()
    h[0:2, ACCEL] = -_tilt_of_offset(r)
    h[2] = _heading_row(r, compass)
    noise = np.array(sigmas)
    k = np.zeros((STATES, 3))
    k[ROTATION] = np.diag(shares)
    ph = p.dot(h.T)
    gain = ph[BIAS] / (np.einsum("ij,ji->i", h, ph) + noise**2)
    k[BIAS] = gain * np.minimum(1.0, np.array(limits) / np.maximum(np.linalg.norm(gain, axis=0), 1e-9))
    x, y, z = k[BIAS].dot(error).tolist()
    return _joseph(p, h, k, noise), (x, y, z)


def rested(p: Array, share: float, sigma: float) -> Array:
    """Return the covariance after a gyro bias correction at rest.

    The correction is a ``share`` of the bias measured with noise ``sigma`` (rad/s).
    """
    k = np.zeros((STATES, 3))
    k[BIAS] = share * np.eye(3)
    return _joseph(p, UNITY[BIAS], k, np.full(3, sigma))


def _joseph(p: Array, h: Array, k: Array, sigmas: Array) -> Array:
    left = UNITY - k.dot(h)
    noise = k * sigmas
    return np.asarray(left @ p @ left.T + noise @ noise.T)


def _updated(p: Array, index: int, innovation: float, variance: float) -> Array:
    """Return the errors from a scalar measurement; the covariance is updated in place."""
    k = p[:, index] / (p.item(index, index) + variance)
    p -= k[:, np.newaxis] * p[index]
    return np.asarray(k * innovation)


def _considered(p: Array, index: int, innovation: float, variance: float) -> Array:
    """Return the errors without a correction of the sensor offsets (Schmidt-Kalman).

    A fix that is inconsistent after a velocity reset must not leave a permanent error in the offsets.
    """
    s = p.item(index, index) + variance
    row = p[index].copy()
    k = row / s
    k[CONSIDERED] = 0.0
    p += s * np.outer(k, k) - np.outer(k, row) - np.outer(row, k)
    return np.asarray(k * innovation)


def _impulse_at(state: State, time_us: int) -> Vector:
    """Return the impulse (m/s) at a past time by linear interpolation."""
    later = state.past[-1]
    for moment in reversed(state.past):
        if moment.time_us <= time_us:
            share = min(1.0, (time_us - moment.time_us) / max(1, later.time_us - moment.time_us))
            a, b = moment.impulse, later.impulse
            return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
        later = moment
    return later.impulse


def _applied(state: State, x: Array) -> tuple[State, Errors]:
    un, ue, tx, ty, tz, bx, by, bz, ax, ay, mx, my = x.tolist()
    state = state._replace(offset=(state.offset[0] + un, state.offset[1] + ue))
    return state, Errors((tx, ty, tz), (bx, by, bz), (ax, ay, 0.0), (mx, my, 0.0))


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))
