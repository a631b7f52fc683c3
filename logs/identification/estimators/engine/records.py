"""A problem as arrays: columns of inputs and outputs, what was measured, what is free; or why it cannot be one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Model, Nuisances, Parameter, Problem
from logs.identification.results import Array
from wingbeat.errors import InputError

FIRST_SAMPLES = 3
LEAST_SAMPLES = 8
EVEN = 1e-2
"""-; of the sampling interval, how far a sample may be off an even time base"""
Ints = tuple[int, ...]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]


class Record(NamedTuple):
    """One experiment as columns."""

    name: str
    time: Array
    """s; (N,)"""
    step: float
    """s"""
    inputs: Array
    """(N, k); as the model's inputs"""
    measured: Array
    """(N, m); of the fitted outputs, 0 where not measured"""
    used: Array
    """(N, m); 1 where measured, else 0"""
    start: Array
    """(n,); initial states that the search begins with"""
    groups: tuple[tuple[Indices, Indices], ...]
    """rows with the same outputs measured, and which outputs those are"""


class Layout(NamedTuple):
    """Which numbers are free: the globals, and each experiment's own (local parameters, states, biases)."""

    base: Array
    """(P,); the model's parameters with the fixed values and the starts of the free ones"""
    free: Ints
    """-; indices into the model's parameters, one value for all experiments"""
    low: Array
    """(p,); bounds of the free parameters"""
    high: Array
    """(p,)"""
    local: Ints
    """-; indices into the model's parameters, one value for each experiment"""
    states: Ints
    """-; of the model, whose initial values are free"""
    outputs: Ints
    """-; of the model, that are fitted"""
    biased_outputs: Ints
    """-; positions among the fitted outputs"""
    biased_inputs: Ints
    """-; of the model's inputs"""
    prior_mean: Array
    """(p,); of the free parameters"""
    precision: Array
    """(p,); of the prior, 0 without one"""

    @property
    def nuisances(self) -> int:
        """How many numbers each experiment has of its own."""
        return len(self.local) + len(self.states) + len(self.biased_outputs) + len(self.biased_inputs)


def layout_of(problem: Problem) -> Layout:
    """Indices of what is free.

    Raises:
        InputError: a name that the model does not have, nothing free, or a start outside its bounds.
    """
    model, parameters, nuisances = problem.model, problem.parameters, problem.nuisances
    names = list(model.parameters)
    _known(parameters, names, "parameter")
    base = np.array([parameters[n].start if n in parameters else model.parameters[n].value for n in names])
    free = [n for n, p in parameters.items() if p.free and not p.local]
    local = [n for n, p in parameters.items() if p.free and p.local]
    _within_bounds(parameters)
    if not free:
        raise InputError("output error has no free parameter")
    fitted = _fitted(problem)
    states = list(model.states) if nuisances.initial_states is None else list(nuisances.initial_states)
    return Layout(
        base=base,
        free=tuple(names.index(n) for n in free),
        low=np.array([parameters[n].low for n in free]),
        high=np.array([parameters[n].high for n in free]),
        local=tuple(names.index(n) for n in local),
        states=_places(states, list(model.states), "state"),
        outputs=_places(fitted, list(model.outputs), "output"),
        biased_outputs=_places(_biased(nuisances, fitted), fitted, "output"),
        biased_inputs=_places(nuisances.input_biases, list(model.inputs), "input"),
        **_priors([parameters[n] for n in free]),
    )


def _priors(free: list[Parameter]) -> dict[str, Array]:
    priors = [one.prior for one in free]
    if any(one is not None and not one.deviation > 0 for one in priors):
        raise InputError("the standard deviation of a prior must be positive")
    return {
        "prior_mean": np.array([one.mean if one else 0.0 for one in priors]),
        "precision": np.array([one.deviation**-2.0 if one else 0.0 for one in priors]),
    }


def _fitted(problem: Problem) -> list[str]:
    if not problem.outputs:
        raise InputError("output error has no output to fit")
    if len(set(problem.outputs)) < len(problem.outputs):
        raise InputError("an output to fit is named twice")
    if problem.weighting == "given":
        missing = [name for name in problem.outputs if not problem.deviations.get(name, 0.0) > 0]
        if missing:
            raise InputError(f"weights are given, but no positive standard deviation for {', '.join(missing)}")
    return list(problem.outputs)


def _biased(nuisances: Nuisances, fitted: list[str]) -> list[str]:
    return [name for name in nuisances.output_biases if name in fitted or _unknown_output(name, fitted)]


def _unknown_output(name: str, fitted: list[str]) -> bool:
    raise InputError(f"a bias of {name} was requested for, which is not fitted (fitted: {', '.join(fitted)})")


