"""HEARTBEAT service.

It sends once a second, at changes of mode or arming, and at the first message of a new station.
"""

from __future__ import annotations

from typing import Any

from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.services.modes import ShownMode
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import Identity, LinkGains, ModeNumbers, VehicleView
from avionics.messages import Failsafe

_CUSTOM_MODE_ENABLED = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
MOST_GREETED = 100
"""new stations stored before all are discarded, to limit the memory for forged senders"""
_SAFETY_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def heartbeat(vehicle: VehicleView, identity: Identity, numbers: ModeNumbers) -> Any:
    """Return the present HEARTBEAT with the given mode ``numbers``."""
    base_mode = numbers.base_mode | _CUSTOM_MODE_ENABLED | (_SAFETY_ARMED if vehicle.armed else 0)
    return mavlink.MAVLink_heartbeat_message(
        identity.type, identity.autopilot, base_mode, numbers.custom_mode, system_status(vehicle), 3
    )


def system_status(vehicle: VehicleView) -> int:
    """Return MAV_STATE: critical while a failsafe is active, else active or standby."""
    health = vehicle.latest(topics.HEALTH)
    if health is not None and health.failsafe & ~Failsafe.LINK_LOST:
        return int(mavlink.MAV_STATE_CRITICAL)
    return int(mavlink.MAV_STATE_ACTIVE if vehicle.armed else mavlink.MAV_STATE_STANDBY)


class HeartbeatService:
    """HEARTBEAT service."""

    takes = frozenset({"HEARTBEAT"})

    def __init__(self, vehicle: VehicleView, identity: Identity, gains: LinkGains, shown: ShownMode) -> None:
        self._vehicle = vehicle
        self._shown = shown
        self._identity = identity
        self._interval = gains.heartbeat
        self._due = -float("inf")
        self._sent: tuple[ModeNumbers, bool] | None = None
        self._greeted: set[Sender] = set()

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Answer the first HEARTBEAT of a station."""
        if sender in self._greeted:
            return []
        if len(self._greeted) >= MOST_GREETED:
            self._greeted.clear()
        self._greeted.add(sender)
        return [Reply(self._heartbeat(), sender)]

    def step(self, now: float) -> list[Output]:
        """Send HEARTBEAT when it is due."""
        state = (self._shown.numbers, self._vehicle.armed)
        if now < self._due and state == self._sent:
            return []
        self._due = now + self._interval
        self._sent = state
        return [Reply(self._heartbeat())]

    def _heartbeat(self) -> Any:
        return heartbeat(self._vehicle, self._identity, self._shown.numbers)
