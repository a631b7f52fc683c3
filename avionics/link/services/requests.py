"""Requested messages and telemetry rates.

The messages are REQUEST_MESSAGE, SET_MESSAGE_INTERVAL and their predecessors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from avionics.link import metadata as metadata_files
from avionics.link.dialect import mavlink
from avionics.link.services import modes
from avionics.link.services.flight_information import FlightInformation
from avionics.link.services.heartbeat import heartbeat
from avionics.link.services.service import Output, Sender
from avionics.link.streams import Streams
from avionics.link.vehicle import Identity, VehicleView

_MAVLINK_2 = 200
_METADATA_URI = metadata_files.uri(metadata_files.GENERAL).encode()
_DEVELOPMENT = 0
"""FIRMWARE_VERSION_TYPE_DEV"""


def autopilot_version(identity: Identity) -> Any:
    """Return AUTOPILOT_VERSION."""
    major, minor, patch = identity.version
    version = major << 24 | minor << 16 | patch << 8 | _DEVELOPMENT
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        identity.capabilities, version, 0, 0, 0, list(b"wingbeat"), none, none, 0, 0, identity.uid
    )


def basic_information(identity: Identity, time_ms: int) -> Any:
    """Return COMPONENT_INFORMATION_BASIC."""
    version = ".".join(map(str, identity.version)).encode()
    vendor = metadata_files.VENDOR.encode()
    return mavlink.MAVLink_component_information_basic_message(
        time_ms, identity.capabilities, 0, vendor, vendor, version, b"", f"{identity.uid:x}".encode()
    )


def protocol_version() -> Any:
    """Return PROTOCOL_VERSION: MAVLink 1 and 2, according to the peer."""
    return mavlink.MAVLink_protocol_version_message(_MAVLINK_2, 100, _MAVLINK_2, [0] * 8, [0] * 8)


class Requests:
    """Messages available on request, and their rates."""

    takes = frozenset({"REQUEST_DATA_STREAM"})

    def __init__(
        self,
        vehicle: VehicleView,
        identity: Identity,
        streams: Streams,
        shown: modes.ShownMode,
        flights: FlightInformation,
        metadata: Mapping[str, bytes],
    ) -> None:
        """Create the service; ``metadata`` has the files of component metadata by path."""
        self._metadata_crc = metadata_files.crc32(metadata[metadata_files.GENERAL])
        self._vehicle = vehicle
        self._flights = flights
        self._shown = shown
        self._identity = identity
        self._streams = streams

    def build(self, message_id: float, argument: float, link: int) -> list[Any] | None:
        """Return the requested messages; None for an unknown one.

        The list is empty if there is no content yet.
        """
        if not math.isfinite(message_id):
            return None
        number = int(message_id)
        if number == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION:
            return [autopilot_version(self._identity)]
        if number == mavlink.MAVLINK_MSG_ID_PROTOCOL_VERSION:
            return [protocol_version()]
        if number == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES:
            index = int(argument) if math.isfinite(argument) else 0
            return modes.available_modes(self._identity, index) or None
        if number == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR:
            return [mavlink.MAVLink_available_modes_monitor_message(0)]  # the modes never change
        if number == mavlink.MAVLINK_MSG_ID_CURRENT_MODE:
            return [modes.current_mode(self._shown.numbers)]
        if number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return [heartbeat(self._vehicle, self._identity, self._shown.numbers)]
        if number == mavlink.MAVLINK_MSG_ID_FLIGHT_INFORMATION:
            return [self._flights.build()]
        if number == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self.interval(link, argument)
        if number == mavlink.MAVLINK_MSG_ID_COMPONENT_INFORMATION_BASIC:
            return [basic_information(self._identity, self._time_ms())]
        if number == mavlink.MAVLINK_MSG_ID_COMPONENT_METADATA:
            return [mavlink.MAVLink_component_metadata_message(self._time_ms(), self._metadata_crc, _METADATA_URI)]
        if number == mavlink.MAVLINK_MSG_ID_COMPONENT_INFORMATION:
            return [
                mavlink.MAVLink_component_information_message(
                    self._time_ms(), self._metadata_crc, _METADATA_URI, 0, b""
                )
            ]
        return self._streams.build(number)

    def _time_ms(self) -> int:
        return self._vehicle.time_us // 1000 & 0xFFFFFFFF

    def interval(self, link: int, message_id: float) -> list[Any] | None:
        """Return MESSAGE_INTERVAL of a message on this link; None for an invalid ID."""
        if not 0 <= message_id <= 0xFFFF:
            return None
        number = int(message_id)
        return [mavlink.MAVLink_message_interval_message(number, self._streams.interval_us(link, number))]

    def set_interval(self, link: int, message_id: float, interval_us: float) -> bool:
        """Process SET_MESSAGE_INTERVAL; False for an unknown message or a NaN interval."""
        if not (math.isfinite(message_id) and math.isfinite(interval_us)):
            return False
        return self._streams.set_interval(link, int(message_id), interval_us)

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process REQUEST_DATA_STREAM, which has no answer."""
        rate = float(message.req_message_rate) if message.start_stop else 0.0
        self._streams.set_group(sender.link, message.req_stream_id, rate)
        return []

    def step(self, now: float) -> list[Output]:
        """Return no periodic messages."""
        return []
