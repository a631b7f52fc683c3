"""The loss of the ground link: a ground station was heard, and now none is."""

from __future__ import annotations

from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Sender
from avionics.link.vehicle import LinkGains, VehicleView
from avionics.messages import Command, CommandKind


class SilenceService:
    """Tells the flight core when the last ground station has fallen silent, and when one speaks again.

    A ground station is who sent a HEARTBEAT of MAV_TYPE_GCS; any message of it counts as a word, which the
    owner of the links reports with `received`. One that was heard for a moment only (`LinkGains.acquaintance`), as a
    single command of `wingbeat gcs` is, may fall silent: nobody flies by it. Nor is one missed that leaves a vehicle
    that is not armed; whoever arms it then is there.
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
        """Ground stations that were heard within the time allowed."""
        return len(self._stations)

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """A HEARTBEAT makes its sender a ground station when it says so."""
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
        """Any message came from ``sender``."""
        key = (sender.system, sender.component, sender.link)
        if key in self._stations:
            self._stations[key] = now

    def step(self, now: float) -> list[Output]:
        """LINK_LOST once the last ground station has been silent for too long."""
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
