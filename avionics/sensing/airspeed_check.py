"""Whether the pitot can be believed, and the airspeed to fly by when it cannot.

The GPS tells the velocity over ground, and while the pitot is good the two tell the wind. A pitot that departs for
long from the airspeed that the ground velocity and the remembered wind make, or says standstill instead, is blocked;
that airspeed then takes its place, without fixes that of the cruise. Without fixes a pitot at standstill is blocked
where wings that beat carry the vehicle: dead reckoning would judge it by itself.
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, hypot, sin
from typing import Annotated, NamedTuple

from avionics.limits import low_pass
from wingbeat.units import Quantity

AGREEMENT = 0.5
"""-; share of `Gains.difference` within which a blocked pitot agrees: what comes and goes is not believed"""

GUSTS_IN_DIFFERENCE = 2.5
"""-; standard deviations of moderate gusts in `Gains.difference`"""


class Aloft(IntEnum):
    """How far the vehicle is from standing on the ground."""

    GROUND = 0
    LOW = 1
    """flying, but it may just have touched down, or glides"""
    HIGH = 2
    """above the flare, on beating wings"""


HIGH = int(Aloft.HIGH)


class Gains(NamedTuple):
    """When the pitot is blocked, and when it is well again."""

    standstill: Annotated[float, Quantity("m/s", 0.1, 20.0)]
    """m/s; less airspeed than this, where twice as much is expected, is that of a blocked pitot"""
    standstill_time: Annotated[float, Quantity("s", 0.05, 20.0)]
    """s; for which it must last"""
    difference: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    """m/s; from the expected airspeed that no gust makes for so long"""
    difference_time: Annotated[float, Quantity("s", 0.1, 60.0)]
    """s; for which it must last"""
    recovery_time: Annotated[float, Quantity("s", 0.1, 600.0)]
    """s; of agreement after which the pitot is believed again"""
    wind_time: Annotated[float, Quantity("s", 0.5, 600.0)]
    """s; time constant of the remembered wind"""
    cruise: Annotated[float, Quantity("m/s", 0.5, 50.0)]
    """m/s; airspeed that is taken without a fix"""


class State(NamedTuple):
    """What the check remembers."""

    wind_north: float = 0.0
    """m/s; of the air over ground"""
    wind_east: float = 0.0
    """m/s"""
    span: float = 0.0
    """s; over which the wind has been learned"""
    stationary_time: float = 0.0
    """s; for which it has stood still in motion"""
    differing_time: float = 0.0
    """s; for which it has differed from the expected airspeed"""
    agreeing: float = 0.0
    """s; for which a blocked pitot has agreed"""
    blocked: int = 0
    """-; 1 while the pitot is not believed"""


class Motion(NamedTuple):
    """What the pitot is compared with."""

    v_north: float
    """m/s; velocity over ground of the last fix"""
    v_east: float
    """m/s"""
    yaw: float
    """rad; of the nose"""


def step(
    gains: Gains, state: State, dt: float, airspeed: float, motion: Motion | None, airborne: int
) -> tuple[State, float]:
    """One sample of the pitot on.

    Args:
        gains: thresholds.
        state: what the last step returned, ``State()`` at boot.
        dt: s; since the last sample.
        airspeed: m/s; of the pitot.
        motion: None without a recent fix: the verdict stays, but for a standstill high in the air.
        airborne: see `Aloft`; on the ground nothing is judged, and a blocked pitot is forgotten.
    Returns:
        the state, and the airspeed (m/s) to fly by.
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
    """Airspeed (m/s) by the ground velocity and the remembered wind, that of the cruise where one is not known."""
    if motion is None or state.span < gains.difference_time:
        return gains.cruise
    return hypot(motion.v_north - state.wind_north, motion.v_east - state.wind_east)


def is_inconsistent(state: State) -> bool:
    """Whether the pitot is about to be called blocked, or is."""
    return state.blocked == 1 or state.stationary_time > 0.0 or state.differing_time > 0.0


def variance(gains: Gains) -> float:
    """Variance (m^2/s^2) of the airspeed that takes a blocked pitot's place: of the gusts that it does not know."""
    return (gains.difference / GUSTS_IN_DIFFERENCE) ** 2


def _moving(gains: Gains, known: bool, likely: float, motion: Motion) -> bool:
    """Whether it flies: what is blown along the ground moves over it alone, what hovers in a headwind does not."""
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
    """The wind that the good pitot and the fix make: a mean at first, a low-pass later."""
    span = min(state.span + dt, gains.wind_time)
    north = motion.v_north - airspeed * cos(motion.yaw)
    east = motion.v_east - airspeed * sin(motion.yaw)
    if state.span:
        north = low_pass(state.wind_north, north, span, dt)
        east = low_pass(state.wind_east, east, span, dt)
    return State(north, east, span, state.stationary_time, state.differing_time, state.agreeing, state.blocked)
