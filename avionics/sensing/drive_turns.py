"""Crank revolutions since the last crossings, from the throttle history.

A motor with a crank follows its throttle with a first-order lag. If the throttle changes, the duration of the next
stroke differs from that of the last one. The commanded frequency after that lag is integrated to revolutions, as a
clock that follows the drive. The revolutions in one stroke are measured between crossings, so that a scale error of
the frequency map has no effect.
"""

from __future__ import annotations

from typing import Final, NamedTuple

LEAST, MOST = 0.5, 2.0
"""turns; limits of the commanded revolutions in one measured stroke; outside them the frequency map does not fit the
drive"""
SHARE: Final = 0.5
"""-; weight of the last stroke in the means of its revolutions and of its fraction above the middle, which vary
slowly"""
STEADY: Final = 0.02
"""-; maximum relative change of the revolutions between strokes in steady flapping"""


class State(NamedTuple):
    """Integrated drive speed and its values at the last crossings."""

    speed: float = 0.0
    """Hz; commanded frequency after the lag of the drive"""
    turns: float = 0.0
    """turns; integrated revolutions since the start"""
    crossed: float = 0.0
    """turns; revolutions at the last crossing"""
    before: float = 0.0
    """turns; revolutions at the previous crossing, in the other direction"""
    stroke: float = 0.0
    """turns; low-passed revolutions per full stroke, 0 if unknown"""
    anchor: float = 0.0
    """-; phase at the last crossing, in strokes"""
    split: float = -1.0
    """-; fraction of a stroke above the middle, -1 if unknown"""


NOTHING: Final = State()
"""State without a known stroke."""


def step(state: State, frequency: float, lag: float, dt: float) -> State:
    """Advance by ``dt`` (s) with a commanded ``frequency`` (Hz).

    ``lag`` (s) is the time constant of the drive.
    """
    speed, turns, crossed_at, before, stroke, anchor, split = state
    speed += dt / (lag + dt) * (frequency - speed)
    return State(speed, turns + speed * dt, crossed_at, before, stroke, anchor, split)


def crossed(state: State, ago: float, rising: bool, whole: bool) -> State:
    """Update the state with a crossing ``ago`` (s) before the last step.

    ``whole`` is True if the stroke also began at a crossing. Otherwise, after an encoder failure or correction, the
    estimates of the drive are kept.
    """
    speed, turns, last, before, known, _, split = state
    at = turns - speed * ago
    stroke = at - before if whole else known
    if not LEAST < stroke < MOST:
        return State(speed, turns, at, last, 0.0, 0.0, split)
    if not whole:
        return State(speed, turns, at, last, known, 0.0 if rising else split, split)
    # Between a rising and a falling crossing the wing is above the middle.
    above = (last - before if rising else at - last) / stroke
    if split < 0.0:
        split = above
    if abs(stroke - known) < STEADY * stroke:
        split += SHARE * (above - split)
        stroke = known + SHARE * (stroke - known)
    return State(speed, turns, at, last, stroke, 0.0 if rising else split, split)


def follows(state: State, frequency: float) -> bool:
    """Return whether the clock predicts the stroke, which needs a commanded frequency."""
    return state.stroke > 0.0 and frequency > 0.0


def phase(state: State) -> float:
    """Return the phase in strokes."""
    return state.anchor + (state.turns - state.crossed) / state.stroke


def frequency(state: State) -> float:
    """Return the frequency (Hz) of the present stroke."""
    return state.speed / state.stroke
