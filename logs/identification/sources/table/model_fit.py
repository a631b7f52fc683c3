"""[modes] and [[aero.output_error]] of a map: a model fitted to the outputs by maximum likelihood."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, cast

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import bridged, measured_pieces
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import FASTEST_TURN, LEAST_RUN, aliased_mode, coarse_inputs
from logs.identification.diagnostics.model_structure import (
    conditional_estimates,
    has_lack_of_fit,
    omitted_effects,
    widened,
)
from logs.identification.diagnostics.table import diagnose
from logs.identification.estimators.engine.problem import Fit, Nuisances, Problem
from logs.identification.estimators.engine.problem import Parameter as FitParameter
from logs.identification.estimators.filter_error import filter_error_search
from logs.identification.estimators.initial_values import SPANS, best_delay, start_values
from logs.identification.estimators.output_error import Method, Search, fitted_series, output_error, predicted
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.estimators.terms import quotient
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Estimate, EstimationResult, FitSeries
from logs.identification.sources.table.config import DELAY, OutputError
from logs.identification.sources.table.derived import check_distinct
from logs.identification.sources.table.maneuvers import DataSplit
from logs.identification.sources.table.models import LONGEST_DELAY, Chosen, chosen_model
from logs.identification.sources.table.signals import LONGEST_FILL
from wingbeat.errors import InputError
from wingbeat.text import pluralize

RANDOM_STARTS = Search(starts=4, fallback=False)
"""if Gauss-Newton does not converge from any other start"""
Estimator = Callable[[Problem, Search], tuple[Problem, Fit]]


def _filter_error(problem: Problem, search: Search) -> tuple[Problem, Fit]:
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            found = filter_error_search(problem, None, search)
    except np.linalg.LinAlgError:
        raise InputError("filter error: the covariance of the innovations is singular") from None
    return found.problem, found.fit


METHODS: dict[str, tuple[str, Estimator]] = {
    "output_error": ("output error", lambda problem, search: (problem, output_error(problem, search))),
    "filter_error": ("filter error", _filter_error),
}
"""by the word in the map: title, and (problem, search) -> the problem as solved and its fit"""
DELAY_SHARE, LEAST_DELAY_STEPS = 0.5, 2.0
"""-; squares of the equations' errors that a delay leaves, and its sampling intervals, from which it is reported"""

register({
    "interpolated_inputs": Entry("{where}: {value:.0f} samples of {subject} interpolated", "Short gaps of an input."),
    "skipped_samples": Entry(
        "{where}: {value:.0f} samples without {subject} left out",
        "Samples without an input, or pieces that are too short, cut the maneuver.",
    ),
    "no_numbers": Entry("{reason}", "The search did not end at an optimum of the likelihood."),
    "input_delay": Entry(
        "{subject} {amount:.2g} s {direction} fits the equations far better",
        "The model's equations, fitted to the measured states, find a delay of the inputs.",
        "set delay = \"free\"",
    ),
})  # fmt: skip


class ModelFit(NamedTuple):
    """A fit by maximum likelihood with what it was made of."""

    result: EstimationResult
    fit: Fit
    chosen: Chosen


class Driven(NamedTuple):
    """Maneuvers whose inputs have every sample."""

    experiments: tuple[Experiment, ...]
    findings: tuple[Finding, ...]


def model_fit(subject: str, section: OutputError, data: DataSplit) -> ModelFit:
    """One fit over all maneuvers, and its prediction of the held-out ones.

    Raises:
        InputError: a signal, constant or parameter that the model does not have or needs and is not there.
    """
    constants = data.constants
    check_distinct(data.fitted, section.inputs, section.outputs, subject)
    title, estimator = METHODS[section.method]
    chosen = chosen_model(section, constants, data.fitted)
    fitted = driven(data.fitted, chosen, data.fill)
    held = driven(data.held_out, chosen, data.fill) if data.held_out else Driven((), ())
    starts, problem, fit = _likeliest(section, chosen, fitted.experiments, constants, estimator)
    aliased = _aliased(fit, section, chosen, data.fitted)
    lines = {name: chosen.aliases.get(name, name) for name in section.inputs if name not in section.zoh_inputs}
    simulated = not aliased and section.method == "output_error"
    effects = () if not simulated else omitted_effects(problem, fit, constants, lines, chosen.unnamed)
    fit = widened(fit, effects)
    conditional = conditional_estimates(problem, fit) if simulated else ()
    dependent = {one.subject for one in conditional}
    fit = fit._replace(estimates=tuple(one for one in fit.estimates if one.name not in dependent))
    series = (*fitted_series(problem, fit), *(predicted(problem, fit, held.experiments) if held.experiments else ()))
    result = EstimationResult(
        section.method, subject, section.model, chosen.equations, fit.status, tuple(map(shortened, fit.estimates)),
        _covariance(fit), fit.degrees, (), series, sum(len(one.time) for one in fitted.experiments),
        initial={name: value for name, value in starts.items() if name not in chosen.fixed}, fixed=chosen.fixed,
        title=f"{title}, {section.model}", unnamed=chosen.unnamed,
    )  # fmt: skip
    if aliased:
        result = result._replace(status="not converged", estimates=(), covariance=None, series=())
    context = Context(
        data.fitted,
        constants,
        section.inputs,
        section.outputs,
        section.zoh_inputs,
        result,
        chosen.linear,
        data.averaged,
    )
    findings = (
        *_failure(fit, aliased), *chosen.findings, *conditional, *(one.finding for one in effects),
        *diagnose("model", context),
        *_input_delay(section, chosen, fitted.experiments, constants, series, fit),
        *fitted.findings, *held.findings,
    )  # fmt: skip
    return ModelFit(result._replace(findings=findings), fit, chosen)


