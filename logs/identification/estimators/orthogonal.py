"""Multivariate orthogonal functions: the choice of terms among similar candidates.

Morelli, Global Nonlinear Aerodynamic Modeling Using Multivariate Orthogonal Functions, J. Aircraft 32(2), 1995; Klein
& Morelli, Aircraft System Identification, 2006, ch. 5.4. The candidates are made orthogonal to one another (modified
Gram-Schmidt, the one that explains most first), so that each reduces the squares independently of the others. Those
up to the least predicted square error are retained. Every orthogonal function is a sum of ordinary terms, so that the
model's coefficients and their covariance follow exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Settings,
    one_response,
    regression_result,
    settings_of,
    solve,
)
from logs.identification.estimators.model_structure import DEPENDENT, ROUNDING, Candidates, candidates_of
from logs.identification.estimators.registry import ESTIMATORS, Estimator, Request
from logs.identification.results import Array, EstimationResult


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
    chances = fisher.sf(amplitudes**2 / left, 1, free)
    return tuple(
        Function(name, float(a**2 / total), float(p), index < retained, float(chance))
        for index, (name, a, p, chance) in enumerate(zip(names, amplitudes, pse, chances, strict=True))
    )


def _row(request: Request) -> EstimationResult:
    most = int(request.options.get("most_terms", 12))
    found = orthogonal_regression(
        request.experiments, one_response(request), request.regressors, most, settings_of(request)
    )
    return regression_result("orthogonal", request, found.model, steps=found.functions)


ESTIMATORS["orthogonal"] = Estimator(
    "orthogonal", "Multivariate orthogonal functions", "Morelli, J. Aircraft 32(2), 1995", _row,
    '[[aero.regression]] method = "orthogonal"', {"most_terms": "orthogonal functions at most"},
)  # fmt: skip
