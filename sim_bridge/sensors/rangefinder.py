"""Downward rangefinder: a narrow beam along the body's z axis, over level ground at the launch site's altitude."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import SensorSeed, normal_rows, split
from wingbeat.samples import RangeSample
from wingbeat.units import Quantity

NO_ECHO, GOOD_ECHO = 0, 100
"""%; quality of a reading without and with an echo"""
CENTI = 100.0
"""1/m; distances cross the wire in centimeters"""


class RangefinderSpec(NamedTuple):
    """A laser rangefinder, as its data sheet describes it."""

    min_distance: Annotated[float, Quantity("m", 0.0, 10.0)]
    """of a reading"""
    max_distance: Annotated[float, Quantity("m", 0.5, 200.0)]
    """of a reading"""
    noise: Annotated[float, Quantity("m", 0.0, 1.0)]
    """standard deviation of one reading"""
    zero_sigma: Annotated[float, Quantity("m", 0.0, 1.0)]
    """of the constant error of a unit"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the relative scale error of a unit"""


class RangefinderErrors(NamedTuple):
    """Errors of this unit for the whole flight."""

    zero: float
    """m"""
    scale: float
    """-"""


class Rangefinder:
    """One unit."""

    def __init__(self, spec: RangefinderSpec, seed: SensorSeed) -> None:
        unit, flight = split(seed)
        zero, scale = unit.standard_normal(2).tolist()
        self.errors = RangefinderErrors(spec.zero_sigma * zero, spec.scale_sigma * scale)
        self._spec = spec
        self._normals = normal_rows(flight, 1)

    def read(self, observation: Observation) -> RangeSample:
        """Return the distance to the ground along the beam; 0 with quality 0 if there is no echo."""
        spec = self._spec
        (normal,) = next(self._normals)
        _, x, y, _ = observation.quaternion
        vertical = 1.0 - 2.0 * (x * x + y * y)
        height = -observation.position_ned[2]
        distance = height / vertical if vertical > 0.0 else spec.max_distance + 1.0
        read = distance * (1.0 + self.errors.scale) + self.errors.zero + spec.noise * normal
        has_echo = 0.0 <= distance <= spec.max_distance
        return RangeSample(
            observation.time_us,
            round(max(read, 0.0) * CENTI) / CENTI if has_echo else 0.0,
            spec.min_distance,
            spec.max_distance,
            GOOD_ECHO if has_echo else NO_ECHO,
        )