def fit_by_row(subject: str, section: OutputError, data: DataSplit) -> EstimationResult:
    """The fit of a model by another row of the registry, from the start values of equation error.

    Raises:
        InputError: as `model_fit`.
    """
    check_distinct(data.fitted, section.inputs, section.outputs, subject)
    chosen = chosen_model(section, data.constants, data.fitted)
    fitted = driven(data.fitted, chosen, data.fill).experiments
    held = driven(data.held_out, chosen, data.fill).experiments if data.held_out else ()
    starts = start_values(chosen.model, chosen.parameters, fitted, data.constants, chosen.linear)
    parameters = _problem(section, chosen, fitted, starts).parameters
    row = ESTIMATORS[section.method]
    request = Request(
        fitted, held, tuple(chosen.model.inputs), section.outputs, (), chosen.model, parameters, data.constants
    )
    found = row.estimate(request)
    return found._replace(
        subject=subject, model=section.model, equations=found.equations or chosen.equations,
        title=f"{row.title}, {section.model}", fixed=chosen.fixed,
    )  # fmt: skip


def _covariance(fit: Fit) -> np.ndarray | None:
    if not fit.estimates:
        return None
    places = [fit.names.index(one.name) for one in fit.estimates]
    return np.asarray(fit.covariance[np.ix_(places, places)])


def _failure(fit: Fit, aliased: Finding | None) -> tuple[Finding, ...]:
    """Why there is no number, or which parameters have none."""
    if aliased is not None:
        return (aliased,)
    failed = (Finding("no_numbers", "withheld", details={"reason": fit.failure}),) if fit.failure else ()
    return (*failed, *(one for one in fit.findings if one.subject or one.severity != "withheld"))


def _aliased(fit: Fit, section: OutputError, chosen: Chosen, experiments: tuple[Experiment, ...]) -> Finding | None:
    """The finding of a mode that the samples cannot show; None if there is none."""
    if fit.failure or not chosen.linear:
        return None
    roots = np.linalg.eigvals(chosen.system_of(fit)(fit.values))
    step = min(one.step for one in experiments)
    fastest = float(np.max(np.abs(roots.imag), initial=0.0))
    turning = float(np.max(np.abs(roots[roots.imag > 0]), initial=0.0))
    coarse = coarse_inputs([name for name in section.inputs if name not in section.zoh_inputs], experiments)
    if fastest * step > np.pi or (coarse and turning * step > FASTEST_TURN):
        return aliased_mode(turning or fastest, step)
    return None


def _input_delay(
    section: OutputError,
    chosen: Chosen,
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    series: tuple[FitSeries, ...],
    fit: Fit,
) -> tuple[Finding, ...]:
    """A large delay of the inputs by the model's equations, if the outputs are not followed."""
    if section.delay.fixed != 0.0 or not section.inputs or not (fit.failure or has_lack_of_fit(series)):
        return ()
    delay, share = best_delay(chosen.model, chosen.parameters, experiments, constants, chosen.linear)
    least = LEAST_DELAY_STEPS * max(one.step for one in experiments)
    if share >= DELAY_SHARE or abs(delay) <= least:
        return ()
    details = {"amount": abs(delay), "direction": "late" if delay > 0 else "early"}
    return (Finding("input_delay", "warning", ", ".join(section.inputs), delay, least, details),)


