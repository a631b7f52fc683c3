"""Coefficients of a measured quantity on named regressors, in the time or in the frequency domain: the way in.

settings = Settings(constants={"c": 0.2}, units={"c": "m"})
result = coefficient_regression((flight,), "C_L", ("alpha", "q*c/2V", "delta"), "time", settings)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.regression.averaging import as_regressed
from logs.identification.estimators.regression.design import INTERCEPT, Design, design_of, parameter_units
from logs.identification.estimators.regression.equation_error import Domain, Equations, Settings, equations
from logs.identification.estimators.regression.frequency_domain import bridged
from logs.identification.estimators.regression.least_squares import Fit, Piece, regress_records
from logs.identification.estimators.regression.terms import parse
from logs.identification.results import Array, Estimate, Unidentified, estimate
from logs.identification.statistics.collinearity import DEPENDENT, NOTABLE, Collinearity, collinearity
from logs.identification.statistics.goodness import Goodness, goodness
from wingbeat.errors import InputError

FOLLOWING = 100.0
"""-; condition index from which on a coefficient whose interval spans zero is refused"""


class CoefficientRegression(NamedTuple):
    """Outcome of one regression."""

    response: str
    """-; what was regressed"""
    unit: str
    """-; of the response"""
    domain: Domain
    names: tuple[str, ...]
    """-; (p,), of the fitted columns, the intercept first"""
    values: Array
    """(p,); response per regressor, also of what is not to be trusted on its own: predict with them"""
    covariance: Array
    """(p, p); corrected for coloured residuals"""
    degrees: Array
    """-; (p,), effective degrees of freedom"""
    estimates: tuple[Estimate, ...]
    """what the data gives"""
    unidentified: tuple[Unidentified, ...]
    """what it does not, and why"""
    goodness: Goodness
    """of the fit, over time"""
    collinearity: Collinearity | None
    """of the regressors asked for, without intercept and trends"""
    residuals: tuple[Array, ...]
    """as the response; (N_i,) of each manoeuvre, measured minus model, NaN where not used"""
    frequencies: Array
    """Hz; (F,), where the transform was taken; empty in the time domain"""
    samples: int
    """-; used"""
    notes: tuple[str, ...] = ()
    """what a reader must know"""
    failure: str = ""
    """-; why there are no numbers, empty when there are"""


class Told(NamedTuple):
    """What is known of the regressors before anything is fitted."""

    collinearity: Collinearity | None
    refused: dict[str, str]
    """-; why each regressor that depends on others has no coefficient, by name"""


def coefficient_regression(
    experiments: tuple[Experiment, ...],
    response: str,
    regressors: tuple[str, ...],
    domain: Domain = "time",
    settings: Settings | None = None,
) -> CoefficientRegression:
    """Least squares of ``response`` on ``regressors`` (`terms`) over all ``experiments`` (Grauer Eq. 17 to 21).

    A sample that lacks any of the signals is left out in the time domain; in the frequency domain short runs of them
    are interpolated. Regressors that follow one another are named in `unidentified`, the others keep their numbers.

    Raises:
        InputError: unknown names, unequal time steps, long runs without data, frequencies that the record cannot
            hold.
    """
    settings = settings or Settings()
    design = design_of(experiments, response, regressors, settings.constants, settings.units, settings.averaging)
    lengths = tuple(len(record.used) for record in design.records)
    if domain == "frequency":
        design = bridged(design, settings.longest_gap)
    return solve(design, domain, settings, lengths)


def solve(design: Design, domain: Domain, settings: Settings, lengths: tuple[int, ...]) -> CoefficientRegression:
    """The regression of a ``design`` whose experiments have ``lengths`` samples."""
    if not design.samples:
        return _failed(design, domain, f"no sample has {design.response} and all regressors")
    values = np.concatenate([record.response[record.used > 0] for record in design.records])
    if np.ptp(values) <= 0:
        return _failed(design, domain, f"{design.response} is {values[0]:g} throughout")
    asked = equations(design, domain, settings)
    if design.samples <= len(asked.names) + 2:
        return _failed(design, domain, f"{design.samples} samples for {len(asked.names)} parameters")
    told = _told(design, asked)
    kept = _independent(design, asked.separate) if told.refused else design.names
    solved = asked if kept == design.names else equations(design.taking(kept), domain, settings)
    if not solved.names:
        return _failed(design, domain, "; ".join(f"{name} {why}" for name, why in told.refused.items()))
    try:
        fit = _fit(solved, settings)
    except np.linalg.LinAlgError:
        return _failed(
            design, domain, "the samples leave nothing of the regressors or of the residuals to learn from"
        )
    return _result(design, domain, solved, fit, told, lengths)


def _fit(system: Equations, settings: Settings) -> Fit:
    """The solution, found with columns of unit size."""
    size = np.linalg.norm(np.vstack([p.regressors * p.used[:, None] for p in system.pieces]), axis=0)
    scale = np.where(size > 0, size, 1.0)
    pieces = tuple(Piece(p.regressors / scale, p.instruments / scale, p.response, p.used) for p in system.pieces)
    fit = regress_records(pieces, colour=settings.covariance)
    return fit._replace(values=fit.values / scale, covariance=fit.covariance / np.outer(scale, scale))


def _told(design: Design, asked: Equations) -> Told:
    if not design.names:
        return Told(None, {})
    diagnosis = collinearity(asked.separate, design.names)
    reasons: dict[str, str] = {}
    for name, inflation in zip(diagnosis.names, diagnosis.inflation, strict=True):
        if not np.isfinite(inflation):
            reasons[name] = "does not vary on its own: it is zero, or the mean or the trend over again"
    for group in diagnosis.groups(DEPENDENT):
        for name in group:
            others = ", ".join(other for other in group if other != name)
            reasons[name] = f"depends linearly on {others} in this data"
    return Told(diagnosis, reasons)


def _independent(design: Design, separate: Array) -> tuple[str, ...]:
    """The first of the design's names that are independent of those before them."""
    kept: list[int] = []
    for column in range(separate.shape[1]):
        tried = [*kept, column]
        told = collinearity(separate[:, tried], tuple(design.names[c] for c in tried))
        if np.all(told.indices <= DEPENDENT):
            kept = tried
    return tuple(design.names[column] for column in kept)


