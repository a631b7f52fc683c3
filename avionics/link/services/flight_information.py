"""FLIGHT_INFORMATION: times of arming, takeoff and landing, and the flight number."""

from __future__ import annotations

from typing import Any

from avionics.link import telemetry
from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.vehicle import VehicleView

_AIRBORNE = (mavlink.MAV_LANDED_STATE_TAKEOFF, mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_LANDING)


INTERVAL = 5.0
"""s; interval of the message"""


class FlightInformation:
    """Times of the last flight."""

    takes: frozenset[str] = frozenset()

    def __init__(self, vehicle: VehicleView) -> None:
        self._vehicle = vehicle
        self._armed = self._airborne = False
        self._armed_us = self._takeoff_us = self._landing_ms = 0
        self._flight = 0
        self._due = -float("inf")

    def build(self) -> Any:
        """Return the message.

        Times are 0 before the first arming; the time of the landing is 0 in flight.
        """
        return mavlink.MAVLink_flight_information_message(
            telemetry.boot_ms(self._vehicle.time_us), self._armed_us, self._takeoff_us, self._flight, self._landing_ms
        )

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Ignore the message."""
        return []

    def step(self, now: float) -> list[Output]:
        """Update the times since boot, and send the message every `INTERVAL`.

        MAVSDK requires periodic messages.
        """
        armed, airborne = self._vehicle.armed, telemetry.landed_state(self._vehicle) in _AIRBORNE
        if armed and not self._armed:
            self._armed_us, self._flight = self._vehicle.time_us, self._flight + 1
            self._takeoff_us = self._landing_ms = 0
        if airborne and not self._airborne:
            self._takeoff_us, self._landing_ms = self._vehicle.time_us, 0
        if self._airborne and not airborne:
            self._landing_ms = telemetry.boot_ms(self._vehicle.time_us)
        self._armed, self._airborne = armed, airborne
        if now < self._due:
            return []
        self._due = now + INTERVAL
        return [Reply(self.build())]
