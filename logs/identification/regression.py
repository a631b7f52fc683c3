"""Least squares with standard errors that stay true when the residuals are coloured.

Residuals of flight data are correlated from sample to sample; the textbook covariance is then several times
too small. The covariance here weighs the regressors with the residuals' own autocovariance (Morelli & Klein,
Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997), its lags
tapered by Parzen's window. Records are equally spaced; a sample that is not used has the weight 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

WORST_CONDITION = 1e10


class Fit(NamedTuple):
    """Outcome of a linear regression."""

    values: Array
    """as the regressors ask; (p,)"""
    covariance: Array
    """(p, p); corrected for coloured residuals"""
    residuals: Array
    """as the response; (N,), 0 where the weight is 0"""
    degrees: float
    """-; effective degrees of freedom"""


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


def regress(
    regressors: Array, response: Array, used: Array, least_lags: int = 1, instruments: Array | None = None
) -> Fit:
    """Least squares of ``response`` (N,) on ``regressors`` (N, p) where ``used`` (N,) is 1.

    ``instruments`` (N, p), where given, follow the regressors but do not share their noise; the values are then
    free of the attenuation that noise in the regressors causes. The lag window spans a tenth of the record and
    at least ``least_lags`` samples.

    Raises:
        numpy.linalg.LinAlgError: the regressors are linearly dependent.
    """
    design = (regressors if instruments is None else instruments) * used[:, None]
    if np.linalg.cond(design) > WORST_CONDITION:
        raise np.linalg.LinAlgError("the regressors are linearly dependent")
    inverse = np.linalg.inv(design.T @ (regressors * used[:, None]))
    values = inverse @ (design.T @ (response * used))
    residuals = (response - regressors @ values) * used
    lags = max(int(len(used) / 10), least_lags, 1)
    colour = colour_of([residuals[:, None]], [used], lags)
    degrees = max(colour.effective - len(values), 1.0)
    core = coloured_information([design[:, None, :]], colour)
    white = inverse @ (design.T @ design) @ inverse.T * (residuals @ residuals) / max(used.sum() - len(values), 1.0)
    covariance = inverse @ core @ inverse.T * (colour.effective / degrees)
    return Fit(values, _not_below_white(covariance, white), residuals, degrees)


def _not_below_white(covariance: Array, white: Array) -> Array:
    """Scale up to the white-residual standard errors: a short record must not promise more than they do."""
    ratio = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    scaled: Array = covariance * np.outer(ratio, ratio)
    return scaled
