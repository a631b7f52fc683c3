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
A launch makes the heading observable, and the tilt about the right axis of the body, which turns the launch
acceleration out of the horizontal. It raises the variance of the offset along body x if it contradicts a calibrated
accelerometer.

Unlike the airspeed, the ground velocity is valid in gusts, sideslip and during the launch. Flapping requires no
averaging, because the force between two fixes is integrated sample by sample.

The covariance is also propagated without fixes, as the uncertainty of the attitude. Scalar updates in plain NumPy are
used, because a general update would cost more than the rest of a tick.
"""

from __future__ import annotations

from math import atan2, cos, hypot, isfinite, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.messages import GpsFix
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.rotations import Matrix, Vector, norm

Array = NDArray[np.float64]

VELOCITY, DOWN, ROTATION, TILT, HEADING, BIAS = slice(0, 3), 2, slice(3, 6), slice(3, 5), 5, slice(6, 9)
ACCEL, LEVEL_ACCEL, FORWARD_ACCEL, IRON = slice(9, 12), slice(9, 11), 9, slice(12, 14)
ALL_BUT_OFFSETS, ONLY_DOWN = slice(0, 9), slice(2, 3)
STATES: Final = 14
"""u north, east and down in m/s; theta about north, east and down in rad; db about the body axes in rad/s; da along
the body axes in m/s^2; dm along body x and y in gauss"""
UNITY: Final[Array] = np.eye(STATES)
POSITION_FIX: Final = 2
"""minimum `GpsFix.fix_type` of a velocity that is used"""
SPACE_FIX: Final = 3
"""minimum `GpsFix.fix_type` of a climb rate that is used"""
HISTORY_STEP_US: Final = 20_000
"""us; interval of the impulse history for delayed fixes"""
CONFIRMATIONS: Final = 3
"""-; number of fixes that must agree with a new velocity before they replace the block averages"""
CONFIRMATION_GATE: Final = 3.0
"""-; innovation gate of those fixes in standard deviations"""
START_TILT, START_HEADING, START_BIAS = 0.05, 0.15, 0.01
"""rad, rad, rad/s; standard deviations after the first sample"""
START_ACCEL, START_IRON = 0.1, 0.01
"""m/s^2, gauss; standard deviations of accelerometer offset and hard iron, each axis. Chosen: root
sum of squares of 5 mg after calibration, 0.3 degrees of mounting and 7 mg of temperature drift; of 5 mgauss after
calibration and the field of 3.5 A of drive current (0.4 uT/A), each axis"""
UNCALIBRATED_ACCEL: Final = 0.6
"""m/s^2; standard deviation of the accelerometer offset after a launch has shown more than the calibration leaves"""
CLIMB_TEST, LAUNCH_FIXES = 0.35, 4
"""m/s, -; mean innovation of the climb rate over the fixes after a launch, after which the offset along body x is
such: over twice the greatest of calibrated sensors"""
GRAVITY_NOISE: Final = 0.05
"""m/s^2; standard deviation of the magnitude of the specific force at rest, from the accelerometer's scale"""
ACCEL_WALK, IRON_WALK = 0.002, 0.0001
"""m/s^2.5, gauss/s^0.5; random walk of both"""
LAUNCH_SPEED: Final = 3.0
"""m/s; ground speed that separates rest and flight: after a launch from rest the course indicates the heading"""
SPEED_AGREEMENT: Final = 0.25
"""-; maximum relative difference between the propagated speed and the speed of a fix if only the heading is wrong"""
TURN_AGREEMENT: Final = 0.2
"""rad; maximum difference between the heading errors of two successive fixes"""
TILT_IRON: Final = 0.03
"""gauss; standard deviation of a hard iron estimated with a tilt error of `UNCALIBRATED_ACCEL`, each axis"""
SET_IRON: Final = 0.005
"""gauss; standard deviation of a hard iron set from a mean field, each axis"""
LEAST_HORIZONTAL: Final = 0.05
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
    offset: Vector = ZERO
    """m/s; difference between ground velocity and the integral of specific force and gravity, earth axes"""
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
    launch_fixes: int = 0
    """-; fixes since the launch, at most `LAUNCH_FIXES`"""
    climb: float = 0.0
    """m/s; sum of their innovations of the climb rate"""


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


NOTHING: Final = Errors(ZERO, ZERO, ZERO, ZERO)


def start(time_us: int, r: Matrix) -> State:
    """Return the state before the first fix.

    The matrix ``r`` was leveled by the accelerometer, so that its offset is correlated with the tilt.
    """
    variances = [
        1.0, 1.0, 1.0, *2 * [START_TILT**2], START_HEADING**2, *3 * [START_BIAS**2], *3 * [START_ACCEL**2],
        *2 * [START_IRON**2],
    ]  # fmt: skip
    j = UNITY.copy()
    j[TILT, LEVEL_ACCEL] = _tilt_of_offset(r)
    p = (j * variances).dot(j.T)
    return State(tuple(p.ravel().tolist()), time_us)


