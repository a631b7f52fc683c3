"""ADXL345 three-axis accelerometer."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import corner, low_pass
from sim_bridge.sensors.noise import SensorSeed, split
from sim_bridge.sensors.triad import Conversion, Triad, draw_errors
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.units import Quantity


class AccelerometerSpec(NamedTuple):
    """ADXL345 (Analog Devices data sheet rev. D/E) in full resolution at an output data rate of 200 Hz.

    Range +-16 g (Gerdes Table 1), 256 LSB/g = 3.9 mg/LSB in 13 bits. Noise at 100 Hz 0.75 LSB rms in x and y and
    1.1 LSB rms in z, rising by the square root of two per doubling of the data rate: 1.06 and 1.56 LSB at 200 Hz.
    Bandwidth half the data rate. The 0 g offset (up to 150 mg new) is what is left after a six-position
    calibration.
    """

    range_g: Annotated[float, Quantity("g", 1.0, 200.0)]
    """either way"""
    sensitivity: Annotated[float, Quantity("LSB/g", 1.0, 1e5)]
    """of the data sheet; the driver divides by it"""
    noise: Annotated[tuple[float, float, float], Quantity("LSB", 0.0, 1000.0)]
    """standard deviation of each axis"""
    bandwidth: Annotated[float, Quantity("Hz", 0.0, 1000.0)]
    """of the low pass in the sensor; 0 for none"""
    offset_sigma_mg: Annotated[float, Quantity("mg", 0.0, 500.0)]
    """of the units' residual offsets"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative scale errors"""
    misalignment_sigma_deg: Annotated[float, Quantity("deg", 0.0, 5.0)]
    """of the mounting, about each axis"""


class Accelerometer:
    """One unit; `read` every tick."""

    def __init__(self, spec: AccelerometerSpec, seed: SensorSeed, period: float) -> None:
        unit, flight = split(seed)
        self.errors = draw_errors(
            unit,
            spec.offset_sigma_mg * 1e-3 * STANDARD_GRAVITY,
            spec.scale_sigma,
            math.radians(spec.misalignment_sigma_deg),
        )
        limit = round(spec.range_g * spec.sensitivity)
        conversion = Conversion(spec.sensitivity / STANDARD_GRAVITY, -limit, limit - 1, spec.noise)
        self.triad = Triad(conversion, self.errors, low_pass(corner(spec.bandwidth), period), flight)

    def read(self, specific_force_frd: Vector) -> Vector:
        """Return the measured specific force in m/s^2 of the true one in m/s^2, body axes."""
        return self.triad.read(specific_force_frd)
