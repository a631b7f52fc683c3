"""The records that a flight path is reconstructed from, and the path about its present parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.flight_path.sensors import (
    LONGITUDINAL_INPUTS,
    LONGITUDINAL_OUTPUTS,
    OUTPUTS,
    WRAPPED,
    Parameter,
    Places,
    corrected_inputs,
    input_push,
    output_slopes,
    true_outputs,
)
from logs.identification.models.rigid_body import INPUTS, STATES, fly, jacobians, state_slopes
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

LEAST_SAMPLES = 40
UNEVEN = 1e-3
"""-; of a step"""
LEVEL = 0.1
"""rad; that a turn with banked wings may pitch the aircraft by before it is not taken for longitudinal flight"""


class Record(NamedTuple):
    """One experiment as arrays."""

    name: str
    time: Array
    """s; (N,)"""
    inputs: Array
    """(N, 6); measured, 0 where the mode leaves one out"""
    outputs: Array
    """(N, m); measured, 0 where not"""
    used: Array
    """-; (N, m), 1 where an output was measured"""

    @property
    def step(self) -> float:
        """s; between samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


class Problem(NamedTuple):
    """What is reconstructed from what."""

    records: tuple[Record, ...]
    channels: tuple[str, ...]
    """-; the outputs, columns of `Record.outputs`"""
    parameters: tuple[Parameter, ...]
    free: tuple[int, ...]
    """-; states whose first value is free in every record"""
    places: Places


class Values(NamedTuple):
    """The unknowns."""

    errors: Array
    """(p,); of the sensors, in the order of `Problem.parameters`"""
    starts: Array
    """(R, 9); first states of the records"""


class Path(NamedTuple):
    """One record flown at present values."""

    states: Array
    """(N, 9)"""
    inputs: Array
    """(N, 6); corrected"""
    residuals: Array
    """(N, m); measured minus told, 0 where not measured"""


class Slopes(NamedTuple):
    """How one record's outputs follow the unknowns."""

    outputs: Array
    """(N, m, p + n); by the parameters and the record's n free first states, 0 where not measured"""
    steps: tuple[Array, Array]
    """Jacobians of every step"""
    by_state: Array
    """(N, m, 9); of the outputs, scales included"""


def records_of(experiments: Sequence[Experiment], longitudinal: bool) -> tuple[tuple[Record, ...], tuple[str, ...]]:
    """The records and the outputs that at least one of them has.

    Raises:
        InputError: an input is missing or has gaps, no airspeed was measured, a record is short or uneven,
            or one that turns is to be reconstructed by its longitudinal motion alone.
    """
    if not experiments:
        raise InputError("no record to reconstruct a flight path from")
    wanted = LONGITUDINAL_OUTPUTS if longitudinal else OUTPUTS
    channels = tuple(c for c in wanted if any(np.any(np.isfinite(e.signals.get(c, np.nan))) for e in experiments))
    if longitudinal:
        _refuse_turns(experiments)
    return tuple(_record(e, channels, LONGITUDINAL_INPUTS if longitudinal else INPUTS) for e in experiments), channels


def _refuse_turns(experiments: Sequence[Experiment]) -> None:
    """The pitch that q alone misses, where bank and yaw rate tell it."""
    for experiment in experiments:
        if {"phi", "q", "r"} <= set(experiment.signals):
            phi, q, r = (experiment.signals[name] for name in ("phi", "q", "r"))
            missed = np.nancumsum(q * (np.cos(phi) - 1) - r * np.sin(phi)) * experiment.step
            if np.max(np.abs(missed)) > LEVEL:
                turned = f"{experiment.name}: it turns with banked wings ({np.max(np.abs(missed)):.2f} rad of pitch)"
                raise InputError(f"{turned}, cut the turns out or reconstruct all axes")


