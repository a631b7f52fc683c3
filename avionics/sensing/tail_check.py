"""Whether the tail answers: a vehicle without its tail swings through its pitch for longer than any gust lasts.

Jammed near its trim a tail leaves a slow swing that grows, so the mean of the error is small and that of its size is
not. Nothing is asked of the model of the vehicle.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.limits import low_pass
from avionics.quantities import Quantity


class Gains(NamedTuple):
    """When the tail is jammed."""

    error: Annotated[float, Quantity("rad", 0.01, 3.2)]
    """rad; mean size of the pitch error that a working tail does not leave"""
    time: Annotated[float, Quantity("s", 0.1, 60.0)]
    """s; time constant of the mean"""
    grace: Annotated[float, Quantity("s", 0.0, 60.0)]
    """s; after the launch, in which nothing is judged"""


class State(NamedTuple):
    """What the check remembers."""

    error: float = 0.0
    """rad; mean size"""
    closed: float = 0.0
    """s; for which the pitch loop has flown"""
    jammed: int = 0
    """-; 1 once the tail is jammed; kept until the next arming"""


def step(gains: Gains, state: State, dt: float, pitch_error: float, closed: bool) -> State:
    """One look; ``pitch_error`` in rad, ``dt`` in s, ``closed`` while the pitch loop flies."""
    if not closed:
        return State(0.0, 0.0, state.jammed)
    time = state.closed + dt
    error = low_pass(state.error, abs(pitch_error), gains.time, dt) if time > gains.grace else 0.0
    return State(error, time, 1 if state.jammed or error > gains.error else 0)
