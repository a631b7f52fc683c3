"""STATUSTEXT service: events in chunks of 50 characters.

A STATUSTEXT has no time. The preceding SYSTEM_TIME gives the time of the event since boot, independent of the
interval of telemetry timestamps in a simulation faster than real time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.telemetry import boot_ms
from avionics.link.vehicle import VehicleView
from wingbeat.message import Event, Severity

CHUNK = 50
LONGEST = 4 * CHUNK
"""characters; limit of a text"""
MOST_AT_ONCE = 20
"""events sent in one step; older ones are in the log"""


def chunks(severity: int, text: str, identifier: int) -> list[Any]:
    """Return the STATUSTEXT messages of one text.

    ``identifier`` joins the chunks and is 0 for a single one. A text that fills its last chunk is followed by an
    empty one, because the receiver does not take a chunk without a terminating zero as the last.
    """
    data = text.encode("utf-8", errors="replace")[:LONGEST]
    if len(data) <= CHUNK:
        return [mavlink.MAVLink_statustext_message(severity, data, 0, 0)]
    parts = [data[start : start + CHUNK] for start in range(0, len(data), CHUNK)]
    if len(parts[-1]) == CHUNK:
        parts.append(b"")
    return [
        mavlink.MAVLink_statustext_message(severity, part, identifier, number) for number, part in enumerate(parts)
    ]


def refusal_text(reason: str, sender: Sender) -> list[Reply]:
    """Return the reason of a denial for the sender of the request."""
    if not reason:
        return []
    identifier = 1 + sum(reason.encode("utf-8", errors="replace")) % 0xFFFE
    return [Reply(message, sender) for message in chunks(int(Severity.WARNING), reason, identifier)]


class StatustextService:
    """Forwarding of every event of the vehicle to every link."""

    takes: frozenset[str] = frozenset()

    def __init__(self, vehicle: VehicleView, unix_time: Callable[[], float]) -> None:
        """Create the service; ``unix_time`` returns the seconds since 1970."""
        self._vehicle = vehicle
        self._unix_time = unix_time
        self._reported = 0
        self._identifier = 0
        self._local: list[Event] = []

    def send_statustext(self, event: Event) -> None:
        """Queue an event of another source."""
        self._local.append(event)

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Ignore the message."""
        return []

    def step(self, now: float) -> list[Output]:
        """Return SYSTEM_TIME and STATUSTEXT of new events."""
        events = self._vehicle.events(self._reported)
        if not events and not self._local:
            return []
        self._reported += len(events)
        latest = [*events, *self._local][-MOST_AT_ONCE:]
        self._local = []
        return [Reply(message) for event in latest for message in (self._time(event), *self._chunks(event))]

    def _time(self, event: Event) -> Any:
        return mavlink.MAVLink_system_time_message(int(self._unix_time() * 1e6), boot_ms(event.time_us))

    def _chunks(self, event: Event) -> list[Any]:
        self._identifier = self._identifier % 0xFFFE + 1
        return chunks(int(event.severity), event.text, self._identifier)
