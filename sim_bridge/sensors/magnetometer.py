"""HMC5883L three-axis magnetometer."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from sim_bridge.environment.magnetic import MagneticField, field_ned
from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import low_pass
from sim_bridge.sensors.noise import SensorSeed, split
from sim_bridge.sensors.triad import ZERO, Conversion, Triad, draw_errors
from wingbeat.quaternions import frd_from_ned
from wingbeat.units import Quantity


class MagnetometerSpec(NamedTuple):
    """HMC5883L (Honeywell data sheet, form 900405) at its minimum gain.

    Range +-8.1 G (Gerdes Table 1: +-8 G), 230 LSB/G = 4.35 mG/LSB, noise floor 2 mG, output rate up to 75 Hz.
    Hard iron (the drives' magnets, the battery's leads) is what is left after a calibration turn.
    """

    range_gauss: Annotated[float, Quantity("gauss", 0.5, 100.0)]
    """either way"""
    sensitivity: Annotated[float, Quantity("LSB/gauss", 1.0, 1e6)]
    """of the data sheet; the driver divides by it"""
    noise_mg: Annotated[float, Quantity("mgauss", 0.0, 200.0)]
    """standard deviation of each axis"""
    hard_iron_sigma_mg: Annotated[float, Quantity("mgauss", 0.0, 500.0)]
    """of the residual field of the vehicle itself, each axis"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative scale errors"""
    misalignment_sigma_deg: Annotated[float, Quantity("deg", 0.0, 5.0)]
    """of the mounting, about each axis"""


class Magnetometer:
    """One unit in the field of one location; `read` at its output rate."""

    def __init__(self, spec: MagnetometerSpec, seed: SensorSeed, field: MagneticField) -> None:
        unit, flight = split(seed)
        self.errors = draw_errors(
            unit, spec.hard_iron_sigma_mg * 1e-3, spec.scale_sigma, math.radians(spec.misalignment_sigma_deg)
        )
        limit = round(spec.range_gauss * spec.sensitivity)
        noise = spec.noise_mg * 1e-3 * spec.sensitivity
        conversion = Conversion(spec.sensitivity, -limit, limit, (noise, noise, noise))
        self.triad = Triad(conversion, self.errors, low_pass(0.0, 1.0), flight)
        self.field_ned = field_ned(field)
        """gauss; of the earth"""

    def read(self, quaternion: tuple[float, float, float, float], vehicle_field: Vector = ZERO) -> Vector:
        """Return the measured field in gauss, body axes.

        Args:
            quaternion: of r_ned_from_frd, (w, x, y, z).
            vehicle_field: gauss, body axes; of the vehicle's own currents.
        """
        return self.triad.read(frd_from_ned(quaternion, self.field_ned), vehicle_field)
