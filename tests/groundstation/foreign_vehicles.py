"""Scripted vehicles that speak as PX4 and ArduPilot do, where they differ from ours."""

from __future__ import annotations

import math
import struct
from typing import Any

from lossy_vehicle import LossyVehicle
from pymavlink.dialects.v20 import ardupilotmega

from avionics.link.dialect import mavlink
from groundstation.link.missions import Item

HOME = (473_977_419, 85_455_939, 488_000)
"""1e-7 deg, 1e-7 deg, mm above the sea"""
INT32 = 6
RELATIVE = (3, 6)
GLOBAL = (0, 5)


class ForeignVehicle(LossyVehicle):
    """What both have in common: whole-number parameters, a version, a home."""

    autopilot = 0
    vehicle_type = 1
    capabilities = 0

    def __init__(self, loss: float = 0.0, seed: int = 1) -> None:
        super().__init__(loss, seed)
        self.whole = {"COUNT": 7, "MASK": 2_000_000_001}
        self.takeoffs: list[Any] = []
        self.places: list[Any] = []
        self.announced: dict[int, str] = {}
        self.intervals: dict[int, float] = {}
        """us; by message id, as they were asked for"""
        self.groups: list[tuple[int, int]] = []
        """MAV_DATA_STREAM and Hz, as they were asked for"""

    def heartbeat(self) -> Any:
        return mavlink.MAVLink_heartbeat_message(
            self.vehicle_type, self.autopilot, 1 | 128 * self.armed, self.custom_mode, 4, 3
        )

    def _command_long(self, message: Any) -> list[Any]:
        if message.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._requested(int(message.param1))
        if message.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            self.takeoffs.append(message)
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and message.command not in self.results:
            self.intervals[int(message.param1)] = message.param2
        if message.command == mavlink.MAV_CMD_DO_SET_MODE and message.command not in self.results:
            self.custom_mode = self._mode(message)
            return [mavlink.MAVLink_command_ack_message(message.command, 0)]
        return super()._command_long(message)

    def _mode(self, message: Any) -> int:
        raise NotImplementedError

    def _command_int(self, message: Any) -> list[Any]:
        self.places.append(message)
        self.custom_mode = self.leads_to[message.command]
        return [mavlink.MAVLink_command_ack_message(message.command, 0)]

    def _request_data_stream(self, message: Any) -> list[Any]:
        self.groups.append((message.req_stream_id, message.req_message_rate))
        return []

    def _requested(self, number: int) -> list[Any]:
        if number == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES and self.announced:
            return [mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_REQUEST_MESSAGE, 0), *self._modes()]
        answers = {
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: _home,
        }
        known = answers.get(number)
        result = mavlink.MAV_RESULT_UNSUPPORTED if known is None else mavlink.MAV_RESULT_ACCEPTED
        ack = mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_REQUEST_MESSAGE, result)
        return [ack] if known is None else [ack, known()]

    def _modes(self) -> list[Any]:
        total = len(self.announced)
        return [
            mavlink.MAVLink_available_modes_message(total, place, 0, number, 0, name.encode())
            for place, (number, name) in enumerate(self.announced.items(), 1)
        ]

    def _version(self) -> Any:
        return mavlink.MAVLink_autopilot_version_message(
            self.capabilities, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0
        )

    def _param_request_list(self, message: Any) -> list[Any]:
        return [self._value(name) for name in (*self.values, *self.whole)]

    def _value(self, name: str) -> Any:
        names = [*self.values, *self.whole]
        kind = INT32 if name in self.whole else 9
        value = self.encoded(self.whole[name]) if name in self.whole else self.values[name]
        return mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(names), names.index(name))

    def _param_request_read(self, message: Any) -> list[Any]:
        name = message.param_id if isinstance(message.param_id, str) else message.param_id.decode()
        names = [*self.values, *self.whole]
        return [self._value(names[message.param_index] if message.param_index >= 0 else name)]

    def _param_set(self, message: Any) -> list[Any]:
        name = message.param_id if isinstance(message.param_id, str) else message.param_id.decode()
        if name in self.whole:
            self.whole[name] = self.decoded(message.param_value)
            return [self._value(name)]
        return super()._param_set(message)

    def encoded(self, value: int) -> float:
        raise NotImplementedError

    def decoded(self, value: float) -> int:
        raise NotImplementedError


