"""What travels by the mission protocol: missions, fences and rally points, each with its number and its codec."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from avionics.guidance.mission import NO_FENCE, ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import (
    GLOBES,
    decode_fence,
    decode_item,
    decode_rally,
    encode_fence,
    encode_item,
    encode_rally,
    is_home,
    skipped_item,
)
from avionics.link.vehicle import Home, VehicleView
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.messages import CommandKind

MOST_ITEMS = 500


class PlanPart(NamedTuple):
    """One of the lists that the mission protocol carries."""

    mission_type: int
    """MAV_MISSION_TYPE"""
    kind: CommandKind
    """the command that puts it on board"""
    none: Any
    """what is on board when it is cleared"""
    on_board: Callable[[VehicleView], Any]
    decode: Callable[[Sequence[WireItem], Home | None], Any]
    encode: Callable[[Any, Home | None], tuple[WireItem, ...]]
    probe: Callable[[int, WireItem, Home | None], Any]
    """decodes one item, with its number, as soon as it comes, to refuse it at once"""


def assumed_home(items: Sequence[WireItem]) -> Home:
    """A home to check items against while the vehicle has none: at the first item with a place, at sea level."""
    places = ((item.x, item.y) for item in items if item.frame in GLOBES and (item.x or item.y))
    latitude, longitude = next(((x, y) for x, y in places if abs(x) <= 90.0 and abs(y) <= 180.0), (0.0, 0.0))
    return Home(math.radians(latitude), math.radians(longitude), 0.0)


def _decode_mission(items: Sequence[WireItem], home: Home | None) -> tuple[MissionItem, ...]:
    return tuple(_decode_numbered(number, item, home, items[:number]) for number, item in enumerate(items))


def _decode_numbered(number: int, item: WireItem, home: Home | None, earlier: Sequence[WireItem] = ()) -> MissionItem:
    """Decode an item; a home that a client sends first is kept, but not flown."""
    return skipped_item(item) if number == 0 and is_home(item, home) else decode_item(item, home, earlier)


def _encode_mission(mission: tuple[MissionItem, ...], home: Home | None) -> tuple[WireItem, ...]:
    return tuple(encode_item(item, home) for item in mission)


_PARTS: dict[int, PlanPart] = {
    part.mission_type: part
    for part in (
        PlanPart(
            mavlink.MAV_MISSION_TYPE_MISSION,
            CommandKind.SET_MISSION,
            (),
            lambda vehicle: vehicle.mission,
            _decode_mission,
            _encode_mission,
            _decode_numbered,
        ),
        PlanPart(
            mavlink.MAV_MISSION_TYPE_FENCE,
            CommandKind.SET_FENCE,
            NO_FENCE,
            lambda vehicle: vehicle.fence,
            decode_fence,
            encode_fence,
            lambda number, item, home: None,
        ),
        PlanPart(
            mavlink.MAV_MISSION_TYPE_RALLY,
            CommandKind.SET_RALLY,
            (),
            lambda vehicle: vehicle.rally,
            decode_rally,
            encode_rally,
            lambda number, item, home: decode_rally((item,), home),
        ),
    )
}


def plan_parts(first_item: int) -> dict[int, PlanPart]:
    """The lists by MAV_MISSION_TYPE; the mission's begins with home where ``first_item`` is 1."""
    mission = _PARTS[mavlink.MAV_MISSION_TYPE_MISSION]
    if first_item == 0:
        return _PARTS
    return {
        **_PARTS,
        mission.mission_type: mission._replace(
            decode=_decode_from_home, encode=_encode_from_home, probe=_probe_from_home
        ),
    }


def _shifted(item: MissionItem, by: int) -> MissionItem:
    return item._replace(jump_to=item.jump_to + by) if item.kind is ItemKind.JUMP else item


def _decode_from_home(items: Sequence[WireItem], home: Home | None) -> tuple[MissionItem, ...]:
    """The items after home, which is the vehicle's to know."""
    return tuple(_decode_after_home(item, home, items[1:number]) for number, item in enumerate(items) if number)


def _probe_from_home(number: int, item: WireItem, home: Home | None) -> MissionItem | None:
    return _decode_after_home(item, home) if number > 0 else None


def _decode_after_home(item: WireItem, home: Home | None, earlier: Sequence[WireItem] = ()) -> MissionItem:
    if not earlier and is_home(item, home):
        return skipped_item(item)  # MAVSDK puts home before a file that begins with it
    decoded = _shifted(decode_item(item, home, earlier), -1)
    if decoded.kind is ItemKind.JUMP and decoded.jump_to < 0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "DO_JUMP: item 0 is home, which is not flown")
    return decoded


def _encode_from_home(mission: tuple[MissionItem, ...], home: Home | None) -> tuple[WireItem, ...]:
    if not mission:
        return ()
    return (_home_item(home), *_encode_mission(tuple(_shifted(item, 1) for item in mission), home))


def _home_item(home: Home | None) -> WireItem:
    """Home as a waypoint above the sea; zeros while it is not known."""
    latitude, longitude, altitude = home or (0.0, 0.0, 0.0)
    place = (math.degrees(latitude), math.degrees(longitude), altitude)
    return WireItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), *place)
