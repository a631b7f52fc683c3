"""International Standard Atmosphere of the troposphere (ISO 2533:1975, Eqs. for the layer of -6.5 K/km)."""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.environment.gravity import GRAVITY

SEA_LEVEL_PRESSURE = 101325.0
"""Pa"""
SEA_LEVEL_TEMPERATURE = 288.15
"""K"""
LAPSE_RATE = 0.0065
"""K/m; temperature falls by this with altitude"""
GAS_CONSTANT = 287.05287
"""J/(kg K); of dry air"""
LOWEST, HIGHEST = -2000.0, 11000.0
"""m; where the layer of constant lapse rate ends"""

_EXPONENT = GRAVITY / (GAS_CONSTANT * LAPSE_RATE)


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
    """Air at ``altitude`` in m above mean sea level (taken as geopotential altitude).

    A day that is not standard is told by its pressure in Pa and temperature in K at sea level.

    Raises:
        ValueError: altitude outside -2 km to 11 km or not finite.
    """
    if not LOWEST <= altitude <= HIGHEST:
        raise ValueError(f"altitude {altitude:g} m is outside the troposphere ({LOWEST:g} to {HIGHEST:g} m)")
    temperature = sea_level_temperature - LAPSE_RATE * altitude
    pressure = sea_level_pressure * math.pow(temperature / sea_level_temperature, _EXPONENT)
    return Air(pressure, temperature, pressure / (GAS_CONSTANT * temperature))
