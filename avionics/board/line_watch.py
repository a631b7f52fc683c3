"""Reports about a serial board: connection, silence, restarts, losses."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from wingbeat.message import Severity
from wingbeat.text import pluralize

SILENCE = 1.0
"""s; time without a frame before a report"""
REPORT = 10.0
"""s; minimum interval of loss reports"""


class Losses(NamedTuple):
    """Losses of a line since the start."""

    lost: int
    """-; messages or frames that were lost or incomplete"""
    late: int
    """-; late frames"""
    bad_bytes: int
    """-; bytes outside frames"""
    dropped: int
    """-; writes that the device rejected"""


class LineWatch:
    """Reports of line states, each once."""

    def __init__(self, name: str, publish: Callable[[Severity, str], None], unit: str = "message") -> None:
        """Create the watch.

        ``name`` is the subject of the reports, ``unit`` the name of a lost element.
        """
        self._unit = unit
        self._name = name
        self._publish = publish
        self._plugged = True
        self._silent = False
        self._reported = Losses(0, 0, 0, 0)
        self._report_at = 0.0

    def waiting(self, plugged: bool, silence: float) -> None:
        """Report a line without a frame for ``silence`` (s)."""
        if self._plugged and not plugged:
            self._publish(Severity.ERROR, f"{self._name} disconnected: check the cable")
        elif plugged and not self._plugged:
            self._publish(Severity.NOTICE, f"{self._name} reconnected")
        elif plugged and silence >= SILENCE and not self._silent:
            self._silent = True
            self._publish(Severity.ERROR, f"{self._name}: no sensor frame for {silence:.0f} s")
        self._plugged = plugged

    def received(self, after: float) -> None:
        """Report a frame after ``after`` (s) without one."""
        if self._silent:
            self._silent = False
            self._publish(Severity.NOTICE, f"{self._name}: sensor frames resumed after {after:.1f} s")

    def restarted(self) -> None:
        """Report a restart of the board."""
        self._publish(Severity.WARNING, f"{self._name} restarted")

    def report(self, now: float, losses: Losses) -> None:
        """Report losses since the last report, at most every `REPORT` seconds."""
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
