"""What travels by the mission protocol: missions, fences and rally points, each with its number and its codec."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from avionics.guidance.mission import NO_FENCE, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import (
    decode_fence,
    decode_item,
    decode_rally,
    encode_fence,
    encode_item,
    encode_rally,
)
from avionics.link.vehicle import Home, VehicleView
from avionics.link.wire_item import WireItem
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
    probe: Callable[[WireItem, Home | None], Any]
    """decodes one item as soon as it comes, to refuse it at once"""


def _decode_mission(items: Sequence[WireItem], home: Home | None) -> tuple[MissionItem, ...]:
    return tuple(decode_item(item, home) for item in items)


def _encode_mission(mission: tuple[MissionItem, ...], home: Home | None) -> tuple[WireItem, ...]:
    return tuple(encode_item(item, home) for item in mission)


PARTS: dict[int, PlanPart] = {
    part.mission_type: part
    for part in (
        PlanPart(
            mavlink.MAV_MISSION_TYPE_MISSION,
            CommandKind.SET_MISSION,
            (),
            lambda vehicle: vehicle.mission,
            _decode_mission,
            _encode_mission,
            decode_item,
        ),
        PlanPart(
            mavlink.MAV_MISSION_TYPE_FENCE,
            CommandKind.SET_FENCE,
            NO_FENCE,
            lambda vehicle: vehicle.fence,
            decode_fence,
            encode_fence,
            lambda item, home: None,
        ),
        PlanPart(
            mavlink.MAV_MISSION_TYPE_RALLY,
            CommandKind.SET_RALLY,
            (),
            lambda vehicle: vehicle.rally,
            decode_rally,
            encode_rally,
            lambda item, home: decode_rally((item,), home),
        ),
    )
}
