"""Stepwise regression: which of many terms a response needs (Grauer V.C; Klein & Morelli, 2006, ch. 5.4).

The candidate of the highest partial correlation with what the model leaves enters; then whatever has become
superfluous leaves; until the stop rule says no. Every step is recorded with why and with all statistics.

The rules:
* ``F``: a term's partial F, the square of its coefficient over its standard error, with the colour of the noise that
  the most complete model leaves (what an early model lacks is no noise) and the term's own degrees of freedom. What
  enters must be less probable by chance than `Rules.significance` shared among the candidates; what stays, than
  `Rules.significance`.
* ``PSE``: the predicted square error falls. Its charge for a term is a multiple of what chance gives: few terms.
* ``PRESS``: the mean square error of runs of samples predicted from the others falls.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.special import fdtrc

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.regression.candidates import Candidates, candidates_of, determined, pieces_of
from logs.identification.estimators.regression.coefficients import CoefficientRegression, solve
from logs.identification.estimators.regression.design import design_of
from logs.identification.estimators.regression.equation_error import Settings
from logs.identification.estimators.regression.least_squares import Fit, regress_records
from logs.identification.estimators.regression.statistics import (
    Statistics,
    partial_correlations,
    partial_f,
    statistics_of,
)


class Rules(NamedTuple):
    """When stepwise regression takes a term and when it stops."""

    stop: Literal["F", "PSE", "PRESS"] = "F"
    significance: float = 0.05
    """-; probability of a term by chance; shared among the candidates where one enters"""
    least_gain: float = 0.0
    """-; R^2 that a term must add, 0.005 in Klein & Morelli"""
    most_terms: int = 12
    """-; in the model, the intercept aside"""
    always: tuple[str, ...] = ()
    """-; terms that are in from the start and stay"""


class Step(NamedTuple):
    """One step."""

    action: Literal["start", "enters", "leaves", "stops"]
    term: str
    """-; the one that came, went or was refused; empty at the start, and where no candidate was left"""
    why: str
    """-; one clause"""
    partial_correlation: float
    """-; of the term with what the model before it left; NaN where none"""
    partial_f: float
    """-; of the term, as published (white residuals); NaN where none"""
    coloured_f: float
    """-; of the term, its error by the recipe for coloured residuals; NaN where none"""
    probability: float
    """-; of that by chance; NaN where none"""
    terms: tuple[str, ...]
    """-; in the model after the step"""
    statistics: Statistics
    """of the model after the step"""


class Stepwise(NamedTuple):
    """Outcome of stepwise regression."""

    model: CoefficientRegression
    """the chosen terms' coefficients"""
    terms: tuple[str, ...]
    """-; chosen, in the order in which they entered"""
    steps: tuple[Step, ...]
    independent: float
    """-; independent samples, by which the rules count"""
    failure: str = ""
    """-; why there is no model, empty when there is"""


class _Pool(NamedTuple):
    """Candidates and by what they are judged."""

    candidates: Candidates
    rules: Rules
    always: tuple[int, ...]


class _Test(NamedTuple):
    """Coloured F test of one term."""

    f: float
    probability: float


def stepwise_regression(
    experiments: tuple[Experiment, ...],
    response: str,
    candidates: tuple[str, ...],
    rules: Rules | None = None,
    settings: Settings | None = None,
) -> Stepwise:
    """The terms of ``candidates`` (`terms.pool` makes powers and products) that ``response`` needs.

    In the time domain; take the terms to `coefficient_regression` for the frequency domain.

    Raises:
        InputError: unknown names, unequal time steps.
    """
    rules, settings = rules or Rules(), settings or Settings()
    candidates = tuple(dict.fromkeys((*rules.always, *candidates)))
    design = design_of(experiments, response, candidates, settings.constants, settings.units, settings.averaging)
    lengths = tuple(len(record.used) for record in design.records)
    least = len(rules.always) + len(experiments) * (2 + (settings.trend or 0)) + 3
    if design.samples < least:
        why = f"{design.samples} samples with {response} and all candidates: {least} are the least"
        return Stepwise(solve(design.taking(()), "time", settings, lengths), (), (), float(design.samples), why)
    always = tuple(candidates.index(name) for name in rules.always)
    pool = _Pool(candidates_of(design, settings), rules, always)
    steps = _walk(pool)
    terms = steps[-1].terms
    model = solve(design.taking(terms), "time", settings, lengths)
    return Stepwise(model, terms, tuple(steps), pool.candidates.system.independent, model.failure)


def _walk(pool: _Pool) -> list[Step]:
    """All steps from the terms that are always in."""
    chosen = pool.always
    steps = [_step(pool, "start", None, "", chosen)]
    seen = {frozenset(chosen)}
    while True:
        entered = _enter(pool, chosen)
        steps.append(entered[1])
        if entered[0] is None or frozenset(entered[0]) in seen:
            if entered[0] is not None:
                steps[-1] = _step(pool, "stops", entered[0][-1], "it came and went before", chosen)
            return steps
        chosen = entered[0]
        seen.add(frozenset(chosen))
        while (left := _leave(pool, chosen)) is not None:
            chosen = left[0]
            steps.append(left[1])


