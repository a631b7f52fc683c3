"""Altitude and climb rate from pressure altitude and vertical acceleration: a Kalman filter at 50 Hz.

State x = (altitude in m, climb rate in m/s, bias of the vertical acceleration in m/s^2). Between two barometer
samples the acceleration is averaged, so that nothing of the flapping is aliased; the velocity that flapping gives
the fuselage (about 1 m/s either way) is real, and is taken out of the message by a mean over the wing's period.
"""

from __future__ import annotations

from functools import lru_cache
from math import exp
from typing import Annotated, NamedTuple

import numpy as np

from avionics.estimation.kalman import Array, constant, filterpy
from avionics.messages import AirData, Altitude
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.records import constructor
from wingbeat.units import Quantity

LONGEST_STEP = 0.5
"""s; between updates"""
LONGEST_MEMORY = 1.3
"""s; of climb rates kept for the mean over a wing period"""

Vector3 = tuple[float, float, float]


UNKNOWN_ACCELERATION = STANDARD_GRAVITY
"""m/s^2; one sigma of the acceleration in an interval of which nothing tells it: between falling and being carried"""


class Gains(NamedTuple):
    """Noise of the sensors and the gate."""

    baro_noise: Annotated[float, Quantity("m", 0.01, 50.0)] = 0.25
    """m; one sigma of a pressure altitude. Default: 3 Pa of the barometer and the flow past its port"""
    accel_noise: Annotated[float, Quantity("m/s^2", 0.001, 50.0)] = 0.8
    """m/s^2; one sigma of the averaged vertical acceleration, errors of the attitude included. Default: gusts and
    what the attitude is off in them, fitted to tests/sitl/test_sitl_consistency.py"""
    bias_walk: Annotated[float, Quantity("m/s^2.5", 0.0, 10.0)] = 0.03
    """m/s^2 in the root of a second; random walk of the acceleration's bias"""
    gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovations beyond this many sigma are refused"""
    gate_timeout: Annotated[float, Quantity("s", 0.0, 60.0, formerly="gate_patience")] = 1.0
    """s; of refused innovations after which the barometer is believed again"""
    gps_altitude_noise: Annotated[float, Quantity("m", 0.1, 100.0)] = 2.0
    """m; one sigma of a receiver's altitude over a minute from where it was known, without a barometer"""
    gps_climb_noise: Annotated[float, Quantity("m/s", 0.01, 20.0)] = 0.3
    """m/s; one sigma of a receiver's Doppler climb rate, without a barometer"""
    baro_drift: Annotated[float, Quantity("m", 0.0, 100.0)] = 0.42
    """m; one sigma of the barometer's drift once it has settled: weather and warming. Default: 5 Pa, weather and
    warming"""
    baro_drift_time: Annotated[float, Quantity("s", 1.0, 1e5)] = 300.0
    """s; time constant of the drift. Default: weather and warming"""


class Climb(NamedTuple):
    """What a fix tells of the altitude."""

    altitude: float
    """m; above the filter's zero"""
    climb_rate: float
    """m/s; positive up"""


class State(NamedTuple):
    """What the filter remembers."""

    time_us: int = -1
    """us; of the last update, -1 before the first"""
    x: Vector3 = (0.0, 0.0, 0.0)
    """altitude, climb rate, acceleration bias"""
    p: tuple[Vector3, Vector3, Vector3] = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    """covariance of x"""
    accel_sum: float = 0.0
    """m/s^2; sum of the upward accelerations since the last update"""
    accel_count: int = 0
    """-; of them"""
    refused: float = 0.0
    """s; since an innovation was last accepted"""
    innovation: float = 0.0
    """m; last one"""
    climbs: tuple[float, ...] = ()
    """m/s; climb rates of the last updates, newest last"""
    innovation_variance: float = 0.0
    """m^2; expected of the last innovation"""
    since_us: int = 0
    """us; of the first pressure altitude"""


_new_state = constructor(State)


def accumulate(state: State, accel_down: float) -> State:
    """Take in one `Attitude.accel_down` (m/s^2, positive down); call at the rate of the AHRS.

    An interval in which nothing was taken in has no acceleration known: the filter then follows the barometer alone.
    """
    time_us, x, p, total, count, refused, innovation, climbs, expected, since = state
    summed = (time_us, x, p, total - accel_down, count + 1, refused, innovation, climbs, expected, since)
    return _new_state(*summed)


def step(gains: Gains, state: State, air: AirData, frequency: float = 0.0) -> tuple[State, Altitude]:
    """One pressure altitude on.

    Args:
        gains: tuning.
        state: with the accelerations since the last step in it, see `accumulate`.
        air: pressure altitude; the filter starts at the first one.
        frequency: Hz; of the wings, 0 when they rest.
    """
    if state.time_us < 0:
        started = State(air.time_us, (air.pressure_altitude, 0.0, 0.0), _start_covariance(gains), climbs=(0.0,))
        started = started._replace(since_us=air.time_us)
        return started, _message(gains, started, 0.0)
    dt = min(LONGEST_STEP, (air.time_us - state.time_us) * 1e-6)
    if dt <= 0.0:
        return state, _message(gains, state, state.x[1])
    x, p = _predicted(gains, state, dt)
    innovation = air.pressure_altitude - x.item(0)
    variance = p.item(0) + gains.baro_noise**2
    refused = state.refused + dt if innovation**2 > gains.gate**2 * variance else 0.0
    if refused > gains.gate_timeout:
        # Believed again: then it is the altitude that must be doubted.
        p[0, 0] += innovation**2
        refused = 0.0
    if refused == 0.0:
        x, p = filterpy().update(x, p, np.array((air.pressure_altitude,)), _measured(gains.baro_noise), H=_PRESSURE)
    state = _kept(state, air.time_us, dt, (x, p), (refused, innovation, variance))
    return state, _message(gains, state, _mean_over_period(state.climbs, frequency, dt))


