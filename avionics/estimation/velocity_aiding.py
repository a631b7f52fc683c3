"""What the ground velocity of a GPS tells of the attitude: a Kalman filter of the errors of `ahrs`.

The specific force, turned into earth axes and freed of gravity, carries the velocity on from fix to fix. A tilt or
heading that is wrong turns the force the wrong way, so what the next fix disagrees about is the attitude's error:

    du/dt = theta x f,    dtheta/dt = -R db

with u the error of the carried velocity, theta the small rotation about earth axes that makes the attitude true, f
the specific force in earth axes and db the error of the gyro bias in body axes: inertial navigation's error equations
in local axes (Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., 14.2)
without the rotation of the earth. Unlike the airspeed, the ground velocity is right in gusts, sideslip and at the
launch, and no flapping has to be averaged away: the force between two fixes is known sample by sample.

The covariance serves without fixes as well: it tells how far the attitude may be off. It is updated one measurement
at a time in plain NumPy: a general update would cost more than all the rest of a tick.
"""

from __future__ import annotations

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.estimation.direction_cosines import Matrix, Vector
from avionics.messages import GpsFix
from avionics.records import new

Array = NDArray[np.float64]

VELOCITY, ROTATION, HEADING, BIAS = slice(0, 2), slice(2, 5), 4, slice(5, 8)
STATES = 8
"""u north and east in m/s, theta about north, east and down in rad, db about the body axes in rad/s"""
UNITY: Array = np.eye(STATES)
POSITION_FIX = 2
"""`GpsFix.fix_type` from which its velocity is used"""
HISTORY_STEP_US = 20_000
"""us; between the moments whose impulse is kept for a fix that arrives late"""
CONFIRMATIONS = 3
"""-; fixes that must agree with a newly set velocity before the filter is left to them alone"""
START_TILT, START_HEADING, START_BIAS = 0.05, 0.15, 0.01
"""rad, rad, rad/s; standard deviations after the first sample"""
ZERO: Vector = (0.0, 0.0, 0.0)


class Noise(NamedTuple):
    """What the errors are believed to be; the fields of the same name of `ahrs.AhrsGains`."""

    gyro_walk: float
    """rad/s^0.5; of the attitude"""
    bias_walk: float
    """rad/s^1.5; of the gyro bias"""
    gps_noise: float
    """m/s; of a fix's velocity, each axis"""
    gps_gate: float
    """-; standard deviations beyond which a fix is refused"""
    gps_patience: float
    """s; without an accepted fix the velocity is taken anew"""
    gps_delay: float
    """s; age of a fix when it arrives"""


class Moment(NamedTuple):
    """The integral of the specific force at one moment."""

    time_us: int
    """us; since boot"""
    impulse: Vector
    """m/s; since boot, earth axes"""


class State(NamedTuple):
    """What is remembered."""

    covariance: tuple[float, ...]
    """SI; of the 8 errors, row by row"""
    time_us: int
    """us; to which the covariance has been carried"""
    impulse: Vector = ZERO
    """m/s; integral of the specific force to that moment, earth axes"""
    past: tuple[Moment, ...] = ()
    """the last moments, oldest first; none before the first fix"""
    offset: tuple[float, float] = (0.0, 0.0)
    """m/s; north and east, of the velocity over ground over the impulse"""
    accepted_us: int = -1
    """us; when the last fix was accepted, -1 before the first"""
    agreed: int = 0
    """-; fixes accepted in a row since the velocity was set"""
    tilt_sigma: float = START_TILT
    """rad; one sigma of the tilt about a horizontal axis"""
    heading_sigma: float = START_HEADING
    """rad; one sigma of the heading"""


class Errors(NamedTuple):
    """What the attitude is to be corrected by."""

    turn: Vector
    """rad; rotation about earth axes"""
    bias: Vector
    """rad/s; to be added to the gyro bias, body axes"""


NOTHING = Errors(ZERO, ZERO)


def start(time_us: int) -> State:
    """Before the first fix."""
    variances = [1.0, 1.0, *2 * [START_TILT**2], START_HEADING**2, *3 * [START_BIAS**2]]
    return State(tuple(np.diag(variances).ravel().tolist()), time_us)


def remember(state: State, gps_delay: float, time_us: int, impulse: Vector) -> State:
    """Keep the impulse (m/s, earth axes) at this moment, to be asked for when a fix of now arrives."""
    kept = 2 + round(gps_delay * 1e6 / HISTORY_STEP_US)
    covariance, carried_us, begun, past, offset, accepted_us, agreed, tilt_sigma, heading_sigma = state
    past = (*past, new(Moment, (time_us, impulse)))[-kept:]
    return new(State, (covariance, carried_us, begun, past, offset, accepted_us, agreed, tilt_sigma, heading_sigma))


def carried(state: State, noise: Noise, time_us: int, impulse: Vector, r: Matrix) -> Array:
    """The covariance carried to ``time_us`` (us), where the specific force has the integral ``impulse`` (m/s)."""
    p = np.array(state.covariance).reshape(STATES, STATES)
    dt = (time_us - state.time_us) * 1e-6
    (x, y, z), (x0, y0, z0) = impulse, state.impulse
    f = UNITY.copy()
    f[0, 3], f[0, 4], f[1, 2], f[1, 4] = z - z0, -(y - y0), -(z - z0), x - x0
    f[ROTATION, BIAS] = np.array(r).reshape(3, 3) * -dt
    p = f.dot(p).dot(f.T)
    attitude, bias = noise.gyro_walk**2 * dt, noise.bias_walk**2 * dt
    p.reshape(-1)[:: STATES + 1] += (0.0, 0.0, attitude, attitude, attitude, bias, bias, bias)
    return np.asarray(p)


