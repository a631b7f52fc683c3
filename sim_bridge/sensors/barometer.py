"""MS5611-class barometer with its thermometer."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, exact, exact_inlined
from sim_bridge.sensors.noise import NormalRows, SensorSeed, gauss_markov_step, split
from sim_bridge.vectors import Floats
from wingbeat.units import Quantity


class BarometerSpec(NamedTuple):
    """MS5611-01BA03 (Measurement Specialties) as compensated by its driver; Gerdes Table 1 lists no barometer.

    10 to 1200 mbar, delivered as counts of 0.01 Pa and 0.01 K. The data sheet's noise is 1.2 Pa rms at an
    oversampling of 4096; the flow past the open port of a flapping fuselage makes it about 3 Pa. Absolute
    accuracy +-150 Pa and +-0.8 K; the drift stands for weather and warming.
    """

    lowest: Annotated[float, Quantity("Pa", 0.0, 1e5)]
    """where it saturates"""
    highest: Annotated[float, Quantity("Pa", 1e4, 1e6)]
    """where it saturates"""
    resolution: Annotated[float, Quantity("Pa", 1e-4, 100.0)]
    """of one count"""
    noise: Annotated[float, Quantity("Pa", 0.0, 100.0)]
    """standard deviation of one reading"""
    drift_sigma: Annotated[float, Quantity("Pa", 0.0, 500.0)]
    """of the slow drift once it has settled; it starts at 0"""
    drift_time_constant: Annotated[float, Quantity("s", 1.0, 1e5)]
    """of the slow drift"""
    offset_sigma: Annotated[float, Quantity("Pa", 0.0, 1000.0)]
    """of the units' absolute errors"""
    temperature_resolution: Annotated[float, Quantity("K", 1e-4, 5.0)]
    """of one count"""
    temperature_noise: Annotated[float, Quantity("K", 0.0, 10.0)]
    """standard deviation of one reading"""
    temperature_offset_sigma: Annotated[float, Quantity("K", 0.0, 20.0)]
    """of the units' absolute errors"""


class BarometerErrors(NamedTuple):
    """Constant errors of one unit."""

    pressure: float
    """Pa"""
    temperature: float
    """K"""


class BarometerArrays(NamedTuple):
    """Kernel arguments."""

    spec: BarometerSpec
    errors: BarometerErrors
    drift: Floats
    """(1,); of unit variance"""
    drift_step: tuple[float, float]
    """decay and drive of the drift"""
    normals: Floats
    """(n, 3); standard normal numbers drawn ahead"""


class Barometer:
    """One unit; `read` every ``period`` s."""

    def __init__(self, spec: BarometerSpec, seed: SensorSeed, period: float) -> None:
        unit, flight = split(seed)
        pressure, temperature = unit.standard_normal(2).tolist()
        self.errors = BarometerErrors(spec.offset_sigma * pressure, spec.temperature_offset_sigma * temperature)
        self.normals = NormalRows(flight, 3)
        drift = gauss_markov_step(period, spec.drift_time_constant)
        self.arrays = BarometerArrays(spec, self.errors, np.zeros(1), drift, self.normals.rows)
        """arguments of `read_pressure`"""

    def read(self, static_pressure: float, temperature: float) -> tuple[int, int]:
        """Return the counts of pressure and temperature for ambient values in Pa and K."""
        return read_pressure_alone(static_pressure, temperature, self.normals.next_row(), self._bound)

    @cached_property
    def _bound(self) -> Bound:
        return Bound(self.arrays)


@exact
def read_pressure_alone(static_pressure: float, temperature: float, at: int, bound: Bound) -> tuple[int, int]:
    """`read_pressure` of one sensor alone."""
    return read_pressure(static_pressure, temperature, at, bound_values(bound))


@exact_inlined
def read_pressure(static_pressure: float, temperature: float, at: int, a: BarometerArrays) -> tuple[int, int]:
    """Compute `Barometer.read` with the row ``at`` of the noise."""
    spec, errors = a.spec, a.errors
    white, slow, warm = a.normals[at, 0], a.normals[at, 1], a.normals[at, 2]
    a.drift[0] = a.drift_step[0] * a.drift[0] + a.drift_step[1] * slow
    pressure = static_pressure + errors.pressure + spec.drift_sigma * a.drift[0] + spec.noise * white
    pressure = min(max(pressure, spec.lowest), spec.highest)
    kelvin = temperature + errors.temperature + spec.temperature_noise * warm
    return round(pressure / spec.resolution), max(round(kelvin / spec.temperature_resolution), 0)
