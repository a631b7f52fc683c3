"""HIL_STATE_QUATERNION from the true state of the vehicle."""

from __future__ import annotations

import math

from avionics.link.dialect import mavlink
from sim_bridge.messages import TruthState

HIL_STATE_QUATERNION: int = mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION
EARTH_RADIUS = 6_378_137.0
"""m; WGS-84 semi-major axis, to convert meters from the launch position to degrees"""
_PACK = mavlink.mavlink_map[HIL_STATE_QUATERNION].unpacker.pack


def encode_truth(truth: TruthState, origin: tuple[float, float, float]) -> bytes:
    """Encode the payload of HIL_STATE_QUATERNION: degE7, mm and cm/s.

    Args:
        truth: true state, meters from the launch position.
        origin: latitude in rad, longitude in rad and altitude in m of the launch position.

    The accelerations are sent as 0: truth does not carry them.
    """
    latitude = origin[0] + truth.north / EARTH_RADIUS
    longitude = origin[1] + truth.east / (EARTH_RADIUS * math.cos(origin[0]))
    airspeed = _clamped(truth.airspeed * 100.0, 0, 65535)
    payload: bytes = _PACK(
        truth.time_us,
        truth.quaternion_w,
        truth.quaternion_x,
        truth.quaternion_y,
        truth.quaternion_z,
        truth.roll_rate,
        truth.pitch_rate,
        truth.yaw_rate,
        round(math.degrees(latitude) * 1e7),
        round(math.degrees(longitude) * 1e7),
        round((origin[2] - truth.down) * 1e3),
        _clamped(truth.v_north * 100.0, -32768, 32767),
        _clamped(truth.v_east * 100.0, -32768, 32767),
        _clamped(truth.v_down * 100.0, -32768, 32767),
        airspeed,
        airspeed,
        0,
        0,
        0,
    )
    return payload


def _clamped(value: float, low: int, high: int) -> int:
    return min(max(round(value), low), high)
