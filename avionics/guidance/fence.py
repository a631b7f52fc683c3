"""How far it is to a plan's fence."""

from __future__ import annotations

import math

from avionics.guidance.mission import Fence, Zone
from avionics.guidance.path import Place


def clearance(fence: Fence, north: float, east: float) -> float:
    """Way (m) from a place to the nearest border of ``fence``, negative when outside; infinite without zones."""
    nearest = math.inf
    for zone in fence.zones:
        inside = depth(zone, (north, east))
        nearest = min(nearest, inside if zone.keep_in else -inside)
    return nearest


def depth(zone: Zone, place: Place) -> float:
    """Way (m) from a place inside of a zone to its border, negative from outside."""
    if zone.radius > 0.0:
        return zone.radius - math.dist(place, zone.places[0])
    away = min(_distance_to_edge(a, b, place) for a, b in _edges(zone.places))
    return away if contains(zone.places, place) else -away


def contains(corners: tuple[Place, ...], place: Place) -> bool:
    """Whether a place is inside of a polygon: a ray from it crosses the border an odd number of times."""
    north, east = place
    inside = False
    for (a_north, a_east), (b_north, b_east) in _edges(corners):
        beside = (a_east > east) != (b_east > east)
        if beside and north < a_north + (east - a_east) / (b_east - a_east) * (b_north - a_north):
            inside = not inside
    return inside


def _edges(corners: tuple[Place, ...]) -> zip[tuple[Place, Place]]:
    return zip(corners, (*corners[1:], corners[0]), strict=True)


def _distance_to_edge(a: Place, b: Place, place: Place) -> float:
    north, east = b[0] - a[0], b[1] - a[1]
    square = north * north + east * east
    along = ((place[0] - a[0]) * north + (place[1] - a[1]) * east) / square if square > 0.0 else 0.0
    share = min(max(along, 0.0), 1.0)
    return math.hypot(place[0] - a[0] - share * north, place[1] - a[1] - share * east)
