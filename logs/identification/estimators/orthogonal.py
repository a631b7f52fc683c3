"""Multivariate orthogonal functions: which terms a response needs when the candidates resemble one another.

Morelli, Global Nonlinear Aerodynamic Modeling Using Multivariate Orthogonal Functions, J. Aircraft 32(2), 1995; Klein
& Morelli, Aircraft System Identification, 2006, ch. 5.4. The candidates are made orthogonal to one another (QR by
modified Gram-Schmidt, the one that explains most first), so that each lowers the squares by an amount of its own;
those are kept with which the predicted square error is least. Every orthogonal function is a sum of ordinary terms:
the model's coefficients follow from the functions' exactly, with their covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.regression.candidates import candidates_of
from logs.identification.estimators.regression.coefficients import CoefficientRegression, solve
from logs.identification.estimators.regression.design import Design, design_of
from logs.identification.estimators.regression.equation_error import Settings
from logs.identification.estimators.regression.least_squares import ROUNDING
from logs.identification.estimators.regression.statistics import System
from logs.identification.results import Array

ALIKE = 1e-10
"""-; squared length of a candidate, of its own, below which those before it explain it whole"""


class Function(NamedTuple):
    """One orthogonal function, in the order in which they were made."""

    term: str
    """-; the candidate that it was made of"""
    gain: float
    """-; share of the response's variance that it explains, of all functions the most at its place"""
    pse: float
    """response squared; predicted square error with it and all before it"""
    kept: bool
    chance: float
    """-; probability of its gain by chance, in independent samples of what all functions leave"""


class Orthogonal(NamedTuple):
    """Outcome of modelling by orthogonal functions."""

    functions: tuple[Function, ...]
    terms: tuple[str, ...]
    """-; ordinary terms of the kept functions"""
    triangle: Array
    """(k, k); upper: the kept terms, free of mean and trend, are the orthonormal functions times this"""
    amplitudes: Array
    """(k,); of the kept orthonormal functions, as the response"""
    covariance: Array
    """(k, k); of the amplitudes, corrected for coloured residuals"""
    model: CoefficientRegression
    """the same model in ordinary terms: intercept, coefficients, covariance"""
    failure: str = ""
    """-; why there is no model, empty when there is"""


def orthogonal_regression(
    experiments: tuple[Experiment, ...],
    response: str,
    candidates: tuple[str, ...],
    most_terms: int = 12,
    settings: Settings | None = None,
) -> Orthogonal:
    """The model of ``response`` in the ``candidates`` (`terms.pool`) that has the least predicted square error.

    Raises:
        InputError: unknown names, unequal time steps.
    """
    settings = settings or Settings()
    design = design_of(experiments, response, candidates, settings.constants, settings.units, settings.averaging)
    lengths = tuple(len(record.used) for record in design.records)
    if design.samples < 3 * len(experiments) + 3:
        return _nothing(design, settings, lengths, f"{design.samples} samples with {response} and all candidates")
    pool = candidates_of(design, settings)
    system = pool.system
    order, basis, triangle = orthogonalised(system.columns, system.response, most_terms)
    if not order:
        return _nothing(design, settings, lengths, "no candidate varies on its own")
    amplitudes = basis.T @ system.response
    functions = _functions([design.names[column] for column in order], amplitudes, system)
    kept = sum(function.kept for function in functions)
    terms = tuple(function.term for function in functions[:kept])
    model = solve(design.taking(terms), "time", settings, lengths)
    own = triangle[:kept, :kept] * pool.lengths[order[:kept]]
    return Orthogonal(functions, terms, own, amplitudes[:kept], _covariance(model, terms, own), model, model.failure)


def _functions(names: list[str], amplitudes: Array, system: System) -> tuple[Function, ...]:
    """The functions made of ``names`` (k,), those kept with which the predicted square error is least."""
    count, total = len(system.response), float(system.response @ system.response)
    fitted = np.arange(1, len(names) + 1) + system.basis.shape[1]
    pse = (total - np.cumsum(amplitudes**2)) / count + system.charge * fitted
    empty = total / count + system.charge * system.basis.shape[1]
    kept = int(np.argmin(pse)) + 1 if pse.min() < empty else 0
    free = max(system.independent - fitted[-1], 1.0)
    left = max(total - float(np.sum(amplitudes**2)), ROUNDING * total) / free
    chances = fisher.sf(amplitudes**2 / left, 1, free)
    return tuple(
        Function(name, float(a**2 / total), float(p), place < kept, float(chance))
        for place, (name, a, p, chance) in enumerate(zip(names, amplitudes, pse, chances, strict=True))
    )


def orthogonalised(columns: Array, response: Array, most: int) -> tuple[list[int], Array, Array]:
    """Order (k,) of the ``columns`` (N, p), orthonormal functions (N, k) and triangle (k, k): columns = functions R.

    At each place stands the column whose part orthogonal to those before it explains most of the ``response`` (N,).
    """
    rest, sizes = columns.copy(), np.sum(columns**2, axis=0)
    order: list[int] = []
    functions: list[Array] = []
    while len(order) < min(most, columns.shape[1]):
        squares = np.sum(rest**2, axis=0)
        alive = squares > ALIKE * sizes
        alive[order] = False
        if not np.any(alive):
            break
        gains = np.where(alive, (rest.T @ response) ** 2 / np.where(alive, squares, 1.0), -1.0)
        best = int(np.argmax(gains))
        own = rest[:, best]
        for function in functions:  # a second pass takes out what rounding left in the first
            own = own - function * (function @ own)
        order.append(best)
        functions.append(own / np.linalg.norm(own))
        rest = rest - np.outer(functions[-1], functions[-1] @ rest)
    basis = np.column_stack(functions) if functions else np.zeros((len(response), 0))
    return order, basis, np.triu(basis.T @ columns[:, order])


def _covariance(model: CoefficientRegression, terms: tuple[str, ...], triangle: Array) -> Array:
    """Covariance (k, k) of the functions' amplitudes: amplitudes are the triangle times the coefficients."""
    if model.failure or any(term not in model.names for term in terms):
        return np.full((len(terms), len(terms)), np.nan)
    places = [model.names.index(term) for term in terms]
    return np.asarray(triangle @ model.covariance[np.ix_(places, places)] @ triangle.T)


def _nothing(design: Design, settings: Settings, lengths: tuple[int, ...], why: str) -> Orthogonal:
    empty = np.zeros((0, 0))
    return Orthogonal((), (), empty, np.zeros(0), empty, solve(design.taking(()), "time", settings, lengths), why)
