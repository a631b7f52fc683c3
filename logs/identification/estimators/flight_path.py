"""Flight-path reconstruction: output error of the kinematics gives the sensors' errors and the motion.

Klein & Morelli, Aircraft System Identification, 2006, chapter 10; Jategaonkar, Flight Vehicle System Identification,
2006, chapter 10. Measured rates and specific forces drive the kinematics of `models.rigid_body`, whose outputs are
fitted to flow angles, attitude and position. Free are biases and scales of the sensors, the wind, and the initial
states of every record. The noise of rates and specific forces is integrated, so it is process noise: the residuals
that output error minimizes are those of an extended Kalman filter (filter error, Jategaonkar ch. 5), after a first
fit without it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from logs.identification.data.experiment import Experiment
from logs.identification.data.signal_errors import noise_level
from logs.identification.estimators.engine.problem import (
    Fit,
    Model,
    Nuisances,
    Parameter,
    Prior,
    Problem,
    RecordParameters,
)
from logs.identification.estimators.output_error import Search, fitted_series, output_error, predicted
from logs.identification.estimators.registry import Request
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.rigid_body import (
    INPUTS,
    LONGITUDINAL_INPUTS,
    LONGITUDINAL_STATES,
    SAMPLE,
    STATE_UNITS,
    STATES,
    UNITS,
    WINDS,
    RigidBody,
    RigidBodyFilter,
    SensorPositions,
    flow_of,
    kalman_gains,
    linearize,
    velocity_at,
    with_middles,
)
from logs.identification.results import Array, Estimate, EstimationResult, FitSeries
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

METHOD = "flight_path"
EQUATIONS = (
    "u' = a_x - g sin(theta) + r v - q w",
    "v' = a_y + g cos(theta) sin(phi) + p w - r u",
    "w' = a_z + g cos(theta) cos(phi) + q u - p v",
    "phi' = p + (q sin(phi) + r cos(phi)) tan(theta)",
    "theta' = q cos(phi) - r sin(phi)",
    "psi' = (q sin(phi) + r cos(phi)) / cos(theta)",
)
LONGITUDINAL_EQUATIONS = ("u' = a_x - g sin(theta) - q w", "w' = a_z + g cos(theta) + q u", "theta' = q")
SENSORS = "measured = (1 + scale) true + bias; steady, level wind"
WRAPPED = ("phi", "psi")
MIN_SAMPLES = 40
SEARCH = Search(fallback=False)
SCALE_DEVIATION = 0.1
"""-; standard deviation of the prior of a scale: in quiet flight it is confounded with the bias"""
MAX_SCALE = 0.6
"""-; bound of a scale's magnitude: a flow-angle sensor that measures nothing (-1) would free the motion"""
GRAVITY_SPAN = 8.0
"""s; of the start, over which the direction of gravity is estimated if no attitude was measured"""
MAX_MISSED_PITCH = 0.1
"""rad; pitch by banked turns, above which the longitudinal equations do not hold"""
LARGE_ERRORS = {"rad/s": 0.05, "m/s^2": 0.3, "m/s": 3.0, "rad": 0.1, "m": 50.0, "-": 0.05}
"""by unit; standard error above which a correction by the estimate makes a sensor no better"""

