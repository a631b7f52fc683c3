"""HSCMRRN001ND2A5 differential pressure sensor behind a pitot tube."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.observation import Vector
from sim_bridge.sensors.low_pass import LowPass, low_pass
from sim_bridge.sensors.noise import NormalRows, SensorSeed, split
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


class PitotArrays(NamedTuple):
    """Kernel arguments."""

    axis: Floats
    """(2,); cosine and sine of the tube's incidence"""
    low_pass: LowPass
    """of tube and hoses"""
    memory: Floats
    """(3,) Pa; last impact pressure, its low-passed value; 1 after the first"""
    errors: PitotErrors
    noise: float
    """Pa; standard deviation of one reading"""
    scale: Floats
    """(4,); range Pa, counts at its lower end, counts/Pa, highest count"""
    normals: Floats
    """(n, 1); standard normal numbers drawn ahead"""


class Pitot:
    """One unit; `sense` every tick, `read` when polled."""

    def __init__(self, spec: PitotSpec, seed: SensorSeed, period: float) -> None:
        unit, flight = split(seed)
        zero, scale = unit.standard_normal(2).tolist()
        self.errors = PitotErrors(spec.zero_sigma * zero, spec.scale_sigma * scale)
        self.normals = NormalRows(flight, 1)
        incidence = math.radians(spec.incidence_deg)
        counts_per_pa = (spec.counts_high - spec.counts_low) / (2.0 * spec.range)
        self.arrays = PitotArrays(
            np.array((math.cos(incidence), math.sin(incidence))),
            low_pass(spec.time_constant, period),
            np.zeros(3),
            self.errors,
            spec.noise,
            np.array((spec.range, spec.counts_low, counts_per_pa, (1 << spec.bits) - 1.0)),
            self.normals.rows,
        )
        """arguments of `sense_impact` and `read_impact`"""

    def sense(self, v_air_frd: Vector, density: float) -> None:
        """Advance the lag of the air column to the impact pressure along the tube.

        ``v_air_frd`` in m/s is the vehicle's velocity through the air, ``density`` in kg/m^3. Flow across the
        tube gives nothing, flow from behind gives suction.
        """
        sense_impact_alone(v_air_frd[0], v_air_frd[2], density, self._bound)

    def read(self) -> int:
        """Return the counts of the differential pressure."""
        return read_impact_alone(self.normals.next_row(), self._bound)

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.arrays)


@exact
def sense_impact_alone(forward: float, down: float, density: float, bound: Bound) -> None:
    """`sense_impact` of one sensor alone."""
    sense_impact(forward, down, density, bound_values(bound))


@exact
def read_impact_alone(at: int, bound: Bound) -> int:
    """`read_impact` of one sensor alone."""
    return read_impact(at, bound_values(bound))


@exact_inlined
def sense_impact(forward: float, down: float, density: float, a: PitotArrays) -> None:
    """Compute `Pitot.sense` for the velocities in m/s along body x and z."""
    memory, (keep, before, now) = a.memory, a.low_pass
    along = forward * a.axis[0] - down * a.axis[1]
    impact = 0.5 * density * along * abs(along)
    if memory[2] == 0.0:
        memory[1], memory[2] = impact, 1.0
    else:
        memory[1] = keep * memory[1] + before * memory[0] + now * impact
    memory[0] = impact


@exact_inlined
def read_impact(at: int, a: PitotArrays) -> int:
    """Compute `Pitot.read` with the row ``at`` of the noise."""
    pressure = a.memory[1] * (1.0 + a.errors.scale) + a.errors.zero + a.noise * a.normals[at, 0]
    counts = round(a.scale[1] + (pressure + a.scale[0]) * a.scale[2])
    return int(min(max(counts, 0), int(a.scale[3])))
