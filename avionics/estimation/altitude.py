"""Altitude and climb rate from pressure altitude and vertical acceleration.

The Kalman filter runs at 50 Hz with the state x = (altitude in m, climb rate in m/s, bias of the vertical
acceleration in m/s^2). The acceleration is averaged between two barometer samples, so that the flapping is not
aliased. The vertical velocity of the fuselage due to flapping (amplitude about 1 m/s) is real; a mean over the wing
period removes it from the message.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp
from typing import Annotated, Final, NamedTuple

import numpy as np

from avionics.estimation.kalman import Rows3, Vector3, filterpy, update_first
from avionics.messages import AirData, Altitude
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.records import constructor
from wingbeat.units import Quantity

LONGEST_STEP: Final = 0.5
"""s; maximum interval between updates"""
LONGEST_MEMORY: Final = 1.3
"""s; duration of climb rates stored for the mean over a wing period"""

UNKNOWN_ACCELERATION: Final = STANDARD_GRAVITY
"""m/s^2; one sigma of an unmeasured acceleration in an interval: between free fall and rest"""


class Gains(NamedTuple):
    """Noise of the sensors and gate of the innovations."""

    baro_noise: Annotated[float, Quantity("m", 0.01, 50.0)] = 0.25
    """m; one sigma of a pressure altitude. Default: 3 Pa of the barometer and the flow at its port"""
    accel_noise: Annotated[float, Quantity("m/s^2", 0.001, 50.0)] = 0.8
    """m/s^2; one sigma of the averaged vertical acceleration, including attitude errors. Default: gusts and the
    attitude errors in them, fitted to tests/sitl/test_sitl_consistency.py"""
    bias_walk: Annotated[float, Quantity("m/s^2.5", 0.0, 10.0)] = 0.03
    """m/s^2 in the root of a second; random walk of the acceleration bias"""
    gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovation gate in standard deviations"""
    gate_timeout: Annotated[float, Quantity("s", 0.0, 60.0, formerly="gate_patience")] = 1.0
    """s; duration of rejected innovations after which the barometer is accepted again"""
    gps_altitude_noise: Annotated[float, Quantity("m", 0.1, 100.0)] = 2.0
    """m; one sigma of the GPS altitude relative to its reference over a minute, without a barometer"""
    gps_climb_noise: Annotated[float, Quantity("m/s", 0.01, 20.0)] = 0.3
    """m/s; one sigma of the Doppler climb rate of the GPS, without a barometer"""
    baro_drift: Annotated[float, Quantity("m", 0.0, 100.0)] = 0.42
    """m; one sigma of the barometer drift in steady state: weather and temperature. Default: 5 Pa, weather and
    temperature"""
    baro_drift_time: Annotated[float, Quantity("s", 1.0, 1e5)] = 300.0
    """s; time constant of the drift. Default: weather and temperature"""


class Climb(NamedTuple):
    """Altitude measurement of a GPS fix."""

    altitude: float
    """m; above the zero of the filter"""
    climb_rate: float
    """m/s; positive up"""


class State(NamedTuple):
    """State of the filter."""

    time_us: int = -1
    """us; time of the last update, -1 before the first"""
    x: Vector3 = (0.0, 0.0, 0.0)
    """m, m/s, m/s^2; altitude, climb rate, acceleration bias"""
    p: tuple[Vector3, Vector3, Vector3] = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    """SI; covariance of x"""
    accel_sum: float = 0.0
    """m/s^2; sum of the upward accelerations since the last update"""
    accel_count: int = 0
    """-; number of accelerations in the sum"""
    refused: float = 0.0
    """s; time since an innovation was last accepted"""
    innovation: float = 0.0
    """m; last innovation"""
    climbs: tuple[float, ...] = ()
    """m/s; climb rates of the last updates, newest last"""
    innovation_variance: float = 0.0
    """m^2; expected variance of the last innovation"""
    since_us: int = 0
    """us; time of the first pressure altitude"""


_new_state: Final = constructor(State)


def accumulate(state: State, accel_down: float) -> State:
    """Accumulate one `Attitude.accel_down` (m/s^2, positive down) at the AHRS rate.

    In an interval without samples the acceleration is unknown: the filter then follows the barometer alone.
    """
    time_us, x, p, total, count, refused, innovation, climbs, expected, since = state
    summed = (time_us, x, p, total - accel_down, count + 1, refused, innovation, climbs, expected, since)
    return _new_state(*summed)


def step(gains: Gains, state: State, air: AirData, frequency: float = 0.0) -> tuple[State, Altitude]:
    """Update the filter with one pressure altitude.

    Args:
        gains: parameters.
        state: state with the accelerations since the last step, see `accumulate`.
        air: pressure altitude; the filter starts at the first one.
        frequency: Hz; flapping frequency, 0 with the wings at rest.
    """
    if state.time_us < 0:
        started = State(air.time_us, (air.pressure_altitude, 0.0, 0.0), _start_covariance(gains), climbs=(0.0,))
        started = started._replace(since_us=air.time_us)
        return started, _message(gains, started, 0.0)
    dt = min(LONGEST_STEP, (air.time_us - state.time_us) * 1e-6)
    if dt <= 0.0:
        return state, _message(gains, state, state.x[1])
    x, p = _predicted(gains, state, dt)
    innovation = air.pressure_altitude - x[0]
    variance = p[0][0] + gains.baro_noise**2
    refused = state.refused + dt if innovation**2 > gains.gate**2 * variance else 0.0
    if refused > gains.gate_timeout:
        # Gate timeout: inflate the variance of the altitude.
        (a, b, c), *others = p
        p = ((a + innovation**2, b, c), *others)
        refused = 0.0
    if refused == 0.0:
        x, p = update_first(x, p, air.pressure_altitude, gains.baro_noise**2)
    state = _kept(state, air.time_us, dt, (x, p), (refused, innovation, variance))
    return state, _message(gains, state, _mean_over_period(state.climbs, frequency, dt))


