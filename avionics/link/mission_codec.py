"""Codec of missions: items in meters from home to and from MAVLink.

MAVLink uses latitudes, longitudes and parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.guidance.mission import Fence, ItemKind, MissionItem, Rally, RallyPoint, Zone
from avionics.guidance.path import Place
from avionics.link.dialect import mavlink
from avionics.link.excitation_codec import DECODERS as EXCITE_COMMANDS
from avionics.link.excitation_codec import decode_excitation, encode_excitation
from avionics.link.vehicle import Home
from avionics.link.wire_item import HomeUnknown, ItemRefused, WireItem

EARTH_RADIUS = 6_378_137.0
"""m; WGS-84 semi-major axis. Missions are within a few km of home, so that the flat-earth error is some centimeters
"""

FARTHEST = 100e3
"""m; maximum distance from home"""

_GLOBAL = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_TERRAIN = (mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT, mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT)
"""frames handled as relative to home, because there is no terrain data"""
_RELATIVE = (
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    *_TERRAIN,
)
SKIPPED = frozenset(
    (
        mavlink.MAV_CMD_NAV_DELAY,
        mavlink.MAV_CMD_CONDITION_DELAY,
        mavlink.MAV_CMD_CONDITION_DISTANCE,
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_DO_SET_RELAY,
        mavlink.MAV_CMD_DO_REPEAT_RELAY,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_REPEAT_SERVO,
        mavlink.MAV_CMD_DO_GRIPPER,
        mavlink.MAV_CMD_DO_AUX_FUNCTION,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_SYSID,
        mavlink.MAV_CMD_NAV_ROI,
        mavlink.MAV_CMD_DO_CONTROL_VIDEO,
        mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_MOUNT_CONFIGURE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL_QUAT,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
        mavlink.MAV_CMD_SET_CAMERA_ZOOM,
        mavlink.MAV_CMD_SET_CAMERA_FOCUS,
        mavlink.MAV_CMD_SET_CAMERA_SOURCE,
        mavlink.MAV_CMD_SET_STORAGE_USAGE,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
    )
)
"""MAV_CMDs that are accepted in a mission, keep their index and are skipped in flight"""
GLOBES = _GLOBAL + _RELATIVE
"""MAV_FRAMEs with latitude and longitude in x and y"""
_LOCAL = (mavlink.MAV_FRAME_LOCAL_NED,)
_CIRCLES = {
    mavlink.MAV_CMD_NAV_LOITER_TURNS: ItemKind.CIRCLE,
    mavlink.MAV_CMD_NAV_LOITER_TIME: ItemKind.CIRCLE,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: ItemKind.CIRCLE,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: ItemKind.LOITER,
}
_AIRSPEED, GROUND_SPEED = 0, 1
"""SPEED_TYPE of DO_CHANGE_SPEED"""
_PLACED = (ItemKind.WAYPOINT, ItemKind.LAND)
_WITH_ALTITUDE = (ItemKind.WAYPOINT, ItemKind.TAKEOFF, ItemKind.HOLD)
_KEEP_IN = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
_KEEP_OUT = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
_CIRCLE_IN = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
_CIRCLE_OUT = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
_RALLY_POINT = mavlink.MAV_CMD_NAV_RALLY_POINT
_NO_INTEGER = 2**31 - 1
"""value of MISSION_ITEM_INT for NaN in x and y"""
_LOCAL_SCALE = 1e4
"""scale of local coordinates in MISSION_ITEM_INT per meter"""
LOCAL_FRAMES = frozenset((1, 4, 7, 8, 9, 12, 20, 21))
"""MAV_FRAMEs with x and y in meters, sent in 1e-4 m; the others are degrees, sent in 1e-7 deg"""


def to_metres(home: Home, latitude: float, longitude: float) -> tuple[float, float]:
    """Return north and east (m) of ``home`` for a position in degrees."""
    north = (math.radians(latitude) - home.latitude) * EARTH_RADIUS
    eastward = math.remainder(math.radians(longitude) - home.longitude, math.tau)
    east = eastward * EARTH_RADIUS * math.cos(home.latitude)
    return north, east


def to_degrees(home: Home, north: float, east: float) -> tuple[float, float]:
    """Return latitude and longitude in degrees of a position (m) from ``home``."""
    latitude = home.latitude + north / EARTH_RADIUS
    longitude = math.remainder(home.longitude + east / (EARTH_RADIUS * math.cos(home.latitude)), math.tau)
    return math.degrees(latitude), math.degrees(longitude)


def wire_scale(frame: int) -> float:
    """Return the scale of x and y in MISSION_ITEM_INT for a frame.

    The units are those of a degree, a meter, or a plain parameter.
    """
    if frame == mavlink.MAV_FRAME_MISSION:
        return 1.0
    return _LOCAL_SCALE if frame in LOCAL_FRAMES else 1e7


def read_message(message: Any) -> WireItem:
    """Convert a MISSION_ITEM or MISSION_ITEM_INT."""
    params = (message.param1, message.param2, message.param3, message.param4)
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM_INT":
        scale = 1e7 if message.frame in GLOBES else 1.0
        scale = _LOCAL_SCALE if message.frame in _LOCAL else scale
        x, y = (math.nan if value == _NO_INTEGER else value / scale for value in (x, y))
    return WireItem(message.frame, message.command, params, x, y, message.z)


def decode_item(item: WireItem, home: Home | None, earlier: Sequence[WireItem] = ()) -> MissionItem:
    """Decode an item to meters from home.

    ``earlier`` items determine the course of a landing without a heading.

    Raises:
        ItemRefused: unknown command or frame, a number that is not finite, an input outside its range, or a global
        position before home is known.
    """
    if item.command in SKIPPED:
        return skipped_item(item)
    if item.command == ItemKind.LAND_START:
        return skipped_item(item)._replace(kind=ItemKind.LAND_START)
    if item.command == ItemKind.SPEED:
        speed = read_speed(item.params)
        marked = skipped_item(item)
        return marked if speed is None else marked._replace(kind=ItemKind.SPEED, airspeed=speed)
    if item.command in EXCITE_COMMANDS:
        return MissionItem(ItemKind.EXCITE, excitation=decode_excitation(item))
    if item.command in _CIRCLES:
        return _decode_circle(item, home)
    try:
        kind = ItemKind(item.command)
    except ValueError:
        text = f"{command_name(item.command)} is not flown"
        raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED, text) from None
    if kind is ItemKind.JUMP:
        return _decode_jump(item)
    if kind is ItemKind.RETURN:
        return MissionItem(kind)
    here = kind in _PLACED and _is_here(item)
    placed = (kind in _PLACED and not here) or (kind is ItemKind.TAKEOFF and _names_a_place(item))
    north, east = _place(item, home) if placed else (0.0, 0.0)
    altitude = _altitude(item, home) if kind in _WITH_ALTITUDE else 0.0
    heading = {ItemKind.HOLD: item.params[1], ItemKind.LAND: item.params[3]}.get(kind, 0.0)
    if kind is ItemKind.LAND and not here and (not math.isfinite(heading) or heading == 0.0):
        heading = math.degrees(_landing_course((north, east), home, earlier))
    held = kind is ItemKind.HOLD or (kind is ItemKind.WAYPOINT and item.params[0] > 0.0)
    duration = item.params[0] if held else 0.0
    if not math.isfinite(duration) or duration < 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a hold time must be a number of seconds from 0")
    return MissionItem(kind, north, east, altitude, _heading(heading), duration, here=int(here))


def _landing_course(place: Place, home: Home | None, earlier: Sequence[WireItem]) -> float:
    """Return the course (rad) of a landing without a heading.

    The course starts at the last position before it, as in ArduPlane and PX4. QGroundControl sends 0 for "none";
    north is 360 degrees.
    """
    flown = (mavlink.MAV_CMD_NAV_WAYPOINT, *_CIRCLES)
    before = [_place(each, home) for each in earlier if each.command in flown and not _is_here(each)]
    for north, east in (*reversed(before), (0.0, 0.0)):
        if math.hypot(place[0] - north, place[1] - east) > 1.0:
            return math.atan2(place[1] - east, place[0] - north)
    return 0.0


def skipped_item(item: WireItem) -> MissionItem:
    """Return an item that keeps its index and is skipped in flight.

    Raises:
        ItemRefused: its fifth or sixth parameter does not fit into a MISSION_ITEM_INT.
    """
    scale = wire_scale(item.frame)
    if any(math.isfinite(value) and abs(value * scale) >= 2**31 for value in (item.x, item.y)):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, "a parameter is out of range")
    numbers = (item.frame, item.command, *item.params, item.x, item.y, item.z)
    return MissionItem(
        ItemKind.SKIP, skipped=tuple(float(value) if math.isfinite(value) else 0.0 for value in numbers)
    )


def read_speed(params: Sequence[float]) -> float | None:
    """Return the airspeed setpoint (m/s) of a DO_CHANGE_SPEED.

    A setpoint of 0 is the default of the vehicle. The result is None if the command changes something else. A ground
    speed is used as an airspeed, as in PX4. -1 is "no change", -2 and 0 are "default".
    """
    speed_type, speed = params[:2]
    if speed_type not in (_AIRSPEED, GROUND_SPEED):
        return None
    if not math.isfinite(speed) or speed == -1.0:
        return None
    return max(speed, 0.0)


def notes(items: Sequence[WireItem], first_item: int = 0) -> tuple[str, ...]:
    """Return notices about items that are flown differently, one line for each kind.

    The list begins with home if ``first_item`` is 1.
    """
    speeds = [item for item in items if item.command == ItemKind.SPEED]
    skipped = [item.command for item in items if item.command in SKIPPED]
    skipped += [item.command for item in speeds if read_speed(item.params) is None]
    names = dict.fromkeys(map(command_name, skipped))
    lines = [f"passed over in flight: {', '.join(names)}"] if names else []
    if first_item and items[0].command != mavlink.MAV_CMD_NAV_WAYPOINT:
        lines.append(f"item 0 is home and not flown: it was {command_name(items[0].command)}")
    if any(item.params[0] == GROUND_SPEED for item in speeds):
        lines.append("ground speeds of DO_CHANGE_SPEED are taken as airspeeds")
    if any(item.frame in _TERRAIN for item in items):
        lines.append("altitudes above terrain are taken as above home")
    return tuple(lines)


def _names_a_place(item: WireItem) -> bool:
    """Return whether a takeoff has a position, as those of QGroundControl do.

    It needs none; 0, 0 and NaN count as none.
    """
    if item.frame == mavlink.MAV_FRAME_MISSION or not (math.isfinite(item.x) and math.isfinite(item.y)):
        return False
    return (item.x, item.y) != (0.0, 0.0)


def _is_here(item: WireItem) -> bool:
    """Return whether an item uses the position of the vehicle at its start.

    This is 0, 0 (ArduPilot) or NaN (PX4) in a global frame.
    """
    return item.frame in GLOBES and not _names_a_place(item)


def with_altitude(item: WireItem, earlier: Sequence[WireItem]) -> WireItem:
    """Replace a NaN altitude (null in a plan) by that of the previous item."""
    if math.isfinite(item.z) or item.frame not in GLOBES:
        return item
    flown = (*_WITH_ALTITUDE, *_CIRCLES)
    last = next((e for e in reversed(earlier) if e.frame in GLOBES and e.z and e.command in flown), None)
    return item if last is None else item._replace(frame=last.frame, z=last.z)


def is_home(item: WireItem, home: Home | None) -> bool:
    """Return whether the first item of an upload is home and not a waypoint.

    Clients of ArduPilot send home first. It is a waypoint with its altitude above mean sea level, either without a
    position or on the ground near home.
    """
    if (item.frame, item.command) not in [(frame, mavlink.MAV_CMD_NAV_WAYPOINT) for frame in _GLOBAL]:
        return False
    if _is_here(item):
        return item.z == 0.0
    return math.hypot(*_place(item, home)) < _HOME_REACH and abs(_altitude(item, home)) < _HOME_HEIGHT


_HOME_REACH = 100.0
"""m; maximum distance from home of a first item that counts as home"""
_HOME_HEIGHT = 5.0
"""m; maximum height difference from home of a first item on the ground"""


def command_name(command: int) -> str:
    """Return the name of a MAV_CMD with its number, or its number alone."""
    entry = mavlink.enums["MAV_CMD"].get(command)
    return f"{str(entry.name).removeprefix('MAV_CMD_')} ({command})" if entry else f"command {command}"


def _decode_circle(item: WireItem, home: Home | None) -> MissionItem:
    """Decode turns, time or altitude of a circle; a NaN radius is the default."""
    kind = _CIRCLES[item.command]
    amount = item.params[0] if item.command in (ItemKind.CIRCLE, mavlink.MAV_CMD_NAV_LOITER_TIME) else 0.0
    if not math.isfinite(amount) or amount < 0.0:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a circle's turns or time must be a number from 0")
    if item.command in (ItemKind.CIRCLE, mavlink.MAV_CMD_NAV_LOITER_TIME) and amount == 0.0:
        raise ItemRefused(
            mavlink.MAV_MISSION_INVALID_PARAM1, "a circle without turns or time: use LOITER_TO_ALT (31)"
        )
    radius = item.params[1 if item.command == mavlink.MAV_CMD_NAV_LOITER_TO_ALT else 2]
    turning = item.command == ItemKind.CIRCLE
    here = _is_here(item)
    return MissionItem(
        kind,
        *((0.0, 0.0) if here else _place(item, home)),
        _altitude(item, home),
        duration=0.0 if turning else amount,
        radius=radius if math.isfinite(radius) else 0.0,
        turns=amount if turning else 0.0,
        here=int(here),
    )


def _decode_jump(item: WireItem) -> MissionItem:
    target, repeats = item.params[:2]
    if not 0.0 <= target < 65536.0 or target != int(target):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "DO_JUMP: the item must be a whole number")
    if not -1.0 <= repeats <= 1000.0 or repeats != int(repeats):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM2, "DO_JUMP: repeats must be -1 (for ever) to 1000")
    return MissionItem(ItemKind.JUMP, jump_to=int(target), repeats=int(repeats))


def _heading(degrees: float) -> float:
    # NaN selects the default, which is 0 in the field.
    return math.remainder(math.radians(degrees), math.tau) if math.isfinite(degrees) else 0.0


def _place(item: WireItem, home: Home | None) -> tuple[float, float]:
    if not (math.isfinite(item.x) and math.isfinite(item.y)):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM5_X, "an item has no place")
    if item.frame in _LOCAL:
        return item.x, item.y
    if item.frame not in GLOBES:
        raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED_FRAME, f"frame {item.frame} is not supported")
    if home is None:
        raise HomeUnknown
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
        raise HomeUnknown
    return item.z - home.altitude


def decode_place(frame: int, x: float, y: float, home: Home | None) -> tuple[float, float]:
    """Return north and east (m) of home.

    ``x`` and ``y`` are in degrees, or in m in the local frame.

    Raises:
        ItemRefused: as `decode_item`.
    """
    return _place(WireItem(frame, 0, (0.0,) * 4, x, y, 0.0), home)


def decode_altitude(frame: int, altitude: float, home: Home | None) -> float:
    """Return the altitude (m) above home.

    ``altitude`` is in m of ``frame``, positive down in the local one.

    Raises:
        ItemRefused: as `decode_item`.
    """
    return _altitude(WireItem(frame, 0, (0.0,) * 4, 0.0, 0.0, altitude), home)


def encode_item(item: MissionItem, home: Home | None) -> WireItem:
    """Encode an item for MAVLink.

    Positions are global, or in the local frame while home is unknown.
    """
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    nan = math.nan
    if item.skipped:
        sent_frame, command, p1, p2, p3, p4, x, y, z = item.skipped
        return WireItem(int(sent_frame), int(command), (p1, p2, p3, p4), x, y, z)
    if item.kind is ItemKind.EXCITE and item.excitation is not None:
        return encode_excitation(item.excitation)
    if item.kind is ItemKind.SPEED:
        params = (float(_AIRSPEED), item.airspeed or -2.0, -1.0, 0.0)
        return WireItem(mavlink.MAV_FRAME_MISSION, item.kind, params, 0.0, 0.0, 0.0)
    if item.kind in (ItemKind.RETURN, ItemKind.LAND_START):
        return WireItem(mavlink.MAV_FRAME_MISSION, item.kind, (0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    if item.kind is ItemKind.JUMP:
        params = (float(item.jump_to), float(item.repeats), 0.0, 0.0)
        return WireItem(mavlink.MAV_FRAME_MISSION, item.kind, params, 0.0, 0.0, 0.0)
    if item.kind in (ItemKind.CIRCLE, ItemKind.LOITER):
        return _encode_circle(item, home)
    heading = math.degrees(item.heading) % 360.0
    heading = heading if item.kind is ItemKind.HOLD else heading or 360.0
    if item.kind is ItemKind.HOLD:
        return WireItem(frame, item.kind, (item.duration, heading, 0.0, 0.0), 0.0, 0.0, item.altitude)
    hold_time = item.duration if item.kind is ItemKind.WAYPOINT else 0.0
    params = (hold_time, 0.0, 0.0, heading if item.kind is ItemKind.LAND else nan)
    if item.here or (item.kind is ItemKind.TAKEOFF and (item.north, item.east) == (0.0, 0.0)):
        return WireItem(frame, item.kind, params, 0.0, 0.0, item.altitude)
    return _placed(item.kind, params, (item.north, item.east, item.altitude), home)


def _encode_circle(item: MissionItem, home: Home | None) -> WireItem:
    command, params = _circle_command(item)
    if item.here:
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        return WireItem(frame, command, params, 0.0, 0.0, item.altitude)
    return _placed(command, params, (item.north, item.east, item.altitude), home)


def _circle_command(item: MissionItem) -> tuple[int, tuple[float, float, float, float]]:
    """Return MAV_CMD and parameters 1 to 4 of a circle."""
    if item.kind is ItemKind.LOITER:
        return item.kind, (0.0, 0.0, item.radius, math.nan)
    if item.turns > 0.0:
        return item.kind, (item.turns, 0.0, item.radius, 1.0)
    if item.duration > 0.0:
        return mavlink.MAV_CMD_NAV_LOITER_TIME, (item.duration, 0.0, item.radius, 1.0)
    return mavlink.MAV_CMD_NAV_LOITER_TO_ALT, (1.0, item.radius, 0.0, 1.0)


def _placed(
    command: int, params: tuple[float, float, float, float], place: tuple[float, float, float], home: Home | None
) -> WireItem:
    """Return an item at north, east and altitude (m) of home, global if home is known."""
    north, east, altitude = place
    if home is None:
        return WireItem(mavlink.MAV_FRAME_LOCAL_NED, command, params, north, east, -altitude)
    latitude, longitude = to_degrees(home, north, east)
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return WireItem(frame, command, params, latitude, longitude, altitude)


# --- fences and rally points -------------------------------------------------------------------------------


def decode_fence(items: Sequence[WireItem], home: Home | None) -> Fence:
    """Decode the zones of a fence; its altitudes are parameters of the vehicle.

    Raises:
        ItemRefused: as `decode_item`, a polygon with corners that are not consecutive, a return point.
    """
    zones: list[Zone] = []
    corners: list[tuple[float, float]] = []
    first = WireItem(0, 0, (0.0,) * 4, 0.0, 0.0, 0.0)
    for number, item in enumerate(items):
        if item.params[1]:
            raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM2, f"item {number}: there is one group of zones, 0")
        if item.command in (_CIRCLE_IN, _CIRCLE_OUT):
            zones.append(Zone(int(item.command == _CIRCLE_IN), (_place(item, home),), _fence_radius(item)))
            continue
        if item.command not in (_KEEP_IN, _KEEP_OUT):
            text = f"item {number}: {command_name(item.command)} is no fence of ours"
            raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED, text)
        if not corners:
            first = item
        elif (item.command, item.params[0]) != (first.command, first.params[0]):
            text = f"item {number}: the corners of a polygon have one command and one count"
            raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, text)
        corners.append(_place(item, home))
        if len(corners) == item.params[0]:
            zones.append(Zone(int(item.command == _KEEP_IN), tuple(corners)))
            corners = []
    if corners:
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a polygon has fewer corners than it says")
    return Fence(tuple(zones))


def _fence_radius(item: WireItem) -> float:
    radius = item.params[0]
    if not (math.isfinite(radius) and radius > 0.0):
        raise ItemRefused(mavlink.MAV_MISSION_INVALID_PARAM1, "a circle needs a radius in m")
    return radius


def encode_fence(fence: Fence, home: Home | None) -> tuple[WireItem, ...]:
    """Return one item for each circle and for each corner."""
    items: list[WireItem] = []
    for zone in fence.zones:
        round_one = zone.radius > 0.0
        if round_one:
            command = _CIRCLE_IN if zone.keep_in else _CIRCLE_OUT
        else:
            command = _KEEP_IN if zone.keep_in else _KEEP_OUT
        params = (zone.radius if round_one else float(len(zone.places)), 0.0, 0.0, 0.0)
        items += [_placed(command, params, (north, east, 0.0), home) for north, east in zone.places]
    return tuple(items)


def decode_rally(items: Sequence[WireItem], home: Home | None) -> Rally:
    """Decode rally points.

    Raises:
        ItemRefused: as `decode_item`.
    """
    for number, item in enumerate(items):
        if item.command != _RALLY_POINT:
            text = f"item {number}: {command_name(item.command)} is no rally point"
            raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED, text)
    return tuple(RallyPoint(*_place(item, home), _altitude(item, home)) for item in items)


def encode_rally(rally: Rally, home: Home | None) -> tuple[WireItem, ...]:
    """Return one item for each point."""
    nothing = (0.0, 0.0, 0.0, 0.0)
    return tuple(_placed(_RALLY_POINT, nothing, (north, east, up), home) for north, east, up in rally)


class Addressee(NamedTuple):
    """Recipient of a mission item."""

    system: int
    component: int


class Slot(NamedTuple):
    """Index and list of an item."""

    sequence: int
    current: bool
    mission_type: int = 0
    """MAV_MISSION_TYPE"""


def write_message(item: WireItem, slot: Slot, to: Addressee, as_int: bool) -> Any:
    """Return MISSION_ITEM_INT, or the old MISSION_ITEM."""
    sequence, current, mission_type = slot
    head = (to.system, to.component, sequence)
    tail = (item.command, int(current), 1, *item.params)
    if not as_int:
        frame = 3 if item.frame in _RELATIVE else item.frame
        return mavlink.MAVLink_mission_item_message(*head, frame, *tail, item.x, item.y, item.z, mission_type)
    scale = 1e7 if item.frame in GLOBES else 1.0
    scale = _LOCAL_SCALE if item.frame in _LOCAL else scale
    x, y = (_NO_INTEGER if math.isnan(value) else round(value * scale) for value in (item.x, item.y))
    return mavlink.MAVLink_mission_item_int_message(*head, item.frame, *tail, x, y, item.z, mission_type)
