"""Stepwise regression: which of many terms a response needs (Grauer V.C; Klein & Morelli, 2006, ch. 5.4).

The candidate with the highest partial correlation with the residuals enters; then terms that have become superfluous
leave; until the stop rule is met. Every step is recorded with its reason and statistics.

Stop rules:
* ``F``: a term's partial F, the square of its coefficient over its standard error, with the autocorrelated noise of
  the largest model (lack of fit of an early model is not noise) and the term's degrees of freedom. A term enters if
  its p-value is below `Rules.significance` divided by the number of candidates; it leaves above
  `Rules.significance`.
* ``PSE``: the predicted square error falls.
* ``PRESS``: the mean square error of blocks of samples predicted from the others falls.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.special import fdtrc

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import (
    CoefficientRegression,
    Settings,
    one_response,
    regression_result,
    settings_of,
    solve,
)
from logs.identification.estimators.least_squares import CovarianceKind, Fit, regress_records
from logs.identification.estimators.model_structure import (
    Candidates,
    Statistics,
    blocks_of,
    candidates_of,
    independent,
    partial_correlations,
    partial_f,
    statistics_of,
)
from logs.identification.estimators.registry import Request
from logs.identification.results import EstimationResult


class Rules(NamedTuple):
    """Stop rule of stepwise regression."""

    stop: Literal["F", "PSE", "PRESS"] = "F"
    significance: float = 0.05
    """-; largest p-value of a term; divided by the number of candidates for one that enters"""
    least_gain: float = 0.0
    """-; increase of R^2 that a term must give, 0.005 in Klein & Morelli"""
    most_terms: int = 12
    """-; in the model, without the intercept"""
    always: tuple[str, ...] = ()
    """-; terms that are forced into the model"""


class Step(NamedTuple):
    """One step."""

    action: Literal["start", "enters", "leaves", "stops"]
    term: str
    """-; the term that entered, left or was rejected; empty at the start, or if no candidate was left"""
    why: str
    """-; one clause"""
    partial_correlation: float
    """-; of the term with the residuals of the model before; NaN if there is no term"""
    partial_f: float
    """-; of the term, for white residuals; NaN if there is no term"""
    colored_f: float
    """-; of the term, for autocorrelated residuals; NaN if there is no term"""
    probability: float
    """-; p-value of that; NaN if there is no term"""
    terms: tuple[str, ...]
    """-; in the model after the step"""
    statistics: Statistics
    """of the model after the step"""


class Stepwise(NamedTuple):
    """Result of stepwise regression."""

    model: CoefficientRegression
    """the chosen terms' coefficients"""
    terms: tuple[str, ...]
    """-; chosen, in the order in which they entered"""
    steps: tuple[Step, ...]
    independent: float
    """-; effective number of independent samples"""
    failure: str = ""
    """-; why there is no model, empty if there is"""


class _Pool(NamedTuple):
    """Candidates and stop rule."""

    candidates: Candidates
    rules: Rules
    always: tuple[int, ...]


