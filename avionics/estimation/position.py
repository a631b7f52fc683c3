"""Position, ground velocity and wind from airspeed, attitude and GPS.

The Kalman filter runs at 50 Hz with the state x = (north, east, wind north, wind east) in m and m/s from home.
Between fixes the velocity through the air (airspeed along the heading) and the wind propagate the position. The
position of a fix corrects the position, and its velocity corrects the wind. Without fixes the filter is a dead
reckoning with a growing variance.

The filter tracks the slow error of the receiver and does not average it: the measurement noise contains only the
error that is new in each fix, and the variance of the slow error is added to the published variance. The process
noise of the wind is estimated from the velocity innovations, because a constant value would be wrong by a factor of
ten in either calm air or gusts. At frequencies above V / L the Dryden spectrum is that of a random walk of
2 sigma^2 V / L, with the airspeed V, the scale length L and the variance sigma^2 of the gusts, so that the estimated
value is that of the spectrum at the present airspeed. Airspeed, heading and sideslip errors add to the variance of
the wind; they are common to all fixes and cancel in the ground velocity.

The errors of north and east are modeled as independent: the covariance consists of a block of position and wind for
each axis. The gate and the random walk of the wind are common.
"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import Annotated, Final, NamedTuple

from avionics.estimation.geodesy import to_geodetic, to_local
from avionics.estimation.kalman import Pair, Symmetric2, update_pair
from avionics.limits import low_pass
from avionics.messages import AirData, Altitude, Attitude, GpsFix, Position
from wingbeat.records import constructor
from wingbeat.units import Quantity

Vector4 = tuple[float, float, float, float]
Matrix4 = tuple[Vector4, Vector4, Vector4, Vector4]

LONGEST_STEP: Final = 0.5
"""s; maximum interval of a prediction"""
STEEPEST_COSINE: Final = 0.3
"""-; minimum cosine of the flight path angle, at any climb rate"""
NOTHING: Vector4 = (0.0, 0.0, 0.0, 0.0)
THREE_DIMENSIONAL: Final = 3
"""-; fix type that sets home"""
LONGEST_INTERVAL: Final = 1.0
"""s; maximum interval between fixes with innovations used for the wind estimation"""
START_SPREAD: Final = 4.0
"""-; initial mean square of the velocity innovations, in multiples of the noise variance"""
TWO_DIMENSIONAL: Final = 2
"""-; minimum fix type that is used"""


class Gains(NamedTuple):
    """Noise of model and receiver, and gate of the innovations."""

    air_velocity_noise: Annotated[float, Quantity("m/s^0.5", 0.0, 50.0)] = 0.4
    """m/s times the root of a second; random walk of the position: errors of airspeed and heading, and variation of
    the slow error of the receiver. Default: a slow error of 2.1 m in 60 s varies by 0.4, fitted to
    tests/sitl/test_sitl_consistency.py"""
    wind_walk: Annotated[float, Quantity("m/s^1.5", 0.0, 50.0)] = 0.2
    """m/s in the root of a second; random walk of the wind in calm air, including errors of airspeed and heading; in
    gusts it is estimated from the innovations. Default: calm air, fitted to tests/sitl/test_sitl_consistency.py"""
    wind_start: Annotated[float, Quantity("m/s", 0.0, 50.0)] = 3.0
    """m/s; one sigma of each wind component before the first fix"""
    least_position_noise: Annotated[float, Quantity("m", 0.01, 100.0)] = 0.25
    """m; minimum one sigma of the new error of a fix, each axis. Default: residual of the filter in the receiver
    between fixes, fitted to tests/sitl/test_sitl_consistency.py"""
    gps_velocity_noise: Annotated[float, Quantity("m/s", 0.01, 20.0)] = 0.15
    """m/s; one sigma of the wind measured by a fix: errors of receiver, airspeed and heading. Default: 0.1 m/s of the
    PA6H data sheet, as much of airspeed and heading, fitted to tests/sitl/test_sitl_consistency.py"""
    spread_time: Annotated[float, Quantity("s", 0.1, 600.0)] = 5.0
    """s; averaging time of the squared velocity innovations. Default: 25 fixes at 5 Hz; typical duration of gusts"""
    new_share: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.1
    """-; fraction of the reported accuracy that is new in each fix; the remainder is slow. Default: 0.2 m of 2.1 m;
    the remaining error of the receiver is slow"""
    sideslip: Annotated[float, Quantity("rad", 0.0, 1.0)] = 0.06
    """rad; one sigma of the sideslip in still air: turns and unequal wings. Default: RMS of Robo Raven and Arizona in
    still air, 0.058 and 0.070, see docs/validation/estimation.md"""
    sideslip_time: Annotated[float, Quantity("s", 0.0, 10.0)] = 0.5
    """s; time in which the heading follows a gust from the side. Default: fitted to wind errors in light gusts with a
    `sideslip` of 0.03, see docs/validation/estimation.md"""
    gps_delay: Annotated[float, Quantity("s", 0.0, 2.0)] = 0.15
    """s; time from measurement to arrival of a fix (MTK3339: solution and serial line)"""
    gate: Annotated[float, Quantity("-", 1.0, 100.0)] = 5.0
    """-; innovation gate of each component of a fix, in standard deviations"""
    gate_timeout: Annotated[float, Quantity("s", 0.0, 600.0, formerly="gate_patience")] = 3.0
    """s; duration of rejected fixes after which the receiver is accepted again"""


class State(NamedTuple):
    """State of the filter."""

    time_us: int = -1
    """us; time of the last prediction, -1 before the first"""
    x: Vector4 = (0.0, 0.0, 0.0, 0.0)
    """m, m, m/s, m/s; north, east, wind north, wind east"""
    p: Matrix4 = (NOTHING, NOTHING, NOTHING, NOTHING)
    """SI; covariance of x"""
    home: tuple[float, float] = (0.0, 0.0)
    """rad; latitude and longitude of the first three-dimensional fix"""
    valid: int = 0
    """-; 1 once home is set"""
    refused_since_us: int = -1
    """us; first of the consecutively rejected fixes, -1 if none"""
    fix_us: int = -1
    """us; time of the last processed fix"""
    slow_variance: float = 0.0
    """m^2; variance of the slow error of the receiver, each axis; the position estimate contains this error and
    follows it"""
    innovation: Vector4 = NOTHING
    """m, m/s; innovation of the last fix, accepted or rejected"""
    expected: Vector4 = NOTHING
    """m^2, m^2/s^2; expected variance of the innovation"""
    spread: float = -1.0
    """m^2/s^2; mean square of the velocity innovations, negative before the first"""
    walk: float = 0.0
    """m^2/s^3; random walk of the wind, estimated from the innovations"""
    past: tuple[tuple[float, float], ...] = ()
    """m/s; velocities through the air over the delay of a fix, oldest first"""


class Motion(NamedTuple):
    """Inputs of the prediction."""

    time_us: int
    """us; since boot"""
    airspeed: float
    """m/s; true"""
    yaw: float
    """rad; heading"""
    climb_rate: float
    """m/s; positive up"""
    variance: float = 0.0
    """m^2/s^2; variance of each component of the velocity through the air; part of the wind error, not of the ground
    velocity error"""


def motion(attitude: Attitude, air: AirData, altitude: Altitude) -> Motion:
    """Return the motion from three messages, at the time of the air data."""
    across = air.airspeed * attitude.heading_sigma
    # Mean of both components, because the one along the heading changes with it.
    variance = 0.5 * (air.airspeed_variance + across * across)
    return Motion(air.time_us, air.airspeed, attitude.yaw, altitude.climb_rate, variance)


_new_state: Final = constructor(State)
_new_position: Final = constructor(Position)


def step(gains: Gains, state: State, now: Motion, fix: GpsFix | None = None) -> tuple[State, Position]:
    """Propagate the filter by one interval and update it with a fix, if any.

    Args:
        gains: parameters.
        state: result of the last step, ``State()`` at boot.
        now: motion; no propagation if it is not later than the last one.
        fix: GPS fix; ignored if old, without a position or not finite.
    """
    v_air = _air_velocity(now)
    if state.time_us < 0:
        state = _started(gains, now.time_us)
    dt = min(LONGEST_STEP, (now.time_us - state.time_us) * 1e-6)
    if dt > 0.0:
        x, p = _predicted(gains, state, v_air, dt)
        past = (*state.past, v_air)[-1 - round(gains.gps_delay / dt) :]
        state = _new_state(now.time_us, x, p, *state[3:-1], past)
    if fix is not None and fix.fix_type >= TWO_DIMENSIONAL and fix.time_us > state.fix_us:
        state = _corrected(gains, state, fix)
    return state, _message(gains, state, v_air, now.variance + _sideslip_variance(gains, state, now.airspeed))


def _started(gains: Gains, time_us: int) -> State:
    wind = gains.wind_start**2
    return State(time_us, p=(NOTHING, NOTHING, (0.0, 0.0, wind, 0.0), (0.0, 0.0, 0.0, wind)))


def _air_velocity(now: Motion) -> tuple[float, float]:
    """Return north and east of the horizontal airspeed, without sideslip."""
    speed = now.airspeed
    level = sqrt(max(speed * speed - now.climb_rate * now.climb_rate, (STEEPEST_COSINE * speed) ** 2))
    return level * cos(now.yaw), level * sin(now.yaw)


def _predicted(gains: Gains, state: State, v_air: tuple[float, float], dt: float) -> tuple[Vector4, Matrix4]:
    """Return state and covariance after ``dt`` (s) with the wind and the velocity through the air (m/s)."""
    north, east, wind_north, wind_east = state.x
    noise, p = (gains.air_velocity_noise**2 * dt, _walk(gains, state) * dt), state.p
    north_block = _predicted_block((p[0][0], p[0][2], p[2][2]), dt, noise)
    east_block = _predicted_block((p[1][1], p[1][3], p[3][3]), dt, noise)
    x = (north + dt * (wind_north + v_air[0]), east + dt * (wind_east + v_air[1]), wind_north, wind_east)
    return x, _matrix(north_block, east_block)


def _predicted_block(p: Symmetric2, dt: float, noise: Pair) -> Symmetric2:
    """Return the covariance of position and wind of one axis after ``dt`` (s) with ``noise``, both variances."""
    a, b, c = p
    covariance = b + dt * c
    return a + dt * (b + covariance) + noise[0], covariance, c + noise[1]


def _matrix(north: Symmetric2, east: Symmetric2) -> Matrix4:
    """Return the covariance of the state from those of the axes."""
    (a, b, c), (d, e, f) = north, east
    return (a, 0.0, b, 0.0), (0.0, d, 0.0, e), (b, 0.0, c, 0.0), (0.0, e, 0.0, f)


def _walk(gains: Gains, state: State) -> float:
    """Return the random walk of the wind (m^2/s^3), at least that of calm air."""
    return max(state.walk, gains.wind_walk**2)


def _sideslip_variance(gains: Gains, state: State, airspeed: float) -> float:
    """Return the variance of the velocity across the heading (m^2/s^2), as the mean of both components.

    A vehicle that follows the air with the time constant T has the sideslip velocity of a high-pass filter, which
    passes the variance q T / 2 of a random walk q.
    """
    across = gains.sideslip * airspeed
    return 0.5 * (across * across + 0.5 * _walk(gains, state) * gains.sideslip_time)


def _corrected(gains: Gains, state: State, fix: GpsFix) -> State:
    """Update the state with a fix.

    The position of the fix is `Gains.gps_delay` old and is propagated by its velocity.
    """
    if not isfinite(sum(fix)):
        return state
    slow = 0.5 * fix.horizontal_accuracy**2
    noise = max(slow * gains.new_share**2, gains.least_position_noise**2)
    if not state.valid:
        if fix.fix_type < THREE_DIMENSIONAL:
            return state
        state = _at_home(state, fix, noise)
    interval = (fix.time_us - state.fix_us) * 1e-6
    state = state._replace(fix_us=fix.time_us, slow_variance=slow)
    v_air = state.past[0] if state.past else (fix.v_north, fix.v_east)
    north, east = to_local(state.home, fix.latitude, fix.longitude)
    measured = (
        north + fix.v_north * gains.gps_delay,
        east + fix.v_east * gains.gps_delay,
        fix.v_north - v_air[0],
        fix.v_east - v_air[1],
    )
    velocity = gains.gps_velocity_noise**2
    return _updated(gains, state, interval, measured, (noise, velocity))


def _at_home(state: State, fix: GpsFix, variance: float) -> State:
    """Set home to the position of the first fix.

    The dead-reckoned position before it is discarded and the wind is kept.
    """
    _, _, wind_north, wind_east = state.x
    p = _matrix((variance, 0.0, state.p[2][2]), (variance, 0.0, state.p[3][3]))
    return state._replace(x=(0.0, 0.0, wind_north, wind_east), p=p, home=(fix.latitude, fix.longitude), valid=1)


def _updated(gains: Gains, state: State, interval: float, measured: Vector4, noise: Pair) -> State:
    """Update the state if the innovation passes the gate.

    After the gate timeout the measurement is accepted with an inflated covariance. ``noise`` contains the variances
    of position (m^2) and velocity (m^2/s^2), each axis.
    """
    (x0, x1, x2, x3), (z0, z1, z2, z3), p, (position, velocity) = state.x, measured, state.p, noise
    a, b, c, d = p[0][0], p[1][1], p[2][2], p[3][3]
    off = (z0 - x0, z1 - x1, z2 - x2, z3 - x3)
    expected = (a + position, b + position, c + velocity, d + velocity)
    state = _watched(gains, state._replace(innovation=off, expected=expected), interval, velocity)
    squares, gate = (off[0] * off[0], off[1] * off[1], off[2] * off[2], off[3] * off[3]), gains.gate**2
    if not all(square <= gate * variance for square, variance in zip(squares, expected, strict=True)):
        if state.refused_since_us < 0:
            return state._replace(refused_since_us=state.fix_us)
        if (state.fix_us - state.refused_since_us) * 1e-6 < gains.gate_timeout:
            return state
        a, b, c, d = a + squares[0], b + squares[1], c + squares[2], d + squares[3]
    (x0, x2), north = update_pair((x0, x2), (a, p[0][2], c), (z0, z2), noise)
    (x1, x3), east = update_pair((x1, x3), (b, p[1][3], d), (z1, z3), noise)
    return state._replace(x=(x0, x1, x2, x3), p=_matrix(north, east), refused_since_us=-1)


def _watched(gains: Gains, state: State, interval: float, noise: float) -> State:
    """Update the mean square of the velocity innovations and the wind random walk.

    A scalar filter in steady state has the variance P before and P R / S after a measurement, with S = P + R. Between
    measurements the random walk adds their difference, (S - R)^2 / S. An innovation is limited to the gate: a single
    wrong fix has little effect on the wind, while a sustained gust widens the gate.
    """
    if interval > LONGEST_INTERVAL:
        return state
    _, _, north, east = state.innovation
    limit = gains.gate**2
    square = 0.5 * (min(north * north, limit * state.expected[2]) + min(east * east, limit * state.expected[3]))
    spread = low_pass(
        state.spread if state.spread >= 0.0 else START_SPREAD * noise, square, gains.spread_time, interval
    )
    above = max(spread - noise, 0.0)
    return state._replace(spread=spread, walk=above * above / (spread * interval))


def _message(gains: Gains, state: State, v_air: tuple[float, float], air_variance: float) -> Position:
    north, east, wind_north, wind_east = state.x
    latitude, longitude = to_geodetic(state.home, north, east) if state.valid else (0.0, 0.0)
    p, expected = state.p, state.expected
    # A fix is delayed; the random walk of the wind since then adds variance.
    velocity = max(p[2][2], p[3][3]) + _walk(gains, state) * gains.gps_delay
    return _new_position(
        state.time_us, north, east, v_air[0] + wind_north, v_air[1] + wind_east, wind_north, wind_east,
        latitude, longitude, max(p[0][0], p[1][1]) + state.slow_variance, state.valid,
        velocity, velocity + air_variance, *state.innovation,
        max(expected[0], expected[1]), max(expected[2], expected[3]),
    )  # fmt: skip
