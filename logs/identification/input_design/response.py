"""Prior of an input design, planned inputs over time, and the response with its sensitivities.

Waveforms are those of `avionics.guidance.excitation`; sensitivities those of the maximum-likelihood engine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from avionics import topics
from avionics.guidance import excitation as shapes
from avionics.guidance import multisine
from avionics.guidance.mission import Excitation
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import ELEVATOR, Reference, tail_angle
from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import flight_of
from logs.identification.models.actuators import Actuated
from logs.identification.models.stroke_averaged import LONGITUDINAL, Matrices, matrices, model_of
from logs.identification.results import Array, EstimationResult
from logs.identification.statistics.covariance import LAG_FRACTION, Autocovariance, autocovariance
from sim_bridge.tuning.model import LinearModel
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

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
    """-; of standard errors predicted by the residuals, see `prediction.inflation`"""

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
