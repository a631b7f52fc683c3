"""Playout of bursts of messages at an even pace."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from operator import attrgetter

from logs.live.follower import Message

DELAY = 0.4
"""s; of wall-clock time that is shown behind what is known: recorders flush every 0.25 s"""


class Playout:
    """Messages of several files, given out in the order of their times a little behind the newest.

    The time that is shown runs towards the newest, faster the farther it is behind: no one need know at how many
    times real time the flight goes.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        """ns since 1970; log time that is shown, 0 before anything is known"""
        self._waiting: list[Message] = []

    def add(self, messages: Iterable[Message]) -> None:
        """Take what is new; what is older than the time that is shown is given out next."""
        self._waiting += messages
        self._waiting.sort(key=attrgetter("log_ns"))

    def step(self, newest_ns: int, dt: float) -> list[Message]:
        """What is due ``dt`` s of wall-clock time after the last step, while ``newest_ns`` is the newest log time."""
        if self.now_ns:
            self.now_ns += round(max(newest_ns - self.now_ns, 0) * min(dt / DELAY, 1.0))
        else:
            self.now_ns = self._waiting[0].log_ns if self._waiting else newest_ns
        due = bisect_right(self._waiting, self.now_ns, key=attrgetter("log_ns"))
        given, self._waiting = self._waiting[:due], self._waiting[due:]
        return given

    def rest(self) -> list[Message]:
        """All that still waits."""
        given, self._waiting = self._waiting, []
        self.now_ns = given[-1].log_ns if given else self.now_ns
        return given
