"""Output error from a problem to a fit that says what it is worth."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from logs.identification.estimators.engine.accuracy import Accuracy, accuracy_of
from logs.identification.estimators.engine.gauss_newton import Found, gauss_newton
from logs.identification.estimators.engine.nelder_mead import nelder_mead
from logs.identification.estimators.engine.normal_equations import SMALLEST_SIZE
from logs.identification.estimators.engine.problem import Fit, History, Own, Problem
from logs.identification.estimators.engine.records import layout_of, records_of
from logs.identification.estimators.engine.simulation import Flight, Unknowns
from logs.identification.estimators.engine.weights import about_mean, noise_of, whitener_of
from logs.identification.results import estimate

MOST_STEPS = 60
SURE = 0.99
Method = Literal["gauss-newton", "nelder-mead", "both"]


class Search(NamedTuple):
    """How the optimum is looked for."""

    method: Method = "gauss-newton"
    """-; "both": Gauss-Newton from where the simplex of Nelder and Mead ended"""
    starts: int = 1
    """-; the first from the problem's start values, the others at random about them; the likeliest end is taken"""
    spread: float = 0.5
    """-; of a parameter's start value, or of the width of its bounds where both are given: standard deviation of
    random starts"""
    steps: int = MOST_STEPS
    """-; at most, of Gauss-Newton"""
    seed: int = 0
    """-; of the random starts"""


FROM_THE_START = Search()


def output_error(problem: Problem, search: Search = FROM_THE_START) -> Fit:
    """The free parameters of ``problem`` by maximum likelihood.

    Raises:
        InputError: the problem does not make sense: unknown names, gaps in inputs, nothing measured.
    """
    flight = flight_of(problem)
    starts = starts_of(flight, search)
    ends = [_found(problem, flight, start, search) for start in starts]
    usable = [found for found in ends if not found.reason]
    return fit_of(problem, flight, min(usable or ends[:1], key=lambda found: found.cost))


def starts_of(flight: Flight, search: Search) -> list[Unknowns]:
    """The problem's start, and others at random about it within the bounds."""
    first, low, high = flight.first(), flight.layout.low, flight.layout.high
    bounded = np.isfinite(low) & np.isfinite(high)
    width = search.spread * np.maximum(np.abs(first.values), SMALLEST_SIZE)
    width[bounded] = search.spread * (high - low)[bounded]
    source = np.random.default_rng(search.seed)
    around = (first.values + width * source.normal(size=len(width)) for _ in range(search.starts - 1))
    return [first, *(first._replace(values=np.clip(values, low, high)) for values in around)]


def _found(problem: Problem, flight: Flight, start: Unknowns, search: Search) -> Found:
    if search.method == "gauss-newton":
        return gauss_newton(problem, flight, start, search.steps)
    simplex = nelder_mead(problem, flight, start)
    if search.method == "nelder-mead" or not np.isfinite(simplex.cost):
        return simplex
    return gauss_newton(problem, flight, simplex.unknowns, search.steps)


def flight_of(problem: Problem) -> Flight:
    """The problem's model and records, ready to be flown.

    Raises:
        InputError: see `output_error`.
    """
    layout = layout_of(problem)
    return Flight(problem.model, layout, records_of(problem, layout))


def fit_of(problem: Problem, flight: Flight, found: Found) -> Fit:
    """What a search found, with its errors; nothing but the reason where it may not be used."""
    names = _free_names(problem, flight)
    reason = found.reason or _explains_nothing(flight, found)
    if reason:
        return _failed(problem, found, names, reason)
    accuracy = accuracy_of(flight, found, names)
    lost = {u.name for u in accuracy.unidentified}
    errors, units = np.sqrt(np.diag(accuracy.covariance)), problem.model.parameters
    rows = zip(names, found.unknowns.values, errors, accuracy.degrees, strict=True)
    return Fit(
        status="converged" if len(lost) < len(names) else "not identifiable",
        failure="" if len(lost) < len(names) else f"no parameter is identified: {accuracy.unidentified[0].reason}",
        estimates=tuple(
            estimate(name, units[name].unit, float(value), float(error), float(degrees))
            for name, value, error, degrees in rows
            if name not in lost
        ),
        unidentified=accuracy.unidentified,
        names=names,
        values=found.unknowns.values,
        covariance=accuracy.covariance,
        degrees=_least(accuracy, names),
        noise=noise_of(problem._replace(weighting="full"), flight.records, flight.residuals(found.unknowns)),
        cost=found.cost,
        iterations=found.iterations,
        own=tuple(_own(problem, flight, found, i) for i in range(len(flight.records))),
        histories=tuple(_history(flight, found, i) for i in range(len(flight.records))),
        outputs=problem.outputs,
    )


def _least(accuracy: Accuracy, names: tuple[str, ...]) -> float:
    """Degrees of freedom of what rests on several parameters: as of the least known of those that were identified."""
    lost = {one.name for one in accuracy.unidentified}
    known = [float(one) for name, one in zip(names, accuracy.degrees, strict=True) if name not in lost]
    return min(known, default=1.0)


def _free_names(problem: Problem, flight: Flight) -> tuple[str, ...]:
    every = tuple(problem.model.parameters)
    return tuple(every[index] for index in flight.layout.free)


def _failed(problem: Problem, found: Found, names: tuple[str, ...], reason: str) -> Fit:
    p, m = len(names), len(problem.outputs)
    nothing = np.full((p, p), np.nan)
    status = found.status if found.reason else "not identifiable"
    return Fit(
        status, reason, (), (), names, np.full(p, np.nan), nothing, 1.0, np.full((m, m), np.nan), found.cost,
        found.iterations, (), (), problem.outputs,
    )  # fmt: skip


def _explains_nothing(flight: Flight, found: Found) -> str:
    """Why a fit that explains no more than chance is none: a search may converge far from any, or without motion.

    An F test of the whole model against constants.
    """
    from scipy.special import fdtri  # takes 0.3 s, which a flight need not wait for

    whiteners = [whitener_of(record, found.weights) for record in flight.records]
    residuals = flight.residuals(found.unknowns)
    left = sum(float(np.sum(w(r) ** 2)) for w, r in zip(whiteners, residuals, strict=True))
    still = sum(float(np.sum(w(about_mean(r)) ** 2)) for w, r in zip(whiteners, flight.records, strict=True))
    count = sum(float(record.used.sum()) for record in flight.records)
    unknown = len(flight.layout.free) + flight.layout.own * len(flight.records)
    rest = max(count - unknown, 1.0)
    if still - left <= fdtri(unknown, rest, SURE) * unknown * left / rest:
        return "the model that was found explains no more of the outputs than chance would"
    return ""


def _own(problem: Problem, flight: Flight, found: Found, index: int) -> Own:
    record, model = flight.records[index], problem.model
    split = flight.split(record, found.unknowns.values, found.unknowns.own[index])
    return Own(
        record.name,
        dict(zip(model.parameters, split.parameters.tolist(), strict=True)),
        dict(zip(model.states, split.start.tolist(), strict=True)),
        dict(zip(problem.outputs, split.output_biases.tolist(), strict=True)),
        dict(zip(model.inputs, split.input_biases.tolist(), strict=True)),
    )


def _history(flight: Flight, found: Found, index: int) -> History:
    record = flight.records[index]
    model = flight.outputs(record, found.unknowns.values, found.unknowns.own[index])
    return History(record.name, record.time, np.where(record.used > 0, record.measured, np.nan), model)