register({
    "not_measured": Entry(
        "{signals} not measured", "The sensor of the parameter was not recorded.", "add its column to [signals]"
    ),
    "unknown_error": Entry("no such error is modeled", "The map names an error that the model does not have."),
    "taken_as_zero": Entry("taken as zero", "The map lists the error in `known`."),
    "fixed_to_converge": Entry(
        "the search converges with it fixed at zero only", "The records hold no information about a sensor's scale.",
        "fly maneuvers that excite the sensor",
    ),
    "imprecise": Entry(
        "standard error {value:.2g} {unit}: a correction by it makes the sensor no better than {limit:g} {unit}",
        "The records hold little information about the error.",
        "fly maneuvers that excite the axis, or fix the error at zero (`known`)",
    ),
    "incompatible_signals": Entry(
        "the kinematics follow {subject} worse than a constant would: unit, sign or sensor position may be wrong",
        "Rates, forces, flow angles and attitude are not those of one motion.",
        "check unit, sign and position of the sensor",
    ),
    "wings_not_level": Entry(
        "measured bank of up to {bank_deg:.0f} deg: it alone makes {value:.2g} {unit} of {subject}",
        "The longitudinal equations take the wings as level; a bank acts like a bias of q and a_z.",
        "record p, r and a_y too, or cut records to where the wings are level",
    ),
    "bank_not_measured": Entry(
        "phi is not measured: a steady bank of {value:.1f} deg would move bias_q or bias_a_z by half their intervals",
        "The longitudinal equations take the wings as level, which is not tested.",
        "record phi",
    ),
    "flies_backward": Entry(
        "the reconstructed motion flies backward: without alpha these records determine no flight path",
        "The search ended in a motion that no aircraft makes.",
        "measure alpha",
    ),
})  # fmt: skip


class PathOptions(NamedTuple):
    """Settings of the reconstruction."""

    longitudinal: bool = False
    """-; u, w, theta and altitude alone, from q, a_x and a_z: flight with level wings"""
    also: tuple[str, ...] = ()
    """-; errors beyond `usual_errors`: scale_q, bias_theta, scale_airspeed, ..."""
    known: tuple[str, ...] = ()
    """-; errors that are zero"""
    positions: SensorPositions = SensorPositions()
    input_noise: Mapping[str, float] = {}
    """as the input, by its name; standard deviation of its white noise; estimated from the record if absent"""


DEFAULT = PathOptions()


class FlightPath(NamedTuple):
    """The sensors' errors, and the motion that agrees best with all sensors."""

    result: EstimationResult
    motions: tuple[Experiment, ...]
    """by record: u, v, w, airspeed, alpha, beta at the center of mass, the other states, and the inputs without their
    errors (specific forces at the IMU's position); empty if the search failed"""


def usual_errors(longitudinal: bool) -> tuple[str, ...]:
    """Names of the parameters that are free by default: biases of the inputs, errors of the vanes, wind."""
    if longitudinal:
        return (*(f"bias_{name}" for name in LONGITUDINAL_INPUTS), "bias_alpha", "scale_alpha")
    vanes = ("bias_alpha", "bias_beta", "scale_alpha", "scale_beta")
    return (*(f"bias_{name}" for name in INPUTS), *vanes, *WINDS)


def reconstruct(
    experiments: Sequence[Experiment], options: PathOptions = DEFAULT, held_out: Sequence[Experiment] = ()
) -> FlightPath:
    """Estimate the sensors' errors and the flight path from records of the same sensors.

    Signals: p, q, r (rad/s), a_x, a_y, a_z (m/s^2, specific force) without gaps, ``airspeed`` (m/s), and any of
    alpha, beta (rad; atan2(w, u), asin(v / V)), phi, theta, psi (rad), altitude, north, east (m), climb_rate (m/s),
    NaN if not measured. Records in ``held_out`` are predicted with the estimates.

    Raises:
        InputError: an input or the airspeed is missing or has gaps, or a record is short or uneven.
    """
    model = RigidBody(options.positions, options.longitudinal)
    records = _prepared(experiments, model)
    outputs = tuple(name for name in model.outputs if any(_is_measured(one, name) for one in records))
    free, findings = _free_errors(model, outputs, options)
    problem = _problem(model, records, outputs, free)
    simulated = output_error(problem, SEARCH)
    scales = [f"scale_{name}" for name in outputs if f"scale_{name}" in free]
    if simulated.failure and scales:
        findings += [Finding("fixed_to_converge", "withheld", name) for name in scales]
        problem = _problem(model, records, outputs, tuple(name for name in free if name not in scales))
        simulated = output_error(problem, SEARCH)
    fit = simulated
    if not simulated.failure:
        problem = _with_filter(model, problem, simulated, options)
        fit = output_error(problem, SEARCH)
    findings += fit.findings
    if fit.failure:
        return FlightPath(_result(options, fit, findings), ())
    motions = tuple(
        _motion(problem, one, fitted) for one, fitted in zip(problem.experiments, fit.records, strict=True)
    )
    later = _prepared(held_out, model) if held_out else ()
    initial = tuple(_initial(model, one) for one in later)
    series = (
        *(one for one in fitted_series(problem, fit) if np.any(np.isfinite(one.measured))),
        *predicted(problem._replace(model=model), fit, later, initial),
    )
    findings += [*_imprecise(fit), *_incompatible(problem, simulated)]
    if model.longitudinal:
        findings += _bank_findings(records, fit.estimates)
    if "alpha" not in outputs and any(np.min(one.signals["u"]) <= 0.0 for one in motions):
        findings.append(Finding("flies_backward", "warning"))
    return FlightPath(_result(options, fit, findings, series), motions)