def _result(
    design: Design, domain: Domain, solved: Equations, fit: Fit, told: Told, lengths: tuple[int, ...]
) -> CoefficientRegression:
    found, weak = _sorted(design, solved, fit, told)
    why = "; ".join(f"{name} {reason}" for name, reason in weak.items())
    return CoefficientRegression(
        design.response,
        design.unit,
        domain,
        solved.names,
        fit.values,
        fit.covariance,
        fit.degrees_each,
        found,
        tuple(Unidentified(name, reason) for name, reason in weak.items()),
        _goodness(design, fit),
        told.collinearity,
        _split(fit.residuals, design, lengths),
        solved.frequencies,
        design.samples,
        _notes(told.collinearity, weak),
        "" if found else f"no coefficient can be told: {why}",
    )


def _sorted(design: Design, solved: Equations, fit: Fit, told: Told) -> tuple[tuple[Estimate, ...], dict[str, str]]:
    """What is known, and why the rest is not, by name."""
    units, errors = parameter_units(design), np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    found, weak = [], dict(told.refused)
    for index, name in enumerate(solved.names):
        if not solved.reported[index] or name in weak:
            continue
        degrees = float(fit.degrees_each[index])
        one = estimate(name, units.get(name, design.unit), float(fit.values[index]), float(errors[index]), degrees)
        others = _followed(told.collinearity, name) if one.contains(0.0) else ()
        if others:
            weak[name] = f"follows {', '.join(others)}: vary it on its own"
        else:
            found.append(one)
    return tuple(found), weak


def _followed(diagnosis: Collinearity | None, name: str) -> tuple[str, ...]:
    """The regressors that ``name`` follows so closely that its own part is not to be told."""
    groups = diagnosis.groups(FOLLOWING) if diagnosis else ()
    return next((tuple(n for n in group if n != name) for group in groups if name in group), ())


def _split(residuals: Array, design: Design, lengths: tuple[int, ...]) -> tuple[Array, ...]:
    """Residuals of each experiment (N_i,), NaN where not used."""
    parts, at = [], 0
    for record, length in zip(design.records, lengths, strict=True):
        part = np.full(length, np.nan)
        own = residuals[at : at + len(record.used)]
        part[record.start : record.start + len(own)] = np.where(record.used > 0, own, np.nan)
        parts.append(part)
        at += len(own)
    return tuple(parts)


def _goodness(design: Design, fit: Fit) -> Goodness:
    used = np.concatenate([record.used for record in design.records]) > 0
    measured = np.concatenate([record.response for record in design.records])
    return goodness(measured[used], (measured - fit.residuals)[used], len(fit.values))


def _notes(told: Collinearity | None, weak: dict[str, str]) -> tuple[str, ...]:
    groups = told.groups(NOTABLE) if told else ()
    return tuple(
        f"{', '.join(group)} follow one another: their coefficients are known better together than each"
        for group in groups
        if not all(name in weak for name in group)
    )


def _failed(design: Design, domain: Domain, why: str) -> CoefficientRegression:
    nothing = np.zeros(0)
    none = Goodness(np.nan, np.nan, np.nan, np.nan, 0)
    unidentified = tuple(Unidentified(name, why) for name in design.names)
    return CoefficientRegression(
        design.response, design.unit, domain, (), nothing, np.zeros((0, 0)), nothing, (), unidentified, none, None,
        (), nothing, design.samples, (), why,
    )  # fmt: skip


def predict(result: CoefficientRegression, experiment: Experiment, settings: Settings | None = None) -> Array:
    """The response (N,) that ``result`` gives for another ``experiment``, without trends; NaN where a regressor is.

    Raises:
        InputError: the result has no numbers, no intercept for all manoeuvres, or a regressor is missing.
    """
    if result.failure:
        raise InputError(f"{result.response}: {result.failure}")
    settings = settings or Settings()
    total = np.zeros(len(experiment.time))
    for name, value in zip(result.names, result.values, strict=True):
        if name == INTERCEPT:
            total += value
        elif " of " not in name:
            total += value * as_regressed(parse(name), experiment, settings.constants, settings.averaging)
    return total
