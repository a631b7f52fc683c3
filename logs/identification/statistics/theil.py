"""Theil's inequality coefficient of a model's prediction of a manoeuvre that it was not fitted to, and its parts.

U = rms(z - y) / (rms(z) + rms(y)): 0 is perfect, 1 no prediction at all; below 0.25 to 0.3 is good for flight data
(Jategaonkar, Flight Vehicle System Identification, 2006, ch. 11; Theil, Economic Forecasts and Policy, 1961). The
mean square error is the sum of three parts, whose shares say what is wrong: *bias* (the means differ: an intercept, a
trim), *variance* (the model moves too much or too little: a gain, a damping), *covariance* (the rest: noise, timing).
Of a good model nearly all is covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

GOOD = 0.3
"""-; coefficient below which a prediction of flight data is called good"""


class Theil(NamedTuple):
    """Prediction of one output of a held-out manoeuvre."""

    coefficient: float
    """-; U, in [0, 1]"""
    bias: float
    """-; share of the mean square error"""
    variance: float
    """-; share of the mean square error"""
    covariance: float
    """-; share of the mean square error"""
    samples: int
    """-; that both have"""
    failure: str = ""
    """-; why there are no numbers, empty when there are"""


def theil(measured: Array, predicted: Array) -> Theil:
    """`Theil` of ``predicted`` (N,) against ``measured`` (N,), NaN where either is missing.

    The coefficient depends on where zero is: take quantities whose zero means something, or deviations from trim.
    """
    there = np.isfinite(measured) & np.isfinite(predicted)
    z, y, count = measured[there], predicted[there], int(there.sum())
    if count < 2:
        return Theil(np.nan, np.nan, np.nan, np.nan, count, f"{count} samples have both")
    error, size = float(np.mean((z - y) ** 2)), float(np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    if size <= 0:
        return Theil(np.nan, np.nan, np.nan, np.nan, count, "both are zero throughout")
    if error <= 0:
        return Theil(0.0, 0.0, 0.0, 0.0, count)
    bias, variance = (z.mean() - y.mean()) ** 2 / error, (z.std() - y.std()) ** 2 / error
    covariance = 2 * (z.std() * y.std() - np.mean((z - z.mean()) * (y - y.mean()))) / error
    return Theil(float(np.sqrt(error)) / size, float(bias), float(variance), float(covariance), count)
