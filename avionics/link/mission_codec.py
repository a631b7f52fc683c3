"""The codec's part for missions: items in metres from home <-> MAVLink's latitudes, longitudes and parameters."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.excitation_codec import DECODERS as EXCITE_COMMANDS
from avionics.link.excitation_codec import decode_excitation, encode_excitation
from avionics.link.vehicle import Home
from avionics.link.wire_item import ItemRefused, WireItem

EARTH_RADIUS = 6_378_137.0
"""m; WGS-84 semi-major axis. Missions stay within a few km of home, where a plane is good to centimetres."""

FARTHEST = 100e3
"""m; from home. A place of 0, 0 means "here" to some ground stations, and is in the Gulf of Guinea to all others."""

_GLOBAL = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_LOCAL = (mavlink.MAV_FRAME_LOCAL_NED,)
_PLACED = (ItemKind.WAYPOINT, ItemKind.LAND)
_WITH_ALTITUDE = (ItemKind.WAYPOINT, ItemKind.TAKEOFF, ItemKind.HOLD)
_LOCAL_SCALE = 1e4
"""LOCAL_NED coordinates in MISSION_ITEM_INT are metres times this"""


def to_metres(home: Home, latitude: float, longitude: float) -> tuple[float, float]:
    """North and east of ``home`` in m, for a place in degrees."""
    north = (math.radians(latitude) - home.latitude) * EARTH_RADIUS
    east = (math.radians(longitude) - home.longitude) * EARTH_RADIUS * math.cos(home.latitude)
    return north, east


def to_degrees(home: Home, north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude in degrees of a place in m from ``home``."""
    latitude = home.latitude + north / EARTH_RADIUS
    longitude = home.longitude + east / (EARTH_RADIUS * math.cos(home.latitude))
    return math.degrees(latitude), math.degrees(longitude)


def read_message(message: Any) -> WireItem:
    """From MISSION_ITEM or MISSION_ITEM_INT."""
    params = (message.param1, message.param2, message.param3, message.param4)
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM_INT":
        scale = 1e7 if message.frame in _GLOBAL + _RELATIVE else 1.0
        scale = _LOCAL_SCALE if message.frame in _LOCAL else scale
        x, y = x / scale, y / scale
    return WireItem(message.frame, message.command, params, x, y, message.z)


def decode_item(item: WireItem, home: Home | None) -> MissionItem:
    """The item in metres from home.

    Raises:
        ItemRefused: unknown command or frame, a number that is not finite, an input outside its range, or a
            place on the globe before home is known.
    """
    if item.command in EXCITE_COMMANDS:
        return MissionItem(ItemKind.EXCITE, excitation=decode_excitation(item))
    try:
        kind = ItemKind(item.command)
    except ValueError:
        raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED, f"command {item.command} is not flown") from None
    if kind is ItemKind.RETURN:
        return MissionItem(kind)
    if kind is ItemKind.WAYPOINT and item.params[0] > 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a waypoint cannot be held: use HOLD (53001)")
    north, east = _place(item, home) if kind in _PLACED else (0.0, 0.0)
    altitude = _altitude(item, home) if kind in _WITH_ALTITUDE else 0.0
    heading = {ItemKind.HOLD: item.params[1], ItemKind.LAND: item.params[3]}.get(kind, 0.0)
    duration = item.params[0] if kind is ItemKind.HOLD else 0.0
    if not math.isfinite(duration) or duration < 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a HOLD needs a duration in s")
    return MissionItem(kind, north, east, altitude, _heading(heading), duration)


def _heading(degrees: float) -> float:
    # NaN means "as you come": the field's zero.
    return math.remainder(math.radians(degrees), math.tau) if math.isfinite(degrees) else 0.0


def _place(item: WireItem, home: Home | None) -> tuple[float, float]:
    if not (math.isfinite(item.x) and math.isfinite(item.y)):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, "an item has no place")
    if item.frame in _LOCAL:
        return item.x, item.y
    if item.frame not in _GLOBAL + _RELATIVE:
        raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, f"frame {item.frame} is not supported")
    if home is None:
        raise ItemRefused(mavlink.MAV_MISSION_DENIED, "home is not known yet: wait for the GPS")
    if abs(item.x) > 90.0 or abs(item.y) > 180.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, "an item's place is not on the globe")
    north, east = to_metres(home, item.x, item.y)
    if math.hypot(north, east) > FARTHEST:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, f"an item is over {FARTHEST / 1e3:g} km from home")
    return north, east


def _altitude(item: WireItem, home: Home | None) -> float:
    if not math.isfinite(item.z):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM7, "an item has no altitude")
    if item.frame in _LOCAL:
        return -item.z
    if item.frame in _RELATIVE or item.frame == mavlink.MAV_FRAME_MISSION:
        return item.z
    if item.frame not in _GLOBAL:
        raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, f"frame {item.frame} is not supported")
    if home is None:
        raise ItemRefused(mavlink.MAV_MISSION_DENIED, "home is not known yet: wait for the GPS")
    return item.z - home.altitude


def encode_item(item: MissionItem, home: Home | None) -> WireItem:
    """The item as MAVLink writes it: places on the globe, or in the local frame while home is not known."""
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    nan = math.nan
    if item.kind is ItemKind.EXCITE and item.excitation is not None:
        return encode_excitation(item.excitation)
    if item.kind is ItemKind.RETURN:
        return WireItem(mavlink.MAV_FRAME_MISSION, item.kind, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    heading = math.degrees(item.heading) % 360.0
    if item.kind is ItemKind.HOLD:
        return WireItem(frame, item.kind, (item.duration, heading, 0.0, 0.0), 0.0, 0.0, item.altitude)
    params = (0.0, 0.0, 0.0, heading if item.kind is ItemKind.LAND else nan)
    if item.kind is ItemKind.TAKEOFF:
        return WireItem(frame, item.kind, params, 0.0, 0.0, item.altitude)
    if home is None:
        return WireItem(mavlink.MAV_FRAME_LOCAL_NED, item.kind, params, item.north, item.east, -item.altitude)
    latitude, longitude = to_degrees(home, item.north, item.east)
    return WireItem(frame, item.kind, params, latitude, longitude, item.altitude)


class Addressee(NamedTuple):
    """Whom a mission item goes to."""

    system: int
    component: int


def write_message(item: WireItem, sequence: int, current: bool, to: Addressee, as_int: bool) -> Any:
    """MISSION_ITEM_INT, or the old MISSION_ITEM."""
    head = (to.system, to.component, sequence)
    tail = (item.command, int(current), 1, *item.params)
    if not as_int:
        frame = 3 if item.frame in _RELATIVE else item.frame
        return mavlink.MAVLink_mission_item_message(*head, frame, *tail, item.x, item.y, item.z)
    scale = 1e7 if item.frame in _GLOBAL + _RELATIVE else 1.0
    scale = _LOCAL_SCALE if item.frame in _LOCAL else scale
    x, y = round(item.x * scale), round(item.y * scale)
    return mavlink.MAVLink_mission_item_int_message(*head, item.frame, *tail, x, y, item.z)