def _enter(pool: _Pool, chosen: tuple[int, ...]) -> tuple[tuple[int, ...] | None, Step]:
    """The model with one more term, or None, and the step that tells why."""
    correlations = partial_correlations(pool.candidates.system, chosen)
    for column in np.argsort(-np.abs(correlations)):
        if correlations[column] == 0 or not determined(pool.candidates, (*chosen, int(column))):
            correlations[column] = 0.0
    best = int(np.argmax(np.abs(correlations))) if len(correlations) else 0
    if len(chosen) >= pool.rules.most_terms:
        return None, _step(pool, "stops", None, f"{pool.rules.most_terms} terms are the most allowed", chosen)
    if not len(correlations) or correlations[best] == 0:
        return None, _step(pool, "stops", None, "no candidate is left that is independent of the terms", chosen)
    trial = (*chosen, best)
    tests = _tests(pool, trial)
    if tests is None:
        return None, _step(pool, "stops", best, "the samples do not bear one more term", chosen)
    accepted, why = _accepted(pool, chosen, trial, tests[-1])
    step = _step(pool, "enters" if accepted else "stops", best, why, trial if accepted else chosen)
    step = _told(step, pool, trial, best, tests[-1], float(correlations[best]))
    return (trial if accepted else None), step


def _accepted(pool: _Pool, chosen: tuple[int, ...], trial: tuple[int, ...], test: _Test) -> tuple[bool, str]:
    """Whether the stop rule takes the last of ``trial``, and why."""
    before, after = (statistics_of(pool.candidates.system, columns) for columns in (chosen, trial))
    gain = after.r_squared - before.r_squared
    if gain < pool.rules.least_gain:
        return False, f"R^2 would rise by {gain:.2g} only"
    if pool.rules.stop == "F":
        level = pool.rules.significance / (len(pool.candidates.names) - len(chosen))
        return test.probability < level, f"probability of its F by chance {test.probability:.2g}, limit {level:.2g}"
    old, new = (before.pse, after.pse) if pool.rules.stop == "PSE" else (before.press, after.press)
    return new < old, f"{pool.rules.stop} {'falls' if new < old else 'does not fall'}: from {old:.4g} to {new:.4g}"


def _leave(pool: _Pool, chosen: tuple[int, ...]) -> tuple[tuple[int, ...], Step] | None:
    """The model without its most superfluous term and the step, None where all are needed."""
    tests = _tests(pool, chosen) if len(chosen) > 1 else None
    free = [i for i, column in enumerate(chosen) if column not in pool.always]
    if tests is None or not free:
        return None
    worst = min(free, key=lambda i: tests[i].f)
    column, rest = chosen[worst], tuple(c for c in chosen if c != chosen[worst])
    goes, why = _superfluous(pool, chosen, rest, tests[worst])
    if not goes:
        return None
    return rest, _told(_step(pool, "leaves", column, why, rest), pool, chosen, column, tests[worst], np.nan)


def _superfluous(pool: _Pool, chosen: tuple[int, ...], rest: tuple[int, ...], test: _Test) -> tuple[bool, str]:
    if pool.rules.stop == "F":
        limit = pool.rules.significance
        return test.probability > limit, f"probability of its F by chance {test.probability:.2g}, limit {limit:.2g}"
    with_, without = (statistics_of(pool.candidates.system, columns) for columns in (chosen, rest))
    old, new = (with_.pse, without.pse) if pool.rules.stop == "PSE" else (with_.press, without.press)
    return new < old, f"{pool.rules.stop} falls without it: from {old:.4g} to {new:.4g}"


def _tests(pool: _Pool, chosen: tuple[int, ...]) -> list[_Test] | None:
    """Coloured F of each of the ``chosen``; None where the fit cannot be had."""
    if len(pool.candidates.system.response) <= pool.candidates.nuisances + len(chosen) + 2:
        return None
    try:
        fit = regress_records(pieces_of(pool.candidates, chosen), noise=pool.candidates.noise)
    except np.linalg.LinAlgError:
        return None
    return [_test(fit, pool.candidates.nuisances + index) for index in range(len(chosen))]


def _test(fit: Fit, index: int) -> _Test:
    variance = float(fit.covariance[index, index])
    f = float(fit.values[index]) ** 2 / variance if variance > 0 else np.inf
    return _Test(f, float(fdtrc(1.0, float(fit.degrees_each[index]), f)) if np.isfinite(f) else 0.0)


def _step(
    pool: _Pool,
    action: Literal["start", "enters", "leaves", "stops"],
    column: int | None,
    why: str,
    chosen: tuple[int, ...],
) -> Step:
    names = tuple(pool.candidates.names[c] for c in chosen)
    term = "" if column is None else pool.candidates.names[column]
    nothing = (np.nan, np.nan, np.nan, np.nan)
    return Step(action, term, why, *nothing, names, statistics_of(pool.candidates.system, chosen))


def _told(step: Step, pool: _Pool, trial: tuple[int, ...], column: int, test: _Test, correlation: float) -> Step:
    """``step`` with the statistics of its term."""
    return step._replace(
        partial_correlation=correlation,
        partial_f=partial_f(pool.candidates.system, trial, column),
        coloured_f=test.f,
        probability=test.probability,
    )
