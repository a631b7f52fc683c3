"""ITG-3200 three-axis gyroscope."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import corner, low_pass
from sim_bridge.sensors.noise import NormalRows, SensorSeed, split
from sim_bridge.sensors.triad import Conversion, Triad, draw_errors
from sim_bridge.vectors import Floats
from wingbeat.units import Quantity


class GyroscopeSpec(NamedTuple):
    """ITG-3200 (InvenSense PS-ITG-3200A) with its 98 Hz digital low pass.

    Range +-2000 deg/s (Gerdes Table 1), 14.375 LSB per deg/s, total noise 0.38 deg/s rms. The zero-rate output
    (+-40 deg/s new) is what is left after averaging at rest before take-off, and walks slowly with temperature.
    """

    range_deg_s: Annotated[float, Quantity("deg/s", 10.0, 10000.0)]
    """either way"""
    sensitivity: Annotated[float, Quantity("LSB s/deg", 0.1, 1e5)]
    """of the data sheet; the driver divides by it"""
    noise_deg_s: Annotated[float, Quantity("deg/s", 0.0, 20.0)]
    """standard deviation of each axis"""
    bandwidth: Annotated[float, Quantity("Hz", 0.0, 1000.0)]
    """of the low pass in the sensor; 0 for none"""
    bias_sigma_deg_s: Annotated[float, Quantity("deg/s", 0.0, 50.0)]
    """of the units' biases at power-on, after calibration"""
    bias_walk_deg_s: Annotated[float, Quantity("deg/s/sqrt(s)", 0.0, 1.0)]
    """random walk of the bias: its standard deviation after one second"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative scale errors"""
    misalignment_sigma_deg: Annotated[float, Quantity("deg", 0.0, 5.0)]
    """of the mounting, about each axis"""


class Walk(NamedTuple):
    """Kernel arguments of the random walk of the bias."""

    bias: Floats
    """(3,) rad/s; sum of the steps"""
    step: float
    """rad/s; standard deviation of a step"""
    normals: Floats
    """(n, 3); standard normal numbers drawn ahead"""


class Gyroscope:
    """One unit; `read` every tick."""

    def __init__(self, spec: GyroscopeSpec, seed: SensorSeed, period: float) -> None:
        unit, flight = split(seed)
        noise_stream, walk_stream = flight.spawn(2)
        self.errors = draw_errors(
            unit,
            math.radians(spec.bias_sigma_deg_s),
            spec.scale_sigma,
            math.radians(spec.misalignment_sigma_deg),
        )
        limit = round(spec.range_deg_s * spec.sensitivity)
        noise = spec.noise_deg_s * spec.sensitivity
        conversion = Conversion(math.degrees(spec.sensitivity), -limit, limit, (noise, noise, noise))
        self.triad = Triad(conversion, self.errors, low_pass(corner(spec.bandwidth), period), noise_stream)
        self.normals = NormalRows(walk_stream, 3)
        step = math.radians(spec.bias_walk_deg_s) * math.sqrt(period)
        self.walk = Walk(np.zeros(3), step, self.normals.rows)
        """arguments of `step_walk`"""

    @property
    def bias(self) -> Vector:
        """True bias in rad/s: the constant of the unit and its random walk."""
        (ox, oy, oz), (wx, wy, wz) = self.errors.offset, self.walk.bias.tolist()
        return ox + wx, oy + wy, oz + wz

    def read(self, omega_frd: Vector) -> Vector:
        """Return the measured angular velocity in rad/s of the true one in rad/s, body axes."""
        step_walk_alone(self.normals.next_row(), self._bound)
        x, y, z = self.walk.bias.tolist()
        return self.triad.read(omega_frd, (x, y, z))

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.walk)


@exact
def step_walk_alone(at: int, bound: Bound) -> None:
    """`step_walk` of one sensor alone."""
    step_walk(at, bound_values(bound))


@exact_inlined
def step_walk(at: int, walk: Walk) -> Vector:
    """Advance the bias by the row ``at`` of its normal numbers and return it."""
    bias, normals = walk.bias, walk.normals
    for axis in range(3):
        bias[axis] += walk.step * normals[at, axis]
    return bias[0], bias[1], bias[2]
