"""Link statistics: message rates, bytes per second, loss.

A sender counts its frames from 0 to 255 and over again, so a gap in the count is what was lost of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

from groundstation.link.frames import Arrival, sequence

KEPT = 600
"""number of stored messages of each type"""
WINDOW = 5.0
"""s; averaging window of rates and losses"""
LATE = 128
"""frames; a counter further ahead than this belongs to a late frame"""


class Quality(NamedTuple):
    """Quality of a link."""

    messages_per_s: float = 0.0
    """1/s; received frames"""
    bytes_per_s: float = 0.0
    """B/s; of those frames"""
    loss: float | None = None
    """-; 0 to 1, recent fraction of lost frames; None before the first frame"""
    lost: int = 0
    """-; number of lost frames"""
    doubled: int = 0
    """-; number of duplicate frames"""
    received: int = 0
    """-; frames"""
    latency: float | None = None
    """s; round-trip time; None without a response"""
    bad_bytes: int = 0
    """-; bytes outside of frames"""


def quality_record(quality: Quality) -> dict[str, Any]:
    """Return the quality as a JSON object; the key ``heard`` has the number of received frames."""
    return {"heard" if name == "received" else name: value for name, value in quality._asdict().items()}


class MessageRow(NamedTuple):
    """Statistics of one message type from one sender, for the inspector."""

    name: str
    """-; as in the dialect, UNKNOWN_123 if none defines it"""
    sender: tuple[int, int]
    """-; system and component"""
    total: int
    """-; since the link was opened"""
    rate: float
    """Hz; recent rate, 0 if the message has stopped"""
    size: int
    """B; of the last frame"""
    age: float
    """s; since the last one"""
    message: Any
    """the last one; None if no dialect defines it"""


class _Sender:
    """Frame counter of one sender."""

    def __init__(self) -> None:
        self.last: int | None = None
        self.received: deque[int] = deque(maxlen=LATE)

    def missing(self, number: int) -> tuple[int, bool]:
        """Return the number of frames missing before this one (-1 for a late one), and whether it is new."""
        before, self.last = self.last, number if self.last is None else self.last
        if before is None:
            self.received.append(number)
            return 0, True
        ahead = (number - before) % 256
        if ahead == 0 or (ahead >= LATE and number in self.received):
            return 0, False
        self.received.append(number)
        if ahead >= LATE:
            return -1, True
        self.last = number
        return ahead - 1, True


class _Kind:
    """Statistics of one message type from one sender."""

    def __init__(self) -> None:
        self.count = 0
        self.size = 0
        self.recent: deque[tuple[float, Any]] = deque(maxlen=KEPT)


class Traffic:
    """Traffic statistics of a link; all results are values."""

    def __init__(self) -> None:
        self._senders: dict[tuple[int, int], _Sender] = {}
        self._kinds: dict[tuple[int, int, int], _Kind] = {}
        self._names: dict[tuple[int, int, int], str] = {}
        self._lately: deque[tuple[float, int, int]] = deque()
        self._started: float | None = None
        self._lost = 0
        self._doubled = 0
        self._counts = 0

    def handle_frame(self, arrival: Arrival) -> None:
        """Count one frame."""
        frame, now = arrival.frame, arrival.at
        self._started = now if self._started is None else self._started
        missing, new = self._senders.setdefault((frame.system, frame.component), _Sender()).missing(sequence(frame))
        self._counts += 1
        self._lost = max(self._lost + missing, 0)
        self._doubled += not new
        self._lately.append((now, len(frame.raw), missing if new else 0))
        key = (frame.system, frame.component, frame.message_id)
        kind = self._kinds.get(key)
        if kind is None:
            kind = self._kinds[key] = _Kind()
            message = arrival.message
            self._names[key] = f"UNKNOWN_{frame.message_id}" if message is None else message.get_type()
        kind.count += 1
        kind.size = len(frame.raw)
        kind.recent.append((now, arrival.message))

    def quality(self, now: float) -> Quality:
        """Return the link quality over the last `WINDOW` seconds, or since the link was opened."""
        if self._started is None:
            return Quality()
        while self._lately and now - self._lately[0][0] > WINDOW:
            self._lately.popleft()
        span = min(max(now - self._started, 0.5), WINDOW)
        count = len(self._lately)
        lost = max(sum(missing for _, _, missing in self._lately), 0)
        return Quality(
            messages_per_s=count / span,
            bytes_per_s=sum(size for _, size, _ in self._lately) / span,
            loss=lost / (lost + count) if lost + count else None,
            lost=self._lost,
            doubled=self._doubled,
            received=self._counts,
        )

    def rows(self, now: float) -> list[MessageRow]:
        """Return every received message type, by name."""
        rows = [self._row(key, kind, now) for key, kind in self._kinds.items()]
        return sorted(rows, key=lambda row: (row.name, row.sender))

    def _row(self, key: tuple[int, int, int], kind: _Kind, now: float) -> MessageRow:
        last, message = kind.recent[-1]
        rate = rate_of([at for at, _ in kind.recent], now)
        return MessageRow(self._names[key], key[:2], kind.count, rate, kind.size, now - last, message)

    def series(self, name: str, field: str, index: int | None = None) -> list[tuple[float, float]]:
        """Return the stored samples (s of the ground clock, value) of a field from its most frequent sender."""
        kinds = [kind for key, kind in self._kinds.items() if self._names[key] == name]
        if not kinds:
            return []
        busiest = max(kinds, key=lambda kind: kind.count)
        return list(_numbers(busiest.recent, field, index))

    def latest(self, name: str) -> Any | None:
        """Return the last message of a type, None without one."""
        heard = [kind.recent[-1] for key, kind in self._kinds.items() if self._names[key] == name]
        return max(heard, key=lambda pair: pair[0])[1] if heard else None

    def names(self) -> list[str]:
        """Return the names of all received message types."""
        return sorted(set(self._names.values()))


def rate_of(times: list[float], now: float) -> float:
    """Return the rate in Hz of messages at ``times`` (s, oldest first) over the last `WINDOW` seconds.

    The window is at least two seconds. A message without a sample for twice its period and the window has stopped: 0.
    """
    if len(times) < 2:
        return 0.0
    lately = [at for at in times if now - at <= WINDOW]
    used = lately if len(lately) > 2 else times[-2:]
    period = (used[-1] - used[0]) / (len(used) - 1)
    if now - times[-1] > max(2.0 * period, WINDOW):
        return 0.0
    return 1.0 / period if period > 0.0 else 0.0


def _numbers(recent: Iterable[tuple[float, Any]], field: str, index: int | None) -> Iterable[tuple[float, float]]:
    for at, message in recent:
        value = getattr(message, field, None)
        if index is not None:
            value = value[index] if isinstance(value, list | tuple) and index < len(value) else None
        if isinstance(value, int | float):
            yield at, float(value)
