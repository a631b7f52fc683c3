"""[modes] and [[aero.output_error]] of a map: a model flown with the measured inputs, fitted to the outputs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import bridged, measured_pieces
from logs.identification.diagnostics.intersample_behavior import FURTHEST_TURN, LEAST_RUN, coarse
from logs.identification.diagnostics.lack_of_fit import lacking
from logs.identification.diagnostics.outliers import spikes
from logs.identification.diagnostics.output_error import Flown, doubts, lines_of
from logs.identification.diagnostics.unexplained_outputs import without_unexplained
from logs.identification.estimators.engine.problem import Fit, Nuisances, Problem
from logs.identification.estimators.engine.problem import Parameter as Sought
from logs.identification.estimators.initial_values import SPANS, begin
from logs.identification.estimators.output_error import Method, Search, output_error, predicted
from logs.identification.estimators.terms import quotient
from logs.identification.results import Estimate, FitSeries, Fitted, Information, Unidentified
from logs.identification.sources.table.config import DELAY, OutputError
from logs.identification.sources.table.maneuvers import Cut
from logs.identification.sources.table.signal_lookup import check_apart
from logs.identification.sources.table.signals import LONGEST_FILL
from logs.identification.statistics.correlation import correlation_among
from logs.identification.statistics.output_fit import output_fits
from logs.identification.tables.models import LONGEST_DELAY, Chosen, chosen_model
from logs.identification.tables.results import LITTLE, TableFit
from wingbeat.errors import InputError
from wingbeat.text import pluralize

BESIDE = Search(starts=4)
"""where Gauss-Newton does not arrive: from starts beside the first as well"""
SEARCHES: dict[str, Method] = {"gauss-newton": "gauss-newton", "nelder-mead": "nelder-mead", "both": "both"}
"""how the optimum is looked for, by the word in the map"""


class Driven(NamedTuple):
    """Manoeuvres whose inputs have every sample."""

    experiments: tuple[Experiment, ...]
    notes: tuple[str, ...]


def output_error_fit(
    subject: str, asked: OutputError, found: Cut, constants: Mapping[str, float], fill: float | None
) -> tuple[TableFit, Fit, Chosen]:
    """One output-error fit over all manoeuvres, and its prediction of those that were held out.

    Raises:
        InputError: a signal, constant or parameter that the model does not have or needs and is not there.
    """
    check_apart(found.fitted, asked.inputs, asked.outputs, subject)
    chosen = chosen_model(asked, constants, found.fitted)
    fitted = driven(found.fitted, chosen, fill)
    held = driven(found.held_out, chosen, fill) if found.held_out else Driven((), ())
    fixed = {name: one.fixed for name, one in chosen.parameters.items() if one.fixed is not None}
    starts, problem, fit = _likeliest(asked, chosen, fitted.experiments, constants)
    fit = _within_sampling(fit, chosen, fitted.experiments, bool(coarse(lines_of(asked), found.fitted)))
    series = (*_flown(problem, fit), *(predicted(problem, fit, held.experiments) if held.experiments else ()))
    correlation = correlation_among(fit.estimates, fit.names, fit.covariance)
    notes = doubts(asked, found.fitted, Flown(chosen, problem, fit, series), constants)
    spiky = spikes(series, (*fitted.experiments, *held.experiments), tuple(chosen.model.inputs))
    told = Fitted(
        f"output error, {asked.model}", chosen.equations, tuple(map(shortened, fit.estimates)),
        fit.unidentified, correlation, series,
        (*(Information(one.text) for one in chosen.findings), *fitted.notes, *held.notes, *spiky, *notes),
    )  # fmt: skip
    told = without_unexplained(told)
    samples = sum(len(one.time) for one in fitted.experiments)
    own = {name: value for name, value in starts.items() if name not in fixed}
    table = TableFit(
        subject, told, fit.status == "converged", fit.failure, own, fixed, output_fits(series), samples, asked.model,
        unnamed=chosen.unnamed,
    )  # fmt: skip
    return table, fit, chosen


def _within_sampling(fit: Fit, chosen: Chosen, experiments: tuple[Experiment, ...], jerky: bool) -> Fit:
    """The fit, or none where the motion that it found is faster than the samples could show.

    Where the inputs' course between samples is not known either (``jerky``), that is one that turns by more than a
    radian between two.
    """
    if fit.failure or not chosen.linear:
        return fit
    held = {name: one.fixed for name, one in chosen.parameters.items() if one.fixed is not None}
    values = {name: one.value for name, one in chosen.model.parameters.items()} | held
    roots = np.linalg.eigvals(chosen.system(values | dict(zip(fit.names, fit.values.tolist(), strict=True))))
    step = min(one.step for one in experiments)
    fastest, turning = float(np.max(np.abs(roots.imag))), float(np.max(np.abs(roots[roots.imag > 0]), initial=0.0))
    if fastest * step > np.pi:
        why = (
            f"it found a motion of {fastest:.3g} rad/s, faster than {np.pi / step:.3g} rad/s, half the sampling rate"
        )
    elif jerky and turning * step > FURTHEST_TURN:
        why = (
            f"it found a motion of {turning:.3g} rad/s, a period of {2 * np.pi / turning / step:.1f} samples, and the"
            " inputs move far between two: record it faster"
        )
    else:
        return fit
    nothing = tuple(Unidentified(name, why) for name in fit.names)
    return fit._replace(
        status="not converged", failure=why, estimates=(), unidentified=nothing, own=(), histories=(),
        values=np.full(len(fit.values), np.nan),
    )  # fmt: skip


def driven(experiments: tuple[Experiment, ...], chosen: Chosen, fill: float | None) -> Driven:
    """The manoeuvres, short gaps of their inputs bridged, cut at longer ones.

    Raises:
        InputError: an input is not among the signals, or no run with all of them is long enough.
    """
    pieces: list[Experiment] = []
    notes: list[str] = []
    for experiment in (chosen.about(one) for one in experiments):
        pieces += _whole_runs(experiment, tuple(chosen.model.inputs), fill, notes)
    if not pieces:
        longest = max(len(one.time) for one in experiments)
        if longest < LEAST_RUN or not chosen.model.inputs:
            raise InputError(f"the longest manoeuvre has {pluralize(longest, 'sample')}: it takes {LEAST_RUN}")
        raise InputError(f"no {LEAST_RUN} samples on end have every input ({', '.join(chosen.model.inputs)})")
    return Driven(tuple(chosen.from_trim(one) for one in pieces), tuple(notes))


def _whole_runs(
    experiment: Experiment, inputs: tuple[str, ...], fill: float | None, notes: list[str]
) -> tuple[Experiment, ...]:
    for name in inputs:
        if name not in experiment.signals:
            raise InputError(f"input {name} is not in [signals]; there are {', '.join(experiment.signals)}")
    whole = bridged(experiment, inputs, LONGEST_FILL if fill is None else int(fill / experiment.step + 1e-9))
    for name in inputs:
        count = int(np.isfinite(whole.signals[name]).sum() - np.isfinite(experiment.signals[name]).sum())
        if count:
            notes.append(Information(f"{experiment.name}: {pluralize(count, 'sample')} of {name} interpolated"))
    pieces = measured_pieces(whole, inputs, LEAST_RUN)
    untold = int(np.count_nonzero(~np.all([np.isfinite(whole.signals[name]) for name in inputs], axis=0)))
    short = len(experiment.time) - sum(len(piece.time) for piece in pieces) - untold
    if untold or short:
        lost = [f"{pluralize(untold, 'sample')} without {', '.join(inputs)}"] if untold else []
        lost += [f"{pluralize(short, 'sample')} of pieces that are too short"] if short else []
        notes.append(Information(f"{experiment.name}: {' and '.join(lost)} left out"))
    return pieces


def _problem(
    asked: OutputError,
    chosen: Chosen,
    experiments: tuple[Experiment, ...],
    values: Mapping[str, float],
    free: tuple[str, ...],
) -> Problem:
    sought = {name: _sought(name, value, name in free) for name, value in values.items()}
    biases = asked.biases if asked.biases is not None else (asked.outputs if chosen.linear else ())
    return Problem(
        chosen.model, experiments, sought, asked.outputs,
        Nuisances(output_biases=biases, input_biases=chosen.input_biases(asked.outputs)),
    )  # fmt: skip


def _likeliest(
    asked: OutputError,
    chosen: Chosen,
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
) -> tuple[dict[str, float], Problem, Fit]:
    """The fit, with where it began, from the first start that leads somewhere; in doubt the likeliest of all.

    In doubt is what did not converge, or leaves more of an output than noise: of full and clean records of a large
    transport, one in twenty ended elsewhere from the first start; of those with runs not measured, most.
    """
    fixed = {name: one.fixed for name, one in chosen.parameters.items() if one.fixed is not None}
    names = tuple(name for name in chosen.parameters if name not in fixed)
    ends: list[tuple[dict[str, float], Problem, Fit]] = []
    for starts, search in _starts(asked, chosen, experiments, constants):
        if any(starts == before for before, *_ in ends) and search is not BESIDE:
            continue
        if search is BESIDE and any(not _led_nowhere(fit) for *_, fit in ends):
            continue
        problem = _problem(asked, chosen, experiments, {**starts, **fixed}, names)
        ends.append((starts, problem, output_error(problem, search)))
        if not _in_doubt(problem, ends[-1][-1]):
            return ends[-1]
    somewhere = [end for end in ends if not _led_nowhere(end[-1])]
    return min(somewhere or ends[-1:], key=lambda end: end[-1].cost)


def _led_nowhere(fit: Fit) -> bool:
    return fit.status in ("not converged", "diverged")


def _in_doubt(problem: Problem, fit: Fit) -> bool:
    """Whether another start may lead to a likelier end."""
    if fit.failure:
        return True
    series = tuple(_flown(problem, fit))
    return bool(lacking(series)) or any(one.r_squared < LITTLE for one in output_fits(series))


def _starts(
    asked: OutputError, chosen: Chosen, experiments: tuple[Experiment, ...], constants: Mapping[str, float]
) -> Iterator[tuple[dict[str, float], Search]]:
    """Starts and how to search from each: the map's, and where it gives any, those without them; then of slopes over
    longer spans; then at random about the first that are not the map's."""
    unaided = {name: one._replace(start=None) for name, one in chosen.parameters.items()}
    first = Search(SEARCHES[asked.search])
    if unaided != chosen.parameters:
        yield begin(chosen.model, chosen.parameters, experiments, constants, chosen.linear), first
    own = begin(chosen.model, unaided, experiments, constants, chosen.linear)
    yield own, first
    for span in SPANS:
        yield begin(chosen.model, unaided, experiments, constants, chosen.linear, span), first
    yield own, BESIDE


def shortened(one: Estimate) -> Estimate:
    """With its unit shortened: ``(rad/s)/(rad)`` is 1/s."""
    parts = re.fullmatch(r"\((.*)\)/\((.*)\)", one.unit)
    return one._replace(unit=quotient(parts[1], parts[2])) if parts else one


def _sought(name: str, value: float, free: bool) -> Sought:
    return Sought(value, free, -LONGEST_DELAY, LONGEST_DELAY) if name == DELAY else Sought(value, free)


def _flown(problem: Problem, fit: Fit) -> list[FitSeries]:
    return [
        FitSeries(
            one.name, output, problem.model.outputs[output], one.time, one.measured[:, place], one.model[:, place]
        )
        for one in fit.histories
        for place, output in enumerate(fit.outputs)
    ]
