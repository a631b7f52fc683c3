"""Comparison of replayed and recorded messages."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.columns import Columns
from logs.layout import layout_of
from logs.reader import Log
from wingbeat.message import Event, Text
from wingbeat.topic import Topic

LAST_BITS = 4
"""-; limit of a rounding difference, in units of the last bit of the field's largest value"""
BLOCK = 2048
"""number of messages compared at a time"""


class FieldDifference(NamedTuple):
    """Difference of one field of a topic."""

    field: str
    unit: str
    differing: int
    """-; number of messages with different values"""
    largest: float
    """in the field's unit; replayed minus recorded value of the largest magnitude, infinite if one is not finite"""
    at: float
    """s; since boot, of the largest difference"""
    rms: float
    """in the field's unit; over all messages compared, without infinite differences"""
    rounding: bool
    """whether no difference exceeds a few last bits of the largest value"""


class TopicDifference(NamedTuple):
    """Difference of one topic."""

    topic: str
    recorded: int
    """-; messages in the replayed part of the flight"""
    replayed: int
    """-; messages"""
    differing: int
    """-; messages that are not bit-identical"""
    first: float | None
    """s; since boot, of the first such message; None without one"""
    fields: tuple[FieldDifference, ...]
    """fields that differ"""

    @property
    def same(self) -> bool:
        """Whether all messages are bit-identical, and none is missing or additional."""
        return not self.differing and self.recorded == self.replayed


class _Field:
    """Sums of one field's differences."""

    def __init__(self) -> None:
        self.differing = 0
        self.largest = self.at = self.squares = 0.0
        self.finite = 0
        self.last_bit = 0.0

    def take(
        self, replayed: NDArray[Any], was: NDArray[Any], times: NDArray[Any], differing: NDArray[np.bool_]
    ) -> None:
        change = replayed.astype(np.float64) - was.astype(np.float64)
        both_missing = np.isnan(replayed.astype(np.float64)) & np.isnan(was.astype(np.float64))
        change = np.where(both_missing, 0.0, np.where(np.isfinite(change), change, np.inf))
        if change.ndim > 1:
            change = np.abs(change).max(axis=1)
        finite = change[np.isfinite(change)]
        self.squares += float(finite @ finite)
        self.finite += len(finite)
        self.differing += int(differing.sum())
        sizes = np.abs(was[np.isfinite(was)]).astype(np.float64)
        step = float(np.finfo(was.dtype).eps) if was.dtype.kind == "f" else 0.0
        self.last_bit = max(self.last_bit, step * float(sizes.max(initial=0.0)))
        place = int(np.argmax(np.abs(change)))
        if abs(change[place]) > abs(self.largest):
            self.largest, self.at = float(change[place]), float(times[place])

    def result(self, name: str, unit: str) -> FieldDifference:
        rms = float(np.sqrt(self.squares / self.finite)) if self.finite else 0.0
        rounding = abs(self.largest) <= LAST_BITS * self.last_bit
        return FieldDifference(name, unit, self.differing, self.largest, self.at, rms, rounding)


class TopicComparison:
    """Comparison of the messages of one topic of fixed layout, in sequence."""

    def __init__(self, topic: Topic[Any], columns: Columns, start: float, end: float) -> None:
        """Compare from the first message after ``start`` (s) to the last one not after ``end``."""
        self._topic, self._columns = topic, columns
        low, high = np.searchsorted(columns.time, (start, end), side="right")
        self._first, self._next, self._end = int(low), int(low), int(high)
        self._waiting: list[Any] = []
        self._replayed = self._differing = 0
        self._at: float | None = None
        layout = layout_of(topic.message)  # type: ignore[arg-type]
        self._fields = {field.name: _Field() for field in layout.fields if field.name in columns}
        self._units = {field.name: field.unit for field in layout.fields}

    def take(self, message: Any) -> None:
        """Compare one message of the replay."""
        self._replayed += 1
        self._waiting.append(message)
        if len(self._waiting) >= BLOCK:
            self._compare()

    def result(self) -> TopicDifference:
        """Return the result."""
        self._compare()
        fields = tuple(
            found.result(name, self._units[name]) for name, found in self._fields.items() if found.differing
        )
        return TopicDifference(
            self._topic.name, self._end - self._first, self._replayed, self._differing, self._at, fields
        )

    def _compare(self) -> None:
        count = min(len(self._waiting), self._end - self._next)
        block, self._waiting = self._waiting[:count], []
        if not count:
            return
        rows = slice(self._next, self._next + count)
        self._next += count
        times = self._columns.time[rows]
        any_differs = np.zeros(count, bool)
        names = self._topic.message._fields
        for name, found in self._fields.items():
            place = names.index(name)
            was = self._columns[name][rows]
            replayed = np.array([message[place] for message in block], was.dtype)
            differs = ~((replayed == was) | ((replayed != replayed) & (was != was)))
            if differs.ndim > 1:
                differs = differs.any(axis=1)
            if differs.any():
                found.take(replayed, was, times, differs)
                any_differs |= differs
            else:
                found.finite += count
        if any_differs.any():
            self._differing += int(any_differs.sum())
            if self._at is None:
                self._at = float(times[np.argmax(any_differs)])


class TextComparison:
    """Comparison of events or documents, which have no fields of fixed width."""

    def __init__(self, topic: Topic[Any], recorded: list[Any], start: float, end: float) -> None:
        """Initialize as `TopicComparison`, for messages with a ``time_us``."""
        self._topic = topic
        self._recorded = [message for message in recorded if start < message.time_us * 1e-6 <= end]
        self._replayed = self._differing = 0
        self._at: float | None = None

    def take(self, message: Any) -> None:
        """Compare one message of the replay."""
        place, self._replayed = self._replayed, self._replayed + 1
        if place < len(self._recorded) and self._recorded[place] != message:
            self._differing += 1
            self._at = message.time_us * 1e-6 if self._at is None else self._at

    def result(self) -> TopicDifference:
        """Return the result."""
        return TopicDifference(self._topic.name, len(self._recorded), self._replayed, self._differing, self._at, ())


def comparison(log: Log, topic: Topic[Any], start: float, end: float) -> TopicComparison | TextComparison:
    """Build the comparison of a topic of ``log`` with a replay, after ``start`` to ``end`` (s since boot).

    Raises:
        InputError: a part of the file is damaged.
    """
    if topic.message is Event:
        return TextComparison(topic, log.events(topic), start, end)
    if topic.message is Text:
        return TextComparison(topic, log.texts(topic), start, end)
    return TopicComparison(topic, log.columns(topic), start, end)
