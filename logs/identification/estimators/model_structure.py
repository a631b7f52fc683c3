"""Choice of a regression's terms: statistics, and multivariate orthogonal functions.

Klein & Morelli, Aircraft System Identification, 2006, ch. 5. The published criteria count samples. With
autocorrelated residuals they would accept nearly every term: here they count effective samples, and PRESS leaves out
blocks of samples. With white residuals they are the published ones.

Orthogonal functions (Morelli, Global Nonlinear Aerodynamic Modeling Using Multivariate Orthogonal Functions, J.
Aircraft 32(2), 1995): candidates are made orthogonal (modified Gram-Schmidt, the one that explains most first), so
that each reduces the squares independently of the others; those up to the least predicted square error are retained.
Every orthogonal function is a sum of ordinary terms, from which coefficients and covariance follow exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Settings,
    equations,
    one_response,
    regression_result,
    settings_of,
    solve,
)
from logs.identification.estimators.least_squares import CovarianceKind, Noise, RecordBlock, regress_records
from logs.identification.estimators.registry import Request
from logs.identification.estimators.regressors import Design
from logs.identification.results import Array, EstimationResult

RANK = 1e-5
"""-; smallest singular value of independent candidates of unit length"""
SAMPLES_PER_TERM = 10
MAX_TERMS = 24
"""-; of the largest model, from whose residuals the noise is estimated"""
ROUNDING = 1e-24
"""-; of the response's squares, below which residuals are rounding"""
KINDS: tuple[CovarianceKind, CovarianceKind] = ("autocorrelated", "white")
DEPENDENT = 1e-10
"""-; relative squared length of a column that the others do not explain, below which it depends on them"""


class Candidates(NamedTuple):
    """Candidate terms, intercepts and trends taken out, with the noise of the largest model."""

    names: tuple[str, ...]
    """-; (p,)"""
    blocks: tuple[RecordBlock, ...]
    """nuisances (intercepts, trends) first, then the candidates; columns of unit length over all records"""
    nuisances: int
    """-; number of their columns"""
    columns: Array
    """(N, p); candidates of all records, orthogonal to the nuisances"""
    response: Array
    """(N,); orthogonal to the nuisances"""
    basis: Array
    """(N, k); orthonormal, of the nuisances"""
    lengths: Array
    """(p,); length of each candidate"""
    effective: float
    """-; effective number of independent samples"""
    charge: float
    """response squared; of the predicted square error for each parameter"""
    noise: Noise | None
    """of the largest model; None if its residuals are rounding or white"""
    steady: bool = False
    """-; residuals are white"""


class Statistics(NamedTuple):
    """Fit of a model with some of the candidates."""

    r_squared: float
    """-; fraction of the response's variance that the terms explain"""
    adjusted: float
    """-; the same, adjusted for the number of parameters"""
    press: float
    """response squared; mean square error of each block of samples predicted from the others (5.98)"""
    pse: float
    """response squared; predicted square error: mean square plus a charge for each parameter (5.103)"""
    variance: float
    """response squared; s^2, squares over degrees of freedom"""
    parameters: int
    """-; fitted, nuisances included"""


def candidates_of(design: Design, settings: Settings) -> Candidates:
    """The columns of ``design`` as candidates.

    Samples count by the median factor by which autocorrelation raises the variances of the largest model's terms.
    """
    wanted = equations(design, "time", settings)
    nuisances = len(wanted.names) - len(design.names)
    size = np.linalg.norm(np.vstack([block.regressors for block in wanted.blocks]), axis=0)
    scale = np.where(size > 0, size, 1.0)
    unit = [block.regressors / scale for block in wanted.blocks]
    blocks = tuple(b._replace(regressors=u, instruments=u) for b, u in zip(wanted.blocks, unit, strict=True))
    used = np.concatenate([block.used for block in blocks]) > 0
    table = np.vstack(unit)[used]
    response = np.concatenate([block.response for block in blocks])[used]
    basis = np.linalg.qr(table[:, :nuisances])[0] if nuisances else np.zeros((len(table), 0))
    rest = table[:, nuisances:] - basis @ (basis.T @ table[:, nuisances:])
    lost = np.sum(rest**2, axis=0) <= 1e-20 * np.sum(table[:, nuisances:] ** 2, axis=0)
    remaining, count = response - basis @ (basis.T @ response), len(table)
    charge = float(remaining @ remaining) / max(count - nuisances, 1) / count
    plain = Candidates(
        design.names, blocks, nuisances, np.where(lost, 0.0, rest), remaining, basis, scale[nuisances:],
        float(count), charge, None, settings.steady,
    )  # fmt: skip
    largest = _largest_model(plain)
    left = statistics_of(plain, largest)
    if not largest or not left.r_squared < 1 - ROUNDING or settings.steady:
        return plain
    fit, white = (regress_records(blocks_of(plain, largest), kind) for kind in KINDS)
    edges = np.cumsum([len(block.used) for block in blocks])[:-1]
    noise = Noise(tuple(np.split(fit.residuals, edges)), len(fit.values))
    raised = (np.diag(fit.covariance) / np.diag(white.covariance))[nuisances:]
    effective = count / float(np.clip(np.median(raised), 1.0, count / 3))
    # The published charge, sigma_max^2 / N with the response's own variance, exceeds the 2 sigma^2 / N of white noise
    # (Barron 1984); autocorrelated noise may need more.
    return plain._replace(effective=effective, charge=max(charge, 2 * left.variance / effective), noise=noise)


