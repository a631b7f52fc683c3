"""Progress bar of long work on a terminal; occasional lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, Progress, TaskID, TextColumn

from groundstation.views.terminal import open_console

APPEARS_AFTER = 1.0
"""s; shorter work shows no progress"""
LINE_EVERY = 1.0
"""s; between two lines without a terminal"""


class ProgressBar:
    """Progress bar on stderr; a context manager that removes the bar at the end.

    ``quiet`` draws no bar. With ``reporting``, lines are printed if there is no terminal, at least ``every`` s apart.
    """

    def __init__(
        self,
        label: str,
        quiet: bool = False,
        reporting: bool = False,
        clock: Callable[[], float] = time.monotonic,
        every: float = LINE_EVERY,
    ) -> None:
        self._label = label
        self._clock = clock
        self._started = clock()
        self._shown = not quiet and sys.stderr.isatty()
        self._reporting = reporting
        self._reported = ""
        self._reported_at = self._started
        self._every = every
        self._bar: Progress | None = None
        self._task = TaskID(0)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, done: float, total: float, note: str = "") -> None:
        """Show the progress; ``total`` is 0 while it is unknown."""
        if self._clock() - self._started < APPEARS_AFTER:
            return
        if not self._shown:
            self._report(note)
            return
        if self._bar is None:
            columns = (
                TextColumn("{task.description}", markup=False),
                BarColumn(40),
                TextColumn("{task.percentage:3.0f} %"),
            )
            self._bar = Progress(*columns, console=open_console(stderr=True), transient=True)
            self._task = self._bar.add_task(self._label, total=total or None)
            self._bar.start()
        self._bar.update(self._task, completed=done, total=total or None, description=note or self._label)

    def _report(self, note: str) -> None:
        """Print a line without a terminal: new text only, with limited rate."""
        now = self._clock()
        if self._reporting and note and note != self._reported and now - self._reported_at >= self._every:
            self._reported, self._reported_at = note, now
            print(note, file=sys.stderr, flush=True)
