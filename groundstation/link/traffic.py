"""Link statistics: message rates, bytes per second, loss.

A sender counts its frames from 0 to 255 and over again, so a gap in the count is what was lost of it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

from groundstation.link.frames import Arrival, sequence

KEPT = 600
"""messages of each kind that are remembered"""
WINDOW = 5.0
"""s; over which rates and losses are counted"""
LATE = 128
"""frames; a count that is further ahead than this is one that comes late"""


class Quality(NamedTuple):
    """How good a link is."""

    messages_per_s: float = 0.0
    """1/s; frames heard"""
    bytes_per_s: float = 0.0
    """B/s; of those frames"""
    loss: float | None = None
    """-; 0 to 1, share of the frames sent that were not heard lately; None before anything was heard"""
    lost: int = 0
    """-; frames that were never heard"""
    doubled: int = 0
    """-; frames that were heard again"""
    received: int = 0
    """-; frames"""
    latency: float | None = None
    """s; from our question to the vehicle's answer; None where it answers none"""
    bad_bytes: int = 0
    """-; bytes that belonged to no frame"""


def quality_record(quality: Quality) -> dict[str, Any]:
    """Return the quality as a JSON object; the key ``heard`` has the number of frames received."""
    return {"heard" if name == "received" else name: value for name, value in quality._asdict().items()}


class MessageRow(NamedTuple):
    """One kind of message from one sender, for the inspector."""

    name: str
    """-; as in the dialect, UNKNOWN_123 where none knows it"""
    sender: tuple[int, int]
    """-; system and component"""
    total: int
    """-; since the link was opened"""
    rate: float
    """Hz; lately, 0 when it comes no more"""
    size: int
    """B; of the last frame"""
    age: float
    """s; since the last one"""
    message: Any
    """the last one; None where no dialect knows it"""


class _Sender:
    """The count of one sender's frames."""

    def __init__(self) -> None:
        self.last: int | None = None
        self.received: deque[int] = deque(maxlen=LATE)

    def missing(self, number: int) -> tuple[int, bool]:
        """How many frames are missing before this one, -1 for one missed that comes late; and whether it is new."""
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
    """One kind of message from one sender."""

    def __init__(self) -> None:
        self.count = 0
        self.size = 0
        self.recent: deque[tuple[float, Any]] = deque(maxlen=KEPT)


class Traffic:
    """Counts what goes by; everything that it tells is a value."""

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
        """Take one frame."""
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
        """The link over the last `WINDOW` seconds, or since it was opened."""
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
        """Every kind of message that was heard, by name."""
        rows = [self._row(key, kind, now) for key, kind in self._kinds.items()]
        return sorted(rows, key=lambda row: (row.name, row.sender))

    def _row(self, key: tuple[int, int, int], kind: _Kind, now: float) -> MessageRow:
        last, message = kind.recent[-1]
        rate = rate_of([at for at, _ in kind.recent], now)
        return MessageRow(self._names[key], key[:2], kind.count, rate, kind.size, now - last, message)

    def series(self, name: str, field: str, index: int | None = None) -> list[tuple[float, float]]:
        """What is remembered of a field: (s of the ground's clock, value) of the sender who says most of it."""
        kinds = [kind for key, kind in self._kinds.items() if self._names[key] == name]
        if not kinds:
            return []
        busiest = max(kinds, key=lambda kind: kind.count)
        return list(_numbers(busiest.recent, field, index))

    def latest(self, name: str) -> Any | None:
        """The last message of a kind, None where none was heard."""
        heard = [kind.recent[-1] for key, kind in self._kinds.items() if self._names[key] == name]
        return max(heard, key=lambda pair: pair[0])[1] if heard else None

    def names(self) -> list[str]:
        """Names of all kinds of messages that were heard."""
        return sorted(set(self._names.values()))


def rate_of(times: list[float], now: float) -> float:
    """Hz; of messages at ``times`` (s, oldest first): of the last `WINDOW` seconds, at least of the last two.

    What has been silent for twice its own period and the window comes no more: 0.
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