def estimate_flight_path(request: Request) -> EstimationResult:
    """Row of the registry; options as the fields of `PathOptions`."""
    return reconstruct(request.experiments, PathOptions(**request.options), request.held_out).result


# --- preparation --------------------------------------------------------------------------------------------


def _prepared(experiments: Sequence[Experiment], model: RigidBody) -> tuple[Experiment, ...]:
    """The records with continuous angles.

    Raises:
        InputError: see `reconstruct`.
    """
    if not experiments:
        raise InputError("no record to reconstruct a flight path from")
    records = []
    for one in experiments:
        if len(one.time) < MIN_SAMPLES:
            raise InputError(
                f"{one.name}: {len(one.time)} samples are too few for a flight path, it takes {MIN_SAMPLES}"
            )
        for name in (*model.inputs, "airspeed"):
            if not _is_measured(one, name):
                raise InputError(
                    f"{one.name}: {name} was not measured; it takes {', '.join((*model.inputs, 'airspeed'))}"
                )
        if model.longitudinal:
            _check_turns(one)
        signals = {name: np.asarray(values, dtype=np.float64) for name, values in one.signals.items()}
        records.append(
            one._replace(signals=signals | {name: unwrapped(signals[name]) for name in signals if name in WRAPPED})
        )
    return tuple(records)


def unwrapped(angle: Array) -> Array:
    """An angle (rad) without jumps of a turn, NaN where not measured."""
    continuous, known = angle.copy(), np.isfinite(angle)
    continuous[known] = np.unwrap(angle[known])
    return continuous


def _is_measured(one: Experiment, name: str) -> bool:
    return name in one.signals and bool(np.any(np.isfinite(one.signals[name])))


def _check_turns(one: Experiment) -> None:
    if {"phi", "q", "r"} <= one.signals.keys():
        phi, q, r = (one.signals[name] for name in ("phi", "q", "r"))
        pitch = float(np.max(np.abs(np.nancumsum(q * (np.cos(phi) - 1) - r * np.sin(phi)) * one.step)))
        if pitch > MAX_MISSED_PITCH:
            raise InputError(
                f"{one.name}: banked turns ({pitch:.2f} rad of pitch): cut them out or reconstruct all axes"
            )


def _free_errors(
    model: RigidBody, outputs: tuple[str, ...], options: PathOptions
) -> tuple[tuple[str, ...], list[Finding]]:
    """Parameters to be estimated, and why others of those requested are not."""
    free: list[str] = []
    findings: list[Finding] = []
    for name in dict.fromkeys((*usual_errors(options.longitudinal), *options.also)):
        channel = name.partition("_")[2]
        if name not in model.parameters:
            findings.append(Finding("unknown_error", "withheld", name))
        elif name in options.known:
            findings.append(Finding("taken_as_zero", "info", name))
        elif name in WINDS and not {"north", "east"} <= set(outputs):
            findings.append(Finding("not_measured", "withheld", name, details={"signals": "north and east"}))
        elif channel not in (*model.inputs, *outputs):
            findings.append(Finding("not_measured", "withheld", name, details={"signals": channel}))
        else:
            free.append(name)
    return tuple(free), findings


