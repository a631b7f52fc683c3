"""Attitude of a board on a bench and of the flight computer."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import TracebackType
from typing import NamedTuple

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from avionics.board.line_watch import Losses
from avionics.board.razor_protocol import Angles
from avionics.messages import Attitude
from groundstation.views import tables, wording
from wingbeat.text import pluralize

REFRESH = 0.1
"""s; between two updates"""
LINE_EVERY = 1.0
"""s; between two lines without a terminal"""
LAYOUT = "+z.1f"


class Bench(NamedTuple):
    """Data of the view."""

    board: str
    """address"""
    frames: int
    """-; since the start"""
    step: float
    """s; between two frames"""
    attitude: Attitude
    """attitude estimated by the flight computer"""
    local: Angles | None
    """attitude from the board, None if it sends none"""
    losses: Losses
    """losses on the line"""
    restarts: int
    """-; restarts of the board"""


def render(bench: Bench) -> Group:
    """Render a table of three angles and a line about the connection."""
    return Group(Text(bench.board, style="bold"), _table(bench), Text(_line(bench), style="dim"))


def _table(bench: Bench) -> tables.PlainTable:
    heads = ("flight computer", "± one sigma", "board's own", "difference")
    table = tables.plain_table(("", ""), *((head, tables.NUMBER) for head in heads))
    for name, sigma in (("roll", "tilt_sigma"), ("pitch", "tilt_sigma"), ("yaw", "heading_sigma")):
        mine = getattr(bench.attitude, name)
        local = None if bench.local is None else getattr(bench.local, name)
        apart = None if local is None else math.remainder(local - mine, math.tau)
        table.add_row(
            name,
            wording.angle(mine, LAYOUT),
            wording.angle(getattr(bench.attitude, sigma), ".1f"),
            wording.angle(local, LAYOUT),
            wording.angle(apart, LAYOUT),
        )
    return table


def _line(bench: Bench) -> str:
    lost = bench.losses
    rate = f"{1.0 / bench.step:.1f} Hz"
    return f"{rate}, {pluralize(bench.frames, 'frame')}, {lost.lost} lost, {pluralize(bench.restarts, 'restart')}"


def plain_line(bench: Bench) -> str:
    """Format the same data on one line."""
    mine, local = bench.attitude, bench.local
    angles = "  ".join(f"{name} {wording.angle(getattr(mine, name), LAYOUT):>7}" for name in Angles._fields)
    if local is not None:
        angles += "  own " + " ".join(f"{wording.angle(angle, LAYOUT):>7}" for angle in local)
    return f"{mine.time_us * 1e-6:7.1f} s  {angles}  {_line(bench)}"


class BenchView:
    """Periodic view of a `Bench`: live on a terminal, lines elsewhere; a context manager."""

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._clock = clock
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self._next = -math.inf

    def __enter__(self) -> BenchView:
        """Start the live display."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the live display; its last state remains visible."""
        if self._live is not None:
            self._live.stop()

    @property
    def due(self) -> bool:
        """Return whether the next update is due."""
        return self._clock() >= self._next

    def show(self, bench: Bench) -> None:
        """Update the view."""
        self._next = self._clock() + (LINE_EVERY if self._live is None else REFRESH)
        if self._live is None:
            self._console.print(plain_line(bench), soft_wrap=True)
        else:
            self._live.update(render(bench), refresh=True)
