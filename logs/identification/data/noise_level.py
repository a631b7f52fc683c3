"""How noisy a signal is, without a model of what it tells.

Tintner, The Variate Difference Method, 1940; the variances of the differences as in Anderson, The Statistical
Analysis of Time Series, 1971, chapter 3. The k-th difference of white noise has binomial(2k, k) times its
variance; what is smooth in the signal vanishes as k rises.
"""

from __future__ import annotations

from math import comb, sqrt

import numpy as np

from logs.identification.data.smoothed import whole
from logs.identification.results import Array

HIGHEST = 8
"""-; order of differences"""
THIRD = 3
"""-; order of the difference in which only noise and steps are left of a motion"""
MEDIAN_TO_DEVIATION = 1.4826
"""-; standard deviation of a normal variable over its median size"""
SETTLED = 2.0
"""-; standard deviations by which a higher difference lowers the estimate, at the most, once all signal is gone"""


def noise_level(values: Array) -> float:
    """Standard deviation of the white noise in equally spaced ``values`` (N,), in their unit.

    Noise that is correlated from sample to sample counts only by what of it differs between neighbours.

    Raises:
        InputError: too few samples, or some are missing.
    """
    whole(values, 2 * HIGHEST)
    before = _variance(values, 1)
    for order in range(1, HIGHEST):
        after = _variance(values, order + 1)
        if before - after <= SETTLED * before * sqrt(_spread_of_change(order) / (len(values) - order)):
            return sqrt(before)
        before = after
    return sqrt(before)


def noise_beside_steps(values: Array) -> float:
    """The same where ``values`` (N,) may step, as a control does, or be NaN: by the median of the third difference.

    What is smooth is gone from it; a step is in four of them and moves the median by little. It takes nearly three
    times the samples to be as exact. 0 where no four neighbours were measured.
    """
    return noise_of_differences(third_differences(values))


def third_differences(values: Array) -> Array:
    """Of neighbours in ``values`` (N,) or (N, k): (N - 3, ...), none where there are fewer than four."""
    return np.asarray(np.diff(values, THIRD, axis=0))


def noise_of_differences(differences: Array) -> float:
    """Standard deviation of the white noise whose `third_differences` (N,) these are, NaN left out."""
    known = np.abs(differences[np.isfinite(differences)])
    return MEDIAN_TO_DEVIATION * float(np.median(known)) / sqrt(_growth(THIRD)) if len(known) else 0.0


def _growth(order: int) -> int:
    """Variance of the difference of white noise with variance 1."""
    return comb(2 * order, order)


def _variance(values: Array, order: int) -> float:
    return float(np.mean(np.diff(values, order) ** 2)) / _growth(order)


def _spread_of_change(order: int) -> float:
    """N times the variance of the change from one order to the next, for white noise of variance 1."""
    here, there = _growth(order), _growth(order + 1)
    return 2 * (
        comb(4 * order, 2 * order) / here**2
        - 2 * comb(4 * order + 2, 2 * order + 1) / (here * there)
        + comb(4 * order + 4, 2 * order + 2) / there**2
    )
