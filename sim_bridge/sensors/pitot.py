"""HSCMRRN001ND2A5 differential pressure sensor behind a pitot tube."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact
from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import LowPass, low_pass
from sim_bridge.sensors.noise import SensorSeed, normal_rows, split
from sim_bridge.vectors import Floats
from wingbeat.units import Quantity


class PitotSpec(NamedTuple):
    """Honeywell TruStability HSCMRRN001ND2A5: +-1 inch of water (+-248.84 Pa, Gerdes Table 1), digital.

    14-bit word, transfer function A: 10 % of 2^14 (1638) at the lower end of the range, 90 % (14746) at the
    upper. Gerdes gives 0.2 m/s of airspeed precision: rho V dV is 1.9 Pa at 7.75 m/s. The zero is what the
    zeroing before take-off leaves; 0.25 % of full scale is the data sheet's linearity.
    """

    range: Annotated[float, Quantity("Pa", 10.0, 1e5)]
    """either way"""
    counts_low: Annotated[int, Quantity("counts", 0, 1 << 24)]
    """at minus the range"""
    counts_high: Annotated[int, Quantity("counts", 1, 1 << 24)]
    """at plus the range"""
    bits: Annotated[int, Quantity("-", 8, 24)]
    """of the word, at whose ends the reading saturates"""
    noise: Annotated[float, Quantity("Pa", 0.0, 100.0)]
    """standard deviation of one reading"""
    zero_sigma: Annotated[float, Quantity("Pa", 0.0, 50.0)]
    """of the units' residual zero offsets"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the units' relative scale errors"""
    time_constant: Annotated[float, Quantity("s", 0.0, 1.0)]
    """of the air column in tube and hoses"""
    incidence_deg: Annotated[float, Quantity("deg", -60.0, 60.0)]
    """of the tube to the fuselage, nose up; along the cruising flow when negative by the angle of attack"""


class PitotErrors(NamedTuple):
    """Constant errors of one unit."""

    zero: float
    """Pa"""
    scale: float
    """-"""


class AirColumn(NamedTuple):
    """Kernel arguments of the lag in tube and hoses."""

    axis: Floats
    """(2,); cosine and sine of the tube's incidence"""
    low_pass: LowPass
    memory: Floats
    """(3,) Pa; last impact pressure, its low-passed value; 1 after the first"""


class Pitot:
    """One unit; `sense` every tick, `read` when polled."""

    def __init__(self, spec: PitotSpec, seed: SensorSeed, period: float) -> None:
        unit, flight = split(seed)
        zero, scale = unit.standard_normal(2).tolist()
        self.errors = PitotErrors(spec.zero_sigma * zero, spec.scale_sigma * scale)
        self._spec = spec
        self._counts_per_pa = (spec.counts_high - spec.counts_low) / (2.0 * spec.range)
        self._normals = normal_rows(flight, 1)
        incidence = math.radians(spec.incidence_deg)
        self.column = AirColumn(
            np.array((math.cos(incidence), math.sin(incidence))), low_pass(spec.time_constant, period), np.zeros(3)
        )
        """arguments of `sense_impact`"""

    def sense(self, v_air_frd: Vector, density: float) -> None:
        """Advance the lag of the air column to the impact pressure along the tube.

        ``v_air_frd`` in m/s is the vehicle's velocity through the air, ``density`` in kg/m^3. Flow across the
        tube gives nothing, flow from behind gives suction.
        """
        sense_alone(v_air_frd[0], v_air_frd[2], density, self._bound)

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.column)

    def read(self) -> int:
        """Return the counts of the differential pressure."""
        (normal,) = next(self._normals)
        spec, errors = self._spec, self.errors
        pressure = self.column.memory.item(1) * (1.0 + errors.scale) + errors.zero + spec.noise * normal
        counts = round(spec.counts_low + (pressure + spec.range) * self._counts_per_pa)
        return min(max(counts, 0), (1 << spec.bits) - 1)


@exact
def sense_alone(forward: float, down: float, density: float, bound: Bound) -> None:
    """`sense_impact` of one sensor alone."""
    sense_impact(forward, down, density, bound_values(bound))


@exact
def sense_impact(forward: float, down: float, density: float, column: AirColumn) -> None:
    """Compute `Pitot.sense` for the velocities in m/s along body x and z."""
    memory, (keep, before, now) = column.memory, column.low_pass
    along = forward * column.axis[0] - down * column.axis[1]
    impact = 0.5 * density * along * abs(along)
    if memory[2] == 0.0:
        memory[1], memory[2] = impact, 1.0
    else:
        memory[1] = keep * memory[1] + before * memory[0] + now * impact
    memory[0] = impact
