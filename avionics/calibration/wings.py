"""Wing encoder calibration: zeros, with both wings at rest at a known angle."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.calibration.result import Result, Setting, Took
from avionics.messages import EncoderSample
from avionics.sensing.wing_angle import Gains

AT_REST = 200
"""samples: one second"""
PLAY = 2
"""counts; maximum jitter of a wing at rest"""


class State(NamedTuple):
    """Collected samples."""

    samples: int = 0
    """-; samples"""
    left: tuple[int, int, int] = (0, 0, 0)
    """counts; minimum, maximum, sum"""
    right: tuple[int, int, int] = (0, 0, 0)
    """counts; minimum, maximum, sum"""


def step(state: State, sample: EncoderSample) -> tuple[State, Took]:
    """Add a sample at rest; a motion of a wing ends the calibration."""
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
    """Return the completed fraction, 0 to 1."""
    return state.samples / AT_REST


def finish(state: State, gains: Gains, angle: float) -> tuple[Result, str]:
    """Return the zeros of the wings at rest at ``angle`` (rad, positive up).

    The error text is always empty.
    """
    counts = angle * gains.counts_per_turn * gains.gear_ratio / math.tau
    left = state.left[2] / state.samples - gains.sign_left * counts
    right = state.right[2] / state.samples - gains.sign_right * counts
    play = max(state.left[1] - state.left[0], state.right[1] - state.right[0])
    settings = (Setting("wing_angle", "zero_left", -1, left), Setting("wing_angle", "zero_right", -1, right))
    return Result(settings, float(play), "counts", state.samples), ""
