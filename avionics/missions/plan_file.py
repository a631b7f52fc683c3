"""Plan file of QGroundControl (``.plan``): mission, geofence and rally points.

The file is a JSON document. Surveys and corridor scans contain their simple items; a fixed-wing landing pattern is
converted to the items that QGroundControl sends for it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.mission_codec import to_metres
from avionics.link.vehicle import Home
from avionics.link.wire_item import WireItem
from wingbeat.documents import parse_json
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import read_error_text

RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT


class PlannedItem(NamedTuple):
    """Mission item and its location in the file."""

    item: WireItem
    where: str
    """-; "item 3", or "item 3 (survey)\""""
    identity: int
    """-; number used by DO_JUMP in the file"""


class PlanFile(NamedTuple):
    """Content of a file in MAVLink terms."""

    home: Home
    mission: tuple[PlannedItem, ...]
    fence: tuple[WireItem, ...] = ()
    rally: tuple[WireItem, ...] = ()


def read(path: Path) -> PlanFile:
    """Read the plan of a file.

    Raises:
        InputError: unreadable, no plan, or a malformed part; the text names it.
    """
    try:
        document = parse_json(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read mission file {path}: {read_error_text(error)}") from None
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None
    if not isinstance(document, dict) or document.get("fileType") != "Plan":
        raise InputError(f'{path}: a plan has "fileType": "Plan"')
    try:
        return _plan(document)
    except _Malformed as error:
        raise InputError(f"{path}: {error}") from None


class _Malformed(ValueError):
    """Malformed part of the document; the text names it."""


def _plan(document: Mapping[str, Any]) -> PlanFile:
    mission = _table(document, "mission", "the plan")
    latitude, longitude, altitude = _numbers(mission, "plannedHomePosition", 3, "the mission")
    home = Home(math.radians(latitude), math.radians(longitude), altitude)
    items = [
        made
        for number, table in enumerate(_list(mission, "items", "the mission"), 1)
        for made in _items(table, f"item {number}")
    ]
    fence = document.get("geoFence", {})
    rally = document.get("rallyPoints", {})
    if not isinstance(fence, dict) or not isinstance(rally, dict):
        raise _Malformed("geoFence and rallyPoints must be objects")
    plan = PlanFile(home, tuple(items), _fence(fence), _rally(rally))
    if not (plan.mission or plan.fence or plan.rally):
        raise _Malformed("the plan is empty: no mission item, fence or rally point")
    return plan


# --- mission -----------------------------------------------------------------------------------------------


def _items(table: Any, where: str) -> list[PlannedItem]:
    if not isinstance(table, dict):
        raise _Malformed(f"{where} must be an object")
    if table.get("type") == "SimpleItem":
        return [_simple(table, where)]
    if table.get("type") != "ComplexItem":
        raise _Malformed(f"{where}: type must be SimpleItem or ComplexItem, not {table.get('type')!r}")
    kind = str(table.get("complexItemType", ""))
    if kind == "fwLandingPattern":
        return _landing(table, f"{where} ({kind})")
    laid_out = table.get("TransectStyleComplexItem")
    if not isinstance(laid_out, dict):
        raise _Malformed(f"{where}: a {kind or 'complex item'} cannot be flown")
    inner = _list(laid_out, "Items", f"{where} ({kind})")
    return [made for item in inner for made in _items(item, f"{where} ({kind})")]


def _simple(table: Mapping[str, Any], where: str) -> PlannedItem:
    frame, command = (_whole(table, key, where, 65535) for key in ("frame", "command"))
    if "coordinate" in table:  # QGroundControl up to 3.1 wrote the position beside four parameters
        values = _numbers(table, "params", 4, where, empty=math.nan)
        x, y, z = _numbers(table, "coordinate", 3, where, empty=math.nan)
    else:
        values = _numbers(table, "params", 7, where, empty=math.nan)
        x, y, z = values[4:7]
    if frame == mavlink.MAV_FRAME_MISSION:
        x, y, z = (0.0 if math.isnan(value) else value for value in (x, y, z))
    item = WireItem(frame, command, (values[0], values[1], values[2], values[3]), x, y, z)
    return PlannedItem(item, where, _whole(table, "doJumpId", where, 65535, 0))


def _landing(table: Mapping[str, Any], where: str) -> list[PlannedItem]:
    """Return a fixed-wing landing pattern as QGroundControl sends it.

    It is a circle or a position for the descent, and LAND. The course of the LAND is that of the line from the end of
    the circle, or from the position.
    """
    key = next((key for key in ("landingApproachCoordinate", "loiterCoordinate") if key in table), None)
    if key is None:
        raise _Malformed(f"{where}: landingApproachCoordinate is missing")
    approach, place = (_numbers(table, name, 3, where) for name in (key, "landCoordinate"))
    radius = _number(table.get("loiterRadius", 0.0), f"{where}: loiterRadius")
    circling = table.get("useLoiterToAlt", True) and radius > 0.0
    radius = radius if table.get("loiterClockwise", True) else -radius
    north, east = to_metres(Home(math.radians(approach[0]), math.radians(approach[1]), 0.0), *place[:2])
    course, distance = math.atan2(east, north), math.hypot(north, east)
    if circling:
        course += math.asin(max(-1.0, min(1.0, radius / max(distance, 1e-3))))
    heading = math.degrees(course) % 360.0 or 360.0
    command, params = mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, math.nan)
    if circling:
        command, params = mavlink.MAV_CMD_NAV_LOITER_TO_ALT, (1.0, radius, 0.0, 1.0)
    items = (
        WireItem(mavlink.MAV_FRAME_MISSION, mavlink.MAV_CMD_DO_LAND_START, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0),
        WireItem(RELATIVE, command, params, *approach),
        WireItem(RELATIVE, mavlink.MAV_CMD_NAV_LAND, (0.0, 0.0, 0.0, heading), place[0], place[1], 0.0),
    )
    return [PlannedItem(item, where, 0) for item in items]


