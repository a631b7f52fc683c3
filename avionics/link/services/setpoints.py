"""Setpoint messages for OFFBOARD and GUIDED, and guided waypoints.

Guided waypoints are MISSION_ITEM with ``current`` 2 and 3.
"""

from __future__ import annotations

import contextlib
from typing import Any

from avionics import topics
from avionics.guidance.setpoint import Path, Setpoint
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import decode_altitude, decode_place, read_message
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.statustext import refusal_text
from avionics.link.setpoint_codec import Origin, decode_setpoint
from avionics.link.vehicle import Identity, VehicleView
from avionics.link.wire_item import ItemRefused
from avionics.messages import Command, CommandKind, Mode

PERIOD_US = 50_000
"""us; minimum flight time between two setpoints: the period of the navigation"""
REPORT_INTERVAL = 10.0
"""s; minimum interval of STATUSTEXTs with the same reason to the same sender"""
MOST_REPORTS = 64
GUIDED_WAYPOINT, GUIDED_ALTITUDE = 2, 3
"""``current`` of a MISSION_ITEM that is not part of an upload (ArduPilot, used by dronekit)"""
_WAYPOINTS = (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LOITER_UNLIM)
_Key = tuple[int, int, int]


class SetpointService:
    """Forwarding of the latest setpoint of all senders, at most once per `PERIOD_US`."""

    takes = frozenset(
        {
            "SET_POSITION_TARGET_GLOBAL_INT",
            "SET_POSITION_TARGET_LOCAL_NED",
            "SET_ATTITUDE_TARGET",
            "MISSION_ITEM",
            "MISSION_ITEM_INT",
        }
    )

    def __init__(self, vehicle: VehicleView, identity: Identity) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._latest: tuple[Any, Sender] | None = None
        self._sent_us = -PERIOD_US
        self._reported: dict[tuple[_Key, str], float] = {}

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Store a setpoint for `step`, or answer a guided waypoint."""
        if message.get_type() not in ("MISSION_ITEM", "MISSION_ITEM_INT"):
            self._latest = (message, sender)
            return []
        return self._guided_item(message, sender) if message.current in (GUIDED_WAYPOINT, GUIDED_ALTITUDE) else []

    def step(self, now: float) -> list[Output]:
        """Return SET_SETPOINT for the flight core, or a STATUSTEXT with the rejection."""
        if self._latest is None or 0 <= self._vehicle.time_us - self._sent_us < PERIOD_US:
            return []
        (message, sender), self._latest = self._latest, None
        self._sent_us = self._vehicle.time_us
        try:
            setpoint = self._decoded(message)
        except ItemRefused as refused:
            return self._report(str(refused), sender, now)
        command = self._command(CommandKind.SET_SETPOINT, sender, payload=setpoint)
        reason = self._vehicle.refusal(command)
        return self._report(reason, sender, now) if reason else [command]

    def entry(self, mode: Mode) -> Setpoint | None:
        """Return the setpoint with which ``mode`` begins.

        It is the one not forwarded yet, or a circle in GUIDED of ArduPlane. MAVSDK sends the first setpoint and the
        change of the mode in one burst.
        """
        if mode is not Mode.OFFBOARD:
            return None
        if self._latest is not None:
            with contextlib.suppress(ItemRefused):
                return self._decoded(self._latest[0])
        return Setpoint(Path.CIRCLE_HERE, expires=0) if self._identity.guided is not None else None

    def _decoded(self, message: Any) -> Setpoint:
        """Decode a setpoint; in GUIDED of ArduPlane a position does not expire.

        OFFBOARD of PX4 requires a stream.
        """
        setpoint = decode_setpoint(message, self._origin())
        streamed = self._identity.guided is None or setpoint.path in (Path.COURSE, Path.ATTITUDE)
        return setpoint._replace(expires=int(streamed))

    def _origin(self) -> Origin:
        position, height = self._vehicle.latest(topics.POSITION), self._vehicle.latest(topics.ALTITUDE)
        north, east = (0.0, 0.0) if position is None else (position.north, position.east)
        return Origin(self._vehicle.home, north, east, 0.0 if height is None else height.altitude)

    def _command(self, kind: CommandKind, sender: Sender, value: float = 0.0, payload: Any = None) -> Command:
        return Command(self._vehicle.time_us, kind, "", value, payload, sender.name)

    def _report(self, reason: str, sender: Sender, now: float) -> list[Output]:
        """Return a STATUSTEXT, once per sender and reason within `REPORT_INTERVAL`."""
        key = ((sender.system, sender.component, sender.link), reason)
        if now - self._reported.get(key, -REPORT_INTERVAL) < REPORT_INTERVAL:
            return []
        if len(self._reported) >= MOST_REPORTS:
            self._reported.clear()
        self._reported[key] = now
        return list(refusal_text(reason, sender))

    def _guided_item(self, message: Any, sender: Sender) -> list[Output]:
        """Process a guided waypoint or altitude; the answer is a MISSION_ACK."""
        try:
            command = self._item_command(message, sender)
        except ItemRefused as refused:
            return [_ack(sender, refused.result), *refusal_text(f"guided waypoint: {refused}", sender)]
        reason = self._vehicle.refusal(command)
        if reason:
            return [_ack(sender, mavlink.MAV_MISSION_DENIED), *refusal_text(reason, sender)]
        return [command, _ack(sender, mavlink.MAV_MISSION_ACCEPTED)]

    def _item_command(self, message: Any, sender: Sender) -> Command:
        item, home = read_message(message), self._vehicle.home
        altitude = decode_altitude(item.frame, item.z, home)
        if message.current == GUIDED_ALTITUDE:
            return self._command(CommandKind.CHANGE_ALTITUDE, sender, altitude)
        if item.command not in _WAYPOINTS:
            raise ItemRefused(mavlink.MAV_MISSION_UNSUPPORTED, "only NAV_WAYPOINT (16) is supported")
        if self._vehicle.mode is not Mode.OFFBOARD:
            name = self._identity.numbers(Mode.OFFBOARD).name
            raise ItemRefused(mavlink.MAV_MISSION_DENIED, f"the mode is not {name}")
        north, east = decode_place(item.frame, item.x, item.y, home)
        setpoint = Setpoint(Path.CIRCLE_AT, north, east, altitude=altitude, expires=0)
        return self._command(CommandKind.SET_SETPOINT, sender, payload=setpoint)


def _ack(sender: Sender, result: int) -> Reply:
    return Reply(mavlink.MAVLink_mission_ack_message(sender.system, sender.component, result, 0), sender)
