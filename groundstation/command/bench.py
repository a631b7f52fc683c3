"""Bench mode of ``wingbeat avionics``: a time limit and the attitude of a Razor."""

from __future__ import annotations

import contextlib
import math
from typing import Protocol

from avionics.board.razor import RazorBoard
from avionics.isolation import Guard
from avionics.messages import ActuatorCommand, SensorFrame
from avionics.view import FlightView
from groundstation.command.console_status import ReportingBoard
from groundstation.views.bench import Bench, BenchView
from groundstation.views.terminal import open_console

TIME_IS_UP = "the time is up"


class Show(Protocol):
    """Display that is updated after each tick."""

    def __call__(self) -> None:
        """Update the display if it is due."""


class BoundedBoard:
    """`Board` that ends after ``duration`` seconds of sensor time; ``show`` is called after each tick."""

    def __init__(self, board: ReportingBoard, duration: float | None, show: Show | None) -> None:
        self._board = board
        # Half a millisecond of tolerance: the times of frames are rounded to microseconds.
        self._duration = math.inf if duration is None else duration - 5e-4
        self._show = show
        self._first: float | None = None
        self.ended = ""
        """reason why `read` returned None, empty if the board ended"""

    def read(self) -> SensorFrame | None:
        """See `Board.read`."""
        if self._elapsed() >= self._duration:
            self.ended = TIME_IS_UP
            return None
        frame = self._board.read()
        if self._first is None:
            self._first = self._board.outcome.time
        return frame

    def _elapsed(self) -> float:
        """Return the time in s since the first frame."""
        return 0.0 if self._first is None else self._board.outcome.time - self._first

    def write(self, command: ActuatorCommand) -> None:
        """See `Board.write`."""
        self._board.write(command)
        if self._show is not None:
            self._show()

    def close(self) -> None:
        """See `Board.close`."""
        self._board.close()


def showing(
    stack: contextlib.ExitStack,
    address: str,
    board: RazorBoard,
    console: ReportingBoard,
    view: FlightView,
    guard: Guard,
) -> Show:
    """Show the attitude on the terminal until ``stack`` is closed; ``guard`` catches exceptions of the view."""
    screen = stack.enter_context(BenchView(open_console()))

    def show() -> None:
        if screen.due:
            attitude = view.autopilot.memory.attitude
            screen.show(
                Bench(
                    address, console.outcome.frames, board.step, attitude, board.angles, board.losses, board.restarts
                )
            )

    def guarded() -> None:
        guard.run(show)

    return guarded