class _Test(NamedTuple):
    """F test of one term for autocorrelated residuals."""

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
        InputError: unknown names, unequal sampling intervals.
    """
    rules, settings = rules or Rules(), settings or Settings()
    candidates = tuple(dict.fromkeys((*rules.always, *candidates)))
    design = settings.design(experiments, response, candidates)
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
    return Stepwise(model, terms, tuple(steps), pool.candidates.effective, model.failure)


def _walk(pool: _Pool) -> list[Step]:
    """All steps from the forced terms."""
    chosen = pool.always
    steps = [_step(pool, "start", None, "", chosen)]
    visited = {frozenset(chosen)}
    while True:
        entered = _enter(pool, chosen)
        steps.append(entered[1])
        if entered[0] is None or frozenset(entered[0]) in visited:
            if entered[0] is not None:
                steps[-1] = _step(pool, "stops", entered[0][-1], "it entered and left before", chosen)
            return steps
        chosen = entered[0]
        visited.add(frozenset(chosen))
        while (left := _leave(pool, chosen)) is not None:
            chosen = left[0]
            steps.append(left[1])


def _enter(pool: _Pool, chosen: tuple[int, ...]) -> tuple[tuple[int, ...] | None, Step]:
    """The model with one more term, or None, and the step with the reason."""
    correlations = partial_correlations(pool.candidates, chosen)
    for column in np.argsort(-np.abs(correlations)):
        if correlations[column] == 0 or not independent(pool.candidates, (*chosen, int(column))):
            correlations[column] = 0.0
    best = int(np.argmax(np.abs(correlations))) if len(correlations) else 0
    if len(chosen) >= pool.rules.most_terms:
        return None, _step(pool, "stops", None, f"{pool.rules.most_terms} terms are the most allowed", chosen)
    if not len(correlations) or correlations[best] == 0:
        return None, _step(pool, "stops", None, "no candidate is left that is independent of the terms", chosen)
    trial = (*chosen, best)
    tests = _tests(pool, trial)
    if tests is None:
        return None, _step(pool, "stops", best, "too few samples for one more term", chosen)
    accepted, why = _accepted(pool, chosen, trial, tests[-1])
    step = _step(pool, "enters" if accepted else "stops", best, why, trial if accepted else chosen)
    step = _with_statistics(step, pool, trial, best, tests[-1], float(correlations[best]))
    return (trial if accepted else None), step


def _accepted(pool: _Pool, chosen: tuple[int, ...], trial: tuple[int, ...], test: _Test) -> tuple[bool, str]:
    """Whether the stop rule accepts the last of ``trial``, and why."""
    before, after = (statistics_of(pool.candidates, columns) for columns in (chosen, trial))
    gain = after.r_squared - before.r_squared
    if gain < pool.rules.least_gain:
        return False, f"R^2 would rise by {gain:.2g} only"
    if pool.rules.stop == "F":
        level = pool.rules.significance / (len(pool.candidates.names) - len(chosen))
        return test.probability < level, f"probability of its F by chance {test.probability:.2g}, limit {level:.2g}"
    old, new = (before.pse, after.pse) if pool.rules.stop == "PSE" else (before.press, after.press)
    return new < old, f"{pool.rules.stop} {'falls' if new < old else 'does not fall'}: from {old:.4g} to {new:.4g}"


def _leave(pool: _Pool, chosen: tuple[int, ...]) -> tuple[tuple[int, ...], Step] | None:
    """The model without its least significant term and the step, None if all are needed."""
    tests = _tests(pool, chosen) if len(chosen) > 1 else None
    free = [i for i, column in enumerate(chosen) if column not in pool.always]
    if tests is None or not free:
        return None
    worst = min(free, key=lambda i: tests[i].f)
    column, rest = chosen[worst], tuple(c for c in chosen if c != chosen[worst])
    leaves, why = _superfluous(pool, chosen, rest, tests[worst])
    if not leaves:
        return None
    return rest, _with_statistics(
        _step(pool, "leaves", column, why, rest), pool, chosen, column, tests[worst], np.nan
    )


def _superfluous(pool: _Pool, chosen: tuple[int, ...], rest: tuple[int, ...], test: _Test) -> tuple[bool, str]:
    if pool.rules.stop == "F":
        limit = pool.rules.significance
        return test.probability > limit, f"probability of its F by chance {test.probability:.2g}, limit {limit:.2g}"
    with_, without = (statistics_of(pool.candidates, columns) for columns in (chosen, rest))
    old, new = (with_.pse, without.pse) if pool.rules.stop == "PSE" else (with_.press, without.press)
    return new < old, f"{pool.rules.stop} falls without it: from {old:.4g} to {new:.4g}"


def _tests(pool: _Pool, chosen: tuple[int, ...]) -> list[_Test] | None:
    """F of each of the ``chosen``; None if there are too few samples."""
    if len(pool.candidates.response) <= pool.candidates.nuisances + len(chosen) + 2:
        return None
    try:
        kind: CovarianceKind = "white" if pool.candidates.steady else "autocorrelated"
        fit = regress_records(blocks_of(pool.candidates, chosen), kind, pool.candidates.noise)
    except np.linalg.LinAlgError:
        return None
    return [_test(fit, pool.candidates.nuisances + index) for index in range(len(chosen))]


def _test(fit: Fit, index: int) -> _Test:
    variance = float(fit.covariance[index, index])
    f = float(fit.values[index]) ** 2 / variance if variance > 0 else np.inf
    return _Test(f, float(fdtrc(1.0, fit.degrees, f)) if np.isfinite(f) else 0.0)


def _step(
    pool: _Pool,
    action: Literal["start", "enters", "leaves", "stops"],
    column: int | None,
    why: str,
    chosen: tuple[int, ...],
) -> Step:
    names = tuple(pool.candidates.names[c] for c in chosen)
    term = "" if column is None else pool.candidates.names[column]
    missing = (np.nan, np.nan, np.nan, np.nan)
    return Step(action, term, why, *missing, names, statistics_of(pool.candidates, chosen))


def _with_statistics(
    step: Step, pool: _Pool, trial: tuple[int, ...], column: int, test: _Test, correlation: float
) -> Step:
    """``step`` with the statistics of its term."""
    return step._replace(
        partial_correlation=correlation,
        partial_f=partial_f(pool.candidates, trial, column),
        colored_f=test.f,
        probability=test.probability,
    )


def estimate_stepwise(request: Request) -> EstimationResult:
    """Stepwise regression of a request; options as the fields of `Rules`."""
    rules = Rules(**{name: value for name, value in request.options.items() if name in Rules._fields})
    found = stepwise_regression(
        request.experiments, one_response(request), request.regressors, rules, settings_of(request)
    )
    return regression_result("stepwise", request, found.model, steps=found.steps)
