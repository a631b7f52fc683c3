"""Detection of a lost ground link: timeout of all connected ground stations."""

from __future__ import annotations

from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Sender
from avionics.link.vehicle import LinkGains, VehicleView
from avionics.messages import Command, CommandKind


class SilenceService:
    """Link-loss detection, reported to the flight core as LINK_LOST and LINK_REGAINED.

    A ground station is a sender of a HEARTBEAT of MAV_TYPE_GCS. Any of its messages resets the timeout; the owner of
    the links reports them by `received`. A short connection (`LinkGains.acquaintance`), as of a single command of
    `wingbeat gcs`, has no timeout, because no flight depends on it. A timeout while disarmed has no effect either;
    arming then requires a connection.
    """

    takes = frozenset({"HEARTBEAT"})

    def __init__(self, vehicle: VehicleView, gains: LinkGains) -> None:
        self._vehicle = vehicle
        self._timeout = gains.silence
        self._acquaintance = gains.acquaintance
        self._stations: dict[tuple[int, int, int], float] = {}
        self._met: dict[tuple[int, int, int], float] = {}
        self._lost = False

    @property
    def stations(self) -> int:
        """Number of ground stations received within the timeout."""
        return len(self._stations)

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Register the sender of a HEARTBEAT of a ground station."""
        if message.type != mavlink.MAV_TYPE_GCS:
            return []
        key = (sender.system, sender.component, sender.link)
        self._met.setdefault(key, now)
        self._stations[key] = now
        if not self._lost:
            return []
        self._lost = False
        return [Command(self._vehicle.time_us, CommandKind.LINK_REGAINED, source=sender.name)]

    def received(self, sender: Sender, now: float) -> None:
        """Reset the timeout of ``sender`` after any message."""
        key = (sender.system, sender.component, sender.link)
        if key in self._stations:
            self._stations[key] = now

    def step(self, now: float) -> list[Output]:
        """Return LINK_LOST after the timeout of the last ground station."""
        silent = [key for key, last in self._stations.items() if now - last > self._timeout]
        known = [key for key in silent if self._stations[key] - self._met[key] >= self._acquaintance]
        for key in silent:
            del self._stations[key], self._met[key]
        lost = self._vehicle.armed and (self._lost or bool(known and not self._stations))
        if lost == self._lost:
            return []
        self._lost = lost
        kind = CommandKind.LINK_LOST if lost else CommandKind.LINK_REGAINED
        return [Command(self._vehicle.time_us, kind, source="link")]
