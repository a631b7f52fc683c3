"""What a slow link still carries: a bucket of bytes that fills at the link's rate.

What must not wait is sent at once, and may leave a debt; everything else asks first whether the bucket holds what is
kept for those before it. The order, first served first:

1. at once: HEARTBEAT, acknowledgements, STATUSTEXT, missions, what was asked for (`URGENT`)
2. lists of parameters (`PARAMETERS`)
3. where it is and how it is: `Rank.FIRST`
4. the other instruments: `Rank.SECOND`
5. files, and what other links send (`BULK`)
6. our own dialect and the details: `Rank.THIRD`
7. what repeats for others what is sent anyway: `Rank.LAST`
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

DEPTH = 0.25
"""s; of the rate that may be sent at once"""
SHALLOWEST = 600.0
"""bytes; two of the longest frames"""
USED = 0.95
"""share of the rate that is used: a radio has words of its own"""
BITS_PER_BYTE = 10.0
"""on a serial line, with start and stop"""
DEBT = 2.0
"""s; of the rate that may be owed before even an answer is dropped"""
PARAMETERS = 0.0
BULK = 0.4
"""share of the depth that must be left"""
STALE = 5.0
"""s; a radio that was not heard for so long throttles no more"""
SLOWEST = 0.1
"""share of the rate that no radio can take from us"""
TELEMETRY_FRAMES = 32
"""-; telemetry frames between two ticks over all links and peers, however many there are and whatever they ask for"""
Capacity = Callable[[float], float]
"""bytes that a link accepts now, as a function of the fraction of its depth that must be left"""


class Rank(Enum):
    """How much of the depth must be left for a stream to be sent."""

    FIRST = 0.1
    SECOND = 0.25
    THIRD = 0.55
    LAST = 0.7


class Budget:
    """The bucket of one link; without a rate it never empties."""

    def __init__(self, baud: int) -> None:
        """``baud`` is 0 where nothing limits the link."""
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
        """Bytes/s that may be sent now."""
        return self._nominal * self._share

    @property
    def depth(self) -> float:
        """Bytes that may be sent at once."""
        return max(DEPTH * self.rate, SHALLOWEST)

    def advance(self, now: float) -> None:
        """Fill up to the wall-clock time ``now`` in s."""
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
        """``size`` bytes were sent."""
        self._sent += size
        self._level -= size

    def available_bytes(self, kept: float) -> float:
        """Bytes that may be sent while the share ``kept`` of the depth is left; negative for none."""
        return math.inf if math.isinf(self.rate) else self._level - kept * self.depth

    def broke(self) -> bool:
        """Whether so much is owed that only heartbeats and acknowledgements are sent."""
        return self._level < -DEBT * self.rate

    def note_radio(self, free: int, now: float) -> None:
        """A RADIO_STATUS says how many percent of the radio's buffer are free.

        Below half the rate goes down, near the end faster, and above nine tenths up again; a link whose rate nobody
        named begins at what is sent now.
        """
        self._radio_received = now
        if free < 50 and math.isinf(self._nominal):
            self._nominal = max(self._measured, SHALLOWEST)
            self._level = min(self._level, self.depth)
        factor = 0.7 if free < 20 else 0.9 if free < 50 else 1.1 if free > 90 else 1.0
        self._share = min(max(self._share * factor, SLOWEST), 1.0)
