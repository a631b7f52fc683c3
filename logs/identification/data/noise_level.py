"""Noise level of a signal without a model of it.

Tintner, The Variate Difference Method, 1940; the variances of the differences as in Anderson, The Statistical
Analysis of Time Series, 1971, chapter 3. The k-th difference of white noise has binomial(2k, k) times its
variance; the smooth part of the signal vanishes as k increases.
"""

from __future__ import annotations

from math import comb, sqrt

import numpy as np

from logs.identification.data.smoothing import whole
from logs.identification.results import Array

HIGHEST = 8
"""-; order of differences"""
THIRD = 3
"""-; order of the difference that has only noise and steps of a motion"""
MEDIAN_TO_DEVIATION = 1.4826
"""-; standard deviation of a normal variable over its median size"""
SETTLED = 2.0
"""-; standard deviations: decrease of the estimate by the next order, below which the order is sufficient"""


def noise_level(values: Array) -> float:
    """Standard deviation of the white noise in equally spaced ``values`` (N,), in their unit.

    Of correlated noise only the part that differs between adjacent samples counts.

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


def noise_with_steps(values: Array) -> float:
    """The same for ``values`` (N,) with steps, as of a control, or NaN: by the median of the third difference.

    A step is in four of them, which changes the median little. It needs nearly three times the samples for the same
    accuracy. 0 if no four adjacent samples were measured.
    """
    return noise_of_differences(third_differences(values))


def third_differences(values: Array) -> Array:
    """Of ``values`` (N,) or (N, k): (N - 3, ...), none if there are fewer than four."""
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
