"""Phase of a wing that follows its commanded stroke: the commanded phase less a lag that the crossings tell slowly.

A stroke that grows or shrinks moves its own middle, so that single crossings come some degrees early or late. Where
a drive follows the command turn by turn (a servo drive does, a motor's crank does not) the commanded phase is the
better clock: each crossing then corrects the lag by a share only. Whether it follows is measured, at each crossing.
"""

from __future__ import annotations

from typing import NamedTuple

FOLLOWS = 0.04
"""-; of a turn, by which period and lag may differ from crossing to crossing while the wing follows"""
SHARE = 0.2
"""-; of a crossing's deviation from the lag that corrects it"""


class State(NamedTuple):
    """What is known of the lag."""

    lag: float = 0.0
    """-; commanded less measured phase, in turns"""
    crossings: int = -1
    """-; in a row that agreed; -1 before the first"""


NOTHING = State()
"""no lag is known"""


def crossed(state: State, lag: float, turns: float) -> State:
    """After a crossing.

    Args:
        state: before it.
        lag: commanded less measured phase at the crossing, in turns.
        turns: commanded over the stroke that it ended, 0 where it ended none.
    """
    deviation = (lag - state.lag + 0.5) % 1.0 - 0.5
    if state.crossings < 0 or abs(turns - 1.0) > FOLLOWS or abs(deviation) > FOLLOWS:
        return State(lag, 0)
    return State(state.lag + SHARE * deviation, state.crossings + 1)


def follows(state: State) -> bool:
    """Whether the wing follows its command."""
    return state.crossings > 0


def phase(state: State, commanded: float, measured: float) -> float:
    """Phase in turns: by the ``commanded`` one (turns) while the wing follows it, else the ``measured`` one."""
    return (commanded - state.lag if follows(state) else measured) % 1.0