def blocks_of(candidates: Candidates, chosen: tuple[int, ...]) -> tuple[RecordBlock, ...]:
    """The records with only the nuisances and the ``chosen`` candidates."""
    columns = [*range(candidates.nuisances), *(candidates.nuisances + column for column in chosen)]
    parts = ((block, block.regressors[:, columns]) for block in candidates.blocks)
    return tuple(RecordBlock(regressors, regressors, block.response, block.used) for block, regressors in parts)


def independent(candidates: Candidates, chosen: tuple[int, ...]) -> bool:
    """Whether the ``chosen`` candidates are linearly independent."""
    columns = candidates.columns[:, chosen]
    return bool(np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)[-1] > RANK)


def residuals_of(candidates: Candidates, chosen: tuple[int, ...]) -> Array:
    """Residuals (N,) of the model with the ``chosen`` candidates."""
    columns = candidates.columns[:, chosen]
    return np.asarray(candidates.response - columns @ np.linalg.lstsq(columns, candidates.response, rcond=None)[0])


def statistics_of(candidates: Candidates, chosen: tuple[int, ...]) -> Statistics:
    """`Statistics` of the model with the ``chosen`` candidates; NaN for ratios to a response that does not vary."""
    residuals = residuals_of(candidates, chosen)
    count = len(residuals)
    fitted = len(chosen) + candidates.nuisances
    squares, total = float(residuals @ residuals), float(candidates.response @ candidates.response)
    all_variance, variance = total / max(count - candidates.nuisances, 1), squares / max(count - fitted, 1)
    return Statistics(
        1 - squares / total if total > 0 else np.nan,
        1 - variance / all_variance if total > 0 else np.nan,
        _press(candidates, chosen, residuals),
        squares / count + candidates.charge * fitted,
        variance,
        fitted,
    )


def partial_f(candidates: Candidates, chosen: tuple[int, ...], column: int) -> float:
    """Partial F of one ``column`` of the ``chosen`` (5.92), as published: for white residuals."""
    full = residuals_of(candidates, chosen)
    without = residuals_of(candidates, tuple(c for c in chosen if c != column))
    squares = float(full @ full)
    degrees = max(len(full) - len(chosen) - candidates.nuisances, 1)
    return (float(without @ without) - squares) / squares * degrees if squares > 0 else np.inf


def partial_correlations(candidates: Candidates, chosen: tuple[int, ...]) -> Array:
    """Partial correlation (p,) of each candidate with the response, given the ``chosen`` (5.90).

    Zero for the chosen and for candidates that depend on them.
    """
    residuals, retained = residuals_of(candidates, chosen), candidates.columns[:, chosen]
    rest = candidates.columns - retained @ np.linalg.lstsq(retained, candidates.columns, rcond=None)[0]
    squares, total = np.sum(rest**2, axis=0), np.sum(candidates.columns**2, axis=0)
    varies = squares > DEPENDENT * total
    varies[list(chosen)] = False
    size = np.sqrt(np.where(varies, squares, 1.0) * max(float(residuals @ residuals), 1e-300))
    return np.asarray(np.where(varies, rest.T @ residuals / size, 0.0))