# --- fence and rally points --------------------------------------------------------------------------------


def _fence(table: Mapping[str, Any]) -> tuple[WireItem, ...]:
    items: list[WireItem] = []
    for number, entry in enumerate(_list(table, "polygons", "the fence", []), 1):
        where = f"fence, polygon {number}"
        corners = [_pair(corner, where) for corner in _list(_object(entry, where), "polygon", where)]
        command = _KEEP_IN if _object(entry, where).get("inclusion", True) else _KEEP_OUT
        params = (float(len(corners)), 0.0, 0.0, 0.0)
        items += [WireItem(RELATIVE, command, params, x, y, 0.0) for x, y in corners]
    for number, entry in enumerate(_list(table, "circles", "the fence", []), 1):
        where = f"fence, circle {number}"
        circle = _table(_object(entry, where), "circle", where)
        x, y = _numbers(circle, "center", 2, where)
        command = _CIRCLE_IN if _object(entry, where).get("inclusion", True) else _CIRCLE_OUT
        params = (_number(circle.get("radius"), f"{where}: radius"), 0.0, 0.0, 0.0)
        items.append(WireItem(RELATIVE, command, params, x, y, 0.0))
    return tuple(items)


_KEEP_IN = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
_KEEP_OUT = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
_CIRCLE_IN = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
_CIRCLE_OUT = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION


def _rally(table: Mapping[str, Any]) -> tuple[WireItem, ...]:
    command, nothing = mavlink.MAV_CMD_NAV_RALLY_POINT, (0.0, 0.0, 0.0, 0.0)
    points = [
        _row(point, 3, f"rally point {number}")
        for number, point in enumerate(_list(table, "points", "the rally points", []), 1)
    ]
    return tuple(WireItem(RELATIVE, command, nothing, *point) for point in points)


# --- parts of the document ---------------------------------------------------------------------------------


