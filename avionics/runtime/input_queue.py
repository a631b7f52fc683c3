"""Inputs from the ground that wait for the next tick: applied soon, or not at all.

Where a sensor frame is late, what waits for it grows old. What is older than `SILENCE` is forgotten, because nobody
expects the wings to move half a minute after the button; only what stops them waits as long as it must.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from avionics.link.vehicle import PATIENT
from avionics.messages import Command, Input

SILENCE = 0.5
"""s; of wall-clock time without a sensor frame, after which nothing that moves is taken any more"""


class QueuedInput(NamedTuple):
    """One input."""

    since: float
    """s; wall-clock time at which it came"""
    entry: Input


class InputQueue:
    """The inputs since the last tick, in the order in which they came."""

    def __init__(self) -> None:
        self._waiting: list[QueuedInput] = []

    def add(self, now: float, entries: Iterable[Input]) -> None:
        """Keep what came at wall-clock time ``now`` (s); what may wait is kept once, however often it is said."""
        for entry in entries:
            if not (is_patient(entry) and any(_same(each.entry, entry) for each in self._waiting)):
                self._waiting.append(QueuedInput(now, entry))

    def take(self) -> list[Input]:
        """All that waits, for a tick."""
        waiting, self._waiting = self._waiting, []
        return [each.entry for each in waiting]

    def drop_stale(self, now: float) -> list[Input]:
        """Forget, and give, what waited for longer than `SILENCE` at ``now`` (s)."""
        old = [now - each.since > SILENCE and not is_patient(each.entry) for each in self._waiting]
        stale = [each.entry for each, is_old in zip(self._waiting, old, strict=True) if is_old]
        self._waiting = [each for each, is_old in zip(self._waiting, old, strict=True) if not is_old]
        return stale


def is_patient(entry: Input) -> bool:
    """Whether it may wait for a tick, however late."""
    return isinstance(entry, Command) and entry.kind in PATIENT


def _same(one: Input, other: Input) -> bool:
    """Whether two commands ask for the same, whoever did."""
    both = isinstance(one, Command) and isinstance(other, Command)
    return both and (one.kind, one.value) == (other.kind, other.value)  # type: ignore[union-attr]
