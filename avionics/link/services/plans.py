"""Lists of the mission protocol: missions, fences and rally points, with codecs."""

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
    """List type of the mission protocol."""

    mission_type: int
    """MAV_MISSION_TYPE"""
    kind: CommandKind
    """command that sets the list"""
    none: Any
    """content of a cleared list"""
    on_board: Callable[[VehicleView], Any]
    decode: Callable[[Sequence[WireItem], Home | None], Any]
    encode: Callable[[Any, Home | None], tuple[WireItem, ...]]
    probe: Callable[[int, WireItem, Home | None], Any]
    """decoder of one item with its number at its reception, for an immediate rejection"""


def assumed_home(items: Sequence[WireItem]) -> Home:
    """Return a home for checks of items before home is known.

    It is at the first item with a position, at sea level.
    """
    places = ((item.x, item.y) for item in items if item.frame in GLOBES and (item.x or item.y))
    latitude, longitude = next(((x, y) for x, y in places if abs(x) <= 90.0 and abs(y) <= 180.0), (0.0, 0.0))
    return Home(math.radians(latitude), math.radians(longitude), 0.0)


def _decode_mission(items: Sequence[WireItem], home: Home | None) -> tuple[MissionItem, ...]:
    return tuple(_decode_numbered(number, item, home, items[:number]) for number, item in enumerate(items))


def _decode_numbered(number: int, item: WireItem, home: Home | None, earlier: Sequence[WireItem] = ()) -> MissionItem:
    """Decode an item; a home item that a client sends first is stored, but not flown."""
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
    """Return the lists by MAV_MISSION_TYPE.

    The mission begins with home if ``first_item`` is 1.
    """
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
    """Decode the items after home, which the vehicle determines itself."""
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
    """Return home as a waypoint above mean sea level; zeros if unknown."""
    latitude, longitude, altitude = home or (0.0, 0.0, 0.0)
    place = (math.degrees(latitude), math.degrees(longitude), altitude)
    return WireItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), *place)
