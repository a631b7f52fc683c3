"""Recursive least squares with forgetting: the time history of the estimates (Klein & Morelli, 2006, ch. 8).

With the forgetting factor lambda the estimate at sample k minimizes the sum over i of lambda^(k - i) r_i^2. Its
information matrix and right-hand side are first-order recursions over the samples. The covariance is exact for white
residuals: R^-1 S R^-1 sigma^2, R the sum of lambda^(k - i) x x^T and S that of lambda^(2 (k - i)) x x^T. Without
forgetting the last estimate is that of ordinary least squares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import (
    Settings,
    coefficient_regression,
    one_response,
    predict,
    settings_of,
)
from logs.identification.estimators.least_squares import MAX_CONDITION
from logs.identification.estimators.registry import Request
from logs.identification.estimators.regressors import INTERCEPT, as_regressed
from logs.identification.estimators.terms import parse
from logs.identification.findings import of_severity
from logs.identification.results import Array, EstimationResult, FitSeries, estimates
from wingbeat.errors import InputError


class History(NamedTuple):
    """Time history of one parameter."""

    name: str
    unit: str
    time: Array
    """s; (N,), of all maneuvers one after the other"""
    value: Array
    """as `unit`; (N,), NaN until the samples determine it"""
    standard_error: Array
    """as `unit`; (N,)"""


class Recursive(NamedTuple):
    """Estimates after every sample."""

    names: tuple[str, ...]
    """-; (p,), the intercept first"""
    histories: tuple[History, ...]
    covariance: Array
    """(p, p); after the last sample"""
    degrees: float
    """-; degrees of freedom after the last sample"""
    predictions: tuple[Array, ...]
    """as the response; (N_i,) of each maneuver: response predicted from the estimate one sample before"""


def recursive_least_squares(
    experiments: tuple[Experiment, ...],
    response: str,
    regressors: tuple[str, ...],
    forgetting: float = 1.0,
    settings: Settings | None = None,
) -> Recursive:
    """Estimates of ``response`` on ``regressors`` and an intercept after every sample; missing samples are skipped.

    Raises:
        InputError: a forgetting factor outside (0, 1], unknown names, unequal sampling intervals.
    """
    if not 0.0 < forgetting <= 1.0:
        raise InputError(f"forgetting must be above 0 and at most 1, not {forgetting:g}")
    settings = settings or Settings()
    design = settings.design(experiments, response, regressors)
    used = np.concatenate([record.used for record in design.records])
    columns = np.vstack([record.regressors for record in design.records])
    x = np.column_stack((used, columns))
    y = np.concatenate([record.response for record in design.records])
    scale = np.where((size := np.linalg.norm(x, axis=0)) > 0, size, 1.0)
    x, center = x / scale, float(y[used > 0].mean()) if np.any(used) else 0.0
    centered = (y - center) * used
    outer = x[:, :, None] * x[:, None, :]
    information, squared = (_weighted_sums(outer, factor) for factor in (forgetting, forgetting**2))
    right = _weighted_sums(x * centered[:, None], forgetting)
    squares, weight = (_weighted_sums(one, forgetting) for one in (centered**2, used))
    known = np.linalg.cond(information) < MAX_CONDITION
    inverse = np.full_like(information, np.nan)
    inverse[known] = np.linalg.inv(information[known])
    values = np.einsum("npq,nq->np", inverse, right)
    # Expected squares of the residuals in variances (Klein & Morelli 5.20, weighted).
    degrees = weight - np.einsum("npq,nqp->n", inverse, squared)
    left = np.maximum(squares - np.einsum("np,np->n", right, values), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = np.where(degrees > 0.5, left / degrees, np.nan)
    covariance = inverse @ squared @ inverse * variance[:, None, None] / np.outer(scale, scale)
    values = values / scale
    values[:, 0] += center
    errors = np.sqrt(np.maximum(np.einsum("npp->np", covariance), 0.0))
    units = {INTERCEPT: design.unit, **design.parameter_units}
    time = np.concatenate([one.time for one in experiments])
    histories = tuple(
        History(name, unit, time, values[:, n], errors[:, n]) for n, (name, unit) in enumerate(units.items())
    )
    before = np.vstack((np.full((1, len(scale)), np.nan), values[:-1]))
    predicted = np.where(used > 0, np.einsum("np,np->n", x * scale, before), np.nan)
    edges = np.cumsum([len(record.used) for record in design.records])[:-1]
    free = float(weight[-1] ** 2 / _weighted_sums(used, forgetting**2)[-1]) if weight[-1] > 0 else 0.0
    return Recursive(tuple(units), histories, covariance[-1], free - len(units), tuple(np.split(predicted, edges)))


def _weighted_sums(values: Array, factor: float) -> Array:
    """Sums (N, ...) over the samples up to each one, older ones weighted by ``factor`` per sample."""
    return np.asarray(lfilter([1.0], [1.0, -factor], values, axis=0))


def estimate_recursively(request: Request) -> EstimationResult:
    """Recursive least squares of a request, the values at the end; option ``forgetting``."""
    response, settings = one_response(request), settings_of(request)
    batch = coefficient_regression(request.experiments, response, request.regressors, "time", settings)
    withheld = of_severity(batch.findings, "withheld")
    terms = tuple(name for name in request.regressors if name in batch.names)
    if not batch.estimates:
        return EstimationResult("recursive_least_squares", status="not identifiable", findings=withheld)
    found = recursive_least_squares(
        request.experiments, response, terms, float(request.options.get("forgetting", 1.0)), settings
    )
    last = np.array([one.value[-1] for one in found.histories])
    units = {one.name: one.unit for one in found.histories}
    target = parse(response)
    series = [
        FitSeries(
            one.name, response, batch.unit, one.time,
            as_regressed(target, one, settings.constants, settings.averaging), predicted,
        )
        for one, predicted in zip(request.experiments, found.predictions, strict=True)
    ]  # fmt: skip
    final = batch._replace(names=found.names, values=last)
    for one in request.held_out:
        measured = as_regressed(target, one, settings.constants, settings.averaging)
        series.append(
            FitSeries(one.name, response, batch.unit, one.time, measured, predict(final, one, settings), True)
        )
    return EstimationResult(
        "recursive_least_squares", equations=(f"{response} = " + " + ".join(found.names),),
        estimates=estimates(units, last, found.covariance, found.degrees), covariance=found.covariance,
        degrees=found.degrees, series=tuple(series), samples=batch.samples, findings=batch.findings,
        steps=found.histories,
    )  # fmt: skip
