"""Correlation of parameters: which of them the data tells only together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

STRONG = 0.9
"""-; size from which on a pair is named (Klein & Morelli, Aircraft System Identification, 2006, ch. 5)"""


class Pair(NamedTuple):
    """Two parameters whose errors go together."""

    one: str
    other: str
    correlation: float
    """-; in [-1, 1]: near 1 their difference is well known, near -1 their sum, in standard errors"""


class Correlation(NamedTuple):
    """Correlation of all parameters' errors."""

    names: tuple[str, ...]
    """-; (p,)"""
    matrix: Array
    """-; (p, p), NaN for a parameter without an error"""
    strong: tuple[Pair, ...]
    """the pairs above `STRONG`, the strongest first"""


def correlation_of(names: tuple[str, ...], covariance: Array) -> Correlation:
    """Correlation matrix of parameters ``names`` with ``covariance`` (p, p), and the pairs above 0.9 by name."""
    errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = errors > 0
    safe = np.where(known, errors, 1.0)
    matrix = np.clip(covariance / np.outer(safe, safe), -1.0, 1.0)
    matrix[~known, :] = matrix[:, ~known] = np.nan
    return Correlation(names, matrix, strong_pairs(names, matrix))


def strong_pairs(names: tuple[str, ...], matrix: Array) -> tuple[Pair, ...]:
    """The pairs of ``names`` (p,) whose correlation in ``matrix`` (p, p) is above `STRONG`, the strongest first."""
    rows, columns = np.nonzero(np.triu(np.abs(np.nan_to_num(matrix)) > STRONG, 1))
    pairs = [Pair(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.correlation)))
