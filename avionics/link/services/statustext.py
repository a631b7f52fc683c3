"""STATUSTEXT: events for people, in chunks of 50 characters.

A STATUSTEXT carries no time: the SYSTEM_TIME before it says when since boot the event was, however far apart the time
stamps of the telemetry are in a simulation that is faster than real time.
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
"""Longer texts are cut: nobody reads more in flight."""
MOST_AT_ONCE = 20
"""Events sent in one step; older ones are in the log."""


def chunks(severity: int, text: str, identifier: int) -> list[Any]:
    """STATUSTEXT messages of one text; ``identifier`` joins the chunks and is 0 for a text of one.

    A text whose length is a whole number of chunks ends with an empty one, because the receiver takes a chunk
    without a terminating zero as not the last.
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
    """Why something was refused, to the one who asked."""
    if not reason:
        return []
    identifier = 1 + sum(reason.encode("utf-8", errors="replace")) % 0xFFFE
    return [Reply(message, sender) for message in chunks(int(Severity.WARNING), reason, identifier)]


class StatustextService:
    """Sends every event of the vehicle to every link."""

    takes: frozenset[str] = frozenset()

    def __init__(self, vehicle: VehicleView, unix_time: Callable[[], float]) -> None:
        """``unix_time`` tells the seconds since 1970."""
        self._vehicle = vehicle
        self._unix_time = unix_time
        self._reported = 0
        self._identifier = 0
        self._local: list[Event] = []

    def send_statustext(self, event: Event) -> None:
        """Send also what is no event of the vehicle."""
        self._local.append(event)

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Takes no message."""
        return []

    def step(self, now: float) -> list[Output]:
        """SYSTEM_TIME and STATUSTEXT of the events that are new."""
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