def _press(candidates: Candidates, chosen: tuple[int, ...], residuals: Array) -> float:
    """Mean square error of blocks of N / effective samples, each predicted from all others."""
    design = np.column_stack((candidates.basis, np.linalg.qr(candidates.columns[:, chosen])[0]))
    length = max(round(len(residuals) / candidates.effective), 1)
    blocks = -(-len(residuals) // length)
    padded = np.zeros((blocks * length, design.shape[1] + 1))
    padded[: len(residuals), :-1], padded[: len(residuals), -1] = design, residuals
    stacked = padded.reshape(blocks, length, -1)
    rows, errors = stacked[:, :, :-1], stacked[:, :, -1:]
    transposed = rows.transpose(0, 2, 1)
    # (I - H)^-1 of a block (Woodbury), in the few dimensions of the model instead of the many of the block.
    inner = np.linalg.pinv(np.eye(design.shape[1]) - transposed @ rows, hermitian=True)
    return float(np.sum((errors + rows @ (inner @ (transposed @ errors))) ** 2)) / len(residuals)


def _largest_model(candidates: Candidates) -> tuple[int, ...]:
    """Independent candidates in the order of partial correlation, as many as the samples allow."""
    chosen: tuple[int, ...] = ()
    limit = min(len(candidates.names), max(len(candidates.response) // SAMPLES_PER_TERM, 1), MAX_TERMS)
    while len(chosen) < limit:
        correlations = np.abs(partial_correlations(candidates, chosen))
        best = int(np.argmax(correlations))
        if correlations[best] <= 0 or not independent(candidates, (*chosen, best)):
            break
        chosen = (*chosen, best)
    return chosen


class Function(NamedTuple):
    """One orthogonal function, in the order in which they were made."""

    term: str
    """-; the candidate that it was made of"""
    gain: float
    """-; fraction of the response's variance that it explains"""
    pse: float
    """response squared; predicted square error with it and all before it"""
    kept: bool
    chance: float
    """-; p-value of its partial F, counted in effective samples"""


class Orthogonal(NamedTuple):
    """Result of modeling by orthogonal functions."""

    functions: tuple[Function, ...]
    terms: tuple[str, ...]
    """-; ordinary terms of the retained functions"""
    triangle: Array
    """(k, k); upper: the retained terms, without mean and trend, are the orthonormal functions times this"""
    amplitudes: Array
    """(k,); of the retained orthonormal functions, as the response"""
    model: CoefficientRegression
    """the same model in ordinary terms: intercept, coefficients, covariance"""
    failure: str = ""
    """-; why there is no model, empty if there is"""


def orthogonal_regression(
    experiments: tuple[Experiment, ...],
    response: str,
    candidates: tuple[str, ...],
    most_terms: int = 12,
    settings: Settings | None = None,
) -> Orthogonal:
    """The model of ``response`` in the ``candidates`` (`terms.pool`) with the least predicted square error.

    Raises:
        InputError: unknown names, unequal sampling intervals.
    """
    settings = settings or Settings()
    design = settings.design(experiments, response, candidates)
    lengths = tuple(len(record.used) for record in design.records)
    if design.samples < 3 * len(experiments) + 3:
        failure = f"{design.samples} samples with {response} and all candidates"
    else:
        pool = candidates_of(design, settings)
        order, basis, triangle = orthogonalized(pool.columns, pool.response, most_terms)
        if order:
            amplitudes = basis.T @ pool.response
            functions = _functions([design.names[column] for column in order], amplitudes, pool)
            count = sum(function.kept for function in functions)
            terms = tuple(function.term for function in functions[:count])
            model = solve(design.taking(terms), "time", settings, lengths)
            scaled = triangle[:count, :count] * pool.lengths[order[:count]]
            return Orthogonal(functions, terms, scaled, amplitudes[:count], model, model.failure)
        failure = "no candidate varies on its own"
    empty = solve(design.taking(()), "time", settings, lengths)
    return Orthogonal((), (), np.zeros((0, 0)), np.zeros(0), empty, failure)


def orthogonalized(columns: Array, response: Array, limit: int) -> tuple[list[int], Array, Array]:
    """Order (k,) of the ``columns`` (N, p), orthonormal functions (N, k) and triangle (k, k): columns = functions R.

    The next column is the one whose part orthogonal to those before it explains most of the ``response`` (N,).
    """
    rest, sizes = columns.copy(), np.sum(columns**2, axis=0)
    order: list[int] = []
    functions: list[Array] = []
    while len(order) < min(limit, columns.shape[1]):
        squares = np.sum(rest**2, axis=0)
        varies = squares > DEPENDENT * sizes
        varies[order] = False
        if not np.any(varies):
            break
        gains = np.where(varies, (rest.T @ response) ** 2 / np.where(varies, squares, 1.0), -1.0)
        best = int(np.argmax(gains))
        column = rest[:, best]
        for function in functions:  # a second pass removes the rounding of the first
            column = column - function * (function @ column)
        order.append(best)
        functions.append(column / np.linalg.norm(column))
        rest = rest - np.outer(functions[-1], functions[-1] @ rest)
    basis = np.column_stack(functions) if functions else np.zeros((len(response), 0))
    return order, basis, np.triu(basis.T @ columns[:, order])


def _functions(names: list[str], amplitudes: Array, pool: Candidates) -> tuple[Function, ...]:
    """The functions made of ``names`` (k,), retained up to the least predicted square error."""
    count, total = len(pool.response), float(pool.response @ pool.response)
    fitted = np.arange(1, len(names) + 1) + pool.nuisances
    pse = (total - np.cumsum(amplitudes**2)) / count + pool.charge * fitted
    empty = total / count + pool.charge * pool.nuisances
    retained = int(np.argmin(pse)) + 1 if pse.min() < empty else 0
    free = max(pool.effective - fitted[-1], 1.0)
    left = max(total - float(np.sum(amplitudes**2)), ROUNDING * total) / free
    chances = fdtrc(1.0, free, amplitudes**2 / left)
    return tuple(
        Function(name, float(a**2 / total), float(p), index < retained, float(chance))
        for index, (name, a, p, chance) in enumerate(zip(names, amplitudes, pse, chances, strict=True))
    )


def estimate_orthogonal(request: Request) -> EstimationResult:
    """Orthogonal functions of a request; option ``most_terms``."""
    most = int(request.options.get("most_terms", 12))
    found = orthogonal_regression(
        request.experiments, one_response(request), request.regressors, most, settings_of(request)
    )
    return regression_result("orthogonal", request, found.model, steps=found.functions)
