"""Detection of a blocked pitot, and the airspeed that replaces it.

The GPS measures the velocity over ground; with a valid pitot the difference is the wind. The pitot counts as blocked
if it deviates for long from the airspeed of ground velocity and stored wind, or indicates a standstill in flight.
That airspeed then replaces it, or without fixes the cruise airspeed. Without fixes a pitot at standstill counts as
blocked only if the wings flap above the flare altitude, because dead reckoning depends on the pitot.
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, hypot, sin
from typing import Annotated, Final, NamedTuple

from avionics.limits import low_pass
from wingbeat.units import Quantity

AGREEMENT: Final = 0.5
"""-; fraction of `Gains.difference` within which a blocked pitot agrees, so that an intermittent blockage does not
recover"""

GUSTS_IN_DIFFERENCE: Final = 2.5
"""-; standard deviations of moderate gusts in `Gains.difference`"""


class Aloft(IntEnum):
    """Distance of the vehicle from the ground."""

    GROUND = 0
    LOW = 1
    """in flight, with a touchdown or a glide possible"""
    HIGH = 2
    """above the flare altitude with flapping wings"""


HIGH: Final = int(Aloft.HIGH)


class Gains(NamedTuple):
    """Thresholds of blockage and recovery of the pitot."""

    standstill: Annotated[float, Quantity("m/s", 0.1, 20.0)]
    """m/s; airspeed of a blocked pitot, if at least twice as much is expected"""
    standstill_time: Annotated[float, Quantity("s", 0.05, 20.0)]
    """s; confirmation time of the standstill"""
    difference: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    """m/s; difference from the expected airspeed that gusts do not cause for this long"""
    difference_time: Annotated[float, Quantity("s", 0.1, 60.0)]
    """s; confirmation time of the difference"""
    recovery_time: Annotated[float, Quantity("s", 0.1, 600.0)]
    """s; duration of agreement after which the pitot is accepted again"""
    wind_time: Annotated[float, Quantity("s", 0.5, 600.0)]
    """s; time constant of the stored wind"""
    cruise: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    """m/s; airspeed used without a fix"""


class State(NamedTuple):
    """State of the check."""

    wind_north: float = 0.0
    """m/s; north wind velocity over ground"""
    wind_east: float = 0.0
    """m/s; east wind velocity over ground"""
    span: float = 0.0
    """s; averaging time of the wind so far"""
    stationary_time: float = 0.0
    """s; duration of a standstill indication in motion"""
    differing_time: float = 0.0
    """s; duration of the difference from the expected airspeed"""
    agreeing: float = 0.0
    """s; duration of agreement of a blocked pitot"""
    blocked: int = 0
    """-; 1 while the pitot is rejected"""


class Motion(NamedTuple):
    """Reference motion for the pitot."""

    v_north: float
    """m/s; north velocity over ground of the last fix"""
    v_east: float
    """m/s; east velocity over ground of the last fix"""
    yaw: float
    """rad; heading of the nose"""


def step(
    gains: Gains, state: State, dt: float, airspeed: float, motion: Motion | None, airborne: int
) -> tuple[State, float]:
    """Check one pitot sample.

    Args:
        gains: thresholds.
        state: result of the last step, ``State()`` at boot.
        dt: s; since the last sample.
        airspeed: m/s; pitot airspeed.
        motion: None without a recent fix: the result is kept, except for a standstill at a high altitude.
        airborne: see `Aloft`; on the ground the check is inactive and a blockage is cleared.

    Returns:
        The state and the airspeed (m/s) for control.
    """
    if not airborne:
        return State(), airspeed
    if motion is None:
        if not state.blocked and airborne == HIGH:
            state = _watched(gains, state, dt, airspeed < gains.standstill, False)
        return state, gains.cruise if state.blocked else airspeed
    known = state.span >= gains.difference_time
    likely = expected(gains, state, motion)
    is_stationary = airspeed < gains.standstill
    away = abs(airspeed - likely)
    if state.blocked:
        state = _recovering(gains, state, dt, agrees=not is_stationary and away <= AGREEMENT * gains.difference)
    else:
        is_stationary = is_stationary and _moving(gains, known, likely, motion)
        differs = known and away > gains.difference
        state = _watched(gains, state, dt, is_stationary, differs)
        if not (is_stationary or differs):
            state = _learned(gains, state, dt, airspeed, motion)
    return state, likely if state.blocked else airspeed


def expected(gains: Gains, state: State, motion: Motion | None) -> float:
    """Return the airspeed (m/s) expected from ground velocity and stored wind.

    The result is the cruise airspeed if one of them is unknown.
    """
    if motion is None or state.span < gains.difference_time:
        return gains.cruise
    return hypot(motion.v_north - state.wind_north, motion.v_east - state.wind_east)


def is_inconsistent(state: State) -> bool:
    """Return whether the pitot is blocked or a blockage is pending."""
    return state.blocked == 1 or state.stationary_time > 0.0 or state.differing_time > 0.0


def variance(gains: Gains) -> float:
    """Return the variance (m^2/s^2) of the airspeed that replaces a blocked pitot.

    The error consists of gusts.
    """
    return (gains.difference / GUSTS_IN_DIFFERENCE) ** 2


def _moving(gains: Gains, known: bool, likely: float, motion: Motion) -> bool:
    """Return whether the vehicle moves through the air.

    Without a known wind the ground speed decides. It is close to zero while hovering in a headwind.
    """
    if known:
        return likely > 2.0 * gains.standstill
    return hypot(motion.v_north, motion.v_east) > gains.standstill


def _watched(gains: Gains, state: State, dt: float, is_stationary: bool, differs: bool) -> State:
    stationary_time = state.stationary_time + dt if is_stationary else 0.0
    apart_time = state.differing_time + dt if differs else 0.0
    blocked = stationary_time >= gains.standstill_time or apart_time >= gains.difference_time
    return State(state.wind_north, state.wind_east, state.span, stationary_time, apart_time, 0.0, int(blocked))


def _recovering(gains: Gains, state: State, dt: float, agrees: bool) -> State:
    agreeing = state.agreeing + dt if agrees else 0.0
    blocked = int(agreeing < gains.recovery_time)
    return state._replace(stationary_time=0.0, differing_time=0.0, agreeing=agreeing, blocked=blocked)


def _learned(gains: Gains, state: State, dt: float, airspeed: float, motion: Motion) -> State:
    """Update the wind from pitot and fix: a mean at first, a low-pass filter later."""
    span = min(state.span + dt, gains.wind_time)
    north = motion.v_north - airspeed * cos(motion.yaw)
    east = motion.v_east - airspeed * sin(motion.yaw)
    if state.span:
        north = low_pass(state.wind_north, north, span, dt)
        east = low_pass(state.wind_east, east, span, dt)
    return State(north, east, span, state.stationary_time, state.differing_time, state.agreeing, state.blocked)
