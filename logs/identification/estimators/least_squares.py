"""Linear least squares over several records, with a covariance for autocorrelated residuals (`statistics.hac`).

Records are equally spaced; a sample that is not used has the weight 0.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np

from logs.identification.results import Array
from logs.identification.statistics.hac import HacCovariance, Linear, Noise, autocorrelated, under, white

WORST_CONDITION = 1e10
ROUNDING = 1e-24
"""-; of the response's squares, below which residuals are rounding and have no autocorrelation"""
CovarianceKind = Literal["autocorrelated", "white"]


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
    """Result of a linear regression."""

    values: Array
    """as the regressors; (p,)"""
    covariance: Array
    """(p, p)"""
    residuals: Array
    """as the response; (N,) of all records one after the other, 0 where the weight is 0"""
    degrees: float
    """-; effective degrees of freedom, the fewest of any parameter"""
    degrees_each: Array
    """-; (p,), effective degrees of freedom of each parameter"""


def regress(
    regressors: Array,
    response: Array,
    used: Array,
    instruments: Array | None = None,
    covariance: CovarianceKind = "autocorrelated",
) -> Fit:
    """Least squares of ``response`` (N,) on ``regressors`` (N, p) where ``used`` (N,) is 1.

    Optional ``instruments`` (N, p) are correlated with the regressors but not with their noise; the estimate is then
    free of attenuation (instrumental variables: Young, Recursive Estimation and Time-Series Analysis, 1984, ch. 8).

    Raises:
        numpy.linalg.LinAlgError: the regressors are linearly dependent.
    """
    piece = Piece(regressors, regressors if instruments is None else instruments, response, used)
    return regress_records((piece,), covariance)


def regress_records(
    pieces: tuple[Piece, ...], covariance: CovarianceKind = "autocorrelated", noise: Noise | None = None
) -> Fit:
    """`regress` over several records with independent residuals.

    ``noise`` is the noise model of a larger model, so that the lack of fit of this one does not count as noise.
    """
    scaled, scale = _scaled(pieces)
    values, records = linear_of(scaled)
    found = _covariance(records, covariance, pieces) if noise is None else under(noise, records)
    residuals = np.concatenate([record.residuals for record in records])
    return Fit(
        values / scale, found.covariance / np.outer(scale, scale), residuals,
        float(found.degrees.min(initial=np.inf)), found.degrees,
    )  # fmt: skip


def linear_of(pieces: tuple[Piece, ...]) -> tuple[Array, tuple[Linear, ...]]:
    """Values (p,) and the weights of every sample by record; raises as `regress`."""
    designs = [piece.instruments * piece.used[:, None] for piece in pieces]
    whole = np.vstack(designs)
    if len(whole) < whole.shape[1] or np.linalg.cond(whole) > WORST_CONDITION:
        raise np.linalg.LinAlgError("the regressors are linearly dependent")
    pairs = list(zip(designs, pieces, strict=True))
    inverse = np.linalg.inv(np.sum([d.T @ (p.regressors * p.used[:, None]) for d, p in pairs], axis=0))
    values = inverse @ np.sum([d.T @ (p.response * p.used) for d, p in pairs], axis=0)
    residuals = [(p.response - p.regressors @ values) * p.used for p in pieces]
    basis, edges = np.linalg.qr(whole)[0], np.cumsum([0] + [len(p.used) for p in pieces])
    rows = zip(designs, residuals, pieces, pairwise(edges), strict=True)
    return values, tuple(Linear(d @ inverse.T, basis[a:b], r, p.used) for d, r, p, (a, b) in rows)


def _scaled(pieces: tuple[Piece, ...]) -> tuple[tuple[Piece, ...], Array]:
    """The pieces with regressors and instruments of unit length, and the lengths (p,) of the regressors."""
    scale, other = (
        np.where((size := np.linalg.norm(np.vstack(columns), axis=0)) > 0, size, 1.0)
        for columns in (
            [p.regressors * p.used[:, None] for p in pieces], [p.instruments * p.used[:, None] for p in pieces]
        )
    )  # fmt: skip
    return tuple(
        p._replace(regressors=p.regressors / scale, instruments=p.instruments / other) for p in pieces
    ), scale


def _covariance(records: tuple[Linear, ...], kind: CovarianceKind, pieces: tuple[Piece, ...]) -> HacCovariance:
    squares = sum(float(piece.response**2 @ piece.used) for piece in pieces)
    rounding = sum(float(r.residuals @ r.residuals) for r in records) <= ROUNDING * squares
    return white(records) if kind == "white" or rounding else autocorrelated(records)
