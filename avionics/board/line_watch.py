"""Says what becomes of a serial board, once each time: gone, back, silent, began anew, losing messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from wingbeat.message import Severity
from wingbeat.text import pluralize

SILENCE = 1.0
"""s; without a frame before it is said"""
REPORT = 10.0
"""s; between two reports of losses, while there are any"""


class Losses(NamedTuple):
    """What a line lost since the start."""

    lost: int
    """-; messages or frames that never came whole"""
    late: int
    """-; frames that came late"""
    bad_bytes: int
    """-; that were no part of a frame"""
    dropped: int
    """-; writes that the device did not take"""


class LineWatch:
    """Remembers what has been said."""

    def __init__(self, name: str, publish: Callable[[Severity, str], None], unit: str = "message") -> None:
        """``name`` is whom the words are about, ``unit`` what is lost one by one."""
        self._unit = unit
        self._name = name
        self._publish = publish
        self._plugged = True
        self._silent = False
        self._reported = Losses(0, 0, 0, 0)
        self._report_at = 0.0

    def waiting(self, plugged: bool, silence: float) -> None:
        """No frame for ``silence`` s."""
        if self._plugged and not plugged:
            self._publish(Severity.ERROR, f"{self._name} disconnected: check the cable")
        elif plugged and not self._plugged:
            self._publish(Severity.NOTICE, f"{self._name} reconnected")
        elif plugged and silence >= SILENCE and not self._silent:
            self._silent = True
            self._publish(Severity.ERROR, f"{self._name}: no sensor frame for {silence:.0f} s")
        self._plugged = plugged

    def received(self, after: float) -> None:
        """A frame came ``after`` s without one."""
        if self._silent:
            self._silent = False
            self._publish(Severity.NOTICE, f"{self._name}: sensor frames resumed after {after:.1f} s")

    def restarted(self) -> None:
        """The board restarted."""
        self._publish(Severity.WARNING, f"{self._name} restarted")

    def report(self, now: float, losses: Losses) -> None:
        """Say what was lost since the last report, at most every `REPORT` seconds."""
        if losses == self._reported or now < self._report_at:
            return
        lost, late, bad, dropped = (after - before for after, before in zip(losses, self._reported, strict=True))
        parts = (
            (lost, "message", "lost"),
            (late, "frame", "late"),
            (bad, "byte", "rejected"),
            (dropped, "write", "failed"),
        )
        told = ", ".join(f"{pluralize(number, what)} {how}" for number, what, how in parts if number)
        self._publish(Severity.WARNING, f"{self._name}: {told}")
        self._reported, self._report_at = losses, now + REPORT
