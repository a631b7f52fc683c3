"""Phase of a wing that follows the commanded stroke: command minus a slow lag.

A change of the stroke amplitude moves the stroke middle, so that single crossings are some degrees early or late. If
a drive follows the command in each stroke (a servo drive does, the crank of a motor does not), the commanded phase is
more accurate. Each crossing then corrects the lag by a fraction only. The check of this condition runs at each
crossing.
"""

from __future__ import annotations

from typing import Final, NamedTuple

FOLLOWS: Final = 0.04
"""-; maximum change of period and lag between crossings, in turns, while the wing follows"""
SHARE: Final = 0.2
"""-; fraction of the deviation at a crossing that corrects the lag"""


class State(NamedTuple):
    """State of the lag estimation."""

    lag: float = 0.0
    """-; commanded minus measured phase, in turns"""
    crossings: int = -1
    """-; consecutive crossings that agreed; -1 before the first"""


NOTHING: Final = State()
"""State without a known lag."""


def crossed(state: State, lag: float, turns: float) -> State:
    """Update the lag at a crossing.

    Args:
        state: state before the crossing.
        lag: commanded minus measured phase at the crossing, in turns.
        turns: commanded turns in the stroke that ended, 0 if none ended.
    """
    deviation = (lag - state.lag + 0.5) % 1.0 - 0.5
    if state.crossings < 0 or abs(turns - 1.0) > FOLLOWS or abs(deviation) > FOLLOWS:
        return State(lag, 0)
    return State(state.lag + SHARE * deviation, state.crossings + 1)


def follows(state: State) -> bool:
    """Return whether the wing follows its command."""
    return state.crossings > 0


def phase(state: State, commanded: float, measured: float) -> float:
    """Return the phase (turns).

    The phase is derived from ``commanded`` (turns) while the wing follows it, and equals ``measured`` otherwise.
    """
    return (commanded - state.lag if follows(state) else measured) % 1.0
