"""What is no mode, though a method found a frequency: a motion that does not decay, and two pairs that turn alike."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.modes.errors import Spread
from logs.identification.modes.mode import FORCED, KINDS, PHUGOID, SHORT_PERIOD, Mode, paired_mode


def found(pairs: list[float], errors: list[float], kinds: tuple[str, ...] = KINDS) -> Mode:
    return paired_mode("free response", kinds, np.array(pairs), Spread(np.diag(np.square(errors)), 100.0))


@pytest.mark.parametrize("damping", [0.005, -0.002, 0.0])
def test_a_motion_that_does_not_decay_is_no_short_period(damping: float) -> None:
    """GIVEN wings that shake the body WHEN a method is sure of their frequency THEN it is not told as the mode."""
    mode = found([29.5, damping], [0.1, 0.01], (SHORT_PERIOD,))
    assert mode.frequency is None
    assert [one.reason for one in mode.unidentified] == [FORCED]


@pytest.mark.parametrize("damping", [0.055, -0.05])
def test_one_that_surely_decays_or_grows_is(damping: float) -> None:
    mode = found([6.28, damping], [0.1, 0.01], (SHORT_PERIOD,))
    assert mode.frequency is not None and mode.damping is not None and mode.damping.value == damping


def test_a_phugoid_may_last() -> None:
    mode = found([3.8, 0.6, 0.2, 0.0], [0.1, 0.1, 0.01, 0.01])
    assert mode.short_period is not None and mode.phugoid is not None


def test_pairs_that_turn_alike_are_parts_of_one_motion() -> None:
    mode = found([0.2, 0.06, 0.24, 0.3], [0.001, 0.01, 0.01, 0.05])
    assert mode.short_period is None and mode.phugoid is None
    assert {one.name for one in mode.unidentified} == {SHORT_PERIOD, PHUGOID}
    assert all("not told apart" in one.reason for one in mode.unidentified)
