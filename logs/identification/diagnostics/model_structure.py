"""Diagnostics of the model structure: lack of fit, and effects outside the model that explain the residuals.

An omitted effect is a number that the model fixes at zero: a delay of the inputs or of one output, the position of a
vane, a derivative, the course of an input between its samples. One Gauss-Newton step from the optimum, with all
parameters and nuisances free, gives its value, the share of the residuals that it explains (score test: Rao, Proc.
Cambridge Phil. Soc. 44, 1948), and the change of every estimate (omitted-variable bias), which is added to the
covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.signal_errors import noise_with_steps
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import coarse_inputs, largest_change, sampling_finding
from logs.identification.estimators.engine.problem import Fit, Problem, RecordParameters
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, Estimate, FitSeries
from logs.identification.statistics.fit_quality import output_fits

DELAY = "delay"
"""name of the parameter: the time by which all inputs act later than they were recorded"""
LEAST_SHARE, LEAST_ERRORS = 0.1, 6.0
"""-; share of the residuals' power, and standard errors, above which an omitted effect is reported"""
LEAST_STEPS = 0.2
"""-; least delay in sampling intervals that is reported"""
SIGNIFICANT_SHIFT = 0.3
"""-; standard errors that the course between samples changes an estimate by, above which it is reported"""
COARSE = 0.1
"""-; change of an input between samples over its range, from which its course is examined"""
UNKNOWN_COURSE = 0.5
"""-; the same, from which the input may have changed at any time between two samples"""
FINE = 4
"""-; steps in a sampling interval for the course between samples"""
VANES = {"alpha": ("q", -1.0), "beta": ("r", 1.0)}
"""a flow angle -> the rate that a vane ahead of the center of mass measures too, and its sign"""
NOISE_RATIO, POWER_SHARE, LEAST_SAMPLES = 3.0, 0.01, 20
"""-; residuals over white noise, and their share of the output's power, above which the model lacks something"""
LITTLE = 0.5
"""-; R^2 below which the model explains little of an output"""
SPEED_RATIO = 1.15
"""-; largest over smallest mean airspeed of the maneuvers of one linear model: derivatives grow with its square"""

register({
    "lack_of_fit": Entry(
        "residuals of {subject}: {value:.0f} times its noise, {percent} % of its power",
        "The model leaves more than noise: turbulence, an input or motion outside the model, or a delayed signal.",
        "{options}see the effect of another finding",
    ),
    "model_structure": Entry(
        "{subject} = {value:+.2g} (fixed: 0) explains {percent:.0f} % of residuals; intervals widened",
        "A derivative outside the model explains the residuals.",
        "free it in the parameters",
    ),
    "time_skew": Entry(
        "{subject} {amount:.2g} s {direction} explains {percent:.0f} % of residuals; intervals widened",
        "A delay of the inputs or of one output explains the residuals.",
        "set delay = \"free\" for inputs, [prepare.delay] for an output",
    ),
    "sensor_position": Entry(
        "vane {subject} {amount:.2g} m {direction} explains {percent:.0f} % of residuals; intervals widened",
        "The position of a vane or accelerometer explains the residuals.",
        "set constants.vane_x or constants.imu_x",
    ),
    "conditional": Entry(
        "it depends on {others}, which the data does not determine",
        "The estimate holds only for the last values of parameters that are not identifiable.",
        "fix one of them, or fly another input",
    ),
    "poor_fit": Entry(
        "the model explains {percent:.0f} % of {subject}{where}",
        "R^2 of an output is below one half; its parameters may have no meaning.",
        "check signs and units, the model and its inputs",
    ),
    "operating_point": Entry(
        "one linear model for mean airspeeds from {value:.3g} to {limit:.3g} m/s",
        "Derivatives grow with the airspeed and its square; one linear model is an average.",
        "fit each airspeed separately, or use the nonlinear model",
    ),
    "trim_from_vane": Entry(
        "trim {subject} of {value:.3g} rad is the mean of a vane",
        "The bias of the vane turns the axes of the linear model, and no pitch angle corrects it.",
        "set alpha and theta in [constants]; 0.0 for stability axes",
    ),
    "trim_assumed": Entry(
        "{subject} is neither a constant nor a signal: assumed 0 rad",
        "The axes of the linear model turn with the trim angles.",
        "add it to [constants] or [signals]",
    ),
})  # fmt: skip


