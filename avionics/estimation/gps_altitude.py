"""Offset between GPS altitude and barometer zero, for a loss of the barometer.

The offset is estimated while the barometer is valid.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from avionics.estimation.altitude import Climb
from avionics.limits import low_pass
from avionics.messages import GpsFix

LEARNING_TIME: Final = 20.0
"""s; time constant of the offset: includes the slow error of the receiver, excludes its noise"""
THREE_DIMENSIONAL: Final = 3
"""-; minimum fix type with an altitude"""


class State(NamedTuple):
    """State of the offset estimation."""

    time_us: int = -1
    """us; time of the last processed fix, -1 before the first"""
    offset: float = 0.0
    """m; GPS altitude at the zero of the barometer"""
    span: float = 0.0
    """s; averaging time of the offset so far"""


def learn(state: State, fix: GpsFix, altitude: float) -> State:
    """Update the offset with a fix at the barometric ``altitude`` (m)."""
    if fix.fix_type < THREE_DIMENSIONAL or fix.time_us <= state.time_us:
        return state
    offset = fix.altitude - altitude
    if state.time_us < 0:
        return State(fix.time_us, offset, 0.0)
    dt = min((fix.time_us - state.time_us) * 1e-6, 1.0)
    span = min(state.span + dt, LEARNING_TIME)
    return State(fix.time_us, low_pass(state.offset, offset, span, dt), span)


def climb(state: State, fix: GpsFix) -> tuple[State, Climb | None]:
    """Return the altitude measurement of a fix without a barometer.

    The result is None if the fix is old, has no altitude, or if the offset is unknown.
    """
    if fix.fix_type < THREE_DIMENSIONAL or not 0 <= state.time_us < fix.time_us:
        return state, None
    return state._replace(time_us=fix.time_us), Climb(fix.altitude - state.offset, -fix.v_down)
