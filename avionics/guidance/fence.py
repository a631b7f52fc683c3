"""Geofence: clearance to the limits of the vehicle and of the plan."""

from __future__ import annotations

import math

from avionics.guidance.mission import Fence, ItemKind, Mission, MissionItem, Zone
from avionics.guidance.modes import AIRBORNE, LANDING, Conditions, Gains, State
from avionics.guidance.path import Place
from avionics.messages import Breach

CLIMBING = (ItemKind.WAYPOINT, ItemKind.LOITER, ItemKind.CIRCLE)
"""kinds of item with a position and an altitude"""
PLACED = (*CLIMBING, ItemKind.LAND)
"""kinds of item with a position"""
HIGH = (*CLIMBING, ItemKind.TAKEOFF, ItemKind.HOLD)
"""kinds of item with an altitude that the ceiling limits"""


def vehicle_fence(gains: Gains) -> Fence:
    """Return the limits of the vehicle as a fence."""
    circle = Zone(1, ((0.0, 0.0),), gains.fence_radius)
    return Fence((circle,), gains.fence_floor, gains.fence_altitude)


def mission_breach(fence: Fence, mission: Mission, first: int = 0) -> str:
    """Return which item of a mission is outside ``fence``; empty if none is.

    Args:
        fence: of the plan or of the vehicle.
        mission: its items.
        first: number of the first item in the text; events count from 0, messages about files from 1.
    """
    for number, item in enumerate(mission, first):
        reason = _item_breach(fence, item)
        if reason:
            return f"mission item {number} is {reason}"
    return ""


def _item_breach(fence: Fence, item: MissionItem) -> str:
    placed = item.kind in PLACED and not item.here
    if placed and clearance(fence, item.north, item.east) < 0.0:
        return "outside the fence"
    if fence.ceiling and item.kind in HIGH and item.altitude > fence.ceiling:
        return f"above the fence's ceiling of {fence.ceiling:g} m"
    below = fence.floor and item.kind in CLIMBING and item.altitude < fence.floor
    return f"below the fence's floor of {fence.floor:g} m" if below else ""


def clearance(fence: Fence, north: float, east: float) -> float:
    """Return the distance (m) to the nearest border of ``fence``.

    The distance is negative outside the fence, and infinite without zones.
    """
    nearest = math.inf
    for zone in fence.zones:
        inside = depth(zone, (north, east))
        nearest = min(nearest, inside if zone.keep_in else -inside)
    return nearest


def depth(zone: Zone, place: Place) -> float:
    """Return the distance (m) to the border of a zone; negative outside."""
    if zone.radius > 0.0:
        return zone.radius - math.dist(place, zone.places[0])
    away = min(_distance_to_edge(a, b, place) for a, b in _edges(zone.places))
    return away if contains(zone.places, place) else -away


def contains(corners: tuple[Place, ...], place: Place) -> bool:
    """Return whether a position is inside a polygon (odd-even rule)."""
    north, east = place
    inside = False
    for (a_north, a_east), (b_north, b_east) in _edges(corners):
        beside = (a_east > east) != (b_east > east)
        if beside and north < a_north + (east - a_east) / (b_east - a_east) * (b_north - a_north):
            inside = not inside
    return inside


def target_refusal(gains: Gains, fence: Fence, place: Place, altitude: float) -> str:
    """Return why a target position and altitude is denied; empty if inside the fence.

    ``place`` is in m from home and ``altitude`` in m above home.
    """
    if math.hypot(*place) > gains.fence_radius or clearance(fence, *place) < 0.0:
        return "outside the fence"
    return altitude_refusal(gains, fence, altitude)


def altitude_refusal(gains: Gains, fence: Fence, altitude: float) -> str:
    """Return why an altitude (m above home) is denied; empty if inside the fence."""
    ceiling, floor = min(gains.fence_altitude, fence.ceiling or math.inf), max(gains.fence_floor, fence.floor)
    if altitude > ceiling:
        return f"{altitude:.0f} m is above the fence's ceiling of {ceiling:g} m"
    return f"{altitude:.0f} m is below the fence's floor of {floor:g} m" if altitude < floor else ""


def least_clearance(gains: Gains, state: State, conditions: Conditions) -> float:
    """Return the distance (m) to the nearest limit of the fences of vehicle and plan.

    The distance is negative outside, and infinite on the ground.
    """
    return min(_clearances(gains, state, conditions)) if state.stage in AIRBORNE else math.inf


def breach(gains: Gains, state: State, conditions: Conditions) -> Breach:
    """Return the fence limit with the largest violation; NONE inside the fence."""
    rooms = dict(
        zip((Breach.FLOOR, Breach.CEILING, Breach.BORDER), _clearances(gains, state, conditions), strict=True)
    )
    return min(rooms, key=rooms.__getitem__) if least_clearance(gains, state, conditions) < 0.0 else Breach.NONE


def watch_floor(gains: Gains, state: State, conditions: Conditions) -> State:
    """Enable the fence floor once the vehicle was above it by the margin.

    The floor is disabled after the flight.
    """
    floor = max(gains.fence_floor, conditions.fence_floor)
    up = state.stage in AIRBORNE and floor > 0.0
    passed = int(up and (state.above_floor == 1 or conditions.altitude > floor + gains.fence_margin))
    return state if passed == state.above_floor else state._replace(above_floor=passed)


def _clearances(gains: Gains, state: State, conditions: Conditions) -> tuple[float, float, float]:
    """Return the clearances (m) to floor, ceiling and border."""
    ceiling = min(gains.fence_altitude, conditions.fence_ceiling or math.inf) - conditions.altitude
    border = min(gains.fence_radius - conditions.home_distance, conditions.fence_clearance)
    if not state.above_floor or state.stage in LANDING:
        return math.inf, ceiling, border
    return conditions.altitude - max(gains.fence_floor, conditions.fence_floor), ceiling, border


def _edges(corners: tuple[Place, ...]) -> zip[tuple[Place, Place]]:
    return zip(corners, (*corners[1:], corners[0]), strict=True)


def _distance_to_edge(a: Place, b: Place, place: Place) -> float:
    north, east = b[0] - a[0], b[1] - a[1]
    square = north * north + east * east
    along = ((place[0] - a[0]) * north + (place[1] - a[1]) * east) / square if square > 0.0 else 0.0
    share = min(max(along, 0.0), 1.0)
    return math.hypot(place[0] - a[0] - share * north, place[1] - a[1] - share * east)
