"""Bandwidth budget of a slow link: a token bucket filled at the rate of the link.

Urgent messages are sent at once and may leave a deficit. All others are sent only if the bucket contains the reserve
of the higher priorities. The order of priority:

1. at once: HEARTBEAT, acknowledgements, STATUSTEXT, missions, requested messages (`URGENT`)
2. lists of parameters (`PARAMETERS`)
3. position and vehicle status: `Rank.FIRST`
4. other instruments: `Rank.SECOND`
5. files and messages of other links (`BULK`)
6. the Wingbeat dialect and details: `Rank.THIRD`
7. duplicates of other messages for other stations: `Rank.LAST`
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

DEPTH = 0.25
"""s; depth of the bucket as a duration of the rate"""
SHALLOWEST = 600.0
"""bytes; minimum depth: two of the longest frames"""
USED = 0.95
"""-; fraction of the rate that is used, because a radio has overhead"""
BITS_PER_BYTE = 10.0
"""-; bits per byte on a serial line, including start and stop bits"""
DEBT = 2.0
"""s; maximum deficit as a duration of the rate, above which acknowledgements are dropped as well"""
PARAMETERS = 0.0
BULK = 0.4
"""-; fraction of the depth to be reserved"""
STALE = 5.0
"""s; age of the last radio status above which the radio does not limit the rate"""
SLOWEST = 0.1
"""-; minimum fraction of the rate under throttling by a radio"""
TELEMETRY_FRAMES = 32
"""-; telemetry frames between two ticks over all links and peers, independent of their number and requests"""
Capacity = Callable[[float], float]
"""bytes that a link accepts now, as a function of the reserved fraction of its depth"""


class Rank(Enum):
    """Fraction of the depth to be reserved when a stream is sent."""

    FIRST = 0.1
    SECOND = 0.25
    THIRD = 0.55
    LAST = 0.7


class Budget:
    """Token bucket of one link; without a rate it is unlimited."""

    def __init__(self, baud: int) -> None:
        """Create the bucket; ``baud`` is 0 for an unlimited link."""
        self._named = USED * baud / BITS_PER_BYTE if baud else math.inf
        self._nominal = self._named
        self._share = 1.0
        self._radio_received = -math.inf
        self._filled_at: float | None = None
        self._sent = 0.0
        self._measured = 0.0
        self._level = self.depth

    @property
    def rate(self) -> float:
        """Present rate (bytes/s)."""
        return self._nominal * self._share

    @property
    def depth(self) -> float:
        """Present depth of the bucket (bytes)."""
        return max(DEPTH * self.rate, SHALLOWEST)

    def advance(self, now: float) -> None:
        """Fill the bucket up to the wall-clock time ``now`` (s)."""
        before, self._filled_at = self._filled_at, now
        if before is None or now <= before:
            return
        elapsed = now - before
        weight = min(elapsed, 1.0)
        self._measured += weight * (self._sent / elapsed - self._measured)
        self._sent = 0.0
        if now - self._radio_received > STALE:
            self._share, self._nominal = 1.0, self._named
        self._level = self.depth if math.isinf(self.rate) else min(self._level + elapsed * self.rate, self.depth)

    def spend(self, size: int) -> None:
        """Account for ``size`` sent bytes."""
        self._sent += size
        self._level -= size

    def available_bytes(self, kept: float) -> float:
        """Return the bytes that may be sent with the fraction ``kept`` in reserve.

        The result is negative if none may be sent.
        """
        return math.inf if math.isinf(self.rate) else self._level - kept * self.depth

    def broke(self) -> bool:
        """Return whether the deficit permits only heartbeats and acknowledgements."""
        return self._level < -DEBT * self.rate

    def note_radio(self, free: int, now: float) -> None:
        """Adapt the rate to the free buffer (percent) of a RADIO_STATUS.

        Below one half the rate decreases, near the end faster; above nine tenths it increases. A link without a
        specified rate starts at the present send rate.
        """
        self._radio_received = now
        if free < 50 and math.isinf(self._nominal):
            self._nominal = max(self._measured, SHALLOWEST)
            self._level = min(self._level, self.depth)
        factor = 0.7 if free < 20 else 0.9 if free < 50 else 1.1 if free > 90 else 1.0
        self._share = min(max(self._share * factor, SLOWEST), 1.0)