class Effect(NamedTuple):
    """An effect outside the model."""

    finding: Finding
    shift: Array
    """(p,); change of the fit's values by it"""


class _Candidate(NamedTuple):
    code: str
    subject: str
    response: Callable[[RecordParameters, Array, Array, float], Array]
    """(record, inputs (N, k), outputs (N, m), step) -> change of all fitted outputs (N, m) by a unit of it"""


def omitted_effects(
    problem: Problem,
    fit: Fit,
    constants: Mapping[str, float],
    lines: Mapping[str, str],
    unnamed: Mapping[str, float],
) -> tuple[Effect, ...]:
    """The delay, position or derivative that explains the most, and inputs unknown between their samples.

    Args:
        problem: of the ``fit``, which has no failure.
        fit: the optimum.
        constants: SI; of the map.
        lines: the model's inputs that are lines between samples, by the signal's name.
        unnamed: parameters of the model that are neither free nor fixed by the user.
    """
    if fit.failure or not problem.model.inputs or not len(fit.values):
        return ()
    speeds = airspeeds(problem.experiments, constants)
    candidates = _candidates(problem, speeds, unnamed)
    coarse = coarse_inputs(tuple(lines.values()), problem.experiments, COARSE)
    named = {model: signal for signal, model in lines.items()}
    every = (*candidates, *(_between_samples(problem, name) for name in coarse))
    with np.errstate(all="ignore"):
        parameters, columns, residuals = _sensitivities(problem, fit, every)
    if not np.all(np.isfinite(parameters)) or not np.all(np.isfinite(columns)):
        return ()
    both = np.column_stack((columns, residuals))
    solved: Array = np.asarray(np.linalg.lstsq(parameters, both, rcond=1e-10)[0], dtype=np.float64)
    rest = both - parameters @ solved
    tested, left, count = rest[:, : len(candidates)], rest[:, -1], len(candidates)
    effects = [*_most_likely(problem, candidates, tested, left, solved, len(fit.values))]
    errors = {one.name: one.standard_error for one in fit.estimates}
    scale = np.array([errors.get(name, np.inf) for name in fit.names])
    for place, name in enumerate(coarse):
        shift = solved[:, count + place]
        if np.any(np.abs(shift) > SIGNIFICANT_SHIFT * np.maximum(scale, 1e-300)):
            finding = sampling_finding(name, problem.experiments)._replace(subject=named[name])
            effects.append(Effect(finding, shift))
    return tuple(effects)


def conditional_estimates(problem: Problem, fit: Fit) -> tuple[Finding, ...]:
    """Estimates that change by more than their standard error if a parameter without estimate changes by a tenth."""
    known = [one.name for one in fit.estimates if one.name in fit.names]
    lost = [name for name in fit.names if name not in known]
    if fit.failure or not known or not lost:
        return ()
    with np.errstate(all="ignore"):
        parameters, _, _ = _sensitivities(problem, fit, ())
    if not np.all(np.isfinite(parameters)):
        return ()
    rows, others = [fit.names.index(name) for name in known], [fit.names.index(name) for name in lost]
    slopes = np.linalg.lstsq(parameters[:, rows], parameters[:, others], rcond=1e-10)[0]
    change = np.max(np.abs(slopes) * 0.1 * np.abs(fit.values[others]), axis=1)
    errors = {one.name: one.standard_error for one in fit.estimates}
    details = {"others": ", ".join(lost)}
    return tuple(
        Finding("conditional", "withheld", name, float(shift), errors[name], details)
        for name, shift in zip(known, change, strict=True)
        if shift > errors[name]
    )


def widened(fit: Fit, effects: tuple[Effect, ...]) -> Fit:
    """The fit with the change of each estimate by omitted effects in its covariance and intervals."""
    if not effects:
        return fit
    more = np.sum([np.outer(one.shift, one.shift) for one in effects], axis=0)
    estimates = []
    for one in fit.estimates:
        place = fit.names.index(one.name)
        error = float(np.sqrt(one.standard_error**2 + more[place, place]))
        estimates.append(_with_error(one, error))
    return fit._replace(estimates=tuple(estimates), covariance=fit.covariance + more)