def _record(experiment: Experiment, channels: tuple[str, ...], needed: tuple[str, ...]) -> Record:
    time, signals, count = experiment.time, experiment.signals, len(experiment.time)
    if count < LEAST_SAMPLES:
        raise InputError(
            f"{experiment.name}: {count} samples are too few for a flight path, it takes {LEAST_SAMPLES}"
        )
    steps = np.diff(time)
    if not np.all(np.abs(steps - experiment.step) < UNEVEN * experiment.step + 1e-9):
        raise InputError(f"{experiment.name}: its time base is not even, resample it first")
    missing = [name for name in needed if name not in signals]
    if missing:
        raise InputError(f"{experiment.name} has no {', '.join(missing)}: a flight path takes {', '.join(needed)}")
    for name in needed:
        absent = int(np.sum(~np.isfinite(signals[name])))
        if absent:
            raise InputError(
                f"{experiment.name}: {absent} samples of {name} are missing, bridge or split there first"
            )
    if not np.any(np.isfinite(signals.get("airspeed", np.nan))):
        raise InputError(f"{experiment.name}: no airspeed was measured, without which no flight path is to be had")
    inputs = np.column_stack([signals[name] if name in needed else np.zeros(count) for name in INPUTS])
    outputs = np.column_stack([_measured(signals, name, count) for name in channels])
    used = np.isfinite(outputs).astype(np.float64)
    return Record(experiment.name, time, inputs, np.where(used > 0, outputs, 0.0), used)


def _measured(signals: Mapping[str, Array], name: str, count: int) -> Array:
    if name not in signals:
        return np.full(count, np.nan)
    values: Array = signals[name].astype(np.float64)
    if name in WRAPPED:
        known = np.isfinite(values)
        values[known] = np.unwrap(values[known])
    return values


def free_states(channels: tuple[str, ...], longitudinal: bool) -> tuple[int, ...]:
    """States whose first value matters to any of the outputs."""
    names = ["u", "w", "theta"] if longitudinal else ["u", "v", "w", "phi", "theta"]
    if not longitudinal and {"psi", "north", "east"} & set(channels):
        names.append("psi")
    names += [name for name in ("altitude", "north", "east") if name in channels]
    return tuple(STATES.index(name) for name in names)


def errors_by_name(problem: Problem, values: Values) -> dict[str, float]:
    """The sensors' errors by name."""
    return {p.name: float(value) for p, value in zip(problem.parameters, values.errors, strict=True)}


def path_of(problem: Problem, values: Values, index: int) -> Path:
    """Record ``index`` flown at ``values``."""
    record, errors = problem.records[index], errors_by_name(problem, values)
    inputs = corrected_inputs(record.inputs, errors)
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that runs away has no residuals
        states = fly(values.starts[index], inputs, record.step, STANDARD_GRAVITY)
        told = true_outputs(problem.channels, states, inputs, problem.places)
        left = record.used * (record.outputs - _with_errors(problem, record, told, errors))
    return Path(states, inputs, left)


def _with_errors(problem: Problem, record: Record, told: Array, errors: dict[str, float]) -> Array:
    scale, bias = (np.array([errors.get(f"{kind}_{name}", 0.0) for name in problem.channels])
                   for kind in ("scale", "bias"))  # fmt: skip
    drift = np.array([errors.get(f"wind_{name}", 0.0) for name in problem.channels])
    with_errors: Array = (1 + scale) * told + bias + np.outer(record.time - record.time[0], drift)
    return with_errors


def slopes_of(problem: Problem, values: Values, index: int, path: Path) -> Slopes:
    """How the outputs of record ``index``, flown along ``path``, follow the unknowns."""
    record, errors = problem.records[index], errors_by_name(problem, values)
    count, free = len(problem.parameters), len(problem.free)
    pushes = np.zeros((len(record.time), 6, count + free))
    for column, asked in enumerate(problem.parameters):
        pushes[:, :, column] = input_push(path.inputs, asked, errors)
    first = np.zeros((9, count + free))
    first[problem.free, count + np.arange(free)] = 1.0
    steps = jacobians(path.states, path.inputs, record.step, STANDARD_GRAVITY)
    by_state, by_rate = output_slopes(problem.channels, path.states, path.inputs, problem.places)
    scale = np.array([1 + errors.get(f"scale_{name}", 0.0) for name in problem.channels])[:, None]
    by_state, by_rate = by_state * scale, by_rate * scale
    outputs = by_state @ state_slopes(steps, first, pushes) + by_rate @ pushes[:, :3]
    told = true_outputs(problem.channels, path.states, path.inputs, problem.places)
    for column, asked in enumerate(problem.parameters):
        if asked.channel in problem.channels:
            row = problem.channels.index(asked.channel)
            elapsed = record.time - record.time[0]
            outputs[:, row, column] += {"bias": 1.0, "scale": told[:, row], "wind": elapsed}[asked.kind]
    return Slopes(outputs * record.used[:, :, None], steps, by_state * record.used[:, :, None])
