"""TIMESYNC and PING: immediate answer with the time of the vehicle."""

from __future__ import annotations

from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import VehicleView


class TimesyncService:
    """Service for TIMESYNC and PING."""

    takes = frozenset({"TIMESYNC", "PING"})

    def __init__(self, vehicle: VehicleView) -> None:
        self._vehicle = vehicle

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Return the answer, unless the message itself is one."""
        if message.get_type() == "PING":
            if message.target_system or message.target_component:
                return []
            answer = mavlink.MAVLink_ping_message(message.time_usec, message.seq, sender.system, sender.component)
            return [Reply(answer, sender)]
        if message.tc1 != 0:
            return []
        return [Reply(mavlink.MAVLink_timesync_message(self._vehicle.time_us * 1000, message.ts1), sender)]

    def step(self, now: float) -> list[Output]:
        """Return no periodic messages."""
        return []