def _tilt_of_offset(r: Matrix) -> Array:
    """Return the tilt per accelerometer offset after leveling at rest.

    The matrix (2, 2) relates the tilt about north and east (rad) to offsets along body x and y (m/s^2).
    """
    (nx, ny, _), (ex, ey, _) = r[0:3], r[3:6]
    return np.array(((ex, ey), (-nx, -ny))) / STANDARD_GRAVITY


def gravity_updated(state: State, force: Vector) -> tuple[State, Errors]:
    """Update the state with the mean specific force (m/s^2, body axes) of a standstill.

    At rest its magnitude is that of gravity, so that the difference is the accelerometer offset along the vertical.
    """
    p = np.array(state.covariance).reshape(STATES, STATES)
    size = norm(force)
    h = np.zeros(STATES)
    h[ACCEL] = np.array(force) / size
    ph = p.dot(h)
    k = ph / (float(h.dot(ph)) + GRAVITY_NOISE**2)
    p -= np.outer(k, ph)
    state, errors = _applied(state, k * (size - STANDARD_GRAVITY))
    return state._replace(covariance=tuple(p.ravel().tolist())), errors


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
    dx, dy, dz = x - x0, y - y0, z - z0
    f[VELOCITY, ROTATION] = ((0.0, dz, -dy), (-dz, 0.0, dx), (dy, -dx, 0.0))
    f[ROTATION, BIAS] = f[VELOCITY, ACCEL] = np.subtract(state.attitude, attitude).reshape(3, 3)
    p = f.dot(p).dot(f.T)
    rotation, bias = noise.gyro_walk**2 * dt, noise.bias_walk**2 * dt
    accel, iron = ACCEL_WALK**2 * dt, IRON_WALK**2 * dt
    p.reshape(-1)[:: STATES + 1] += (
        0.0, 0.0, 0.0, rotation, rotation, rotation, bias, bias, bias, accel, accel, accel, iron, iron
    )  # fmt: skip
    return np.asarray(p)


def kept(state: State, p: Array, time_us: int, impulse: Vector, attitude: Matrix) -> State:
    """Return the state with the covariance ``p`` at ``time_us`` (us)."""
    flat = tuple((0.5 * (p + p.T)).ravel().tolist())
    tilt, heading = sqrt(0.5 * (p.item(3, 3) + p.item(4, 4))), sqrt(p.item(HEADING, HEADING))
    return state._replace(
        covariance=flat, time_us=time_us, impulse=impulse, attitude=attitude, tilt_sigma=tilt, heading_sigma=heading
    )


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
    measured_us = fix.time_us - round(noise.gps_delay * 1e6)
    impulse, variance = _impulse_at(state, measured_us), noise.gps_noise**2
    fall = STANDARD_GRAVITY * measured_us * 1e-6
    velocity = (fix.v_north - impulse[0], fix.v_east - impulse[1], fix.v_down - impulse[2] - fall)
    speed = hypot(fix.v_north, fix.v_east)
    if state.accepted_us < 0 or (fix.time_us - state.accepted_us) * 1e-6 > noise.gps_timeout:
        p[VELOCITY, :] = p[:, VELOCITY] = 0.0
        p[0, 0] = p[1, 1] = variance
        p[DOWN, DOWN] = variance
        return state._replace(offset=velocity, accepted_us=fix.time_us, agreed=0, speed=speed), NOTHING
    north, east, down = (a - b for a, b in zip(velocity, state.offset, strict=True))
    confirmed = state.agreed >= CONFIRMATIONS
    gate = (noise.gps_gate if confirmed else min(noise.gps_gate, CONFIRMATION_GATE)) ** 2
    if north**2 > gate * (p.item(0, 0) + variance) or east**2 > gate * (p.item(1, 1) + variance):
        return _turned(state, p, noise, fix, impulse, down)
    update = _updated if confirmed else _considered
    x = update(p, 0, north, variance)
    x += update(p, 1, east - float(x[1]), variance)
    _rotate_tilt(p, x.item(HEADING))
    state, climb = _climbed(state, p, down - float(x[DOWN]), variance, speed, fix.fix_type)
    return _applied(
        state._replace(accepted_us=fix.time_us, agreed=state.agreed + 1, turn=0.0, speed=speed), x + climb
    )


def _climbed(
    state: State, p: Array, innovation: float, variance: float, speed: float, fix_type: int
) -> tuple[State, Array]:
    """Return the state and the errors from the climb rate of a fix; the covariance is updated in place.

    A tilt of the launch acceleration changes the climb rate. If the mean innovation of the first fixes after a launch
    exceeds what a calibration leaves, the offset along body x is estimated from it. Other fixes only follow the
    velocity (Schmidt-Kalman), because flapping and the offset along body z disturb the climb rate more than a small
    tilt does.
    """
    if fix_type < SPACE_FIX:
        return state, np.zeros(STATES)
    if speed < LAUNCH_SPEED or state.launch_fixes >= LAUNCH_FIXES:
        fixes = 0 if speed < LAUNCH_SPEED else state.launch_fixes
        state = state._replace(launch_fixes=fixes, climb=0.0)
        return state, _considered(p, DOWN, innovation, variance, ONLY_DOWN)
    state = state._replace(launch_fixes=state.launch_fixes + 1, climb=state.climb + innovation)
    if state.launch_fixes < LAUNCH_FIXES:
        return state, np.zeros(STATES)
    return state, _launched(state, p, variance)