def coast(
    gains: Gains, state: State, time_us: int, fix: Climb | None, frequency: float = 0.0
) -> tuple[State, Altitude]:
    """Propagate the filter without a barometer; a new GPS fix corrects it.

    Args:
        gains: parameters.
        state: started state with the accelerations since the last step, see `accumulate`.
        time_us: us; time of the tick.
        fix: altitude of a new fix, None if there is none.
        frequency: Hz; flapping frequency, 0 with the wings at rest.
    """
    dt = min(LONGEST_STEP, (time_us - state.time_us) * 1e-6)
    if state.time_us < 0 or dt <= 0.0:
        return state, _message(gains, state, state.x[1])
    estimate = _predicted(gains, state, dt)
    if fix is not None:
        noise = np.diag([gains.gps_altitude_noise**2, gains.gps_climb_noise**2])
        x, p = filterpy().update(np.array(estimate[0]), np.array(estimate[1]), np.array(fix), noise, H=_FIX)
        estimate = x.tolist(), p.tolist()
    state = _kept(state, time_us, dt, estimate, (0.0, 0.0, 0.0))
    return state, _message(gains, state, _mean_over_period(state.climbs, frequency, dt))


def _predicted(gains: Gains, state: State, dt: float) -> tuple[Vector3, Rows3]:
    """Return state and covariance after ``dt`` (s) with the mean acceleration since the last update.

    The acceleration error is constant over the step; its bias is a random walk.
    """
    (altitude, climb_rate, bias), (row, (_, d, e), (_, _, f)) = state.x, state.p
    a, b, c = row
    accel = state.accel_sum / state.accel_count if state.accel_count else bias
    sigma = gains.accel_noise if state.accel_count else UNKNOWN_ACCELERATION
    half = 0.5 * dt * dt
    # F P F' with F = (1, dt, -half; 0, 1, -dt; 0, 0, 1), then G G' sigma^2 with G = (half, dt, 0), then the bias.
    a, b, c = a + dt * b - half * c, b + dt * d - half * e, c + dt * e - half * f
    d, e = d - dt * e, e - dt * f
    a, b, d = a + dt * b - half * c, b - dt * c, d - dt * e
    altitude_noise, climb_noise = half * sigma, dt * sigma
    a, b = a + altitude_noise * altitude_noise, b + altitude_noise * climb_noise
    d, f = d + climb_noise * climb_noise, f + gains.bias_walk**2 * dt
    true_accel = accel - bias
    x = altitude + dt * climb_rate + half * true_accel, climb_rate + dt * true_accel, bias
    return x, ((a, b, c), (b, d, e), (c, e, f))


def _kept(
    state: State,
    time_us: int,
    dt: float,
    estimate: tuple[Sequence[float], Rows3],
    measurements: tuple[float, float, float],
) -> State:
    """Return the state with the estimate, rejection time (s), innovation and variance."""
    altitude, climb_rate, bias = estimate[0]
    (refused, innovation, expected), keep = measurements, round(LONGEST_MEMORY / dt)
    return _new_state(
        time_us, (altitude, climb_rate, bias), _symmetric(estimate[1]), 0.0, 0, refused, innovation,
        (*state.climbs[-keep:], climb_rate), expected, state.since_us,
    )  # fmt: skip


def _symmetric(p: Rows3) -> tuple[Vector3, Vector3, Vector3]:
    """Return the symmetric part of ``p``."""
    (a, b, c), (d, e, f), (g, h, i) = p
    b, c, f = 0.5 * (b + d), 0.5 * (c + g), 0.5 * (f + h)
    return (a, b, c), (b, e, f), (c, f, i)


_FIX: Final = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _start_covariance(gains: Gains) -> tuple[Vector3, Vector3, Vector3]:
    """Return the initial covariance.

    The standard deviations are the altitude noise, 0.3 m/s, and 0.3 m/s^2 for the bias.
    """
    return ((gains.baro_noise**2, 0.0, 0.0), (0.0, 0.09, 0.0), (0.0, 0.0, 0.09))


def _mean_over_period(climbs: tuple[float, ...], frequency: float, dt: float) -> float:
    """Return the mean over the last wing period by the trapezoidal rule.

    The oldest interval is truncated to the period.
    """
    intervals = 1.0 / (frequency * dt) if frequency > 0.0 else 0.0
    whole = int(intervals)
    if whole < 1 or whole + 2 > len(climbs):
        return climbs[-1]
    recent = climbs[-whole - 1 :]
    total = sum(recent) - 0.5 * (recent[0] + recent[-1])
    share = intervals - whole
    cut = recent[0] + share * (climbs[-whole - 2] - recent[0])
    return (total + 0.5 * share * (recent[0] + cut)) / intervals


_new_altitude: Final = constructor(Altitude)


def _message(gains: Gains, state: State, climb_rate: float) -> Altitude:
    time_us, (altitude, _, bias), p = state[:3]
    # First-order Gauss-Markov process, zero when the barometer was zeroed.
    span = (time_us - state.since_us) * 1e-6
    drift = gains.baro_drift**2 * (1.0 - exp(-2.0 * span / gains.baro_drift_time))
    return _new_altitude(
        time_us, altitude, climb_rate, bias, p[0][0] + drift, p[1][1], state.innovation, state.innovation_variance
    )  # fmt: skip