def _with_error(one: Estimate, error: float) -> Estimate:
    factor = (one.high - one.low) / 2.0 / one.standard_error if one.standard_error > 0.0 else 1.96
    return one._replace(standard_error=error, low=one.value - factor * error, high=one.value + factor * error)


def _most_likely(
    problem: Problem,
    candidates: tuple[_Candidate, ...],
    tested: Array,
    left: Array,
    solved: Array,
    parameters: int,
) -> list[Effect]:
    """The one candidate that explains the most of the residuals, if it is significant."""
    power, degrees = float(left @ left), max(len(left) - parameters, 1)
    best: tuple[float, Effect] | None = None
    for place, (candidate, column) in enumerate(zip(candidates, tested.T, strict=True)):
        size = float(column @ column)
        if not size > 0.0 or not power > 0.0:
            continue
        value = float(column @ left) / size
        share = value**2 * size / power
        least = _least_value(problem, candidate)
        sure = value**2 * size * degrees > LEAST_ERRORS**2 * power
        if abs(value) < least or share < LEAST_SHARE or not sure or (best and share <= best[0]):
            continue
        forward = {"time_skew": ("late", "early"), "sensor_position": ("ahead", "behind")}
        details = {
            "percent": 100.0 * share, "amount": abs(value),
            "direction": forward.get(candidate.code, ("", ""))[int(value < 0)],
        }  # fmt: skip
        finding = Finding(candidate.code, "warning", candidate.subject, value, least, details)
        best = share, Effect(finding, -value * solved[:, place])
    return [best[1]] if best else []


def _least_value(problem: Problem, candidate: _Candidate) -> float:
    return LEAST_STEPS * problem.experiments[0].step if candidate.code == "time_skew" else 0.0


def _candidates(
    problem: Problem, speeds: Mapping[str, float], unnamed: Mapping[str, float]
) -> tuple[_Candidate, ...]:
    model, found = problem.model, []

    def delayed_inputs(record: RecordParameters, inputs: Array, outputs: Array, step: float) -> Array:
        later = np.vstack((inputs[:1], inputs[:-1]))
        return (simulated(problem, record, later, step) - outputs) / step

    if DELAY not in model.parameters:
        found.append(_Candidate("time_skew", ", ".join(problem.model.inputs), delayed_inputs))
    for place, name in enumerate(problem.outputs if len(problem.outputs) > 1 else ()):

        def delayed(
            record: RecordParameters, inputs: Array, outputs: Array, step: float, place: int = place
        ) -> Array:
            column = np.zeros_like(outputs)
            column[:, place] = -np.gradient(outputs[:, place], step)
            return column

        found.append(_Candidate("time_skew", name, delayed))
    for name in unnamed:

        def derivative(
            record: RecordParameters, inputs: Array, outputs: Array, step: float, name: str = name
        ) -> Array:
            more = record._replace(parameters={**record.parameters, name: record.parameters[name] + 1e-4})
            return (simulated(problem, more, inputs, step) - outputs) / 1e-4

        found.append(_Candidate("model_structure", name, derivative))
    for angle, (rate, sign) in VANES.items():
        if angle not in problem.outputs or rate not in model.outputs or len(speeds) < len(problem.experiments):
            continue

        def position(
            record: RecordParameters,
            inputs: Array,
            outputs: Array,
            step: float,
            angle: str = angle,
            rate: str = rate,
            sign: float = sign,
        ) -> Array:
            column = np.zeros_like(outputs)
            turning = simulated(problem, record, inputs, step, (rate,))[:, 0]
            column[:, problem.outputs.index(angle)] = sign * turning / speeds[record.name]
            return column

        found.append(_Candidate("sensor_position", angle, position))
    return tuple(found)


