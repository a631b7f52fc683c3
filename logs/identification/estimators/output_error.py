"""Output error: maximum likelihood of the parameters of a simulated model (Klein & Morelli, 2006, ch. 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.normal_equations import SMALLEST_SIZE
from logs.identification.estimators.engine.problem import (
    Fit,
    History,
    Nuisances,
    Parameter,
    Problem,
    RecordParameters,
)
from logs.identification.estimators.engine.records import Record, layout_of, records_of
from logs.identification.estimators.engine.search import (
    OptimizerResult,
    accuracy_of,
    gauss_newton,
    nelder_mead,
)
from logs.identification.estimators.engine.simulation import (
    Flight,
    Unknowns,
    about_mean,
    noise_of,
    variation,
    whitener_of,
)
from logs.identification.estimators.registry import Request
from logs.identification.findings import Finding, of_severity
from logs.identification.results import Array, EstimationResult, FitSeries, estimate
from wingbeat.errors import InputError

MOST_STEPS = 60
SURE = 0.99
PREDICTION_STEPS = 10
"""-; of Gauss-Newton for the initial states and biases of an experiment that is predicted"""
Method = Literal["gauss-newton", "nelder-mead", "both"]


class Search(NamedTuple):
    """How the optimum is looked for."""

    method: Method = "gauss-newton"
    """-; "nelder-mead" and "both": Gauss-Newton from the end of a simplex"""
    fallback: bool = True
    """-; a simplex if Gauss-Newton does not converge from the start"""
    starts: int = 1
    """-; the first from the problem's start values, the others at random about them; the likeliest end is taken"""
    spread: float = 0.5
    """-; of a parameter's start value, or of the width of its bounds where both are given: standard deviation of
    random starts"""
    steps: int = MOST_STEPS
    """-; at most, of Gauss-Newton"""
    seed: int = 0
    """-; of the random starts"""


DEFAULT_SEARCH = Search()


def output_error(problem: Problem, search: Search = DEFAULT_SEARCH) -> Fit:
    """The free parameters of ``problem`` by maximum likelihood.

    A simplex takes over where Gauss-Newton does not converge, and Gauss-Newton again from its end.

    Raises:
        InputError: the problem does not make sense: unknown names, gaps in inputs, nothing measured.
    """
    flight = flight_of(problem)
    starts = starts_of(flight, search)
    ends = [_searched(problem, flight, start, search) for start in starts]
    usable = [optimum for optimum in ends if not optimum.reason]
    return fit_of(problem, flight, min(usable or ends[:1], key=lambda optimum: optimum.cost))


def starts_of(flight: Flight, search: Search) -> list[Unknowns]:
    """The problem's start, and others at random about it within the bounds."""
    first, low, high = flight.first(), flight.layout.low, flight.layout.high
    bounded = np.isfinite(low) & np.isfinite(high)
    width = search.spread * np.maximum(np.abs(first.values), SMALLEST_SIZE)
    width[bounded] = search.spread * (high - low)[bounded]
    source = np.random.default_rng(search.seed)
    around = (first.values + width * source.normal(size=len(width)) for _ in range(search.starts - 1))
    return [first, *(first._replace(values=np.clip(values, low, high)) for values in around)]


def _searched(problem: Problem, flight: Flight, start: Unknowns, search: Search) -> OptimizerResult:
    if search.method == "gauss-newton":
        end = gauss_newton(problem, flight, start, search.steps)
        if end.status != "not converged" or not search.fallback:
            return end
    return gauss_newton(problem, flight, nelder_mead(flight, start), search.steps)


def flight_of(problem: Problem) -> Flight:
    """The problem's model and records, ready to be flown.

    Raises:
        InputError: see `output_error`.
    """
    layout = layout_of(problem)
    return Flight(problem.model, layout, records_of(problem, layout))


