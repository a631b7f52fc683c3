"""Playout of bursts of messages at an even pace."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from operator import attrgetter

from logs.live.follower import Message

DELAY = 0.4
"""s; wall-clock delay of the shown time behind the newest data: recorders flush every 0.25 s"""


class Playout:
    """Merged messages of several files in order of time, slightly behind the newest.

    The shown time approaches the newest time, faster the larger the delay is. The speed factor of the flight need not
    be specified.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        """ns since 1970; log time that is shown, 0 before the first message"""
        self._waiting: list[Message] = []

    def add(self, messages: Iterable[Message]) -> None:
        """Add new messages; those older than the shown time are returned by the next step."""
        self._waiting += messages
        self._waiting.sort(key=attrgetter("log_ns"))

    def step(self, newest_ns: int, dt: float) -> list[Message]:
        """Return the messages due ``dt`` s of wall-clock time after the last step; ``newest_ns`` is the newest log
        time.
        """
        if self.now_ns:
            self.now_ns += round(max(newest_ns - self.now_ns, 0) * min(dt / DELAY, 1.0))
        else:
            self.now_ns = self._waiting[0].log_ns if self._waiting else newest_ns
        due = bisect_right(self._waiting, self.now_ns, key=attrgetter("log_ns"))
        given, self._waiting = self._waiting[:due], self._waiting[due:]
        return given

    def rest(self) -> list[Message]:
        """Return all pending messages."""
        given, self._waiting = self._waiting, []
        self.now_ns = given[-1].log_ns if given else self.now_ns
        return given
