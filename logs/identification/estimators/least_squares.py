"""Linear least squares over several records, with a covariance for colored residuals (`statistics.covariance`).

Records are equally spaced; a sample that is not used has the weight 0.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from logs.identification.results import Array
from logs.identification.statistics.covariance import colored_covariance

MAX_CONDITION = 1e10
CovarianceKind = Literal["autocorrelated", "white"]


class RecordBlock(NamedTuple):
    """One record of a regression."""

    regressors: Array
    """(N, p)"""
    instruments: Array
    """(N, p); the regressors themselves in ordinary least squares"""
    response: Array
    """(N,)"""
    used: Array
    """-; (N,), 1.0 for a sample that counts, else 0.0"""


class Noise(NamedTuple):
    """Residuals of another model, from which the noise is estimated."""

    residuals: tuple[Array, ...]
    """(N,) of each record"""
    fitted: int
    """-; parameters of that model"""


class Fit(NamedTuple):
    """Result of a linear regression."""

    values: Array
    """as the regressors; (p,)"""
    covariance: Array
    """(p, p)"""
    residuals: Array
    """as the response; (N,) of all records one after the other, 0 where the weight is 0"""
    degrees: float
    """-; effective degrees of freedom"""


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
    block = RecordBlock(regressors, regressors if instruments is None else instruments, response, used)
    return regress_records((block,), covariance)


def regress_records(
    blocks: tuple[RecordBlock, ...], covariance: CovarianceKind = "autocorrelated", noise: Noise | None = None
) -> Fit:
    """`regress` over several records with independent residuals.

    ``noise`` is that of a larger model, so that the lack of fit of this one does not count as noise.
    """
    scaled, scale = _scaled(blocks)
    designs = [block.instruments * block.used[:, None] for block in scaled]
    stacked = np.vstack(designs)
    if len(stacked) < stacked.shape[1] or np.linalg.cond(stacked) > MAX_CONDITION:
        raise np.linalg.LinAlgError("the regressors are linearly dependent")
    pairs = list(zip(designs, scaled, strict=True))
    inverse = np.linalg.inv(np.sum([d.T @ (b.regressors * b.used[:, None]) for d, b in pairs], axis=0))
    values = inverse @ np.sum([d.T @ (b.response * b.used) for d, b in pairs], axis=0)
    residuals = tuple((b.response - b.regressors @ values) * b.used for b in scaled)
    noise = noise or Noise(residuals, len(values))
    weights = [design @ inverse.T for design in designs]
    if covariance == "white":
        degrees = max(sum(float(b.used.sum()) for b in scaled) - noise.fitted, 1.0)
        squares = sum(float(r @ r) for r in noise.residuals)
        found = np.sum([w.T @ w for w in weights], axis=0) * (squares / degrees)
    else:
        # With instruments, residuals outside of their band do not count.
        bounded = all(block.instruments is block.regressors for block in blocks)
        columns = [r[:, None] for r in noise.residuals], [b.used[:, None] for b in scaled]
        sensitivities = [w[:, None] for w in weights]
        found, degrees = colored_covariance(*columns, sensitivities, np.eye(len(values)), noise.fitted, bounded)
    return Fit(values / scale, found / np.outer(scale, scale), np.concatenate(residuals), degrees)


def _scaled(blocks: tuple[RecordBlock, ...]) -> tuple[tuple[RecordBlock, ...], Array]:
    """The blocks with regressors and instruments of unit length, and the lengths (p,) of the regressors."""
    scale, other = (
        np.where((size := np.linalg.norm(np.vstack(columns), axis=0)) > 0, size, 1.0)
        for columns in (
            [b.regressors * b.used[:, None] for b in blocks], [b.instruments * b.used[:, None] for b in blocks]
        )
    )  # fmt: skip
    return tuple(
        b._replace(regressors=b.regressors / scale, instruments=b.instruments / other) for b in blocks
    ), scale
