"""Table of telemetry streams: builder, default rate, rank on a slow link, group."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from avionics.link import telemetry
from avionics.link import telemetry_on_request as on_request
from avionics.link.budget import Rank
from avionics.link.dialect import mavlink
from avionics.link.sensor_codec import TELEMETRY
from avionics.link.vehicle import VehicleView


class StreamEntry(NamedTuple):
    """Telemetry stream of one message."""

    message_id: int
    build: Callable[[VehicleView], Any]
    """builder of a message, a list of messages, or None"""
    rate: float
    """Hz; default rate, 0 for messages on request only"""
    rank: Rank
    """priority on a slow link"""
    groups: frozenset[int]
    """MAV_DATA_STREAM groups of the old REQUEST_DATA_STREAM"""
    changes: Callable[[VehicleView], int] | None = None
    """trigger: the message is sent at once when this value changes"""


_STATUS = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS
_PLACE = mavlink.MAV_DATA_STREAM_POSITION
_TURN = mavlink.MAV_DATA_STREAM_EXTRA1
_HUD = mavlink.MAV_DATA_STREAM_EXTRA2
_MORE = mavlink.MAV_DATA_STREAM_EXTRA3
_SERVOS = mavlink.MAV_DATA_STREAM_RC_CHANNELS
_RAW = mavlink.MAV_DATA_STREAM_RAW_SENSORS


_FIRST, _SECOND, _THIRD, _LAST = Rank


def _entry(name: str, build: Callable[[VehicleView], Any], rate: float, rank: Rank, *groups: int) -> StreamEntry:
    return StreamEntry(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"), build, rate, rank, frozenset(groups))


STREAMS = (
    _entry("ATTITUDE", telemetry.attitude, 10.0, _FIRST, _TURN),
    _entry("ATTITUDE_QUATERNION", telemetry.attitude_quaternion, 0.0, _FIRST),
    _entry("VFR_HUD", telemetry.vfr_hud, 5.0, _SECOND, _HUD),
    _entry("GLOBAL_POSITION_INT", telemetry.global_position, 5.0, _FIRST, _PLACE),
    _entry("LOCAL_POSITION_NED", telemetry.local_position, 5.0, _THIRD, _PLACE),
    _entry("GPS_RAW_INT", telemetry.gps_raw, 2.0, _SECOND, _STATUS),
    _entry("SYS_STATUS", telemetry.sys_status, 1.0, _FIRST, _STATUS),
    _entry("BATTERY_STATUS", telemetry.battery, 1.0, _SECOND, _MORE),
    _entry("EXTENDED_SYS_STATE", telemetry.extended_sys_state, 1.0, _FIRST, _STATUS)._replace(
        changes=telemetry.landed_state
    ),
    _entry("NAV_CONTROLLER_OUTPUT", telemetry.navigation_output, 1.0, _THIRD, _STATUS),
    _entry("HOME_POSITION", telemetry.home_position, 0.5, _SECOND),
    _entry("WIND_COV", telemetry.wind, 1.0, _THIRD, _MORE),
    _entry("EKF_STATUS_REPORT", on_request.ekf_status, 1.0, _THIRD, _MORE),
    _entry("SERVO_OUTPUT_RAW", telemetry.servo_output, 5.0, _LAST, _SERVOS),
    _entry("RC_CHANNELS", telemetry.rc_channels, 2.0, _THIRD, _SERVOS),
    _entry("FENCE_STATUS", telemetry.fence_status, 1.0, _SECOND, _STATUS),
    _entry("NAMED_VALUE_FLOAT", telemetry.mirrors, 5.0, _LAST, _RAW),
    _entry("WINGBEAT_WING_STATE", telemetry.wing_state, 10.0, _SECOND, _RAW),
    _entry("WINGBEAT_POWER", telemetry.power_state, 2.0, _SECOND, _RAW),
    _entry("WINGBEAT_NAVIGATION", telemetry.navigation_state, 2.0, _THIRD, _STATUS),
    _entry("WINGBEAT_EXCITATION", telemetry.excitation_state, 2.0, _THIRD, _STATUS),
    _entry("RAW_IMU", on_request.raw_imu, 0.0, _LAST, _RAW),
    _entry("SCALED_IMU", on_request.scaled_imu, 0.0, _LAST),
    _entry("HIGHRES_IMU", on_request.highres_imu, 0.0, _LAST),
    _entry("SCALED_PRESSURE", on_request.scaled_pressure, 1.0, _LAST, _RAW),
    _entry("VIBRATION", on_request.vibration, 0.0, _LAST, _MORE),
    _entry("ALTITUDE", on_request.altitude, 0.0, _THIRD),
    _entry("ESTIMATOR_STATUS", on_request.estimator_status, 0.0, _LAST),
    _entry("ODOMETRY", on_request.odometry, 0.0, _LAST),
    _entry("POSITION_TARGET_GLOBAL_INT", on_request.position_target_global, 0.0, _THIRD),
    _entry("POSITION_TARGET_LOCAL_NED", on_request.position_target_local, 0.0, _THIRD),
    _entry("GPS_GLOBAL_ORIGIN", on_request.gps_global_origin, 0.0, _SECOND),
    _entry("ACTUATOR_OUTPUT_STATUS", on_request.actuator_outputs, 0.0, _LAST),
    *(
        _entry(each.wire, on_request.sensor_message(each), each.topic.telemetry_rate, _LAST, _MORE)
        for each in TELEMETRY
    ),
)
"""all telemetry, with the rates of a new link"""
