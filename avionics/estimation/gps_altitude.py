"""The GPS altitude against the barometer's zero: learned while the barometer is good, used when it is lost."""

from __future__ import annotations

from typing import NamedTuple

from avionics.estimation.altitude import Climb
from avionics.limits import low_pass
from avionics.messages import GpsFix

LEARNING_TIME = 20.0
"""s; time constant of the offset: the receiver's slow error is followed, its noise is not"""
THREE_DIMENSIONAL = 3
"""-; least fix type with an altitude"""


class State(NamedTuple):
    """What is remembered of the fixes."""

    time_us: int = -1
    """us; of the last fix that was looked at, -1 before the first"""
    offset: float = 0.0
    """m; GPS altitude of the barometer's zero"""
    span: float = 0.0
    """s; over which it has been learned"""


def learn(state: State, fix: GpsFix, altitude: float) -> State:
    """A fix came while the barometer tells the ``altitude`` (m)."""
    if fix.fix_type < THREE_DIMENSIONAL or fix.time_us <= state.time_us:
        return state
    offset = fix.altitude - altitude
    if state.time_us < 0:
        return State(fix.time_us, offset, 0.0)
    dt = min((fix.time_us - state.time_us) * 1e-6, 1.0)
    span = min(state.span + dt, LEARNING_TIME)
    return State(fix.time_us, low_pass(state.offset, offset, span, dt), span)


def climb(state: State, fix: GpsFix) -> tuple[State, Climb | None]:
    """What a fix tells without a barometer; None for one seen before, without an altitude, or of unknown offset."""
    if fix.fix_type < THREE_DIMENSIONAL or not 0 <= state.time_us < fix.time_us:
        return state, None
    return state._replace(time_us=fix.time_us), Climb(fix.altitude - state.offset, -fix.v_down)
