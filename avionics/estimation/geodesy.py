"""Places in metres from home: a flat earth with the ellipsoid's radii at home (WGS-84)."""

from __future__ import annotations

from functools import lru_cache
from math import cos, pi, sin, sqrt

SEMI_MAJOR_AXIS = 6378137.0
"""m; WGS-84"""
ECCENTRICITY_SQUARED = 6.69437999014e-3
"""-; WGS-84"""
LEAST_COSINE = 1e-3
"""-; of the latitude, next to a pole"""


@lru_cache(maxsize=64)
def metres_per_radian(latitude: float) -> tuple[float, float]:
    """Metres north per rad of latitude and metres east per rad of longitude at ``latitude`` (rad)."""
    bulge = 1.0 - ECCENTRICITY_SQUARED * sin(latitude) ** 2
    meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (bulge * sqrt(bulge))
    transverse = SEMI_MAJOR_AXIS / sqrt(bulge)
    return meridian, transverse * max(LEAST_COSINE, cos(latitude))


def to_local(home: tuple[float, float], latitude: float, longitude: float) -> tuple[float, float]:
    """North and east in m of a place in rad, from ``home`` = (latitude, longitude) in rad."""
    north, east = metres_per_radian(home[0])
    turn = (longitude - home[1] + pi) % (2.0 * pi) - pi
    return (latitude - home[0]) * north, turn * east


def to_geodetic(home: tuple[float, float], north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude in rad of a place in m from ``home`` = (latitude, longitude) in rad."""
    per_latitude, per_longitude = metres_per_radian(home[0])
    longitude = home[1] + east / per_longitude
    return home[0] + north / per_latitude, (longitude + pi) % (2.0 * pi) - pi
