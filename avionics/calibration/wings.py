"""The zeros of the wing encoders, with both wings at rest at a known angle."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.calibration.result import Result, Setting, Took
from avionics.messages import EncoderSample
from avionics.sensing.wing_angle import Gains

AT_REST = 200
"""samples: one second"""
PLAY = 2
"""counts; that a wing at rest may tremble"""


class State(NamedTuple):
    """What was gathered."""

    samples: int = 0
    """-; samples"""
    left: tuple[int, int, int] = (0, 0, 0)
    """counts; least, greatest, sum"""
    right: tuple[int, int, int] = (0, 0, 0)
    """counts; least, greatest, sum"""


def step(state: State, sample: EncoderSample) -> tuple[State, Took]:
    """One sample at rest; a wing that moves ends it."""
    left = _add(state.left, sample.left_counts, state.samples)
    right = _add(state.right, sample.right_counts, state.samples)
    state = State(state.samples + 1, left, right)
    if max(left[1] - left[0], right[1] - right[0]) > PLAY:
        return state, Took(cancelled="wing moved")
    return state, Took(complete=state.samples >= AT_REST)


def _add(raw_counts: tuple[int, int, int], counts: int, number: int) -> tuple[int, int, int]:
    if number == 0:
        return counts, counts, counts
    return min(raw_counts[0], counts), max(raw_counts[1], counts), raw_counts[2] + counts


def progress(state: State) -> float:
    """Share that has been gathered, 0 to 1."""
    return state.samples / AT_REST


def finish(state: State, gains: Gains, angle: float) -> tuple[Result, str]:
    """Counts at the wings' zero, when they rest at ``angle`` (rad, up is positive) now; never refused."""
    counts = angle * gains.counts_per_turn * gains.gear_ratio / math.tau
    left = state.left[2] / state.samples - gains.sign_left * counts
    right = state.right[2] / state.samples - gains.sign_right * counts
    play = max(state.left[1] - state.left[0], state.right[1] - state.right[0])
    settings = (Setting("wing_angle", "zero_left", -1, left), Setting("wing_angle", "zero_right", -1, right))
    return Result(settings, float(play), "counts", state.samples), ""
