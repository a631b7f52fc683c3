"""Magnetic field of the Earth, constant over a few kilometers."""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.observation import Vector


class MagneticField(NamedTuple):
    """Field at one location by its angles and strength."""

    declination: float
    """rad; of magnetic north from true north, positive east"""
    dip: float
    """rad; below the horizon, positive down"""
    strength: float
    """gauss"""


def field_ned(field: MagneticField) -> Vector:
    """Field vector (north, east, down) in gauss."""
    horizontal = field.strength * math.cos(field.dip)
    return (
        horizontal * math.cos(field.declination),
        horizontal * math.sin(field.declination),
        field.strength * math.sin(field.dip),
    )
