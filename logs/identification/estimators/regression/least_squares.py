"""Least squares with standard errors that stay true when the residuals are coloured.

Residuals of flight data are correlated from sample to sample; the textbook covariance is then several times
too small. How it is put right: `logs.identification.statistics.hac`. Records are equally spaced; a sample that is
not used has the weight 0.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from logs.identification.results import Array
from logs.identification.statistics.hac import Coloured, Linear, Noise, all_lags, prewhitened, under, white

WORST_CONDITION = 1e10
ROUNDING = 1e-24
"""-; of the response's squares, below which residuals have no colour"""
Colouring = Literal["parzen", "all lags", "white"]


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


def regress_records(
    pieces: tuple[Piece, ...], least_lags: int = 1, colour: Colouring = "parzen", noise: Noise | None = None
) -> Fit:
    """`regress` over several records, whose residuals know nothing of each other.

    ``noise``, where given, is that of a fuller model: what this model lacks is then not taken for noise.
    """
    values, records = linear_of(pieces)
    squares = sum(float(piece.response**2 @ piece.used) for piece in pieces)
    coloured = _coloured(records, least_lags, colour, squares) if noise is None else under(noise, records)
    residuals, degrees = np.concatenate([record.residuals for record in records]), coloured.degrees
    return Fit(values, coloured.covariance, residuals, float(degrees.min(initial=np.inf)), degrees)


def linear_of(pieces: tuple[Piece, ...]) -> tuple[Array, tuple[Linear, ...]]:
    """Values (p,) and how they come about, record by record; raises as `regress`."""
    designs = [piece.instruments * piece.used[:, None] for piece in pieces]
    whole = np.vstack(designs)
    if len(whole) < whole.shape[1] or np.linalg.cond(whole) > WORST_CONDITION:
        raise np.linalg.LinAlgError("the regressors are linearly dependent")
    pairs = list(zip(designs, pieces, strict=True))
    inverse = np.linalg.inv(np.sum([d.T @ (p.regressors * p.used[:, None]) for d, p in pairs], axis=0))
    values = inverse @ np.sum([d.T @ (p.response * p.used) for d, p in pairs], axis=0)
    residuals = [(p.response - p.regressors @ values) * p.used for p in pieces]
    basis, at = np.linalg.qr(whole)[0], np.cumsum([0] + [len(p.used) for p in pieces])
    rows = zip(designs, residuals, pieces, pairwise(at), strict=True)
    return values, tuple(Linear(d @ inverse.T, basis[a:b], r, p.used) for d, r, p, (a, b) in rows)


def _coloured(records: tuple[Linear, ...], least_lags: int, colour: Colouring, squares: float) -> Coloured:
    if colour == "all lags":
        return all_lags(records)
    if colour == "white" or sum(float(r.residuals @ r.residuals) for r in records) <= ROUNDING * squares:
        return white(records)
    return prewhitened(records, least_lags)