def fit_of(problem: Problem, flight: Flight, end: OptimizerResult) -> Fit:
    """The fit at the end of a search with its errors; without numbers if the search failed."""
    names = _free_names(problem, flight)
    if end.reason:
        return _failed(problem, end, names, Finding("not_converged", "withheld", details={"reason": end.reason}))
    if _explains_nothing(flight, end):
        return _failed(problem, end, names, Finding("not_significant", "withheld"))
    accuracy = accuracy_of(flight, end, names)
    withheld = of_severity(accuracy.findings, "withheld")
    lost = {one.subject for one in withheld}
    errors, units = np.sqrt(np.diag(accuracy.covariance)), problem.model.parameters
    rows = zip(names, end.unknowns.values, errors, accuracy.degrees, strict=True)
    return Fit(
        status="converged" if len(lost) < len(names) else "not identifiable",
        failure="" if len(lost) < len(names) else f"no parameter is identified: {withheld[0].text}",
        estimates=tuple(
            estimate(name, units[name].unit, float(value), float(error), float(degrees))
            for name, value, error, degrees in rows
            if name not in lost
        ),
        names=names,
        values=end.unknowns.values,
        covariance=accuracy.covariance,
        degrees=min((float(d) for n, d in zip(names, accuracy.degrees, strict=True) if n not in lost), default=1.0),
        noise=noise_of(problem._replace(weighting="full"), flight.records, flight.residuals(end.unknowns)),
        cost=end.cost,
        iterations=end.iterations,
        records=tuple(_per_record(problem, flight, end, i) for i in range(len(flight.records))),
        histories=tuple(_history(flight, end, i) for i in range(len(flight.records))),
        outputs=problem.outputs,
        findings=accuracy.findings,
    )


def variation_of(problem: Problem) -> Array:
    """Standard deviation (m,) of each fitted output over all records."""
    return variation(records_of(problem, layout_of(problem)))


def _free_names(problem: Problem, flight: Flight) -> tuple[str, ...]:
    every = tuple(problem.model.parameters)
    return tuple(every[index] for index in flight.layout.free)


def _failed(problem: Problem, end: OptimizerResult, names: tuple[str, ...], why: Finding) -> Fit:
    p, m = len(names), len(problem.outputs)
    nothing = np.full((p, p), np.nan)
    status, reason = end.status if end.reason else "not identifiable", end.reason or why.text
    return Fit(
        status, reason, (), names, np.full(p, np.nan), nothing, 1.0, np.full((m, m), np.nan), end.cost,
        end.iterations, (), (), problem.outputs, (why,),
    )  # fmt: skip


def _explains_nothing(flight: Flight, end: OptimizerResult) -> bool:
    """Whether an F test of the whole model against constant outputs is not significant."""
    from scipy.special import fdtri  # takes 0.3 s, which a flight need not wait for

    whiteners = [whitener_of(record, end.weights) for record in flight.records]
    residuals = flight.residuals(end.unknowns)
    left = sum(float(np.sum(w(r) ** 2)) for w, r in zip(whiteners, residuals, strict=True))
    total = sum(float(np.sum(w(about_mean(r)) ** 2)) for w, r in zip(whiteners, flight.records, strict=True))
    count = sum(float(record.used.sum()) for record in flight.records)
    unknown = len(flight.layout.free) + flight.layout.nuisances * len(flight.records)
    rest = max(count - unknown, 1.0)
    return bool(total - left <= fdtri(unknown, rest, SURE) * unknown * left / rest)


def _per_record(problem: Problem, flight: Flight, optimum: OptimizerResult, index: int) -> RecordParameters:
    record, model = flight.records[index], problem.model
    split = flight.split(record, optimum.unknowns.values, optimum.unknowns.local[index])
    return RecordParameters(
        record.name,
        dict(zip(model.parameters, split.parameters.tolist(), strict=True)),
        dict(zip(model.states, split.start.tolist(), strict=True)),
        dict(zip(problem.outputs, split.output_biases.tolist(), strict=True)),
        dict(zip(model.inputs, split.input_biases.tolist(), strict=True)),
    )


def _history(flight: Flight, optimum: OptimizerResult, index: int) -> History:
    record = flight.records[index]
    model = flight.outputs(record, optimum.unknowns.values, optimum.unknowns.local[index])
    return History(record.name, record.time, np.where(record.used > 0, record.measured, np.nan), model)