def _problem(
    model: RigidBody, records: tuple[Experiment, ...], outputs: tuple[str, ...], free: tuple[str, ...]
) -> Problem:
    limits = {name: MAX_SCALE if name.startswith("scale_") else np.inf for name in free}
    priors = {name: Prior(0.0, SCALE_DEVIATION) for name in free if name.startswith("scale_")}
    parameters = {name: Parameter(0.0, low=-limits[name], high=limits[name], prior=priors.get(name)) for name in free}
    initial = tuple(_initial(model, one) for one in records)
    moving = LONGITUDINAL_STATES if model.longitudinal else STATES
    states = tuple(name for name in moving if name not in ("north", "east", "psi") or name in outputs)
    return Problem(model, records, parameters, outputs, Nuisances(states), initial)


def _initial(model: RigidBody, one: Experiment) -> dict[str, float]:
    """States at the start from the first sample of each output; an attitude not measured by gravity."""
    first = {name: float(one.signals[name][np.isfinite(one.signals[name])][0])
             for name in model.outputs if _is_measured(one, name)}  # fmt: skip
    if not {"phi", "theta"} <= first.keys():
        bank, pitch = _attitude(model, one)
        first = {"phi": bank, "theta": pitch} | first
    speed = first["airspeed"]
    climb = float(np.arcsin(np.clip(first.get("climb_rate", 0.0) / max(speed, 1e-6), -1, 1)))
    velocity = _velocity(speed, first.get("alpha", first["theta"] - climb), first.get("beta", 0.0))
    states = dict(zip(STATES, (*velocity.tolist(), *(first.get(name, 0.0) for name in STATES[3:])), strict=True))
    return states | ({"v": 0.0, "phi": 0.0} if model.longitudinal else {})


def _velocity(speed: Array | float, alpha: Array | float, beta: Array | float) -> Array:
    """Velocity (m/s; (..., 3), FRD) at the flow angles."""
    ahead = speed * np.cos(beta)
    velocity: Array = np.stack((ahead * np.cos(alpha), speed * np.sin(beta), ahead * np.sin(alpha)), axis=-1)
    return velocity


def _attitude(model: RigidBody, one: Experiment) -> tuple[float, float]:
    """Bank and pitch (rad) at the start.

    With R(t) from the body axes at t to the initial ones (the rates' integral), the kinematics integrate to
    ``R v - int R f dt = v(0) + g t``, linear in v(0) and g, the gravity in the initial body axes. Without alpha:
    wings level, at the pitch at which the mean of a_x is gravity's.
    """
    level = float(np.arcsin(np.clip(np.mean(one.signals["a_x"]) / STANDARD_GRAVITY, -0.9, 0.9)))
    if model.longitudinal or not _is_measured(one, "alpha"):
        return 0.0, level
    count = len(one.time)
    beta = one.signals["beta"] if _is_measured(one, "beta") else np.zeros(count)
    velocity = _velocity(one.signals["airspeed"], one.signals["alpha"], beta)
    known = np.all(np.isfinite(velocity), axis=1) & (one.time - one.time[0] <= GRAVITY_SPAN)
    if np.count_nonzero(known) < MIN_SAMPLES // 2:
        return 0.0, level
    rates, forces = (np.column_stack([one.signals[name] for name in part]) for part in (INPUTS[:3], INPUTS[3:]))
    attitude = [Rotation.identity()]
    for turn in Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2.0 * one.step):
        attitude.append(attitude[-1] * turn)
    to_initial = Rotation.concatenate(attitude)
    force = to_initial.apply(forces)
    gained = np.vstack((np.zeros(3), np.cumsum((force[1:] + force[:-1]) / 2.0 * one.step, axis=0)))
    rest = (to_initial.apply(np.nan_to_num(velocity)) - gained)[known]
    line = np.column_stack((np.ones(count), one.time - one.time[0]))[known]
    down = np.linalg.lstsq(line, rest, rcond=None)[0][1]
    return float(np.arctan2(down[1], down[2])), float(np.arctan2(-down[0], np.hypot(down[1], down[2])))