def _between_samples(problem: Problem, name: str) -> _Candidate:
    """A cubic between the samples of an input in place of a line; for steps the standard deviation of their time.

    A step at any time between two samples lies between a hold and its mirror image about the line: a uniform
    distribution has 1 / sqrt(3) of its half width as standard deviation.
    """
    column = list(problem.model.inputs).index(name)
    stepwise = largest_change(name, problem.experiments) > UNKNOWN_COURSE

    def response(record: RecordParameters, inputs: Array, outputs: Array, step: float) -> Array:
        places = np.arange(FINE * (len(inputs) - 1) + 1) / FINE
        lines = np.column_stack([np.interp(places, np.arange(len(inputs)), one) for one in inputs.T])
        other = lines.copy()
        if stepwise:
            held = inputs[np.floor(places).astype(int), column]
            other[:, column] += (held - lines[:, column]) / np.sqrt(3.0)
        else:
            other[:, column] = _cubic(inputs[:, column], places)
        fine = [simulated(problem, record, one, step / FINE)[::FINE] for one in (other, lines)]
        return np.asarray(fine[0] - fine[1])

    return _Candidate("sampling", name, response)


def _cubic(values: Array, places: Array) -> Array:
    """``values`` (N,) at ``places`` (M,) between them, by the cubic through the four nearest."""
    first = np.clip(np.floor(places).astype(int) - 1, 0, len(values) - 4)
    x, found = places - first, np.zeros(len(places))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        found += values[first + i] * np.prod([(x - j) / (i - j) for j in others], axis=0)
    return found


def simulated(
    problem: Problem, record: RecordParameters, inputs: Array, step: float, names: tuple[str, ...] = ()
) -> Array:
    """Outputs ``names`` (the fitted ones if empty) (N, m) of the model for one record, without output biases."""
    model = problem.model
    parameters = np.array([record.parameters[name] for name in model.parameters])
    start = np.array([record.initial[name] for name in model.states])
    biases = np.array([record.input_biases.get(name, 0.0) for name in model.inputs])
    outputs = list(model.outputs)
    return model.simulate(parameters, start, inputs + biases, step)[
        :, [outputs.index(n) for n in names or problem.outputs]
    ]


def _sensitivities(problem: Problem, fit: Fit, candidates: tuple[_Candidate, ...]) -> tuple[Array, Array, Array]:
    """Parameters (M, p), candidates (M, k) and residuals (M,) over all records in standard deviations of the noise.

    Initial states, biases and local parameters of each record are projected out (Schur complement; Klein & Morelli
    2006, sec. 6.1).
    """
    scale = np.sqrt(np.diag(fit.noise))
    scale = np.where(scale > 0.0, scale, np.inf)
    by_name = {one.name: one for one in problem.experiments}
    blocks = []
    for record, history in zip(fit.records, fit.histories, strict=True):
        experiment = by_name[record.name]
        inputs = np.column_stack([experiment.signals[name] for name in problem.model.inputs])
        step, used = experiment.step, np.isfinite(history.measured)
        outputs = simulated(problem, record, inputs, step)

        def derivative(
            field: str, name: str, record: RecordParameters = record, inputs: Array = inputs, step: float = step,
            outputs: Array = outputs,
        ) -> Array:  # fmt: skip
            values: dict[str, float] = dict(getattr(record, field))
            width = 1e-5 * max(abs(values[name]), 0.1)
            changed: Any = {field: {**values, name: values[name] + width}}
            return np.asarray((simulated(problem, record._replace(**changed), inputs, step) - outputs) / width)

        free = [derivative("parameters", name) for name in fit.names]
        local = [derivative("parameters", n) for n, one in problem.parameters.items() if one.free and one.local]
        states = problem.nuisances.initial_states
        local += [derivative("initial", n) for n in (problem.model.states if states is None else states)]
        local += [derivative("input_biases", n) for n in problem.nuisances.input_biases]
        for name in problem.nuisances.output_biases:
            local.append(np.zeros_like(outputs))
            if name in problem.outputs:
                local[-1][:, problem.outputs.index(name)] = 1.0
        tested = [one.response(record, inputs, outputs, step) for one in candidates]
        residual = np.where(used, history.measured - history.model, 0.0)
        wanted = np.column_stack([(one * used / scale).ravel() for one in (*free, *tested, residual)])
        nuisance = np.column_stack([np.zeros((wanted.shape[0], 0)), *((one * used / scale).ravel() for one in local)])
        blocks.append(wanted - nuisance @ np.linalg.lstsq(nuisance, wanted, rcond=1e-10)[0])
    whole, p = np.vstack(blocks), len(fit.names)
    return whole[:, :p], whole[:, p:-1], whole[:, -1]


