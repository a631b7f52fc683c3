"""Start values of a search by maximum likelihood: equation error with the measured states.

Slopes of the measured states and the outputs are regressed on the model's own equations (Klein & Morelli 2006, ch. 5;
Jategaonkar 2006, ch. 6). States that were not measured are integrated from those that were.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import detrend, savgol_coeffs

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
"""s; longer spans of slopes and averages, for noise that hides the motion from sample to sample"""
MOST_ROWS = 1500
"""-; of one maneuver"""
ROUNDS = 6
DELAYS = [step / 20 for step in range(-20, 21)]
"""s; tried delays of the inputs"""
SMALLEST = 1e-6
"""-; singular value over the largest, below which a combination of parameters keeps its value"""
TYPICAL = {"Z_alpha": (-0.5, 1), "M_q": (-0.5, 1), "M_alpha": (-1.0, 2)}
"""1 rad/s short period: derivative, and the power of the frequency that scales it"""


class _Rows(NamedTuple):
    """Samples of one maneuver with everything that the equations need."""

    states: Array
    """(N, n)"""
    slopes: Array
    """(N, n)"""
    inputs: Array
    """(N, k)"""
    outputs: Array
    """(N, m); NaN if not measured"""


def start_values(
    model: Model,
    parameters: Mapping[str, Parameter],
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    steady: bool,
    span: float | None = None,
) -> dict[str, float]:
    """Start value of every free parameter: the map's, else by equation error, else that of a typical aircraft.

    Args:
        model: to be fitted.
        parameters: free and fixed parameters of the map.
        experiments: maneuvers with complete inputs.
        constants: SI; of the map.
        steady: a constant of every equation of every maneuver is free, as for linear models about a trim.
        span: s; of slopes and averages; None: `derived.SLOPE_SPAN` and signals as measured.
    """
    delay = parameters.get(DELAY, Parameter(fixed=0.0))
    if delay == Parameter():
        delay = Parameter(start=best_delay(model, parameters, experiments, constants, steady)[0])
        parameters = {**parameters, DELAY: delay}
    names, values, requested = _known_values(model, parameters)
    acting = tuple(acting_at(one, model.inputs, delay.fixed or delay.start or 0.0) for one in experiments)
    rows = _rows_of(model, acting, constants, span)
    found = (
        values if not requested else _equation_error(model, rows, values, [names.index(n) for n in requested], steady)
    )
    if found is None:
        found = _typical(model, experiments, values, names, requested)
    return {name: float(found[names.index(name)]) for name, one in parameters.items() if one.fixed is None}


def best_delay(
    model: Model,
    parameters: Mapping[str, Parameter],
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    steady: bool,
) -> tuple[float, float]:
    """Delay of the inputs (s) with which the equations fit best, and its share of the squares without delay."""
    free = {name: one._replace(start=None) if one.fixed is None else one for name, one in parameters.items()}
    names, values, requested = _known_values(model, {name: one for name, one in free.items() if name != DELAY})
    places = [names.index(name) for name in requested]

    def squares(delay: float) -> float:
        acting = tuple(acting_at(one, model.inputs, delay) for one in experiments)
        rows = _rows_of(model, acting, constants, None)
        found = _equation_error(model, rows, values, places, steady)
        return math.inf if found is None else float(np.sum(_errors(model, rows, found, steady) ** 2))

    plain = squares(0.0)
    if not places or not 0.0 < plain < math.inf:
        return 0.0, 1.0
    found = [squares(delay) for delay in DELAYS]
    best = int(np.argmin(found))
    return (DELAYS[best], found[best] / plain) if found[best] < plain else (0.0, 1.0)


def acting_at(experiment: Experiment, inputs: Iterable[str], delay: float) -> Experiment:
    """The experiment with its inputs ``delay`` s later."""
    if not delay:
        return experiment
    time = experiment.time
    moved = {n: np.interp(time - delay, time, experiment.signals[n]) for n in inputs if n in experiment.signals}
    return experiment._replace(signals={**experiment.signals, **moved})


def _known_values(model: Model, parameters: Mapping[str, Parameter]) -> tuple[list[str], Array, list[str]]:
    """Names and values (P,) of the model's parameters as the map has them, and those that it leaves open."""
    names = list(model.parameters)
    values = np.array([model.parameters[name].value for name in names], dtype=np.float64)
    for name, one in parameters.items():
        value = one.fixed if one.fixed is not None else one.start
        if value is not None:
            values[names.index(name)] = value
    requested = [
        name for name, one in parameters.items() if one.fixed is None and one.start is None and name != DELAY
    ]
    return names, values, requested


def _equation_error(model: Model, rows: list[_Rows], values: Array, places: list[int], steady: bool) -> Array | None:
    """Parameters (P,), those at ``places`` by least squares of the equations; None if a state is unknown."""
    if not rows:
        return None
    found = values.copy()
    for _ in range(ROUNDS):
        errors, columns = _errors(model, rows, found, steady), []
        for place in places:
            width = 1e-4 * max(abs(float(found[place])), 0.1)
            moved = found.copy()
            moved[place] += width
            columns.append((_errors(model, rows, moved, steady) - errors) / width)
        design = np.column_stack(columns)
        size = np.linalg.norm(design, axis=0)
        size[~(size > 0)] = np.inf
        step = np.linalg.lstsq(design / size, -errors, rcond=SMALLEST)[0] / size
        if not np.all(np.isfinite(step)):
            return None
        found[places] += step
        if np.all(np.abs(step) <= 1e-6 * np.maximum(np.abs(found[places]), 1e-6)):
            break
    return found


