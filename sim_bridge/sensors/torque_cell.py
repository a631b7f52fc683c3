"""Strain-gauge torque cells on the wing drives of instrumented vehicles.

The gauges' amplifier passes what lasts a tick: a position servo that is given a new rate every tick jumps by some
tenths of a newton metre, and a reading at the end of each would be off by half a jump.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import SensorSeed, normal_rows, split
from wingbeat.samples import TorqueSample
from wingbeat.units import Quantity


class TorqueCellSpec(NamedTuple):
    """A full bridge on each drive's horn (chosen: Gerdes measured torque on a dynamometer, not in flight)."""

    installed: bool
    """false: the vehicle flies without"""
    range: Annotated[float, Quantity("N m", 1e-3, 1000.0)]
    """either way"""
    resolution: Annotated[float, Quantity("N m", 1e-6, 10.0)]
    """of one count"""
    noise: Annotated[float, Quantity("N m", 0.0, 10.0)]
    """standard deviation of one reading"""
    zero_sigma: Annotated[float, Quantity("N m", 0.0, 10.0)]
    """of the cells' residual zero offsets"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the cells' relative scale errors"""


class TorqueCellErrors(NamedTuple):
    """Constant errors of the two cells; left, right."""

    zero: tuple[float, float]
    """N m"""
    scale: tuple[float, float]
    """-"""


class TorqueCell:
    """Left and right cell."""

    def __init__(self, spec: TorqueCellSpec, seed: SensorSeed) -> None:
        unit, flight = split(seed)
        a, b, c, d = unit.standard_normal(4).tolist()
        self.errors = TorqueCellErrors(
            (spec.zero_sigma * a, spec.zero_sigma * b), (spec.scale_sigma * c, spec.scale_sigma * d)
        )
        self._spec = spec
        self._normals = normal_rows(flight, 2)

    def read(self, observation: Observation) -> TorqueSample | None:
        """Return the torques of both drives in counts; None if the vehicle flies without cells."""
        if not self._spec.installed:
            return None
        left, right = next(self._normals)
        zero, scale = self.errors
        return TorqueSample(
            observation.time_us,
            self._counts(observation.torque_left * (1.0 + scale[0]) + zero[0] + self._spec.noise * left),
            self._counts(observation.torque_right * (1.0 + scale[1]) + zero[1] + self._spec.noise * right),
        )

    def _counts(self, torque: float) -> int:
        limit = self._spec.range
        return round(min(max(torque, -limit), limit) / self._spec.resolution)