def problem_of(request: Request) -> Problem:
    """The maximum-likelihood problem of a request.

    ``parameters`` are `engine.problem.Parameter` or start values; without any all parameters of the model are free
    from its values. Options: ``nuisances``, ``initial``, ``weighting`` and ``deviations`` of `Problem`. All outputs
    have a bias unless ``nuisances`` is given.

    Raises:
        InputError: an output is constant in all experiments.
    """
    for output in request.outputs:
        measured = [np.asarray(one.signals[output]) for one in request.experiments if output in one.signals]
        if measured and not any(np.nanmax(one, initial=-np.inf) > np.nanmin(one, initial=np.inf) for one in measured):
            raise InputError(f"the output {output} is constant")
    given = request.parameters or {name: one.value for name, one in request.model.parameters.items()}
    parameters = {n: one if isinstance(one, Parameter) else Parameter(float(one)) for n, one in given.items()}
    options = {name: request.options[name] for name in Problem._fields if name in request.options}
    nuisances = options.pop("nuisances", Nuisances(output_biases=request.outputs))
    return Problem(request.model, request.experiments, parameters, request.outputs, nuisances, **options)


def result_of(method: str, request: Request, problem: Problem, fit: Fit) -> EstimationResult:
    """A fit as the result of a row of the registry, with its prediction of the experiments held out."""
    kept = [index for index, name in enumerate(fit.names) if name in {one.name for one in fit.estimates}]
    return EstimationResult(
        method,
        str(request.options.get("subject", "")),
        str(request.options.get("model", "")),
        status=fit.status,
        estimates=fit.estimates,
        covariance=fit.covariance[np.ix_(kept, kept)],
        degrees=fit.degrees,
        series=(
            *fitted_series(problem, fit),
            *(predicted(problem, fit, request.held_out) if request.held_out else ()),
        ),
        samples=sum(len(one.time) for one in request.experiments),
        findings=fit.findings,
        initial={name: one.start for name, one in problem.parameters.items() if one.free},
        fixed={name: one.start for name, one in problem.parameters.items() if not one.free},
    )


def fitted_series(problem: Problem, fit: Fit) -> tuple[FitSeries, ...]:
    """Measured and modeled outputs of every experiment that was fitted."""
    return tuple(
        FitSeries(
            one.name, output, problem.model.outputs[output], one.time, one.measured[:, place], one.model[:, place]
        )
        for one in fit.histories
        for place, output in enumerate(fit.outputs)
    )


def predicted(
    problem: Problem, fit: Fit, experiments: tuple[Experiment, ...], initial: tuple[Mapping[str, float], ...] = ()
) -> tuple[FitSeries, ...]:
    """Measured and predicted outputs; initial state and biases of each by least squares. Nothing after a failure.

    The search begins at the ``initial`` states, as in `Problem`.

    Raises:
        InputError: a signal is missing, or nothing of the outputs was measured.
    """
    if fit.failure or not experiments:
        return ()
    other = problem._replace(experiments=experiments, initial=initial)
    layout = layout_of(other)
    flight = Flight(problem.model, layout, records_of(other, layout))
    series = []
    for record, local in zip(flight.records, flight.first().local, strict=True):
        there = np.where(record.used > 0, record.measured, np.nan)
        scale = np.nanstd(there, axis=0)
        optimum = _record_values(flight, record, fit.values, local, np.where(scale > 0, scale, 1.0))
        model = flight.outputs(record, fit.values, optimum)
        series += [
            FitSeries(record.name, output, problem.model.outputs[output], record.time, there[:, n], model[:, n], True)
            for n, output in enumerate(problem.outputs)
        ]
    return tuple(series)


def _record_values(flight: Flight, record: Record, values: Array, first: Array, scale: Array) -> Array:
    """Initial state and biases (l,) of the best prediction, by Gauss-Newton."""
    values_of_record = first
    for _ in range(PREDICTION_STEPS):
        rest = (record.measured - flight.outputs(record, values, values_of_record)) * record.used / scale
        slopes = flight.slopes(record, values, values_of_record)[:, :, len(values) :] / scale[:, None]
        design = slopes.reshape(-1, len(values_of_record))
        if not (np.all(np.isfinite(rest)) and np.all(np.isfinite(design))):
            return first
        size = np.linalg.norm(design, axis=0)
        size[~(size > 0)] = np.inf
        step = np.linalg.lstsq(design / size, rest.ravel(), rcond=1e-8)[0] / size
        values_of_record = values_of_record + step
        if np.all(np.abs(step) <= 1e-8 * np.maximum(np.abs(values_of_record), 1e-3)):
            break
    return values_of_record


def estimate_by_output_error(request: Request) -> EstimationResult:
    """Output error of a request; option ``search``: a `Search`."""
    problem = problem_of(request)
    fit = output_error(problem, request.options.get("search", DEFAULT_SEARCH))
    return result_of("output_error", request, problem, fit)