def airspeeds(experiments: tuple[Experiment, ...], constants: Mapping[str, float]) -> dict[str, float]:
    """Mean airspeed (m/s) of each maneuver that has one."""
    found = {}
    for one in experiments:
        values = np.asarray(one.signals.get("V", np.zeros(0)), dtype=np.float64)
        speed = float(np.nanmean(values)) if np.any(np.isfinite(values)) else constants.get("V", 0.0)
        if speed > 0.0:
            found[one.name] = speed
    return found


def lack_of_fit(context: Context) -> tuple[Finding, ...]:
    """Outputs whose residuals are far above the noise, the worst maneuver of each."""
    worst: dict[str, tuple[float, float]] = {}
    for one in context.result.series if context.result and not context.averaged else ():
        ratio = None if one.held_out else _residual_ratio(one)
        if ratio is not None and ratio > worst.get(one.output, (0.0, 0.0)):
            worst[one.output] = ratio
    result = context.result
    options = "states = 4, " if result and result.model == "short period" else ""
    options += 'method = "filter_error", ' if result and result.method == "output_error" and context.linear else ""
    options += "or " if options else ""
    return tuple(
        Finding("lack_of_fit", "warning", name, times, NOISE_RATIO, {"percent": _percent(share), "options": options})
        for name, (times, share) in worst.items()
    )


def has_lack_of_fit(series: tuple[FitSeries, ...]) -> bool:
    """Whether a model leaves more than noise, or explains little, of a fitted output."""
    fitted = tuple(one for one in series if not one.held_out)
    poor = any(one.r_squared < LITTLE and one.white is not True for one in output_fits(fitted))
    return poor or any(_residual_ratio(one) is not None for one in fitted)


def _percent(share: float) -> str:
    return f"{100.0 * share:.1g}" if share < 0.095 else f"{100.0 * share:.0f}"


def _residual_ratio(one: FitSeries) -> tuple[float, float] | None:
    """Residuals over noise, and their share of the output's power; None without a lack of fit."""
    residual = one.measured - one.model
    known = np.isfinite(residual)
    noise = noise_with_steps(residual)
    if np.count_nonzero(known) < LEAST_SAMPLES or not noise > 0:
        return None
    size, power = float(np.std(residual[known])), float(np.var(one.measured[known]))
    if size <= NOISE_RATIO * noise or not size**2 > POWER_SHARE * power:
        return None
    return size / noise, size**2 / power if power > 0 else 1.0


def poor_fit(context: Context) -> tuple[Finding, ...]:
    """Outputs of which the model explains less than half."""
    series = context.result.series if context.result else ()
    return tuple(
        Finding("poor_fit", "warning", one.output, one.r_squared, LITTLE,
                {"percent": 100.0 * max(one.r_squared, 0.0), "where": f" in {one.experiment}"})
        for one in output_fits(series)
        if one.r_squared < LITTLE and one.white is not True
    )  # fmt: skip


def operating_points(context: Context) -> tuple[Finding, ...]:
    """Maneuvers at different airspeeds in one linear model."""
    speeds = airspeeds(context.experiments, context.constants).values()
    low, high = min(speeds, default=1.0), max(speeds, default=1.0)
    if not context.linear or high < SPEED_RATIO * low:
        return ()
    return (Finding("operating_point", "warning", "", low, high),)


def assumed_trim(context: Context) -> tuple[Finding, ...]:
    """Trim angles that nothing gives but the axes of the model need."""
    model = context.result.model if context.result else ""
    if model not in ("longitudinal", "lateral") or "beta" in context.inputs:
        return ()
    signals = context.experiments[0].signals
    known = {*context.constants, *signals}
    found = [Finding("trim_assumed", "warning", n) for n in ("alpha", "theta") if n not in known]
    if "theta" not in known and "alpha" in signals and "alpha" not in context.constants:
        mean = float(np.nanmean(np.concatenate([one.signals["alpha"] for one in context.experiments])))
        found.append(Finding("trim_from_vane", "warning", "alpha", mean))
    return tuple(found)
