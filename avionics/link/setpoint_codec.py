"""Codec of setpoints for OFFBOARD and GUIDED.

The messages are SET_POSITION_TARGET_GLOBAL_INT, SET_POSITION_TARGET_LOCAL_NED and SET_ATTITUDE_TARGET.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from avionics.guidance.setpoint import Path, Setpoint
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import decode_altitude, decode_place
from avionics.link.vehicle import Home
from avionics.link.wire_item import ItemRefused

STOPPED = 0.5
"""m/s; below this horizontal speed a velocity setpoint circles: the vehicle cannot hover"""
_X, _Y, _Z, _VX, _VY, _VZ = (1 << bit for bit in range(6))
_ACCELERATION, _YAW = 0b111 << 6, 1 << 10
_THROTTLE_IGNORE, _ATTITUDE_IGNORE = 1 << 6, 1 << 7
_GLOBAL = {
    mavlink.MAV_FRAME_GLOBAL: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}
_BODY = (mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_BODY_OFFSET_NED, mavlink.MAV_FRAME_BODY_FRD)
_UNSUPPORTED = mavlink.MAV_MISSION_UNSUPPORTED
_UNSUPPORTED_FRAME = mavlink.MAV_MISSION_UNSUPPORTED_FRAME


class Origin(NamedTuple):
    """Reference of relative setpoints."""

    home: Home | None
    """None before the first fix"""
    north: float
    """m; vehicle's position from home"""
    east: float
    """m; vehicle's position from home"""
    altitude: float
    """m; vehicle's altitude above home"""


def decode_setpoint(message: Any, origin: Origin) -> Setpoint:
    """Decode the setpoint of one of the three messages.

    Raises:
        ItemRefused: a frame or a type mask that is not supported, or a position before home is known.
    """
    if message.get_type() == "SET_ATTITUDE_TARGET":
        return _attitude(message)
    mask = message.type_mask
    if ~mask & _ACCELERATION:
        raise ItemRefused(_UNSUPPORTED, "setpoint: acceleration is not supported")
    if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
        horizontal, altitude = _global_position(message, origin.home)
    else:
        horizontal, altitude = _local_position(message, origin)
    climb_rate = -message.vz if _used(mask, _VZ, message.vz) else 0.0
    vertical = Setpoint(Path.KEEP, altitude=altitude, climb_rate=climb_rate if altitude is None else 0.0)
    if horizontal is not None:
        return vertical._replace(path=Path.CIRCLE_AT, north=horizontal[0], east=horizontal[1])
    if _used(mask, _VX | _VY, message.vx + message.vy):
        return _velocity(vertical, message)
    if _used(mask, _YAW, message.yaw):
        return vertical._replace(path=Path.COURSE, course=math.remainder(message.yaw, math.tau))
    if altitude is None and not _used(mask, _VZ, message.vz):
        raise ItemRefused(_UNSUPPORTED, f"setpoint: type mask {mask} has no position, velocity, altitude or yaw")
    return vertical


def _used(mask: int, bits: int, value: float) -> bool:
    """Return whether no field of ``bits`` is ignored; a NaN is ignored, as in PX4."""
    return not mask & bits and math.isfinite(value)


def _global_position(message: Any, home: Home | None) -> tuple[tuple[float, float] | None, float | None]:
    """Return position (m from home) and altitude (m above home), None if not used."""
    frame = _GLOBAL.get(message.coordinate_frame)
    if frame is None:
        raise ItemRefused(_UNSUPPORTED_FRAME, f"setpoint: frame {message.coordinate_frame} is not supported")
    place = None
    if not message.type_mask & (_X | _Y):
        place = decode_place(frame, message.lat_int * 1e-7, message.lon_int * 1e-7, home)
    used = _used(message.type_mask, _Z, message.alt)
    return place, decode_altitude(frame, message.alt, home) if used else None


def _local_position(message: Any, origin: Origin) -> tuple[tuple[float, float] | None, float | None]:
    """Return position (m from home) and altitude (m above home), None if not used.

    A horizontal offset of zero keeps the path: ArduPlane and QGroundControl change the altitude by it.
    """
    mask, frame = message.type_mask, message.coordinate_frame
    offset = frame == mavlink.MAV_FRAME_LOCAL_OFFSET_NED
    placed = _used(mask, _X | _Y, message.x + message.y)
    if frame in _BODY:
        if placed or _used(mask, _Z, message.z) or _used(mask, _YAW, message.yaw):
            raise ItemRefused(_UNSUPPORTED_FRAME, f"setpoint: no position and no yaw in frame {frame}")
        return None, None
    if frame != mavlink.MAV_FRAME_LOCAL_NED and not offset:
        raise ItemRefused(_UNSUPPORTED_FRAME, f"setpoint: frame {frame} is not supported")
    if offset and message.x == 0.0 and message.y == 0.0:
        placed = False
    north, east, altitude = (origin.north, origin.east, origin.altitude) if offset else (0.0, 0.0, 0.0)
    place = (north + message.x, east + message.y) if placed else None
    return place, altitude - message.z if _used(mask, _Z, message.z) else None


def _velocity(vertical: Setpoint, message: Any) -> Setpoint:
    if math.hypot(message.vx, message.vy) < STOPPED:
        return vertical._replace(path=Path.CIRCLE_HERE)
    if message.coordinate_frame in _BODY:
        raise ItemRefused(_UNSUPPORTED_FRAME, f"setpoint: no velocity in frame {message.coordinate_frame}")
    return vertical._replace(path=Path.COURSE, course=math.atan2(message.vy, message.vx))


def _attitude(message: Any) -> Setpoint:
    if message.type_mask & (_THROTTLE_IGNORE | _ATTITUDE_IGNORE):
        raise ItemRefused(_UNSUPPORTED, "setpoint: attitude and throttle are required")
    w, x, y, z = message.q
    if not abs(math.hypot(w, x, y, z) - 1.0) < 0.1:  # also NaN
        raise ItemRefused(_UNSUPPORTED, "setpoint: not a unit quaternion")
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return Setpoint(Path.ATTITUDE, roll=roll, pitch=pitch, throttle=message.thrust)
