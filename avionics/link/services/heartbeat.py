"""HEARTBEAT: once a second, at once when mode or arming change, and to a newcomer as it says hello."""

from __future__ import annotations

from typing import Any

from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import Identity, LinkGains, VehicleView
from avionics.messages import Failsafe, Mode

_CUSTOM_MODE_ENABLED = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
MOST_GREETED = 100
"""Newcomers remembered before all are forgotten, so that forged senders fill no memory."""
_SAFETY_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def heartbeat(vehicle: VehicleView, identity: Identity) -> Any:
    """HEARTBEAT of the vehicle as it is now."""
    numbers = identity.numbers(vehicle.mode)
    base_mode = numbers.base_mode | _CUSTOM_MODE_ENABLED | (_SAFETY_ARMED if vehicle.armed else 0)
    return mavlink.MAVLink_heartbeat_message(
        identity.type, identity.autopilot, base_mode, numbers.custom_mode, system_status(vehicle), 3
    )


def system_status(vehicle: VehicleView) -> int:
    """MAV_STATE: critical while a failsafe is active, otherwise active or standby."""
    health = vehicle.latest(topics.HEALTH)
    if health is not None and health.failsafe & ~Failsafe.LINK_LOST:
        return int(mavlink.MAV_STATE_CRITICAL)
    return int(mavlink.MAV_STATE_ACTIVE if vehicle.armed else mavlink.MAV_STATE_STANDBY)


class HeartbeatService:
    """Sends HEARTBEAT."""

    handles = frozenset({"HEARTBEAT"})

    def __init__(self, vehicle: VehicleView, identity: Identity, gains: LinkGains) -> None:
        self._vehicle = vehicle
        self._identity = identity
        self._interval = gains.heartbeat
        self._due = -float("inf")
        self._said: tuple[Mode, bool] | None = None
        self._greeted: set[Sender] = set()

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """HEARTBEAT to whoever says one for the first time."""
        if sender in self._greeted:
            return []
        if len(self._greeted) >= MOST_GREETED:
            self._greeted.clear()
        self._greeted.add(sender)
        return [Reply(heartbeat(self._vehicle, self._identity), sender)]

    def step(self, now: float) -> list[Output]:
        """HEARTBEAT when it is due."""
        state = (self._vehicle.mode, self._vehicle.armed)
        if now < self._due and state == self._said:
            return []
        self._due = now + self._interval
        self._said = state
        return [Reply(heartbeat(self._vehicle, self._identity))]
