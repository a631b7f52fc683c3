"""Prior knowledge for input design: a linear model of the aircraft, and noise of the sensors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from avionics import topics
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.models.stroke_averaged import LONGITUDINAL, Matrices, matrices
from logs.identification.results import Array
from sim_bridge.tuning.model import LinearModel
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

OUTPUTS = ("q", "a_x", "a_z")
"""fitted outputs, in the order of `Prior.noise`"""
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