def kept(state: State, p: Array, time_us: int, impulse: Vector) -> State:
    """The state with the covariance ``p`` of ``time_us`` (us)."""
    flat = tuple((0.5 * (p + p.T)).ravel().tolist())
    tilt, heading = sqrt(0.5 * (flat[18] + flat[27])), sqrt(flat[36])
    _, _, _, past, offset, accepted_us, agreed, _, _ = state
    return State(flat, time_us, impulse, past, offset, accepted_us, agreed, tilt, heading)


def fixed(state: State, p: Array, noise: Noise, fix: GpsFix) -> tuple[State, Errors]:
    """A fix taken in; ``p``, carried to its arrival, is updated in place.

    A fix that is not finite, without a position, or beyond the gate corrects nothing; after ``gps_patience`` without
    an accepted one the next sets the velocity anew.
    """
    if not isfinite(fix.v_north + fix.v_east) or fix.fix_type < POSITION_FIX:
        return state, NOTHING
    impulse = _impulse_at(state, fix.time_us - round(noise.gps_delay * 1e6))
    velocity, variance = (fix.v_north - impulse[0], fix.v_east - impulse[1]), noise.gps_noise**2
    if state.accepted_us < 0 or (fix.time_us - state.accepted_us) * 1e-6 > noise.gps_patience:
        p[VELOCITY, :] = p[:, VELOCITY] = 0.0
        p[0, 0] = p[1, 1] = variance
        return state._replace(offset=velocity, accepted_us=fix.time_us, agreed=0), NOTHING
    north, east = velocity[0] - state.offset[0], velocity[1] - state.offset[1]
    gate = noise.gps_gate**2
    if north**2 > gate * (p.item(0, 0) + variance) or east**2 > gate * (p.item(1, 1) + variance):
        return state, NOTHING
    x = _updated(p, 0, north, variance)
    x += _updated(p, 1, east - float(x[1]), variance)
    return _applied(state._replace(accepted_us=fix.time_us, agreed=state.agreed + 1), x)


def agreeing(state: State, gps_patience: float, time_us: int) -> bool:
    """Whether fixes tell the tilt: the velocity was set and has been confirmed, the last time not long ago."""
    return state.agreed >= CONFIRMATIONS and (time_us - state.accepted_us) * 1e-6 < gps_patience


def headed(state: State, p: Array, heading_error: float, sigma: float) -> tuple[State, Errors]:
    """A compass taken in, ``p`` updated in place.

    ``heading_error`` in rad is the turn about down that it asks for, ``sigma`` in rad its noise.
    """
    return _applied(state, _updated(p, HEADING, heading_error, sigma**2))


def relaxed(p: Array, r: Matrix, shares: Vector, bias_rates: Vector, sigmas: Vector) -> Array:
    """The covariance after corrections by other gains than the optimum (Joseph's form).

    Args:
        p: covariance before.
        r: r_ned_from_frd.
        shares: of the measured rotation about north, east and down that were taken off.
        bias_rates: 1/s; of the same that were taken off the gyro bias.
        sigmas: rad; noise of the three measurements.
    """
    k = np.zeros((STATES, 3))
    k[ROTATION] = np.diag(shares)
    k[BIAS] = np.array(r).reshape(3, 3).T * np.negative(bias_rates)
    return _joseph(p, ROTATION, k, np.array(sigmas))


def rested(p: Array, share: float, sigma: float) -> Array:
    """The covariance after a ``share`` of the bias seen at rest was taken over, seen with noise ``sigma`` (rad/s)."""
    k = np.zeros((STATES, 3))
    k[BIAS] = share * np.eye(3)
    return _joseph(p, BIAS, k, np.full(3, sigma))


def _joseph(p: Array, measured: slice, k: Array, sigmas: Array) -> Array:
    left = UNITY.copy()
    left[:, measured] -= k
    noise = k * sigmas
    return np.asarray(left @ p @ left.T + noise @ noise.T)


def _updated(p: Array, index: int, innovation: float, variance: float) -> Array:
    """Errors from a measurement of one of them; the covariance is updated in place."""
    k = p[:, index] / (p.item(index, index) + variance)
    p -= k[:, np.newaxis] * p[index]
    return np.asarray(k * innovation)


def _impulse_at(state: State, time_us: int) -> Vector:
    """m/s; at a moment of the past, on a straight line between the two moments next to it."""
    later = state.past[-1]
    for moment in reversed(state.past):
        if moment.time_us <= time_us:
            share = min(1.0, (time_us - moment.time_us) / max(1, later.time_us - moment.time_us))
            a, b = moment.impulse, later.impulse
            return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
        later = moment
    return later.impulse


def _applied(state: State, x: Array) -> tuple[State, Errors]:
    un, ue, tx, ty, tz, bx, by, bz = x.tolist()
    return state._replace(offset=(state.offset[0] + un, state.offset[1] + ue)), Errors((tx, ty, tz), (bx, by, bz))