# --- filter error -------------------------------------------------------------------------------------------


def _with_filter(body: RigidBody, problem: Problem, fit: Fit, options: PathOptions) -> Problem:
    """The problem with an extended Kalman filter along the path of the ``fit``.

    The outputs' noise is that of the residuals, the process noise that of the inputs' differences between samples.
    """
    places = [list(body.outputs).index(name) for name in problem.outputs]
    gains, experiments, first = [], [], 0
    for one, fitted in zip(problem.experiments, fit.records, strict=True):
        path = body.motion(*_arguments(body, one, fitted), one.step)
        steps = linearize(path.states, with_middles(path.inputs), one.step, STANDARD_GRAVITY)
        scales = np.array([1.0 + fitted.parameters[f"scale_{name}"] for name in problem.outputs])
        slopes = body.output_slopes(path.states, path.inputs)[:, places] * scales[:, None]
        pushed = steps[1] * _input_noise(body, one, options)
        noise = np.where(np.isfinite(_measured(problem, one)), np.diag(fit.noise), np.inf)
        gains.append(kalman_gains(steps[0], pushed @ np.swapaxes(pushed, 1, 2), slopes, noise))
        sample = first + np.arange(len(one.time), dtype=np.float64)
        experiments.append(one._replace(signals={**one.signals, SAMPLE: sample}))
        first += len(one.time)
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    return problem._replace(
        model=RigidBodyFilter(body, problem.outputs, np.concatenate(gains)),
        experiments=tuple(experiments),
        parameters={name: one._replace(start=values[name]) for name, one in problem.parameters.items()},
        initial=tuple(fitted.initial for fitted in fit.records),
    )


def _arguments(model: Model, record: Experiment, fitted: RecordParameters) -> tuple[Array, Array, Array]:
    """Parameters, initial states and inputs of a fitted record."""
    parameters = np.array([fitted.parameters[name] for name in model.parameters])
    start = np.array([fitted.initial[name] for name in STATES])
    return parameters, start, np.column_stack([record.signals[name] for name in model.inputs])


def _measured(problem: Problem, record: Experiment) -> Array:
    """Fitted outputs (N, m), NaN if not measured."""
    missing = np.full(len(record.time), np.nan)
    return np.column_stack([record.signals.get(name, missing) for name in problem.outputs])


def _input_noise(model: RigidBody, one: Experiment, options: PathOptions) -> Array:
    """Standard deviation (6,) of each input's white noise."""
    levels = np.zeros(len(INPUTS))
    for place, name in enumerate(INPUTS):
        if name in model.inputs:
            given = options.input_noise.get(name)
            levels[place] = noise_level(one.signals[name]) if given is None else given
    return levels


# --- result -------------------------------------------------------------------------------------------------


def _result(
    options: PathOptions, fit: Fit, findings: Sequence[Finding], series: tuple[FitSeries, ...] = ()
) -> EstimationResult:
    names = [one.name for one in fit.estimates]
    places = [fit.names.index(name) for name in names]
    return EstimationResult(
        METHOD, "path", "rigid body", (*(LONGITUDINAL_EQUATIONS if options.longitudinal else EQUATIONS), SENSORS),
        fit.status, fit.estimates, fit.covariance[np.ix_(places, places)] if names else None, degrees=fit.degrees,
        series=series, samples=sum(len(one.time) for one in fit.histories), findings=tuple(findings),
        initial=dict.fromkeys(fit.names, 0.0),
    )  # fmt: skip


