"""Where output error begins when nobody says: equation error with the model's own equations.

The states as measured (or as kinematics make them of what is measured) and their slopes are put into the model's
equations, the parameters that fit them best are the start (Klein & Morelli, Aircraft System Identification, 2006,
ch. 5 and 6; Jategaonkar, Flight Vehicle System Identification, 2006, ch. 4).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_coeffs

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import filled
from logs.identification.estimators.engine.problem import Model
from logs.identification.estimators.regressors import average_of_slope, averaged
from logs.identification.models.actuators import Actuated
from logs.identification.models.compiled import CompiledModel
from logs.identification.models.linear import LinearModel
from logs.identification.results import Array
from logs.identification.sources.table.config import DELAY, Parameter
from logs.identification.sources.table.derived import SLOPE_SPAN, slope, slope_width
from wingbeat.constants import STANDARD_GRAVITY

SPANS = (0.3, 1.0)
"""s; over which slopes are taken, and states averaged, where shorter ones led nowhere: noise that hides the motion
from sample to sample makes the start of an aircraft that is none"""
MOST_ROWS = 1500
"""-; of one manoeuvre: a start needs no more"""
ROUNDS = 6
LEAST_SWING = 8
DELAYS = [step / 20 for step in range(-20, 21)]
"""s; at which inputs are tried to act"""
DIFFERENCE = 1e-4
SMALLEST = 1e-6
"""-; singular value, of the largest, under which a combination of parameters stays where it was"""


class How(NamedTuple):
    """How a start is found."""

    steady: bool
    """-; a constant is taken out of every equation of every manoeuvre, as linear models about a trim need"""
    span: float | None = None
    """s; that slopes and states are averaged over; None: as `derived.slope` has them, and as measured"""


class _Rows(NamedTuple):
    """Samples of one manoeuvre at which all is known that the equations need."""

    states: Array
    """(N, n)"""
    slopes: Array
    """(N, n)"""
    inputs: Array
    """(N, k)"""
    outputs: Array
    """(N, m); NaN where not measured"""


def said_by(model: Model, states: Array, inputs: Array, parameters: Array) -> Array:
    """Rates and outputs (N, n + m) that a model's equations have at ``states`` (N, n) and ``inputs`` (N, k)."""
    if isinstance(model, Actuated):
        return said_by(model.model, states, inputs, parameters[: len(model.model.parameters)])
    if isinstance(model, LinearModel):
        whole = model.constant + (parameters @ model.slopes).reshape(model.constant.shape)
        return np.asarray(np.column_stack((states, inputs, np.ones(len(states)))) @ whole.T)
    if not isinstance(model, CompiledModel):
        raise TypeError("a model without equations")
    n = states.shape[1]
    said = np.empty((len(states), n + len(model.outputs)))
    for row, (state, given) in enumerate(zip(states, inputs, strict=True)):
        model.rates(state, given, parameters, model.constants, said[row, :n])
        model.observe(state, given, parameters, model.constants, said[row, n:])
    return said


def equation_error_start(
    model: Model,
    experiments: tuple[Experiment, ...],
    values: Array,
    places: list[int],
    constants: Mapping[str, float],
    how: How,
) -> Array | None:
    """The model's parameters (P,), those at ``places`` such that its equations fit best, the others as in ``values``.

    None where a state is neither measured nor to be made of what is.
    """
    rows = [_rows(model, one, constants, how.span) for one in experiments]
    if any(one is None or not len(one.states) for one in rows):
        return None
    known = [one for one in rows if one is not None]
    found = values.copy()
    for _ in range(ROUNDS):
        step = _step(model, known, found, places, how.steady)
        if not np.all(np.isfinite(step)):
            return None
        found[places] += step
        if np.all(np.abs(step) <= 1e-6 * np.maximum(np.abs(found[places]), 1e-6)):
            break
    return found


def _step(model: Model, rows: list[_Rows], values: Array, places: list[int], steady: bool) -> Array:
    """Change of the parameters at ``places`` by linear least squares about ``values``."""
    here = _errors(model, rows, values, steady)
    columns = []
    for place in places:
        width = DIFFERENCE * max(abs(float(values[place])), 0.1)
        moved = values.copy()
        moved[place] += width
        columns.append((_errors(model, rows, moved, steady) - here) / width)
    design = np.column_stack(columns)
    size = np.linalg.norm(design, axis=0)
    size[~(size > 0)] = np.inf
    solved = np.linalg.lstsq(design / size, -here, rcond=SMALLEST)[0]
    return np.asarray(solved / size)


def _errors(model: Model, rows: list[_Rows], values: Array, steady: bool) -> Array:
    """What the equations leave, each scaled by how much its measured side varies over all manoeuvres."""
    pieces = [_left(model, one, values, steady) for one in rows]
    sides = np.vstack([np.hstack((one.slopes, one.outputs)) for one in rows])
    scale = np.array([float(np.nanstd(side)) if np.isfinite(side).any() else 0.0 for side in sides.T])
    scale[~(scale > 0)] = np.inf
    left = np.vstack(pieces) / scale
    return np.asarray(np.where(np.isfinite(left), left, 0.0).ravel())