def _home() -> Any:
    return mavlink.MAVLink_home_position_message(*HOME, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)


class Px4(ForeignVehicle):
    """Whole numbers as bytes, main and sub mode, altitudes above the sea, only places on the globe."""

    autopilot = 12
    capabilities = 16

    def __init__(self, loss: float = 0.0, seed: int = 1) -> None:
        super().__init__(loss, seed)
        self.custom_mode = 4 << 16 | 3 << 24
        self.leads_to[mavlink.MAV_CMD_NAV_TAKEOFF] = 4 << 16 | 2 << 24

    def _mode(self, message: Any) -> int:
        return int(message.param2) << 16 | int(message.param3) << 24

    def encoded(self, value: int) -> float:
        return float(struct.unpack("<f", struct.pack("<i", value))[0])

    def decoded(self, value: float) -> int:
        return int(struct.unpack("<i", struct.pack("<f", value))[0])

    def _mission_item_int(self, message: Any) -> list[Any]:
        if message.frame not in (*GLOBAL, *RELATIVE, mavlink.MAV_FRAME_MISSION):
            return [mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_UNSUPPORTED_FRAME)]
        return super()._mission_item_int(message)


class ArduPlane(ForeignVehicle):
    """Whole numbers as floats, one mode number, item 0 is its own home, NaN parameters are kept as 0.

    Without rotors to hover on it fails NAV_TAKEOFF, and knows no NAV_LAND.
    """

    autopilot = 3
    capabilities = 131072

    def __init__(self, loss: float = 0.0, seed: int = 1) -> None:
        super().__init__(loss, seed)
        self.custom_mode = 0
        self.whole["MASK"] = 65536
        self.values["TKOFF_ALT"] = 50.0
        self.leads_to = {mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: 11, mavlink.MAV_CMD_DO_REPOSITION: 15}
        self.results[mavlink.MAV_CMD_NAV_TAKEOFF] = mavlink.MAV_RESULT_FAILED
        self.results[mavlink.MAV_CMD_NAV_LAND] = mavlink.MAV_RESULT_UNSUPPORTED

    def _mode(self, message: Any) -> int:
        return int(message.param2)

    def encoded(self, value: int) -> float:
        return float(value)

    def decoded(self, value: float) -> int:
        return round(value)

    def _mission_item_int(self, message: Any) -> list[Any]:
        if message.frame not in (*GLOBAL, *RELATIVE, mavlink.MAV_FRAME_MISSION):
            return [mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_UNSUPPORTED_FRAME)]
        answers = super()._mission_item_int(message)
        if message.seq == 0:
            self.incoming[0] = Item(0, 16, (0.0, 0.0, 0.0, 0.0), HOME[0], HOME[1], HOME[2] * 1e-3)
        kept = self.incoming[-1]
        plain = tuple(0.0 if math.isnan(value) else value for value in kept.parameters)
        self.incoming[-1] = kept._replace(parameters=plain)
        return answers

    def _command_int(self, message: Any) -> list[Any]:
        if math.isnan(message.param3) or math.isnan(message.param4):
            return [mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_DENIED)]
        return super()._command_int(message)


def ahrs_report() -> Any:
    """A message that only ArduPilot's dialect has."""
    return ardupilotmega.MAVLink_ahrs2_message(0.1, 0.2, 0.3, 0.5, 481_000_000, 116_000_000)


def ekf_report() -> Any:
    """EKF_STATUS_REPORT of an ArduPilot vehicle."""
    return ardupilotmega.MAVLink_ekf_status_report_message(831, 0.1, 0.2, 0.3, 0.4, 0.5)
