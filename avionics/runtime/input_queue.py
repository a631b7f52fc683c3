"""Queue of ground inputs for the next tick, with a timeout.

If a sensor frame is late, inputs older than `SILENCE` are discarded, because a delayed motion of the wings is not
expected by the operator. Commands that stop the wings have no timeout.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from avionics.link.vehicle import PATIENT
from avionics.messages import Command, Input

SILENCE = 0.5
"""s; wall-clock time without a sensor frame after which inputs that cause motion are rejected"""


class QueuedInput(NamedTuple):
    """Queued input."""

    since: float
    """s; wall-clock time of its reception"""
    entry: Input


class InputQueue:
    """Inputs since the last tick in order of arrival."""

    def __init__(self) -> None:
        self._waiting: list[QueuedInput] = []

    def add(self, now: float, entries: Iterable[Input]) -> None:
        """Add the inputs received at wall-clock time ``now`` (s).

        A repeated command without a timeout is stored once.
        """
        for entry in entries:
            if not (is_patient(entry) and any(_same(each.entry, entry) for each in self._waiting)):
                self._waiting.append(QueuedInput(now, entry))

    def take(self) -> list[Input]:
        """Return and remove all inputs for a tick."""
        waiting, self._waiting = self._waiting, []
        return [each.entry for each in waiting]

    def drop_stale(self, now: float) -> list[Input]:
        """Remove and return the inputs older than `SILENCE` at ``now`` (s)."""
        if not self._waiting:
            return []
        old = [now - each.since > SILENCE and not is_patient(each.entry) for each in self._waiting]
        stale = [each.entry for each, is_old in zip(self._waiting, old, strict=True) if is_old]
        self._waiting = [each for each, is_old in zip(self._waiting, old, strict=True) if not is_old]
        return stale


def is_patient(entry: Input) -> bool:
    """Return whether an input has no timeout."""
    return isinstance(entry, Command) and entry.kind in PATIENT


def _same(one: Input, other: Input) -> bool:
    """Return whether two commands are equal except for their source."""
    both = isinstance(one, Command) and isinstance(other, Command)
    return both and (one.kind, one.value) == (other.kind, other.value)  # type: ignore[union-attr]
