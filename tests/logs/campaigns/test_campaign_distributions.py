"""What is drawn is spread as the distribution says, and stays within its ends."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from logs.campaigns.distributions import Distribution, drawn, read_distribution

MANY = 4000


def draws(table: dict[str, list[float]]) -> np.ndarray:
    one = read_distribution("draw.x", table)
    return np.array([drawn(7, number, "x", one) for number in range(MANY)])


def test_uniform_draws_fill_their_interval_evenly() -> None:
    values = draws({"uniform": [2.0, 6.0]})
    counts, _ = np.histogram(values, 8, (2.0, 6.0))
    assert counts.sum() == MANY
    # Chi-square with 7 degrees of freedom: 99.9 % lie below 24.3.
    assert np.sum((counts - MANY / 8) ** 2 / (MANY / 8)) < 24.3


def test_the_logarithm_of_log_uniform_draws_is_uniform() -> None:
    logarithms = np.log10(draws({"log_uniform": [0.01, 100.0]}))
    assert abs(logarithms.mean()) < 4 * (4 / math.sqrt(12)) / math.sqrt(MANY)
    assert -2 <= logarithms.min() < -1.95 and 1.95 < logarithms.max() <= 2


def test_normal_draws_have_their_mean_and_deviation() -> None:
    values = draws({"normal": [5.0, 0.5]})
    assert abs(values.mean() - 5.0) < 4 * 0.5 / math.sqrt(MANY)
    assert values.std() == pytest.approx(0.5, rel=4 / math.sqrt(2 * MANY))


def test_a_normal_distribution_cut_off_keeps_its_shape_within() -> None:
    values = draws({"normal": [0.0, 1.0], "within": [-0.5, 2.0]})
    bell = NormalDist()
    inside = (bell.cdf(0.5) - bell.cdf(-0.5)) / (bell.cdf(2.0) - bell.cdf(-0.5))
    assert values.min() >= -0.5 and values.max() <= 2.0
    assert np.mean(values < 0.5) == pytest.approx(inside, abs=4 * math.sqrt(0.25 / MANY))


def test_whole_numbers_and_choices_come_as_often_as_each_other() -> None:
    values = draws({"integer": [3, 5]})
    assert sorted(set(values.tolist())) == [3, 4, 5]
    assert max(abs(np.mean(values == n) - 1 / 3) for n in (3, 4, 5)) < 4 * math.sqrt(2 / 9 / MANY)
    one = read_distribution("draw.x", {"choice": ["a", "b"]})
    words = [drawn(7, number, "x", one) for number in range(MANY)]
    assert abs(words.count("a") / MANY - 0.5) < 4 * math.sqrt(0.25 / MANY)


def test_two_keys_are_drawn_without_regard_to_each_other() -> None:
    one = Distribution("uniform", (0.0, 1.0))
    x, y = (np.array([drawn(1, number, key, one) for number in range(MANY)]) for key in ("x", "y"))
    assert abs(np.corrcoef(x, y)[0, 1]) < 4 / math.sqrt(MANY)


@given(st.floats(0.0, 1.0, exclude_max=True), st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_no_share_leaves_the_ends(share: float, low: float, width: float) -> None:
    assert low <= Distribution("uniform", (low, low + width)).at(share) <= low + width
    within = (low - width, low + width)
    assert within[0] <= Distribution("normal", (low, width), within).at(share) <= within[1]
    assert math.isfinite(Distribution("normal", (low, width)).at(share))