def _within_bounds(parameters: Mapping[str, Parameter]) -> None:
    for name, parameter in parameters.items():
        if not np.isfinite(parameter.start):
            raise InputError(f"parameter {name}: its start value is not a number")
        if parameter.free and not parameter.low <= parameter.start <= parameter.high:
            raise InputError(
                f"parameter {name}: its start {parameter.start:g} is outside its bounds "
                f"{parameter.low:g} to {parameter.high:g}"
            )


def _known(requested: Iterable[str], names: list[str], noun: str) -> None:
    for name in requested:
        if name not in names:
            raise InputError(f"the model has no {noun} {name} (it has {', '.join(names)})")


def _places(requested: Iterable[str], names: list[str], noun: str) -> Ints:
    chosen = tuple(requested)
    _known(chosen, names, noun)
    return tuple(names.index(name) for name in chosen)


def records_of(problem: Problem, layout: Layout) -> tuple[Record, ...]:
    """Every experiment as columns.

    Raises:
        InputError: a signal is missing, an input has gaps, an output has no sample, or time is not even.
    """
    if not problem.experiments:
        raise InputError("output error has no maneuver to fit")
    given = problem.initial or tuple({} for _ in problem.experiments)
    if len(given) != len(problem.experiments):
        raise InputError(f"initial states for {len(given)} of {len(problem.experiments)} maneuvers")
    records = tuple(_record(problem, e, i) for e, i in zip(problem.experiments, given, strict=True))
    for index, name in enumerate(problem.outputs):
        if not any(np.any(record.used[:, index]) for record in records):
            raise InputError(f"output {name} has no sample in any of the maneuvers")
    count = sum(float(record.used.sum()) for record in records)
    wanted = len(layout.free) + layout.nuisances * len(records)
    if count <= wanted:
        raise InputError(f"{count:.0f} measured values are too few for {wanted} unknowns")
    return records


def _record(problem: Problem, experiment: Experiment, given: Mapping[str, float]) -> Record:
    _even(experiment)
    inputs = _columns(experiment, tuple(problem.model.inputs), "input")
    for name, column in zip(problem.model.inputs, inputs.T, strict=True):
        gaps = int(np.sum(~np.isfinite(column)))
        if gaps:
            raise InputError(f"{experiment.name}: input {name} lacks {gaps} samples; an input needs all of them")
    raw = _columns(experiment, problem.outputs, "output")
    used = np.isfinite(raw)
    measured = np.where(used, raw, 0.0)
    start = _start(problem.model, experiment, given)
    return Record(
        experiment.name, experiment.time, experiment.step, inputs, measured, used.astype(float), start, _groups(used)
    )


def _groups(used: Flags) -> tuple[tuple[Indices, Indices], ...]:
    codes = used @ (1 << np.arange(used.shape[1]))
    patterns = [int(code) for code in np.unique(codes) if code]
    return tuple((np.flatnonzero(codes == c), np.flatnonzero(used[np.argmax(codes == c)])) for c in patterns)


def _even(experiment: Experiment) -> None:
    time = np.asarray(experiment.time, dtype=np.float64)
    if len(time) < LEAST_SAMPLES:
        raise InputError(f"{experiment.name}: {len(time)} samples are too few, {LEAST_SAMPLES} are the least")
    steps = np.diff(time)
    if not np.all(np.isfinite(steps)) or experiment.step <= 0:
        raise InputError(f"{experiment.name}: its time does not increase")
    if np.max(np.abs(steps - experiment.step)) > EVEN * experiment.step:
        raise InputError(f"{experiment.name}: its samples are not equally spaced; resample it first")


def _columns(experiment: Experiment, names: tuple[str, ...], noun: str) -> Array:
    for name in names:
        if name not in experiment.signals:
            there = ", ".join(experiment.signals)
            raise InputError(f"{experiment.name}: the {noun} {name} is not among its signals ({there})")
        if len(experiment.signals[name]) != len(experiment.time):
            raise InputError(f"{experiment.name}: {name} has not as many samples as the time")
    if not names:
        return np.empty((len(experiment.time), 0))
    return np.column_stack([np.asarray(experiment.signals[name], dtype=np.float64) for name in names])


def _start(model: Model, experiment: Experiment, given: Mapping[str, float]) -> Array:
    _known(given, list(model.states), "state")
    values = []
    for name, state in model.states.items():
        if name in given:
            values.append(float(given[name]))
        else:
            values.append(_first_of(experiment.signals.get(name) if name in model.outputs else None, state.value))
    return np.array(values)


def _first_of(signal: Array | None, otherwise: float) -> float:
    if signal is None:
        return otherwise
    measured = signal[np.isfinite(signal)][:FIRST_SAMPLES]
    return float(np.mean(measured)) if len(measured) else otherwise
