"""Least squares with standard errors that stay true when the residuals are coloured.

Residuals of flight data are correlated from sample to sample; the textbook covariance is then several times
too small. The covariance here weighs the regressors with the residuals' own autocovariance (Morelli & Klein,
Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997), its lags
tapered by Parzen's window. Records are equally spaced; a sample that is not used has the weight 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.accuracy.colour import colour_of, coloured_information
from logs.identification.results import Array

WORST_CONDITION = 1e10


class Piece(NamedTuple):
    """One record of a regression."""

    regressors: Array
    """(N, p)"""
    instruments: Array
    """(N, p); the regressors themselves in ordinary least squares"""
    response: Array
    """(N,)"""
    used: Array
    """-; (N,), 1.0 for a sample that counts, else 0.0"""


class Fit(NamedTuple):
    """Outcome of a linear regression."""

    values: Array
    """as the regressors ask; (p,)"""
    covariance: Array
    """(p, p); corrected for coloured residuals"""
    residuals: Array
    """as the response; (N,) of all records one after the other, 0 where the weight is 0"""
    degrees: float
    """-; effective degrees of freedom, the fewest of any parameter"""
    degrees_each: Array
    """-; (p,), effective degrees of freedom of each parameter"""


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
    piece = Piece(regressors, regressors if instruments is None else instruments, response, used)
    return regress_records((piece,), least_lags)


def regress_records(pieces: tuple[Piece, ...], least_lags: int = 1) -> Fit:
    """`regress` over several records, whose residuals know nothing of each other."""
    designs = [piece.instruments * piece.used[:, None] for piece in pieces]
    if np.linalg.cond(np.vstack(designs)) > WORST_CONDITION:
        raise np.linalg.LinAlgError("the regressors are linearly dependent")
    inverse = np.linalg.inv(sum(d.T @ (p.regressors * p.used[:, None]) for d, p in zip(designs, pieces, strict=True)))
    values = inverse @ sum(d.T @ (p.response * p.used) for d, p in zip(designs, pieces, strict=True))
    residuals = [(p.response - p.regressors @ values) * p.used for p in pieces]
    lags = max(int(max(len(p.used) for p in pieces) / 10), least_lags, 1)
    colour = colour_of([r[:, None] for r in residuals], [p.used for p in pieces], lags)
    degrees = max(colour.effective - len(values), 1.0)
    core = coloured_information([d[:, None, :] for d in designs], colour)
    stacked, design = np.concatenate(residuals), np.vstack(designs)
    samples = sum(float(p.used.sum()) for p in pieces)
    white = inverse @ (design.T @ design) @ inverse.T * (stacked @ stacked) / max(samples - len(values), 1.0)
    covariance = inverse @ core @ inverse.T * (colour.effective / degrees)
    return Fit(values, _not_below_white(covariance, white), stacked, degrees, np.full(len(values), degrees))


def _not_below_white(covariance: Array, white: Array) -> Array:
    """Scale up to the white-residual standard errors: a short record must not promise more than they do."""
    ratio = np.sqrt(np.maximum(np.diag(white) / np.maximum(np.diag(covariance), 1e-300), 1.0))
    scaled: Array = covariance * np.outer(ratio, ratio)
    return scaled
