"""Separable nonlinear least squares: the linear parameters are eliminated at every step (variable projection).

Golub & Pereyra, SIAM J. Numer. Anal. 10(2), 1973, with SciPy's Levenberg-Marquardt search.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from logs.identification.results import Array

PASSES = 2
"""-; estimates of the outputs' variances (relaxation of the likelihood)"""
MAX_EVALUATIONS = 400
TOLERANCE = 1e-6
DEPENDENT = 1e-10
"""-; relative length of a combination of shared columns that is neglected"""
STEP = 1e-6
"""-; relative, of differences"""


class SeparableRecord(NamedTuple):
    """One record of m outputs at given nonlinear parameters."""

    measured: Array
    """(n, m)"""
    nuisances: tuple[Array, ...]
    """m of (n, l), `orthonormal`; columns whose coefficients belong to this record"""
    shared: tuple[Array, ...]
    """m of (n, g); columns with one coefficient in all records, g may be 0"""


class SeparableFit(NamedTuple):
    """Optimum; the parameters are the p nonlinear ones, then the coefficients of the shared columns."""

    values: Array
    """(P,)"""
    residuals: list[Array]
    """(n_i, m); in standard deviations"""
    sensitivities: list[Array]
    """(n_i, m, P); nuisances projected out, in standard deviations"""
    nuisances: int
    """-; number of nuisance parameters"""
    deviation: Array
    """(m,); standard deviation of the outputs' residuals"""
    converged: bool


Build = Callable[[Array], list[SeparableRecord]]


def orthonormal(columns: Array) -> Array:
    """An orthonormal basis (n, l) of ``columns`` (n, l)."""
    scaled = columns / np.maximum(np.abs(columns).max(axis=0), 1e-300)  # squares of 1e200 overflow
    return np.asarray(np.linalg.qr(scaled)[0])


def optimal(records: list[SeparableRecord]) -> tuple[list[Array], list[Array]]:
    """Residuals (n_i, m) with all linear parameters at their optimum, and the shared ones, m of (g,)."""
    residuals, coefficients = [np.empty(one.measured.shape) for one in records], []
    for output in range(records[0].measured.shape[1]):
        rests = [without(one, output, one.measured[:, output]) for one in records]
        designs = [without(one, output, one.shared[output]) for one in records]
        design = np.vstack(designs)
        size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        best = np.zeros(0)
        if design.shape[1]:
            best = np.linalg.lstsq(design / size, np.concatenate(rests), rcond=DEPENDENT)[0] / size
        coefficients.append(best)
        for residual, rest, part in zip(residuals, rests, designs, strict=True):
            residual[:, output] = rest - part @ best
    return residuals, coefficients


def without(record: SeparableRecord, output: int, columns: Array) -> Array:
    """``columns`` (n,) or (n, k) of one output orthogonal to its nuisances."""
    basis = record.nuisances[output]
    return np.asarray(columns - basis @ (basis.T @ columns))


def log_squares(build: Build, values: Array) -> float:
    """Sum over the outputs of the logarithm of the residuals' squares: the concentrated likelihood."""
    residuals, _ = optimal(build(values))
    return float(np.sum(np.log(np.sum(np.vstack(residuals) ** 2, axis=0) + 1e-300)))


def solve(build: Build, start: Array, precision: Array | None = None) -> SeparableFit:
    """Optimum from the nonlinear parameters ``start`` (p,).

    ``precision`` (p,) is one over the standard deviation of a Gaussian prior about zero, 0 without one.
    """
    values, prior = start, np.zeros(len(start)) if precision is None else precision

    def weighted(at: Array) -> Array:
        return np.concatenate(((np.vstack(optimal(build(at))[0]) / deviation).ravel(), at * prior))

    for _ in range(PASSES):
        deviation = np.maximum(np.sqrt(np.mean(np.vstack(optimal(build(values))[0]) ** 2, axis=0)), 1e-300)
        found = least_squares(
            weighted, values, method="lm", x_scale="jac", xtol=TOLERANCE, ftol=TOLERANCE, max_nfev=MAX_EVALUATIONS
        )
        values = found.x
    records = build(values)
    residuals, shared = optimal(records)
    every = np.concatenate((values, *shared))
    sensitivities = [-slopes / deviation[:, None] for slopes in _sensitivities(build, every, len(values))]
    nuisances = sum(basis.shape[1] for one in records for basis in one.nuisances)
    converged = bool(found.success) and all(bool(np.all(np.isfinite(one))) for one in sensitivities)
    return SeparableFit(every, [one / deviation for one in residuals], sensitivities, nuisances, deviation, converged)


def _sensitivities(build: Build, values: Array, nonlinear: int) -> list[Array]:
    """Derivatives (n_i, m, P) of the residuals without nuisances by all parameters, by central differences."""

    def residuals(at: Array) -> list[Array]:
        records, rests, place = build(at[:nonlinear]), [], nonlinear
        for output, width in enumerate(part.shape[1] for part in records[0].shared):
            gains, place = at[place : place + width], place + width
            rests.append(
                [without(one, output, one.measured[:, output] - one.shared[output] @ gains) for one in records]
            )
        return [np.column_stack(columns) for columns in zip(*rests, strict=True)]

    columns = []
    for index, value in enumerate(values):
        step = np.zeros(len(values))
        step[index] = STEP * max(abs(float(value)), 1e-2)
        pairs = zip(residuals(values + step), residuals(values - step), strict=True)
        columns.append([(ahead - behind) / (2 * step[index]) for ahead, behind in pairs])
    return [np.stack(parts, axis=2) for parts in zip(*columns, strict=True)]
