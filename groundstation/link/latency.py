"""Round-trip time of a link by TIMESYNC or PING."""

from __future__ import annotations

import statistics
from collections import deque
from typing import Any

from avionics.link.dialect import mavlink

PERIOD = 1.0
"""s; between two requests"""
PENDING = 16
"""number of requests whose response is awaited"""


class Latency:
    """Latency measurement: the median of the last responses to requests once a second."""

    def __init__(self) -> None:
        self._requested_at = float("-inf")
        self._questions: deque[int] = deque(maxlen=PENDING)
        self._trips: deque[tuple[float, float]] = deque(maxlen=7)
        self._number = 0

    def questions(self, now: float) -> tuple[Any, ...]:
        """Return the messages to send at ``now`` (s, monotonic)."""
        if now - self._requested_at < PERIOD:
            return ()
        self._requested_at = now
        self._number += 1
        stamp = round(now * 1e9)
        self._questions.append(stamp)
        sync = mavlink.MAVLink_timesync_message(0, stamp)
        return sync, mavlink.MAVLink_ping_message(stamp // 1000, self._number, 0, 0)

    def handle_message(self, message: Any, now: float) -> None:
        """Process any message; only a response to a request of this station counts."""
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 != 0 and message.ts1 in self._questions:
            self._trips.append((now, now - message.ts1 * 1e-9))
        elif kind == "PING" and message.target_system and self._is_reply(message):
            self._trips.append((now, now - message.time_usec * 1e-6))

    def _is_reply(self, ping: Any) -> bool:
        return any(stamp // 1000 == ping.time_usec for stamp in self._questions)

    def value(self, now: float) -> float | None:
        """Return the round-trip time in s, None without a response within ten seconds."""
        lately = [trip for at, trip in self._trips if now - at <= 10.0]
        return statistics.median(lately) if lately else None
