"""Limits of missions, fences and rally points: keys with units and ranges."""

from __future__ import annotations

import itertools
import math

from avionics.guidance.fence import contains
from avionics.guidance.mission import INSTANT, Fence, ItemKind, Mission, MissionItem, Rally, Zone
from avionics.missions.keys import Key

LONGEST_MISSION = 500
"""items; limit of a mission"""
MOST_ZONES = 20
MOST_CORNERS = 70
"""corners; limit of all polygons of a fence, because each costs time in every step of the navigation"""
MOST_RALLY_POINTS = 20


PLACE = {"north": Key("m", -1e4, 1e4), "east": Key("m", -1e4, 1e4)}
ALTITUDE = {"altitude": Key("m", 1.0, 1000.0)}
HEADING = {"heading_deg": Key("deg", -180.0, 360.0, math.radians)}
CIRCLE = {**PLACE, **ALTITUDE, "radius": Key("m", -500.0, 500.0, default=0.0)}
KEYS: dict[ItemKind, dict[str, Key]] = {
    ItemKind.TAKEOFF: ALTITUDE,
    ItemKind.HOLD: {**ALTITUDE, **HEADING, "duration": Key("s", 0.0, 3600.0)},
    ItemKind.WAYPOINT: {**PLACE, **ALTITUDE, "duration": Key("s", 0.0, 36000.0, default=0.0)},
    ItemKind.LOITER: CIRCLE,
    ItemKind.CIRCLE: {
        **CIRCLE,
        "turns": Key("-", 0.0, 1000.0, default=0.0),
        "duration": Key("s", 0.0, 36000.0, default=0.0),
    },
    ItemKind.RETURN: {},
    ItemKind.LAND_START: {},
    ItemKind.SPEED: {"airspeed": Key("m/s", 0.0, 50.0)},
    ItemKind.LAND: {**PLACE, **HEADING},
}
"""keys of each kind of item; those of a JUMP are checked against the mission"""
HAND_HEIGHT = 2.0
"""m; height of the hand above home at the throw"""
SMALLEST_CIRCLE = 3.0
"""m; minimum radius"""
RALLY = {**PLACE, **ALTITUDE}
FENCE_CIRCLE = {**PLACE, "radius": Key("m", 10.0, 1e5)}
FENCE_ALTITUDES = {
    "min_altitude": Key("m", 0.0, 1000.0, default=0.0),
    "max_altitude": Key("m", 0.0, 5000.0, default=0.0),
}
SURVEY = {
    **ALTITUDE,
    "spacing": Key("m", 1.0, 1000.0),
    "heading_deg": HEADING["heading_deg"],
    "overshoot": Key("m", 0.0, 500.0, default=0.0),
}


def _outside(values: dict[str, float], keys: dict[str, Key]) -> str:
    """Return the first of ``values`` (SI) outside the range of its key."""
    for name, key in keys.items():
        value = values[name.removesuffix("_deg")]
        low, high = key.si(key.low), key.si(key.high)
        slack = 1e-6 * max(abs(low), abs(high))
        if not low - slack <= value <= high + slack:
            shown = math.degrees(value) if key.unit == "deg" else value
            return f"{name} = {shown:g} is outside {key.low:g} to {key.high:g} {key.unit}".removesuffix(" -")
    return ""


def check_item(item: MissionItem) -> str:
    """Return why the numbers of an item are rejected; empty if accepted."""
    values = {"north": item.north, "east": item.east, "altitude": item.altitude, "heading": item.heading}
    values |= {"duration": item.duration, "radius": item.radius, "turns": item.turns, "airspeed": item.airspeed}
    if not all(math.isfinite(value) for value in values.values()):
        return "a value is not a number"
    refusal = _outside(values, KEYS.get(item.kind, {}))
    if refusal:
        return refusal
    if 0.0 < abs(item.radius) < SMALLEST_CIRCLE:
        return f"radius = {item.radius:g} is smaller than {SMALLEST_CIRCLE:g} m"
    return "turns and duration exclude each other" if item.turns > 0.0 and item.duration > 0.0 else ""


def check_climb(mission: Mission) -> str:
    """Return why a mission cannot be launched; empty if it can.

    An item must climb before a landing.
    """
    before_landing = itertools.takewhile(lambda item: item.kind != ItemKind.LAND, mission)
    if any(item.kind == ItemKind.RETURN or item.altitude > HAND_HEIGHT for item in before_landing):
        return ""
    return f"no item climbs above {HAND_HEIGHT:g} m before a landing: begin with a takeoff"


def check_jumps(mission: Mission) -> str:
    """Return why the jumps of a mission are rejected; empty if accepted."""
    for number, item in enumerate(mission, 1):
        if item.kind != ItemKind.JUMP:
            continue
        if not 0 <= item.jump_to < len(mission):
            return f"item {number}: JUMP leads to item {item.jump_to + 1} of {len(mission)}"
        if not -1 <= item.repeats <= 1000:
            return f"item {number}: JUMP repeats must be -1 (for ever) to 1000"
        if _leads_back(mission, number - 1):
            return f"item {number}: JUMP leads back to itself, with no item to fly between"
    return ""


def _leads_back(mission: Mission, jump: int) -> bool:
    """Return whether a jump leads to itself without an item that takes time.

    Further jumps are followed.
    """
    at, passed = mission[jump].jump_to, set[int]()
    while at < len(mission) and at not in passed and mission[at].kind in (*INSTANT, ItemKind.JUMP):
        if at == jump:
            return True
        passed.add(at)
        onward = mission[at].kind == ItemKind.JUMP and 0 <= mission[at].jump_to < len(mission)
        at = mission[at].jump_to if onward else at + 1
    return False


def check_rally(rally: Rally) -> str:
    """Return why rally points are rejected; empty if accepted."""
    if len(rally) > MOST_RALLY_POINTS:
        return f"at most {MOST_RALLY_POINTS} points, not {len(rally)}"
    for number, point in enumerate(rally, 1):
        refusal = _outside(point._asdict(), RALLY)
        if refusal:
            return f"point {number}: {refusal}"
    return ""


def check_fence(fence: Fence) -> str:
    """Return why a fence is rejected; empty if accepted. Home must be inside."""
    corners = sum(len(zone.places) for zone in fence.zones if not zone.radius)
    if len(fence.zones) > MOST_ZONES or corners > MOST_CORNERS:
        return f"at most {MOST_ZONES} zones with {MOST_CORNERS} corners in all"
    for number, zone in enumerate(fence.zones, 1):
        refusal = _check_zone(zone)
        if refusal:
            return f"zone {number}: {refusal}"
    refusal = _outside({"min_altitude": fence.floor, "max_altitude": fence.ceiling}, FENCE_ALTITUDES)
    if not refusal and 0.0 < fence.ceiling <= fence.floor:
        return "max_altitude must be above min_altitude"
    return refusal


def _check_zone(zone: Zone) -> str:
    if not all(math.isfinite(value) and abs(value) <= 1e5 for place in zone.places for value in place):
        return "a place is not within 100 km of home"
    if zone.radius:
        refusal = _outside({"north": 0.0, "east": 0.0, "radius": zone.radius}, FENCE_CIRCLE)
        inside = math.hypot(*zone.places[0]) < zone.radius
    else:
        refusal = "" if len(zone.places) >= 3 else "a polygon has 3 corners or more"
        inside = not refusal and contains(zone.places, (0.0, 0.0))
    if refusal or inside == bool(zone.keep_in):
        return refusal
    return "home is outside of it" if zone.keep_in else "home is in it"
