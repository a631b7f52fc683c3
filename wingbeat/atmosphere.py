"""International Standard Atmosphere up to 20 km (ISO 2533:1975)."""

from __future__ import annotations

import math
from typing import NamedTuple

from wingbeat.constants import STANDARD_GRAVITY

SEA_LEVEL_PRESSURE = 101325.0
"""Pa"""
SEA_LEVEL_TEMPERATURE = 288.15
"""K"""
SEA_LEVEL_DENSITY = 1.225
"""kg/m^3"""
LAPSE_RATE = 0.0065
"""K/m; decrease of temperature with altitude in the troposphere"""
GAS_CONSTANT = 287.05287
"""J/(kg K); of dry air"""
TROPOPAUSE = 11000.0
"""m; the temperature is constant from here to `HIGHEST`"""
LOWEST, HIGHEST = -2000.0, 20000.0
"""m; range of `isa`"""

_PRESSURE_EXPONENT = STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE)
_ALTITUDE_EXPONENT = GAS_CONSTANT * LAPSE_RATE / STANDARD_GRAVITY


class Air(NamedTuple):
    """State of the air at one altitude."""

    pressure: float
    """Pa; static"""
    temperature: float
    """K"""
    density: float
    """kg/m^3"""


def isa(
    altitude: float,
    sea_level_pressure: float = SEA_LEVEL_PRESSURE,
    sea_level_temperature: float = SEA_LEVEL_TEMPERATURE,
) -> Air:
    """Compute the air at ``altitude`` in m above mean sea level (taken as geopotential altitude).

    Args:
        altitude: m.
        sea_level_pressure: Pa; of a nonstandard day.
        sea_level_temperature: K; likewise.

    Raises:
        ValueError: altitude outside -2 km to 20 km or not finite.
    """
    if not LOWEST <= altitude <= HIGHEST:
        raise ValueError(f"altitude {altitude:g} m is outside the standard atmosphere ({LOWEST:g} to {HIGHEST:g} m)")
    return air_at(altitude, sea_level_pressure, sea_level_temperature)


def air_at(altitude: float, sea_level_pressure: float, sea_level_temperature: float) -> Air:
    """Compute `isa` without its check of the range; the simulator compiles this function."""
    temperature = sea_level_temperature - LAPSE_RATE * min(altitude, TROPOPAUSE)
    pressure = sea_level_pressure * math.pow(temperature / sea_level_temperature, _PRESSURE_EXPONENT)
    if altitude > TROPOPAUSE:
        pressure *= math.exp(-STANDARD_GRAVITY * (altitude - TROPOPAUSE) / (GAS_CONSTANT * temperature))
    return Air(pressure, temperature, pressure / (GAS_CONSTANT * temperature))


def pressure_altitude(pressure: float) -> float:
    """Compute the pressure altitude in m of a static pressure in Pa in the troposphere of the standard day."""
    ratio = max(pressure, 1.0) / SEA_LEVEL_PRESSURE
    return SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - float(ratio**_ALTITUDE_EXPONENT))