def coast(
    gains: Gains, state: State, time_us: int, fix: Climb | None, frequency: float = 0.0
) -> tuple[State, Altitude]:
    """One interval on without a barometer: by the accelerations, and by a fix where a new one has come.

    Args:
        gains: tuning.
        state: started, with the accelerations since the last step in it, see `accumulate`.
        time_us: us; of the tick.
        fix: None where there is no new one.
        frequency: Hz; of the wings, 0 when they rest.
    """
    dt = min(LONGEST_STEP, (time_us - state.time_us) * 1e-6)
    if state.time_us < 0 or dt <= 0.0:
        return state, _message(gains, state, state.x[1])
    x, p = _predicted(gains, state, dt)
    if fix is not None:
        noise = np.diag([gains.gps_altitude_noise**2, gains.gps_climb_noise**2])
        x, p = filterpy().update(x, p, np.array(fix), noise, H=_FIX)
    state = _kept(state, time_us, dt, (x, p), (0.0, 0.0, 0.0))
    return state, _message(gains, state, _mean_over_period(state.climbs, frequency, dt))


def _predicted(gains: Gains, state: State, dt: float) -> tuple[Array, Array]:
    accel = state.accel_sum / state.accel_count if state.accel_count else state.x[2]
    transition, effect = _motion(dt)
    noise = _noise(gains.bias_walk, dt, gains.accel_noise if state.accel_count else UNKNOWN_ACCELERATION)
    x, p = filterpy().predict(np.array(state.x), np.array(state.p), F=transition, Q=noise, u=accel, B=effect)
    return x, p


def _kept(
    state: State, time_us: int, dt: float, estimate: tuple[Array, Array], measurements: tuple[float, float, float]
) -> State:
    """The state with an estimate and the pressure's time without an accepted sample (s), innovation, variance."""
    altitude, climb_rate, bias = estimate[0].tolist()
    (refused, innovation, expected), keep = measurements, round(LONGEST_MEMORY / dt)
    return _new_state(
        time_us, (altitude, climb_rate, bias), _symmetric(estimate[1]), 0.0, 0, refused, innovation,
        (*state.climbs[-keep:], climb_rate), expected, state.since_us,
    )  # fmt: skip


def _symmetric(p: Array) -> tuple[Vector3, Vector3, Vector3]:
    """The symmetric part."""
    (a, b, c), (d, e, f), (g, h, i) = p.tolist()
    b, c, f = 0.5 * (b + d), 0.5 * (c + g), 0.5 * (f + h)
    return (a, b, c), (b, e, f), (c, f, i)


_FIX = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_PRESSURE = np.array([[1.0, 0.0, 0.0]])


@lru_cache(maxsize=32)
def _motion(dt: float) -> tuple[Array, Array]:
    """How the state moves by itself, and with the acceleration."""
    transition = constant([[1.0, dt, -0.5 * dt * dt], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    return transition, constant([0.5 * dt * dt, dt, 0.0])


@lru_cache(maxsize=32)
def _noise(bias_walk: float, dt: float, is_degraded: float) -> Array:
    """Covariance of one step: an acceleration (m/s^2, one sigma) constant over it, and the walk of its bias."""
    way, variance = 0.5 * dt * dt, is_degraded**2
    tied = way * dt * variance
    return constant([
        [way * way * variance, tied, 0.0],
        [tied, dt * dt * variance, 0.0],
        [0.0, 0.0, bias_walk**2 * dt],
    ])  # fmt: skip


@lru_cache(maxsize=32)
def _measured(sigma: float) -> Array:
    """Covariance of one number."""
    return constant([[sigma**2]])


def _start_covariance(gains: Gains) -> tuple[Vector3, Vector3, Vector3]:
    """At the first pressure altitude: its own noise, standing still within 0.3 m/s, bias within 0.3 m/s^2."""
    return ((gains.baro_noise**2, 0.0, 0.0), (0.0, 0.09, 0.0), (0.0, 0.0, 0.09))


def _mean_over_period(climbs: tuple[float, ...], frequency: float, dt: float) -> float:
    """Mean over the last wing period by the trapezoid rule, the oldest interval cut to length."""
    intervals = 1.0 / (frequency * dt) if frequency > 0.0 else 0.0
    whole = int(intervals)
    if whole < 1 or whole + 2 > len(climbs):
        return climbs[-1]
    recent = climbs[-whole - 1 :]
    total = sum(recent) - 0.5 * (recent[0] + recent[-1])
    share = intervals - whole
    cut = recent[0] + share * (climbs[-whole - 2] - recent[0])
    return (total + 0.5 * share * (recent[0] + cut)) / intervals


def _message(gains: Gains, state: State, climb_rate: float) -> Altitude:
    time_us, (altitude, _, bias), p = state[:3]
    # A first-order process that was nothing when the barometer's zero was taken.
    span = (time_us - state.since_us) * 1e-6
    drift = gains.baro_drift**2 * (1.0 - exp(-2.0 * span / gains.baro_drift_time))
    return Altitude(
        time_us, altitude, climb_rate, bias, p[0][0] + drift, p[1][1], state.innovation, state.innovation_variance
    )  # fmt: skip
