"""Turns of a motor's crank since its last crossings, as the throttle's history tells them.

A motor on a crank follows its throttle as a lag: where the throttle moves, the stroke to come takes another time than
the last one. The frequency that the throttle asks for, behind that lag and integrated, gives turns of a clock that
runs slower and faster with the drive. How many of them one stroke takes is measured from crossing to crossing, so
that a frequency map that is off by a factor does no harm.
"""

from __future__ import annotations

from typing import NamedTuple

LEAST, MOST = 0.5, 2.0
"""turns; asked for over one measured stroke, beyond which the frequency map tells another drive"""
SHARE = 0.5
"""-; of the last stroke in its turns and in their share above the middle, which hardly change between strokes"""
STEADY = 0.02
"""-; of the turns of a stroke, by which the last differs at most from those before while it is so"""


class State(NamedTuple):
    """The clock, and what it told at the last crossings."""

    speed: float = 0.0
    """Hz; asked for, behind the drive's lag"""
    turns: float = 0.0
    """turns; of the clock since it began"""
    crossed: float = 0.0
    """turns; at the last crossing"""
    before: float = 0.0
    """turns; at the one before, in the other direction"""
    stroke: float = 0.0
    """turns; over a full stroke, smoothed; 0 while none is known"""
    anchor: float = 0.0
    """-; phase at the last crossing, in strokes"""
    split: float = -1.0
    """-; share of a stroke above the middle; -1 before it is known"""


NOTHING = State()
"""no stroke is known"""


def step(state: State, frequency: float, lag: float, dt: float) -> State:
    """On by ``dt`` s with a ``frequency`` (Hz) asked for; ``lag`` is the drive's, in s."""
    speed, turns, crossed_at, before, stroke, anchor, split = state
    speed += dt / (lag + dt) * (frequency - speed)
    return State(speed, turns + speed * dt, crossed_at, before, stroke, anchor, split)


def crossed(state: State, ago: float, rising: bool, whole: bool) -> State:
    """After a crossing ``ago`` s before the last step; ``whole``: it ended a stroke that began at a crossing too.

    One that was not whole, because encoders failed or were put right in it, leaves what is known of the drive.
    """
    speed, turns, last, before, known, _, split = state
    at = turns - speed * ago
    stroke = at - before if whole else known
    if not LEAST < stroke < MOST:
        return State(speed, turns, at, last, 0.0, 0.0, split)
    if not whole:
        return State(speed, turns, at, last, known, 0.0 if rising else split, split)
    # Above the middle between a rising crossing and a falling one.
    above = (last - before if rising else at - last) / stroke
    if split < 0.0:
        split = above
    if abs(stroke - known) < STEADY * stroke:
        split += SHARE * (above - split)
        stroke = known + SHARE * (stroke - known)
    return State(speed, turns, at, last, stroke, 0.0 if rising else split, split)


def follows(state: State, frequency: float) -> bool:
    """Whether the clock tells how the stroke goes on; not once no ``frequency`` (Hz) is asked for any more."""
    return state.stroke > 0.0 and frequency > 0.0


def phase(state: State) -> float:
    """Phase in strokes."""
    return state.anchor + (state.turns - state.crossed) / state.stroke


def frequency(state: State) -> float:
    """Frequency of the stroke that runs now, in Hz."""
    return state.speed / state.stroke