def _launched(state: State, p: Array, variance: float) -> Array:
    """Return the errors from the mean innovation of the climb rate since a launch."""
    fixes, x = max(state.launch_fixes, 1), np.zeros(STATES)
    mean = state.climb / fixes
    if abs(mean) >= CLIMB_TEST:
        _uncalibrated(p, FORWARD_ACCEL)
        x = _updated(p, DOWN, mean, variance / fixes)
    return x


def _uncalibrated(p: Array, index: int) -> None:
    """Raise the variance of one accelerometer offset in place to that without a calibration.

    The other errors are raised by their regression on it, as if the variance had been larger from the start. The hard
    iron estimated so far contains the vertical field that the tilt turned into the horizontal plane.
    """
    more = UNCALIBRATED_ACCEL**2 - p.item(index, index)
    if more > 0.0:
        along = p[index] / p.item(index, index)
        p += more * np.outer(along, along)
        p[IRON, :] = p[:, IRON] = 0.0
        p[IRON, IRON] = np.eye(2) * TILT_IRON**2


def _turned(state: State, p: Array, noise: Noise, fix: GpsFix, impulse: Vector, down: float) -> tuple[State, Errors]:
    """Rotate the heading to the course of a launch after a second consistent fix.

    A heading error rotates the velocity gained since rest; a change of course in flight does not.
    """
    north, east = state.offset[0] + impulse[0], state.offset[1] + impulse[1]
    carried_speed, speed = hypot(north, east), hypot(fix.v_north, fix.v_east)
    no_launch = state.speed > LAUNCH_SPEED or min(carried_speed, speed) < LAUNCH_SPEED
    if no_launch or abs(carried_speed - speed) > SPEED_AGREEMENT * speed:
        return state._replace(turn=0.0), NOTHING
    turn = _wrapped(atan2(fix.v_east, fix.v_north) - atan2(east, north))
    if state.launch_fixes < LAUNCH_FIXES and fix.fix_type >= SPACE_FIX:
        state = state._replace(launch_fixes=state.launch_fixes + 1, climb=state.climb + down)
    if state.turn == 0.0 or abs(_wrapped(turn - state.turn)) > TURN_AGREEMENT:
        return state._replace(turn=turn), NOTHING
    _rotate_tilt(p, turn)
    state, tilted = _applied(state, _launched(state, p, noise.gps_noise**2))
    for part in (VELOCITY, slice(HEADING, HEADING + 1), IRON):
        p[part, :] = p[:, part] = 0.0
    p[0, 0] = p[1, 1] = p[DOWN, DOWN] = noise.gps_noise**2
    p[HEADING, HEADING] = 2.0 * (noise.gps_noise / speed) ** 2
    state = state._replace(accepted_us=-1, agreed=0, past=(), turn=0.0, launch_fixes=LAUNCH_FIXES)
    return state, Errors((*tilted.turn[:2], turn), tilted.bias, tilted.accel, ZERO, True)


def _rotate_tilt(p: Array, turn: float) -> None:
    """Rotate the tilt in the covariance in place by a correction ``turn`` (rad) of the heading.

    The tilt of an accelerometer offset turns with the body axes (reset of an error-state filter, Sola 2017, 6.3).
    """
    c, s = cos(turn), sin(turn)
    rotation = np.array(((c, -s), (s, c)))
    p[TILT] = rotation.dot(p[TILT])
    p[:, TILT] = p[:, TILT].dot(rotation.T)


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
    h[0:2, LEVEL_ACCEL] = -_tilt_of_offset(r)
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


def _considered(
    p: Array, index: int, innovation: float, variance: float, corrected: slice = ALL_BUT_OFFSETS
) -> Array:
    """Return the errors with a correction of those ``corrected`` alone (Schmidt-Kalman).

    A fix that is inconsistent after a velocity reset must not leave a permanent error in the offsets.
    """
    s, row = p.item(index, index) + variance, p[index].copy()
    k = np.zeros(STATES)
    k[corrected] = row[corrected] / s
    p -= k[:, np.newaxis] * row
    p -= (row - s * k)[:, np.newaxis] * k
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
    un, ue, ud, tx, ty, tz, bx, by, bz, ax, ay, az, mx, my = x.tolist()
    north, east, down = state.offset
    state = state._replace(offset=(north + un, east + ue, down + ud))
    return state, Errors((tx, ty, tz), (bx, by, bz), (ax, ay, az), (mx, my, 0.0))


def _wrapped(angle: float) -> float:
    return atan2(sin(angle), cos(angle))
