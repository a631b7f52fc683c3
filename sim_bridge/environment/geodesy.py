"""Conversion between local NED in m and WGS-84 latitude, longitude and altitude.

North is measured along the meridian and east along the parallel of the middle latitude (mid-latitude formula),
so that horizontal distances agree with the ellipsoid to 1 cm within 2 km of home; down is measured along the
local vertical, so the ground does not curve away. The two directions are exact inverses.
"""

from __future__ import annotations

import math

from sim_bridge.environment.home import Home
from sim_bridge.observation import Vector

SEMI_MAJOR_AXIS = 6378137.0
"""m; WGS-84"""
FLATTENING = 1.0 / 298.257223563
"""-; WGS-84"""
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
"""-; first eccentricity squared"""


def meridian_radius(latitude: float) -> float:
    """Radius of curvature in m along the meridian at ``latitude`` in rad."""
    w = 1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    return SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (w * math.sqrt(w))


def transverse_radius(latitude: float) -> float:
    """Radius of curvature in m across the meridian at ``latitude`` in rad."""
    return SEMI_MAJOR_AXIS / math.sqrt(1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2)


def geodetic_from_ned(home: Home, position_ned: Vector) -> Vector:
    """Latitude (rad), longitude (rad, -pi to pi) and altitude (m) of a position in m from ``home``."""
    north, east, down = position_ned
    latitude = home.latitude + north / (meridian_radius(home.latitude) + home.altitude)
    longitude = home.longitude + east / _parallel_radius(home, latitude)
    return latitude, math.remainder(longitude, math.tau), home.altitude - down


def ned_from_geodetic(home: Home, latitude: float, longitude: float, altitude: float) -> Vector:
    """Position in m from ``home`` of a latitude (rad), longitude (rad) and altitude (m); see `geodetic_from_ned`."""
    north = (latitude - home.latitude) * (meridian_radius(home.latitude) + home.altitude)
    east = math.remainder(longitude - home.longitude, math.tau) * _parallel_radius(home, latitude)
    return north, east, home.altitude - altitude


def _parallel_radius(home: Home, latitude: float) -> float:
    middle = 0.5 * (home.latitude + latitude)
    return (transverse_radius(middle) + home.altitude) * math.cos(middle)
