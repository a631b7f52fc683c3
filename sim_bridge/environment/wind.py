"""Steady, uniform wind."""

from __future__ import annotations

import math

from sim_bridge.observation import Vector
from wingbeat.errors import InputError

STRONGEST = 50.0
"""m/s; no ornithopter flies in more"""


def steady_wind(speed: float, direction_from: float) -> Vector:
    """Wind velocity in m/s, NED, for ``speed`` m/s from the direction ``direction_from`` in rad.

    The direction is that of aviation: 0 is a wind from the north, pi/2 from the east.

    Raises:
        InputError: speed negative, above 50 m/s, or either not finite.
    """
    if not 0.0 <= speed <= STRONGEST:
        raise InputError(f"wind speed {speed:g} m/s is outside 0 to {STRONGEST:g} m/s")
    if not math.isfinite(direction_from):
        raise InputError(f"wind direction {direction_from:g} rad is not a finite angle")
    return -speed * math.cos(direction_from), -speed * math.sin(direction_from), 0.0
