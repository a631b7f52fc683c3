"""The outputs' noise and what it makes of residuals: relaxation of the likelihood (Jategaonkar 2006, ch. 4).

For given parameters the likelihood is greatest where the noise covariance is that of the residuals; for a given
covariance it is a sum of weighted squares. The two are taken in turn.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Problem
from logs.identification.estimators.engine.records import Indices, Record
from logs.identification.results import Array

FLOOR = 1e-8
"""-; of an output's own variation: the least standard deviation, for records without noise"""
LEAST_EIGENVALUE = 1e-6
"""-; of a correlation matrix of residuals, for outputs that repeat each other"""


class Whitener(NamedTuple):
    """One record's way to residuals of unit variance; samples that lack outputs are weighed by what they have."""

    groups: tuple[tuple[Indices, Array], ...]
    """of samples with the same outputs: their rows, and the matrix (m, m) that whitens them; one group for all
    where the noise has no correlations"""
    log_determinant: float
    """-; half the logarithm of the determinants of the noise covariance, summed over samples"""

    def __call__(self, values: Array) -> Array:
        """Residuals (N, m) or slopes (N, m, q), zero where not measured, in standard deviations."""
        if not self.groups:
            return np.zeros_like(values)
        rows, matrix = self.groups[0]
        if not len(rows):
            scale = np.diag(matrix)
            alone: Array = values * (scale if values.ndim == 2 else scale[:, None])
            return alone
        result = np.zeros_like(values)
        for rows, matrix in self.groups:
            result[rows] = values[rows] @ matrix.T if values.ndim == 2 else matrix @ values[rows]
        return result


EVERY_ROW = np.zeros(0, dtype=np.intp)


def whitener_of(record: Record, noise: Array) -> Whitener:
    """How ``noise`` (m, m) weighs the record's samples."""
    variances = np.diag(noise)
    if np.count_nonzero(noise) <= len(noise):
        half = float(record.used.sum(axis=0) @ np.log(variances)) / 2
        return Whitener(((EVERY_ROW, np.diag(1 / np.sqrt(variances))),), half)
    groups, half = [], 0.0
    for rows, there in record.groups:
        matrix, lower = np.zeros(noise.shape), np.linalg.cholesky(noise[np.ix_(there, there)])
        matrix[np.ix_(there, there)] = np.linalg.inv(lower)
        half += len(rows) * float(np.sum(np.log(np.diag(lower))))
        groups.append((rows, matrix))
    return Whitener(tuple(groups), half)


def noise_of(problem: Problem, records: tuple[Record, ...], residuals: list[Array]) -> Array:
    """Covariance (m, m) of the outputs' noise by the problem's weighting, from ``residuals`` (N_i, m)."""
    if problem.weighting == "given":
        return np.diag([problem.deviations[name] ** 2 for name in problem.outputs])
    products = np.sum([r.T @ r for r in residuals], axis=0)
    pairs = np.sum([record.used.T @ record.used for record in records], axis=0)
    covariance = products / np.maximum(pairs, 1.0)
    floor = FLOOR * variation(records)
    deviation = np.sqrt(np.maximum(np.diag(covariance), floor**2))
    if problem.weighting == "diagonal":
        return np.diag(deviation**2)
    correlation = covariance / np.outer(deviation, deviation)
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    safe: Array = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T * np.outer(deviation, deviation)
    return safe


def variation(records: tuple[Record, ...]) -> Array:
    """Size (m,) of each output's motion over all records, one where it does not move."""
    counts = np.maximum(np.sum([r.used.sum(axis=0) for r in records], axis=0), 1.0)
    means = np.sum([r.measured.sum(axis=0) for r in records], axis=0) / counts
    squares = np.sum([np.sum(((r.measured - means) * r.used) ** 2, axis=0) for r in records], axis=0)
    size: Array = np.sqrt(squares / counts)
    return np.where(size > 0, size, 1.0)


def about_mean(record: Record) -> Array:
    """Measured outputs (N, m) about their means over the record, 0 where not measured."""
    counts = np.maximum(record.used.sum(axis=0), 1.0)
    moved: Array = (record.measured - record.measured.sum(axis=0) / counts) * record.used
    return moved
