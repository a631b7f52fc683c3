"""Local positions in meters from home: flat earth with WGS-84 radii at home."""

from __future__ import annotations

from functools import lru_cache
from math import cos, pi, sin, sqrt
from typing import Final

SEMI_MAJOR_AXIS: Final = 6378137.0
"""m; WGS-84"""
ECCENTRICITY_SQUARED: Final = 6.69437999014e-3
"""-; WGS-84"""
LEAST_COSINE: Final = 1e-3
"""-; minimum cosine of the latitude, to avoid the poles"""


@lru_cache(maxsize=64)
def metres_per_radian(latitude: float) -> tuple[float, float]:
    """Return the meters per radian of latitude and of longitude.

    The directions are north and east at ``latitude`` (rad).
    """
    bulge = 1.0 - ECCENTRICITY_SQUARED * sin(latitude) ** 2
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (bulge * sqrt(bulge))
    transverse = SEMI_MAJOR_AXIS / sqrt(bulge)
    return meridian, transverse * max(LEAST_COSINE, cos(latitude))


def to_local(home: tuple[float, float], latitude: float, longitude: float) -> tuple[float, float]:
    """Return north and east (m) of a geodetic position (rad) relative to ``home``.

    ``home`` is (latitude, longitude) in rad.
    """
    north, east = metres_per_radian(home[0])
    turn = (longitude - home[1] + pi) % (2.0 * pi) - pi
    return (latitude - home[0]) * north, turn * east


def to_geodetic(home: tuple[float, float], north: float, east: float) -> tuple[float, float]:
    """Return latitude and longitude (rad) of a position (m) relative to ``home``.

    ``home`` is (latitude, longitude) in rad.
    """
    per_latitude, per_longitude = metres_per_radian(home[0])
    longitude = home[1] + east / per_longitude
    return home[0] + north / per_latitude, (longitude + pi) % (2.0 * pi) - pi
