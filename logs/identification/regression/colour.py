"""The colour of residuals: their autocovariance, tapered, and what it makes of the information in the data.

Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997,
with the lags tapered by Parzen's window.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array


class Colour(NamedTuple):
    """Autocovariance of residuals, tapered, by lag."""

    covariances: Array
    """(L, m, m); of m outputs at lags 0 to L - 1, times the taper"""
    effective: float
    """-; the number of independent samples that carry as much knowledge of the residuals' variance"""


def parzen(lags: int) -> Array:
    """Parzen's lag window at lags 0 to ``lags`` - 1, zero from lag ``lags`` on."""
    x = np.arange(lags) / lags
    window: Array = np.where(x <= 0.5, 1 - 6 * x**2 * (1 - x), 2 * (1 - x) ** 3)
    return window


def colour_of(residuals: list[Array], used: list[Array], lags: int) -> Colour:
    """Autocovariance over records of ``residuals`` (N_i, m), zero where ``used`` (N_i,) is 0."""
    outputs = residuals[0].shape[1]
    sums, pairs = np.zeros((lags, outputs, outputs)), np.zeros(lags)
    for values, mask in zip(residuals, used, strict=True):
        for lag in range(min(lags, len(mask))):
            head, tail = slice(0, len(mask) - lag), slice(lag, len(mask))
            sums[lag] += values[head].T @ values[tail]
            pairs[lag] += mask[head] @ mask[tail]
    raw = sums / np.maximum(pairs, 1.0)[:, None, None]
    tapered = raw * parzen(lags)[:, None, None]
    return Colour(tapered, _effective(tapered, pairs))


def _effective(tapered: Array, pairs: Array) -> float:
    """Independent samples, summed over the outputs: pairs of samples count by their squared correlation."""
    total = 0.0
    for output in range(tapered.shape[1]):
        covariance = tapered[:, output, output]
        if covariance[0] > 0:
            squared = (covariance / covariance[0]) ** 2 * pairs
            total += float(pairs[0] ** 2 / (squared[0] + 2 * np.sum(squared[1:])))
    return total


def coloured_information(sensitivities: list[Array], colour: Colour) -> Array:
    """Sum over lags of S(i)^T Gamma(i - j) S(j) for ``sensitivities`` (N_i, m, p): (p, p)."""
    parameters = sensitivities[0].shape[2]
    total = np.zeros((parameters, parameters))
    for sensitivity in sensitivities:
        for lag in range(min(len(colour.covariances), len(sensitivity))):
            head, tail = sensitivity[: len(sensitivity) - lag], sensitivity[lag:]
            weighted = np.einsum("nip,ij->njp", head, colour.covariances[lag])
            term = np.einsum("njp,njq->pq", weighted, tail)
            total += term if lag == 0 else term + term.T
    return total
