"""Predicted response to an input, and the standard errors of what it would identify.

The Cramer-Rao bound of output error (Klein & Morelli, Aircraft System Identification, 2006, ch. 6 and 9.3), with a
free initial state and a bias of each output. The outputs of a flapping aircraft are averaged over strokes: adjacent
averages share samples, so the bound is that of least squares with colored noise. In gusts the residuals are colored
by the aircraft's motion; their covariance is that of a stationary gust through the model.

Waveforms are those of `avionics.guidance.excitation`; sensitivities those of the maximum-likelihood engine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.sparse import csr_array, eye_array

from avionics import topics
from avionics.guidance import excitation as shapes
from avionics.guidance import multisine
from avionics.guidance.mission import Excitation
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import ELEVATOR, OUTPUT_STEP, Maneuver, Reference, tail_angle
from logs.identification.data.resampling import averaging_matrix
from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import flight_of
from logs.identification.models.actuators import Actuated
from logs.identification.models.modes import short_period_of
from logs.identification.models.stroke_averaged import LONGITUDINAL, UNITS, Matrices, matrices, model_of
from logs.identification.results import Array, EstimationResult
from logs.identification.statistics.covariance import (
    LAG_FRACTION,
    Autocovariance,
    ParameterUncertainty,
    autocovariance,
    colored_information,
    propagate,
)
from sim_bridge.tuning.model import LinearModel
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

WORST_CONDITION = 1e12
FORGOTTEN = 1e-3
"""-; correlation of gusts below which lags are left out"""
MODE_UNITS = {"short_period_frequency": "rad/s", "short_period_damping": "-"}


class Gust(NamedTuple):
    """Turbulence, first-order along and across the path (after Dryden, MIL-F-8785C)."""

    sigma: float
    """m/s; standard deviation of each component"""
    scale: float = 20.0
    """m; length over which it is correlated"""


class Predicted(NamedTuple):
    """One parameter, and what will be uncertain about it."""

    name: str
    """-; symbol of a derivative, or of the mode"""
    unit: str
    """-; its unit"""
    value: float
    """as `unit`; of the prior"""
    standard_error: float
    """as `unit`; predicted"""


def predicted_covariance(prior: Prior, planned: Waveform, response: Response, gust: Gust | None = None) -> Array:
    """Covariance (12, 12) of the derivatives after one maneuver.

    Raises:
        InputError: the maneuver does not tell all derivatives apart, or gusts on an aircraft whose motion grows.
    """
    if prior.residuals is not None and prior.wing_period and gust is None:
        return _covariance_by_residuals(prior, [(planned, response)], prior.residuals)
    averaging, windy = _averaging(prior, planned), gust is not None and gust.sigma > 0.0
    gusts = _gust_autocovariance(prior, gust, len(planned.time)) if gust is not None and windy else None
    noise = np.array(prior.noise) * np.sqrt(float(np.mean(averaging.power(2).sum(axis=1))))
    if gusts is not None:
        noise = np.sqrt(noise**2 + np.diag(gusts.lags[0]))
    averaged = _averaged(averaging, response.sensitivities) / noise[:, None]
    free = _without(_nuisances(averaging, response.starts, noise), averaged)
    inverse = _inverse_information(free)
    weights = np.stack([averaging.T @ free[:, i] for i in range(len(OUTPUTS))], axis=1) / noise[:, None]
    core = np.einsum("nip,i,niq->pq", weights, np.square(prior.noise), weights)
    if gusts is not None:
        core = core + colored_information([_coarser(weights, _stride(prior))], gusts)
    covariance: Array = inverse @ core @ inverse
    return covariance


def _inverse_information(free: Array) -> Array:
    """Inverse (p, p) of the information of sensitivities (M, m, p).

    Raises:
        InputError: it is singular.
    """
    information = np.einsum("nip,niq->pq", free, free)
    size = np.sqrt(np.diag(information))
    if not np.all(size > 0) or np.linalg.cond(information / np.outer(size, size)) > WORST_CONDITION:
        raise InputError("this input does not tell all derivatives apart: make it longer, or of more frequencies")
    inverse: Array = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    return inverse


def _covariance_by_residuals(
    prior: Prior, maneuvers: Sequence[tuple[Waveform, Response]], residuals: Autocovariance
) -> Array:
    """Covariance (12, 12) of least squares with colored residuals of an earlier flight (Morelli & Klein, 1997)."""
    noise, free = np.sqrt(np.diag(residuals.lags[0])), []
    for planned, response in maneuvers:
        averaging = _averaging(prior, planned)
        averaged = _averaged(averaging, response.sensitivities) / noise[:, None]
        free.append(_without(_nuisances(averaging, response.starts, noise), averaged))
    inverse = _inverse_information(np.concatenate(free))
    core = colored_information([one / noise[:, None] for one in free], residuals)
    covariance: Array = prior.inflation**2 * inverse @ core @ inverse
    return covariance


def inflation(prior: Prior, maneuvers: Sequence[Maneuver], errors: Mapping[str, float]) -> float:
    """Standard errors of a flight over those predicted for its own inputs, quadratic mean over the derivatives.

    It contains what the prediction neglects: differences between maneuvers beyond the residuals' autocovariance.

    Args:
        prior: of the flight, with its residuals.
        maneuvers: of the flight.
        errors: standard errors by derivative that the flight left.
    """
    names = [name for name in LONGITUDINAL if errors.get(name, 0.0) > 0.0]
    if prior.residuals is None or not prior.wing_period or not names:
        return 1.0
    flown = []
    for one in maneuvers:
        margin = prior.wing_period / 2 + 2 * prior.step
        planned = Waveform(one.command_time, one.command, margin, float(one.command_time[-1]) - margin)
        flown.append((planned, respond(prior, planned)))
    try:
        covariance = _covariance_by_residuals(prior._replace(inflation=1.0), flown, prior.residuals)
    except InputError:
        return 1.0
    bounds = dict(zip(LONGITUDINAL, np.sqrt(np.diag(covariance)), strict=True))
    return float(np.sqrt(np.mean([(errors[name] / bounds[name]) ** 2 for name in names])))


def predict(prior: Prior, covariance: Array, repeats: int = 1) -> tuple[Predicted, ...]:
    """The mode's frequency and damping, then every derivative, after ``repeats`` of a maneuver.

    Raises:
        InputError: the prior has no short period.
    """
    covariance = covariance / repeats

    def mode(values: Array) -> Array:
        return np.array(short_period_of(matrices(LONGITUDINAL, values, prior.reference, prior.aircraft).a))

    try:
        both, uncertainty = propagate(mode, prior.values, ParameterUncertainty(covariance, np.inf))
    except ValueError as error:
        raise InputError(f"the prior model has no short period: {error}") from None
    rows = zip(
        (*MODE_UNITS, *LONGITUDINAL),
        (*both, *prior.values),
        (*uncertainty.standard_errors, *np.sqrt(np.diag(covariance))),
        strict=True,
    )
    return tuple(Predicted(n, (UNITS | MODE_UNITS)[n], float(value), float(error)) for n, value, error in rows)


def _stride(prior: Prior) -> int:
    """Samples over which gusts and their response hardly change."""
    return max(round(OUTPUT_STEP / prior.step), 1)


def _coarser(weights: Array, stride: int) -> Array:
    """Sums (N / stride, m, p) of ``weights`` (N, m, p) over ``stride`` samples each."""
    summed: Array = np.add.reduceat(weights, np.arange(0, len(weights), stride), axis=0)
    return summed


def _averaging(prior: Prior, planned: Waveform) -> csr_array:
    """From samples to what is fitted: stroke averages, or the samples themselves."""
    if not prior.wing_period:
        return csr_array(eye_array(len(planned.time)))
    at = np.arange(planned.start, planned.end, OUTPUT_STEP)
    return averaging_matrix(planned.time, np.full(len(at), prior.wing_period), at)


def _averaged(averaging: csr_array, columns: Array) -> Array:
    """Averages (M, m, k) of ``columns`` (N, m, k)."""
    flat: Array = averaging @ columns.reshape(len(columns), -1)
    return flat.reshape(-1, *columns.shape[1:])


def _nuisances(averaging: csr_array, starts: Array, noise: Array) -> Array:
    """Columns (M, m, 4 + m) of the initial state and of a bias of each output, in standard deviations."""
    free = _averaged(averaging, starts) / noise[:, None]
    biases = np.broadcast_to(np.eye(free.shape[1]), (len(free), free.shape[1], free.shape[1]))
    return np.concatenate((free, biases), axis=2)


def _without(nuisances: Array, columns: Array) -> Array:
    """``columns`` (M, m, k) less what the nuisances can explain of them."""
    flat, known = columns.reshape(-1, columns.shape[2]), nuisances.reshape(-1, nuisances.shape[2])
    left, sizes, _ = np.linalg.svd(known / np.linalg.norm(known, axis=0), full_matrices=False)
    basis = left[:, sizes > 1e-8 * sizes[0]]
    rest: Array = (flat - basis @ (basis.T @ flat)).reshape(columns.shape)
    return rest


def _gust_autocovariance(prior: Prior, gust: Gust, samples: int) -> Autocovariance:
    """Autocovariance (L, 3, 3) of the outputs in gusts along x and z, by lag in strides of `_stride`."""
    model, pole = prior.model(), prior.reference.airspeed / gust.scale
    force = prior.values.reshape(3, 4)[:, :2]
    x, z, m = force
    at_imu = np.array([np.zeros(2), x + prior.aircraft.imu_z * m, z - prior.aircraft.imu_x * m])
    whole = np.block([[model.a, np.vstack((-force, np.zeros(2)))], [np.zeros((2, 4)), -pole * np.eye(2)]])
    if np.max(np.linalg.eigvals(whole).real) >= 0.0:
        raise InputError("the prior model's motion grows by itself: its errors in gusts cannot be predicted")
    drive = np.diag([0.0, 0.0, 0.0, 0.0, 1.0, 1.0]) * 2.0 * pole * gust.sigma**2
    spread = solve_continuous_lyapunov(whole, -drive)
    c = np.hstack((model.c[: len(OUTPUTS)], -at_imu))
    once, power, lags = expm(whole * prior.step * _stride(prior)), np.eye(6), []
    for _ in range(0, samples, _stride(prior)):
        lags.append(c @ spread @ power.T @ c.T)
        power = once @ power
        if np.max(np.abs(power)) < FORGOTTEN:
            break
    return Autocovariance(np.array(lags), 0.0)


OUTPUTS = ("q", "a_x", "a_z")
"""fitted outputs, in the order of `Prior.noise`"""
NUISANCES = 7
"""-; of a maneuver: initial states and biases of the outputs"""
ROUNDING = 1.0 / math.sqrt(12.0)
"""-; standard deviation of a reading within one count"""


class Prior(NamedTuple):
    """A longitudinal model with its derivatives, and its measurement."""

    values: Array
    """as `longitudinal.UNITS`; (12,), derivatives in the order of `longitudinal.LONGITUDINAL`"""
    reference: Reference
    """the trim"""
    aircraft: Aircraft
    """position of the IMU, lag of the tail"""
    wing_period: float
    """s; over which the outputs are averaged, 0 for fixed wings"""
    noise: tuple[float, float, float]
    """rad/s, m/s^2, m/s^2; standard deviation of one sample of q, a_x and a_z"""
    step: float
    """s; between samples"""
    residuals: Autocovariance | None = None
    """of the stroke averages of `OUTPUTS` in an earlier flight, `OUTPUT_STEP` apart: noise, gusts and all else that
    its model left; None without one"""
    inflation: float = 1.0
    """-; of standard errors predicted by the residuals, see `inflation`"""

    def model(self) -> Matrices:
        """Its state space."""
        return matrices(LONGITUDINAL, self.values, self.reference, self.aircraft)


def prior_of(model: LinearModel, aircraft: Aircraft, noise: tuple[float, float, float], rate: float = 0.0) -> Prior:
    """The prior of a linear ``model`` of level flight; sample ``rate`` (Hz), 0 for that of the IMU.

    Raises:
        InputError: a noise that is not above zero.
    """
    if not all(math.isfinite(sigma) and sigma > 0.0 for sigma in noise):
        raise InputError("the noise of pitch rate and accelerations must be above 0")
    u, w = model.airspeed * math.cos(model.pitch), model.airspeed * math.sin(model.pitch)
    kinematic = np.array([[0.0, 0.0, -w], [0.0, 0.0, u], [0.0, 0.0, 0.0]])
    derivatives = np.column_stack((model.a[:3, :3] - kinematic, model.elevator[:3]))
    reference = Reference(u, w, model.pitch, model.airspeed)
    period = 1.0 / model.frequency if model.frequency > 0.0 else 0.0
    return Prior(derivatives.ravel(), reference, aircraft, period, noise, 1.0 / (rate or topics.IMU.rate))


def sensor_noise(vehicle: SimulatedVehicle) -> tuple[float, float, float]:
    """Noise of one sample of q (rad/s), a_x and a_z (m/s^2) by a vehicle's file, with the rounding to counts.

    Raises:
        InputError: the file has no gyroscope or accelerometer.
    """
    if not {"gyroscope", "accelerometer"} <= set(vehicle.sections):
        raise InputError(f"{vehicle.path} has no gyroscope and accelerometer: specify their noise with --noise")
    gyro, accel = vehicle.sections["gyroscope"], vehicle.sections["accelerometer"]
    q = math.radians(math.hypot(gyro.noise_deg_s, ROUNDING / gyro.sensitivity))
    x, z = (math.hypot(accel.noise[i], ROUNDING) / accel.sensitivity * STANDARD_GRAVITY for i in (0, 2))
    return q, x, z


def residuals_of(result: EstimationResult, nuisances: int = NUISANCES) -> Autocovariance | None:
    """The autocovariance of the residuals of output error over the fitted maneuvers; None without any.

    It is scaled up by the degrees of freedom that the fit took, ``nuisances`` in each maneuver.
    """
    parts: dict[str, dict[str, Array]] = {}
    for one in result.series:
        if not one.held_out and one.output in OUTPUTS:
            parts.setdefault(one.experiment, {})[one.output] = one.measured - one.model
    records = [np.column_stack([found[name] for name in OUTPUTS]) for found in parts.values() if len(found) == 3]
    if not records:
        return None
    used = [np.isfinite(one).astype(float) for one in records]
    lags = max(int(LAG_FRACTION * max(map(len, records))), 1) + 1
    pooled = autocovariance([np.nan_to_num(one) for one in records], used, lags)
    left = pooled.effective - len(result.estimates) - nuisances * len(records)
    factor = pooled.effective / max(left, 0.25 * pooled.effective)
    return pooled._replace(lags=pooled.lags * factor)


STATES = ("u", "w", "q", "theta")
SHOWN = (*OUTPUTS, "theta")


class Waveform(NamedTuple):
    """One maneuver: settle, input, settle, with a margin at both ends."""

    time: Array
    """s; (N,), from 0"""
    command: Array
    """rad; (N,), added to the elevator"""
    start: float
    """s; of the maneuver"""
    end: float
    """s; of the maneuver"""


def waveform(excitation: Excitation, step: float, fade: float, margin: float) -> Waveform:
    """Return one repeat of ``excitation`` with a ``margin`` (s) at its ends; ``fade`` (s) is that of a sweep."""
    length = 2.0 * excitation.settle + shapes.duration(excitation)
    time: Array = step * np.arange(int((length + 2.0 * margin) / step) + 1, dtype=np.float64)
    since = time - margin - excitation.settle
    return Waveform(time, np.array([_value(excitation, fade, t) for t in since.tolist()]), margin, margin + length)


def _value(excitation: Excitation, fade: float, since: float) -> float:
    if not 0.0 <= since < shapes.duration(excitation):
        return 0.0
    if excitation.shape in shapes.SEGMENTS:
        return excitation.amplitude * shapes.steps(excitation.shape, excitation.width, since)
    if excitation.shape in shapes.SWEEPS:
        return excitation.amplitude * shapes.sweep(excitation, fade, since)
    return multisine.value(shapes.spectrum(excitation)[excitation.channel], since)


class Response(NamedTuple):
    """Response of the prior to one maneuver."""

    states: Array
    """m/s, m/s, rad/s, rad; (N, 4), u, w, q and theta about the trim"""
    outputs: Array
    """rad/s, m/s^2, m/s^2, rad; (N, 4), q, a_x and a_z at the IMU, theta, about the trim"""
    sensitivities: Array
    """as the output per derivative; (N, 3, 12), of `OUTPUTS`"""
    starts: Array
    """as the output per state; (N, 3, 4), of `OUTPUTS` to the initial state"""

    def times(self, factor: float) -> Response:
        """The response to an input ``factor`` times as large."""
        return Response(self.states * factor, self.outputs * factor, self.sensitivities * factor, self.starts)


def respond(prior: Prior, planned: Waveform) -> Response:
    """The response to ``planned`` from the trim, and its sensitivities."""
    tail = tail_angle(planned.time, planned.command, prior.aircraft)
    zoh = () if prior.aircraft.tail_time_constant else (ELEVATOR,)
    model = Actuated(model_of(LONGITUDINAL, prior.reference, prior.aircraft), (), zoh)
    signals = {ELEVATOR: tail, **dict.fromkeys(OUTPUTS, np.zeros(len(tail)))}
    parameters = dict(zip(LONGITUDINAL, map(Parameter, prior.values.tolist()), strict=True))
    start = dict.fromkeys(STATES, 0.0)
    problem = Problem(model, (Experiment("plan", planned.time, signals, {}),), parameters, OUTPUTS, initial=(start,))
    flight = flight_of(problem)
    (record,), first, count = flight.records, flight.first(), len(LONGITUDINAL)
    slopes = flight.slopes(record, first.values, first.local[0])
    table = model.simulate(flight.split(record, first.values, first.local[0]).parameters, record.start, record.inputs,
                           record.step)  # fmt: skip
    states, outputs = (table[:, [list(model.outputs).index(name) for name in names]] for names in (STATES, SHOWN))
    return Response(states, outputs, slopes[:, :, :count], slopes[:, :, count:])