def _errors(model: Model, rows: list[_Rows], values: Array, steady: bool) -> Array:
    """Errors of the equations, each over the standard deviation of its measured side; 0 if not measured."""
    parts = []
    for one in rows:
        left: Array = np.hstack((one.slopes, one.outputs)) - model_equations(model, one.states, one.inputs, values)
        if steady:
            left = left - np.nansum(left, axis=0) / np.maximum(np.isfinite(left).sum(axis=0), 1)
        parts.append(left)
    sides = np.vstack([np.hstack((one.slopes, one.outputs)) for one in rows])
    scale = np.array([float(np.nanstd(side)) if np.isfinite(side).any() else 0.0 for side in sides.T])
    scale[~(scale > 0)] = np.inf
    scaled = np.vstack(parts) / scale
    return np.asarray(np.where(np.isfinite(scaled), scaled, 0.0).ravel())


def model_equations(model: Model, states: Array, inputs: Array, parameters: Array) -> Array:
    """Rates and outputs (N, n + m) of a model at ``states`` (N, n) and ``inputs`` (N, k)."""
    if isinstance(model, Actuated):
        return model_equations(model.model, states, inputs, parameters[: len(model.model.parameters)])
    if isinstance(model, LinearModel):
        whole = model.constant + (parameters @ model.slopes).reshape(model.constant.shape)
        return np.asarray(np.column_stack((states, inputs, np.ones(len(states)))) @ whole.T)
    if not isinstance(model, CompiledModel):
        raise TypeError("a model without equations")
    n = states.shape[1]
    found = np.empty((len(states), n + len(model.outputs)))
    for row, (state, given) in enumerate(zip(states, inputs, strict=True)):
        model.rates(state, given, parameters, model.constants, found[row, :n])
        model.observe(state, given, parameters, model.constants, found[row, n:])
    return found


def _rows_of(
    model: Model, experiments: tuple[Experiment, ...], constants: Mapping[str, float], span: float | None
) -> list[_Rows]:
    """Rows of every maneuver, averaged over ``span`` s; none if a state is unknown in one of them."""
    found = [_rows(model, one, constants, span) for one in experiments]
    return (
        [one for one in found if one is not None] if all(one is not None and len(one.states) for one in found) else []
    )


def _rows(model: Model, experiment: Experiment, constants: Mapping[str, float], span: float | None) -> _Rows | None:
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
    chosen = np.flatnonzero(np.all(np.isfinite(np.hstack((table, slopes, inputs))), axis=1))
    chosen = chosen[:: max(1, len(chosen) // MOST_ROWS)]
    return _Rows(*(np.ascontiguousarray(one[chosen], dtype=np.float64) for one in (table, slopes, inputs, outputs)))


def state_history(name: str, experiment: Experiment, constants: Mapping[str, float]) -> Array | None:
    """A state (N,) as measured, or integrated from rates and specific forces; None if neither is possible."""
    signals, step = experiment.signals, experiment.step
    if name in signals and np.isfinite(signals[name]).any():
        return np.asarray(signals[name], dtype=np.float64)
    none = np.zeros(len(experiment.time))

    def known(key: str) -> Array:
        values = np.asarray(signals.get(key, none + constants.get(key, 0.0)), dtype=np.float64)
        return np.where(np.isfinite(values), values, 0.0)

    if name == "q" and "theta" in signals:
        return slope(signals["theta"], step)
    if name == "theta" and "q" in signals:
        return _integrated(signals["q"], step)
    if "V" not in signals and "V" not in constants:
        return None
    speed = signals["V"] if "V" in signals else none + constants["V"]
    if name == "V":
        return np.asarray(speed)
    if name == "alpha" and {"q", "a_z"} <= signals.keys():
        return _integrated(signals["q"] + (signals["a_z"] + STANDARD_GRAVITY * np.cos(known("theta"))) / speed, step)
    if name == "beta" and "r" in signals:
        force = known("a_y") + STANDARD_GRAVITY * np.cos(known("theta")) * np.sin(known("phi"))
        turning = known("p") * np.sin(known("alpha")) - signals["r"] * np.cos(known("alpha"))
        return _integrated(force / speed + turning, step)
    return None


def _integrated(rate: Array, step: float) -> Array:
    """Integral (N,) without mean and trend; missing samples are interpolated."""
    known = np.isfinite(rate)
    if known.sum() < 2:
        return np.full(len(rate), np.nan)
    places = np.arange(len(rate), dtype=np.float64)
    whole = np.interp(places, places[known], rate[known])
    return np.asarray(detrend(cumulative_trapezoid(whole, dx=step, initial=0.0)))


def _typical(
    model: Model, experiments: tuple[Experiment, ...], values: Array, names: list[str], requested: list[str]
) -> Array:
    """An aircraft with the frequency of the strongest peak in the first output."""
    rate, swing = 1.0, 1.0
    for one in experiments:
        measured = next(
            (one.signals[n] for n in ("q", "alpha", "theta", "a_z", *model.outputs) if n in one.signals), None
        )
        known = np.zeros(0) if measured is None else np.asarray(measured)[np.isfinite(measured)]
        if len(known) >= 8:
            power = np.abs(np.fft.rfft((known - known.mean()) * np.hanning(len(known))))
            rate, swing = 2 * np.pi * (1 + int(np.argmax(power[1:]))) / (len(known) * one.step), float(np.ptp(known))
            break
    found = values.copy()
    for name in requested:
        if name in TYPICAL:
            found[names.index(name)] = TYPICAL[name][0] * rate ** TYPICAL[name][1]
        elif name.startswith("M_"):
            ranges = [float(np.ptp(one.signals[name[2:]])) for one in experiments if name[2:] in one.signals]
            reach = max((one for one in ranges if np.isfinite(one)), default=0.0)
            found[names.index(name)] = -rate * swing / reach if reach > 0 else 0.0
    return found
