"""PA6H (MTK3339) GPS receiver."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated, NamedTuple

from sim_bridge.environment.geodesy import geodetic_from_ned
from sim_bridge.environment.home import Home
from sim_bridge.observation import Observation, Vector
from sim_bridge.sensors.noise import SensorSeed, gauss_markov_step, normal_rows, split
from wingbeat.samples import GpsFix
from wingbeat.units import Quantity

THREE_DIMENSIONAL = 3
"""-; fix type"""
DEGREES_E7 = 1e7 * 180.0 / math.pi
"""1/rad; HIL_GPS carries angles in 1e-7 deg"""


class GpsSpec(NamedTuple):
    """GlobalTop PA6H with MediaTek MTK3339: 3 m position accuracy (Gerdes Table 1), 5 Hz.

    3 m two-dimensional rms is 2.1 m on each axis; most of it is slow (ionosphere, multipath, the satellites'
    geometry) and is a first-order Gauss-Markov process, the rest white. It forgets in a quarter of an hour (Beard and
    McLain, Small Unmanned Aircraft, 2012, section 7.5, after Rankin 1994): a flight of some minutes takes most of it
    for the place of home, which is a fix too. Velocity 0.1 m/s (data sheet). A fix has
    of the moment it was measured and arrives later: solution and serial line take 100 to 200 ms.
    """

    horizontal_sigma: Annotated[float, Quantity("m", 0.0, 100.0)]
    """of the slow error, north and east each"""
    vertical_sigma: Annotated[float, Quantity("m", 0.0, 100.0)]
    """of the slow error"""
    correlation_time: Annotated[float, Quantity("s", 0.1, 1e5)]
    """of the slow error"""
    white_sigma: Annotated[float, Quantity("m", 0.0, 50.0)]
    """of the error that is new in every fix, each axis"""
    velocity_sigma: Annotated[float, Quantity("m/s", 0.0, 10.0)]
    """of the velocity, each axis, new in every fix"""
    latency: Annotated[float, Quantity("s", 0.0, 2.0)]
    """from measurement to arrival"""
    satellites: Annotated[int, Quantity("-", 4, 32)]
    """used in a fix"""


class Gps:
    """One receiver; `measure` every ``period`` s, `arrived` every tick."""

    def __init__(self, spec: GpsSpec, seed: SensorSeed, home: Home, period: float) -> None:
        unit, flight = split(seed)
        self._spec = spec
        self._home = home
        self._decay, self._drive = gauss_markov_step(period, spec.correlation_time)
        self._slow: list[float] = unit.standard_normal(3).tolist()
        self._normals = normal_rows(flight, 9)
        self._accuracy = _centi(math.sqrt(2.0) * spec.horizontal_sigma), _centi(spec.vertical_sigma)
        self._latency_us = round(spec.latency * 1e6)
        self._pending: deque[GpsFix] = deque()

    def measure(self, observation: Observation) -> None:
        """Take a fix; its time stamp is the time of its arrival."""
        normals = next(self._normals)
        self._slow = [self._decay * old + self._drive * new for old, new in zip(self._slow, normals, strict=False)]
        latitude, longitude, altitude = geodetic_from_ned(self._home, self._position(observation, normals))
        v_north, v_east, v_down = observation.v_ned
        sigma = self._spec.velocity_sigma
        fix = GpsFix(
            observation.time_us + self._latency_us,
            _degrees_e7(latitude),
            _degrees_e7(longitude),
            round(altitude * 1e3) * 1e-3,
            _centi(v_north + sigma * normals[6]),
            _centi(v_east + sigma * normals[7]),
            _centi(v_down + sigma * normals[8]),
            *self._accuracy,
            THREE_DIMENSIONAL,
            self._spec.satellites,
        )
        self._pending.append(fix)

    def arrived(self, time_us: int) -> GpsFix | None:
        """Return the oldest fix that has arrived and was not returned before, stamped ``time_us``."""
        if not self._pending or self._pending[0].time_us > time_us:
            return None
        return self._pending.popleft()._replace(time_us=time_us)

    def _position(self, observation: Observation, normals: list[float]) -> Vector:
        spec, (north, east, down) = self._spec, observation.position_ned
        return (
            north + spec.horizontal_sigma * self._slow[0] + spec.white_sigma * normals[3],
            east + spec.horizontal_sigma * self._slow[1] + spec.white_sigma * normals[4],
            down + spec.vertical_sigma * self._slow[2] + spec.white_sigma * normals[5],
        )


def _degrees_e7(angle: float) -> float:
    return round(angle * DEGREES_E7) / DEGREES_E7


def _centi(value: float) -> float:
    return round(value * 1e2) * 1e-2