def _left(model: Model, rows: _Rows, values: Array, steady: bool) -> Array:
    """Slopes and outputs (N, n + m), measured minus the model's; NaN where not measured."""
    left: Array = np.hstack((rows.slopes, rows.outputs)) - said_by(model, rows.states, rows.inputs, values)
    if steady:
        counts = np.maximum(np.isfinite(left).sum(axis=0), 1)
        left = left - np.nansum(left, axis=0) / counts
    return left


def _rows(model: Model, experiment: Experiment, constants: Mapping[str, float], span: float | None) -> _Rows | None:
    """What the equations need: as measured, or averaged over ``span`` s; gaps short beside a slope are bridged."""
    states = [state_history(name, experiment, constants) for name in model.states]
    if any(one is None for one in states):
        return None
    missing = np.full(len(experiment.time), np.nan)
    width = slope_width(experiment.step, span or SLOPE_SPAN)
    table = np.column_stack([filled(one, width // 2) for one in states if one is not None])
    slopes = np.column_stack([slope(one, experiment.step, width) for one in table.T])
    inputs = np.column_stack([np.zeros((len(table), 0)), *(experiment.signals[name] for name in model.inputs)])
    outputs = np.column_stack([experiment.signals.get(name, missing) for name in model.outputs])
    if span:
        weights = average_of_slope(savgol_coeffs(width, 2, deriv=1, use="dot"))
        table, inputs, outputs = (
            np.column_stack([np.zeros((len(one), 0)), *(averaged(column, weights) for column in one.T)])
            for one in (table, inputs, outputs)
        )
    whole = np.all(np.isfinite(np.hstack((table, slopes, inputs))), axis=1)
    chosen = np.flatnonzero(whole)
    chosen = chosen[:: max(1, len(chosen) // MOST_ROWS)]
    return _Rows(*(np.ascontiguousarray(one[chosen], dtype=np.float64) for one in (table, slopes, inputs, outputs)))


def state_history(name: str, experiment: Experiment, constants: Mapping[str, float]) -> Array | None:
    """A state (N,) as measured, or made of what is: pitch rate of pitch, angle of attack of the normal force."""
    if name in experiment.signals and np.isfinite(experiment.signals[name]).any():
        return np.asarray(experiment.signals[name], dtype=np.float64)
    signals, step = experiment.signals, experiment.step
    if name == "q" and "theta" in signals:
        return slope(signals["theta"], step)
    if name == "theta" and "q" in signals:
        return _summed(signals["q"], step)
    if name == "V" and "V" in constants:
        return np.full(len(experiment.time), constants["V"])
    if name == "alpha" and {"q", "a_z"} <= signals.keys() and ("V" in signals or "V" in constants):
        speed = signals["V"] if "V" in signals else constants["V"]
        pitch = signals["theta"] if "theta" in signals else np.zeros(len(experiment.time))
        return _summed(signals["q"] + (signals["a_z"] + STANDARD_GRAVITY * np.cos(pitch)) / speed, step)
    if name == "beta" and "r" in signals and ("V" in signals or "V" in constants):
        return _summed(_sideways(experiment, constants), step)
    return None


def _sideways(experiment: Experiment, constants: Mapping[str, float]) -> Array:
    """Rate of the sideslip (N,) in rad/s, of small angles; what is not told of it counts as none."""

    def told(name: str) -> Array:
        none = np.zeros(len(experiment.time))
        values = np.asarray(experiment.signals.get(name, none + constants.get(name, 0.0)), dtype=np.float64)
        return values if name == "r" else np.where(np.isfinite(values), values, 0.0)

    speed = experiment.signals["V"] if "V" in experiment.signals else constants["V"]
    alpha, pushed = told("alpha"), told("a_y") + STANDARD_GRAVITY * np.cos(told("theta")) * np.sin(told("phi"))
    return np.asarray(pushed / speed - told("r") * np.cos(alpha) + told("p") * np.sin(alpha))


def _summed(rate: Array, step: float) -> Array:
    """Integral (N,) without mean and trend; what was not measured is bridged."""
    there = np.isfinite(rate)
    if there.sum() < 2:
        return np.full(len(rate), np.nan)
    places = np.arange(len(rate), dtype=np.float64)
    whole = np.interp(places, places[there], rate[there])
    total = np.concatenate(([0.0], np.cumsum((whole[1:] + whole[:-1]) * step / 2)))
    return np.asarray(total - np.polyval(np.polyfit(places, total, 1), places))


def begin(
    model: Model,
    parameters: Mapping[str, Parameter],
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    steady: bool,
    span: float | None = None,
) -> dict[str, float]:
    """A start of every free parameter: the map's, or what the model's equations make of the measured states.

    With a ``span`` (s) these are averaged over it. Where a state cannot be had of what is measured, the start is that
    of an aircraft that turns as quickly as the outputs swing.
    """
    delay = parameters.get(DELAY, Parameter(fixed=0.0))
    if delay == Parameter():
        delay = Parameter(start=best_delay(model, parameters, experiments, constants, steady)[0])
        parameters = {**parameters, DELAY: delay}
    names, values, wanted = _told(model, parameters)
    places = [names.index(name) for name in wanted]
    acting = tuple(acting_at(one, model.inputs, delay.fixed or delay.start or 0.0) for one in experiments)
    found = equation_error_start(model, acting, values, places, constants, How(steady, span)) if places else values
    if found is None:
        found = _guessed(model, experiments, values, names, wanted)
    return {name: float(found[names.index(name)]) for name, one in parameters.items() if one.fixed is None}


def _told(model: Model, parameters: Mapping[str, Parameter]) -> tuple[list[str], Array, list[str]]:
    """Names and values (P,) of the model's parameters, as the map tells them, and those that it does not tell."""
    names = list(model.parameters)
    values = np.array([model.parameters[name].value for name in names], dtype=np.float64)
    for name, one in parameters.items():
        told = one.fixed if one.fixed is not None else one.start
        if told is not None:
            values[names.index(name)] = told
    wanted = [name for name, one in parameters.items() if one.fixed is None and one.start is None and name != DELAY]
    return names, values, wanted


def best_delay(
    model: Model,
    parameters: Mapping[str, Parameter],
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    steady: bool,
) -> tuple[float, float]:
    """By how much (s) the inputs are best taken as late, of `DELAYS`, and what share of squares that leaves.

    By the model's equations as `begin` fits them; 0 and 1 where these cannot be had of what is measured.
    """
    free = {name: one._replace(start=None) if one.fixed is None else one for name, one in parameters.items()}
    names, values, wanted = _told(model, {name: one for name, one in free.items() if name != DELAY})
    places, how = [names.index(name) for name in wanted], How(steady)

    def left(delay: float) -> float:
        acting = tuple(acting_at(one, model.inputs, delay) for one in experiments)
        found = equation_error_start(model, acting, values, places, constants, how)
        rows = [_rows(model, one, constants, None) for one in acting]
        if found is None:
            return math.inf
        return float(np.sum(_errors(model, [one for one in rows if one is not None], found, steady) ** 2))

    at_once = left(0.0)
    if not places or not 0.0 < at_once < math.inf:
        return 0.0, 1.0
    squares = [left(delay) for delay in DELAYS]
    best = int(np.argmin(squares))
    return (DELAYS[best], squares[best] / at_once) if squares[best] < at_once else (0.0, 1.0)


def acting_at(experiment: Experiment, inputs: Iterable[str], delay: float) -> Experiment:
    """The experiment with its inputs when they act, ``delay`` s after they were recorded."""
    if not delay:
        return experiment
    moved = {
        name: np.interp(experiment.time - delay, experiment.time, experiment.signals[name])
        for name in inputs
        if name in experiment.signals
    }
    return experiment._replace(signals={**experiment.signals, **moved})


TYPICAL = {"Z_alpha": -0.5, "M_q": -0.5, "M_alpha": -1.0}
"""of an aircraft whose short period has 1 rad/s: powers of its frequency scale them"""
POWERS = {"Z_alpha": 1, "M_q": 1, "M_alpha": 2}


def _guessed(
    model: Model, experiments: tuple[Experiment, ...], values: Array, names: list[str], wanted: list[str]
) -> Array:
    rate, swing = _quickness(experiments, tuple(model.outputs))
    found = values.copy()
    for name in wanted:
        if name in TYPICAL:
            found[names.index(name)] = TYPICAL[name] * rate ** POWERS[name]
        elif name.startswith("M_"):
            given = [np.ptp(one.signals[name[2:]]) for one in experiments if name[2:] in one.signals]
            reach = max((float(one) for one in given if np.isfinite(one)), default=0.0)
            found[names.index(name)] = -rate * swing / reach if reach > 0 else 0.0
    return found


def _quickness(experiments: tuple[Experiment, ...], outputs: tuple[str, ...]) -> tuple[float, float]:
    """Angular frequency (rad/s) of the strongest swing of the first output that is there, and its reach."""
    for one in experiments:
        for name in (n for n in ("q", "alpha", "theta", "a_z", *outputs) if n in one.signals):
            values = one.signals[name][np.isfinite(one.signals[name])]
            if len(values) < LEAST_SWING:
                continue
            power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
            strongest = 1 + int(np.argmax(power[1:]))
            return 2 * np.pi * strongest / (len(values) * one.step), float(np.ptp(values))
    return 1.0, 1.0