def driven(experiments: tuple[Experiment, ...], chosen: Chosen, fill: float | None) -> Driven:
    """The maneuvers, short gaps of their inputs interpolated, cut at longer ones.

    Raises:
        InputError: an input is not among the signals, or no run with all of them is long enough.
    """
    pieces: list[Experiment] = []
    findings: list[Finding] = []
    inputs = tuple(chosen.model.inputs)
    for experiment in map(chosen.about, experiments):
        for name in inputs:
            if name not in experiment.signals:
                raise InputError(f"input {name} is not in [signals]; there are {', '.join(experiment.signals)}")
        samples = LONGEST_FILL if fill is None else int(fill / experiment.step + 1e-9)
        whole = bridged(experiment, inputs, samples)
        where = {"where": experiment.name}
        for name in inputs:
            count = int(np.isfinite(whole.signals[name]).sum() - np.isfinite(experiment.signals[name]).sum())
            if count:
                findings.append(Finding("interpolated_inputs", "info", name, float(count), None, where))
        found = measured_pieces(whole, inputs, LEAST_RUN)
        lost = len(experiment.time) - sum(len(piece.time) for piece in found)
        if lost:
            findings.append(Finding("skipped_samples", "info", ", ".join(inputs), float(lost), None, where))
        pieces += found
    if not pieces:
        longest = max(len(one.time) for one in experiments)
        if longest < LEAST_RUN or not inputs:
            raise InputError(f"the longest maneuver has {pluralize(longest, 'sample')}: it takes {LEAST_RUN}")
        raise InputError(f"no {LEAST_RUN} samples on end have every input ({', '.join(inputs)})")
    return Driven(tuple(map(chosen.from_trim, pieces)), tuple(findings))


def _bounds(chosen: Chosen, name: str) -> tuple[float, float]:
    one = chosen.parameters.get(name)
    return (-math.inf, math.inf) if one is None else (one.low, one.high)


def _problem(
    section: OutputError, chosen: Chosen, experiments: tuple[Experiment, ...], values: Mapping[str, float]
) -> Problem:
    parameters = {}
    for name, value in {**values, **chosen.fixed}.items():
        low, high = (-LONGEST_DELAY, LONGEST_DELAY) if name == DELAY else _bounds(chosen, name)
        free = name not in chosen.fixed
        parameters[name] = FitParameter(min(max(value, low), high) if free else value, free, low, high)
    biases = section.biases if section.biases is not None else (section.outputs if chosen.linear else ())
    return Problem(
        chosen.model, experiments, parameters, section.outputs,
        Nuisances(output_biases=biases, input_biases=chosen.input_biases(section.outputs)),
    )  # fmt: skip


def _likeliest(
    section: OutputError,
    chosen: Chosen,
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    estimator: Estimator,
) -> tuple[dict[str, float], Problem, Fit]:
    """The first fit without a lack of fit; else the most likely one of all starts."""
    ends: list[tuple[dict[str, float], Problem, Fit]] = []
    for starts, search in _starts(section, chosen, experiments, constants):
        converged = [end for end in ends if end[-1].status not in ("not converged", "diverged")]
        if search is RANDOM_STARTS and converged:
            continue
        if search is not RANDOM_STARTS and any(starts == before for before, *_ in ends):
            continue
        problem, fit = estimator(_problem(section, chosen, experiments, starts), search)
        ends.append((starts, problem, fit))
        if not fit.failure and not has_lack_of_fit(fitted_series(problem, fit)):
            return ends[-1]
    usable = [end for end in ends if end[-1].status not in ("not converged", "diverged")]
    return min(usable or ends[-1:], key=lambda end: end[-1].cost)


def _starts(
    section: OutputError, chosen: Chosen, experiments: tuple[Experiment, ...], constants: Mapping[str, float]
) -> Iterator[tuple[dict[str, float], Search]]:
    """Start values of the map, by equation error, by equation error over longer spans, and at random about them."""
    unaided = {name: one._replace(start=None) for name, one in chosen.parameters.items()}
    first = Search(cast("Method", section.search), fallback=False)
    if unaided != chosen.parameters:
        yield start_values(chosen.model, chosen.parameters, experiments, constants, chosen.linear), first
    plain = start_values(chosen.model, unaided, experiments, constants, chosen.linear)
    yield plain, first
    if section.method == "filter_error":  # it starts from the optimum of output error
        return
    for span in SPANS:
        yield start_values(chosen.model, unaided, experiments, constants, chosen.linear, span), first
    yield plain, RANDOM_STARTS


def shortened(one: Estimate) -> Estimate:
    """The estimate with its unit shortened: ``(rad/s)/(rad)`` is 1/s."""
    parts = re.fullmatch(r"\((.*)\)/\((.*)\)", one.unit)
    return one._replace(unit=quotient(parts[1], parts[2])) if parts else one