def _motion(problem: Problem, record: Experiment, fitted: RecordParameters) -> Experiment:
    """The filtered motion of one record."""
    model = problem.model
    assert isinstance(model, RigidBodyFilter)
    states, corrected, _ = model.motion(*_arguments(model, record, fitted), _measured(problem, record), record.step)
    velocity = velocity_at(states[:, :3], corrected[:, :3], (0.0, 0.0, 0.0), model.body.positions.imu)
    signals = dict(zip(STATES, states.T, strict=True)) | dict(zip(("u", "v", "w"), velocity.T, strict=True))
    signals |= {name: flow_of(velocity, name) for name in ("airspeed", "alpha", "beta")}
    signals |= dict(zip(INPUTS, corrected.T, strict=True))
    units = dict(zip(STATES, STATE_UNITS, strict=True)) | {name: UNITS[name] for name in signals if name in UNITS}
    return Experiment(record.name, record.time, signals, units)


def _imprecise(fit: Fit) -> list[Finding]:
    limits = {one.name: LARGE_ERRORS[one.unit] for one in fit.estimates}
    return [
        Finding("imprecise", "warning", one.name, one.standard_error, limits[one.name], {"unit": one.unit})
        for one in fit.estimates if one.standard_error > limits[one.name]
    ]  # fmt: skip


def _incompatible(problem: Problem, fit: Fit) -> list[Finding]:
    """Outputs that the fitted kinematics explain worse than their mean does."""
    findings = []
    for column, name in enumerate(problem.outputs):
        pairs = [(one.measured[:, column], one.model[:, column]) for one in fit.histories]
        means = [measured - np.nanmean(measured) for measured, _ in pairs if np.any(np.isfinite(measured))]
        left = sum(float(np.nansum((measured - model) ** 2)) for measured, model in pairs)
        varied = sum(float(np.nansum(one**2)) for one in means)
        if left > varied:
            findings.append(Finding("incompatible_signals", "warning", name, 1.0 - left / max(varied, 1e-300), 0.0))
    return findings


def _bank_findings(records: Sequence[Experiment], estimates: Sequence[Estimate]) -> list[Finding]:
    """What a bank makes of the longitudinal motion.

    A level turn pitches by ``r tan(phi)``, a steady one by ``g / V sin(phi) tan(phi)``, and a_z lacks
    ``g (1 - cos(phi))``.
    """
    half = {one.name: one.high - one.value for one in estimates if one.name in ("bias_q", "bias_a_z")}
    banked = [one for one in records if _is_measured(one, "phi")]
    if banked:
        phi = np.concatenate([one.signals["phi"] for one in banked])
        pitching = np.concatenate([_yaw_rate(one) for one in banked]) * np.tan(phi)
        effects = {"bias_q": np.nanmean(pitching), "bias_a_z": STANDARD_GRAVITY * np.nanmean(1.0 - np.cos(phi))}
        bank = float(np.degrees(np.nanmax(np.abs(phi))))
        details = {name: {"bank_deg": bank, "unit": UNITS[name.removeprefix("bias_")]} for name in half}
        return [
            Finding("wings_not_level", "warning", name, float(effects[name]), limit, details[name])
            for name, limit in half.items() if abs(effects[name]) > limit
        ]  # fmt: skip
    speed = float(np.nanmean(np.concatenate([one.signals["airspeed"] for one in records])))
    banks = []
    if "bias_q" in half:
        # sin(phi) tan(phi) = c, so cos(phi)^2 + c cos(phi) - 1 = 0
        c = half["bias_q"] * speed / STANDARD_GRAVITY
        banks.append(np.arccos(min((np.sqrt(c**2 + 4.0) - c) / 2.0, 1.0)))
    if "bias_a_z" in half:
        banks.append(np.arccos(np.clip(1.0 - half["bias_a_z"] / STANDARD_GRAVITY, -1.0, 1.0)))
    return [Finding("bank_not_measured", "warning", value=float(np.degrees(min(banks))))] if banks else []


def _yaw_rate(one: Experiment) -> Array:
    """Measured (N,), or that of a coordinated turn."""
    if "r" in one.signals:
        return one.signals["r"]
    speed = one.signals["airspeed"]
    return np.asarray(STANDARD_GRAVITY * np.sin(one.signals["phi"]) / np.where(speed > 0.0, speed, np.nan))