def _object(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise _Malformed(f"{where} must be an object")
    return value


def _table(parent: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any]:
    return _object(parent.get(key), f"{where}: {key}")


def _list(parent: Mapping[str, Any], key: str, where: str, default: list[Any] | None = None) -> list[Any]:
    value = parent.get(key, default)
    if not isinstance(value, list):
        raise _Malformed(f"{where}: {key} must be a list")
    return value


def _whole(table: Mapping[str, Any], key: str, where: str, high: int, default: int | None = None) -> int:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= high:
        raise _Malformed(f"{where}: {key} must be a whole number from 0 to {high}, not {value!r}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _Malformed(f"{where} must be a number, not {value!r}")
    return float(value)


def _numbers(
    table: Mapping[str, Any], key: str, count: int, where: str, empty: float | None = None
) -> tuple[float, ...]:
    return _row(table.get(key), count, f"{where}: {key}", empty)


def _row(value: Any, count: int, where: str, empty: float | None = None) -> tuple[float, ...]:
    """Return ``count`` numbers; ``empty`` replaces null if permitted."""
    if not isinstance(value, list) or len(value) != count:
        raise _Malformed(f"{where} must be a list of {count} numbers")
    return tuple(empty if part is None and empty is not None else _number(part, where) for part in value)


def _pair(value: Any, where: str) -> tuple[float, float]:
    first, second = _row(value, 2, where)
    return first, second


# --- items to send or to fly ------------------------------------------------------------------------------


def numbered(mission: Sequence[PlannedItem]) -> tuple[PlannedItem, ...]:
    """Return the items with every DO_JUMP converted to an index in the list.

    Raises:
        InputError: a jump to an item that is not in the list.
    """
    places = {planned.identity: place for place, planned in reversed(list(enumerate(mission))) if planned.identity}
    return tuple(_jump_to(planned, places) for planned in mission)


def _jump_to(planned: PlannedItem, places: Mapping[int, int]) -> PlannedItem:
    item = planned.item
    if item.command != mavlink.MAV_CMD_DO_JUMP:
        return planned
    target = item.params[0]
    if target not in places:
        raise InputError(f"{planned.where}: DO_JUMP (177) leads to item {target:g}, which is not flown")
    return planned._replace(item=item._replace(params=(float(places[int(target)]), *item.params[1:])))


# --- writing -----------------------------------------------------------------------------------------------


def write(path: Path, plan: PlanFile) -> None:
    """Write a plan to a new file.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            json.dump(document(plan), file, indent=4, allow_nan=False)
            file.write("\n")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None


def document(plan: PlanFile) -> dict[str, Any]:
    """Return the plan as a document of QGroundControl."""
    home = [math.degrees(plan.home.latitude), math.degrees(plan.home.longitude), plan.home.altitude]
    items = [_simple_table(planned.item, number) for number, planned in enumerate(plan.mission, 1)]
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "Wingbeat",
        "mission": {
            "version": 2,
            "firmwareType": mavlink.MAV_AUTOPILOT_GENERIC,
            "vehicleType": mavlink.MAV_TYPE_FIXED_WING,
            "cruiseSpeed": 8,
            "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1,
            "plannedHomePosition": home,
            "items": items,
        },
        "geoFence": {"version": 2, "circles": _circles(plan.fence), "polygons": _polygons(plan.fence)},
        "rallyPoints": {"version": 2, "points": [[item.x, item.y, item.z] for item in plan.rally]},
    }


def _simple_table(item: WireItem, number: int) -> dict[str, Any]:
    params: list[float | None] = [*item.params, item.x, item.y, item.z]
    if item.command == mavlink.MAV_CMD_DO_JUMP:
        params[0] = item.params[0] + 1.0
    values = [None if value is None or math.isnan(value) else value for value in params]
    # A plan does not support the frames of the integer messages.
    frame = RELATIVE if item.frame == mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT else item.frame
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": frame,
        "params": values,
        "Altitude": values[6],
        "AltitudeMode": 1,
        "AMSLAltAboveTerrain": None,
    }


def _circles(fence: Sequence[WireItem]) -> list[dict[str, Any]]:
    return [
        {
            "circle": {"center": [item.x, item.y], "radius": item.params[0]},
            "inclusion": item.command == _CIRCLE_IN,
            "version": 1,
        }
        for item in fence
        if item.command in (_CIRCLE_IN, _CIRCLE_OUT)
    ]


def _polygons(fence: Sequence[WireItem]) -> list[dict[str, Any]]:
    corners = [item for item in fence if item.command in (_KEEP_IN, _KEEP_OUT)]
    polygons: list[dict[str, Any]] = []
    while corners:
        count = max(int(corners[0].params[0]), 1)
        polygon, corners = corners[:count], corners[count:]
        inside = polygon[0].command == _KEEP_IN
        places = [[item.x, item.y] for item in polygon]
        polygons.append({"polygon": places, "inclusion": inside, "version": 1})
    return polygons
