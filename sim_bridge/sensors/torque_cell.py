"""Strain-gauge torque cells on the wing drives of instrumented vehicles.

The gauges' amplifier passes what lasts a tick: a position servo that is given a new rate every tick jumps by some
tenths of a newton metre, and a reading at the end of each would be off by half a jump.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import NormalRows, SensorSeed, split
from sim_bridge.sensors.torque_cell_spec import TorqueCellSpec
from sim_bridge.vectors import Floats
from wingbeat.samples import TorqueSample


class TorqueCellErrors(NamedTuple):
    """Constant errors of the two cells; left, right."""

    zero: tuple[float, float]
    """N m"""
    scale: tuple[float, float]
    """-"""


class CellArrays(NamedTuple):
    """Kernel arguments of both cells."""

    errors: Floats
    """(2, 2); of left and right: scale, zero in N m"""
    noise: float
    """N m; standard deviation of one reading"""
    limit: float
    """N m; where they saturate, either way"""
    resolution: float
    """N m; of one count"""
    normals: Floats
    """(n, 2); standard normal numbers drawn ahead"""


class TorqueCell:
    """Left and right cell."""

    def __init__(self, spec: TorqueCellSpec, seed: SensorSeed) -> None:
        unit, flight = split(seed)
        a, b, c, d = unit.standard_normal(4).tolist()
        zero, scale = (spec.zero_sigma * a, spec.zero_sigma * b), (spec.scale_sigma * c, spec.scale_sigma * d)
        self.errors = TorqueCellErrors(zero, scale)
        self.is_installed = spec.installed
        """whether the vehicle flies with the cells"""
        self.normals = NormalRows(flight, 2)
        self.arrays = CellArrays(
            np.column_stack((scale, zero)), spec.noise, spec.range, spec.resolution, self.normals.rows
        )
        """arguments of `read_torques`"""

    def read(self, observation: Observation) -> TorqueSample | None:
        """Return the torques of both drives in counts; None if the vehicle flies without cells."""
        if not self.is_installed:
            return None
        torques = observation.torque_left, observation.torque_right
        return TorqueSample(observation.time_us, *read_torques_alone(*torques, self.normals.next_row(), self._bound))

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.arrays)


@exact
def read_torques_alone(left: float, right: float, at: int, bound: Bound) -> tuple[int, int]:
    """`read_torques` of one sensor alone."""
    return read_torques(left, right, at, bound_values(bound))


@exact_inlined
def read_torques(left: float, right: float, at: int, a: CellArrays) -> tuple[int, int]:
    """Return the counts of torques in N m with the row ``at`` of the noise."""
    return _counts(left, 0, at, a), _counts(right, 1, at, a)


@exact_inlined
def _counts(torque: float, side: int, at: int, a: CellArrays) -> int:
    reading: float = torque * (1.0 + a.errors[side, 0]) + a.errors[side, 1] + a.noise * a.normals[at, side]
    return round(min(max(reading, -a.limit), a.limit) / a.resolution)
