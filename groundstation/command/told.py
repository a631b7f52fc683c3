"""What ``wingbeat avionics`` says while it flies: one line for each thing that happens aboard."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.board.board import Board
from avionics.messages import ActuatorCommand, Event, SensorFrame
from avionics.view import FlightView
from groundstation.link.vehicle_state import Heard
from groundstation.views.flight_view import event_line


class Account:
    """Lines on stderr, or none where nobody is to read them."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet

    def say(self, text: str) -> None:
        """Write one line, at once."""
        if not self._quiet:
            print(text, file=sys.stderr, flush=True)


class Flown(NamedTuple):
    """What came of a flight."""

    frames: int = 0
    """-; sensor frames read"""
    time: float = 0.0
    """s; since boot, of the last sensor frame"""


class ToldBoard:
    """A `Board` that tells of its first sensor frame, and after each what was said aboard meanwhile."""

    def __init__(self, board: Board, view: FlightView, account: Account, announced: Sequence[Event] = ()) -> None:
        """``announced`` grows by what the ground links say of themselves, which is no event of the vehicle."""
        self._board = board
        self._view = view
        self._account = account
        self._announced = announced
        self._told = self._told_links = 0
        self.flown = Flown()

    def read(self) -> SensorFrame | None:
        """See `Board.read`."""
        frame = self._board.read()
        if frame is not None:
            if not self.flown.frames:
                self._account.say(f"first sensor frame at {frame.time_us * 1e-6:.3f} s")
            self.flown = Flown(self.flown.frames + 1, frame.time_us * 1e-6)
        return frame

    def write(self, command: ActuatorCommand) -> None:
        """See `Board.write`."""
        self._board.write(command)
        self.tell_events()

    def tell_events(self) -> None:
        """Say what was said aboard since it was last told."""
        events, announced = self._view.events(self._told), self._announced[self._told_links :]
        self._told += len(events)
        self._told_links += len(announced)
        for event in (*events, *announced):
            self._account.say(event_line(Heard(event.time_us * 1e-6, event.severity, event.text)))

    def close(self) -> None:
        """See `Board.close`."""
        self._board.close()


def event_record(event: Event) -> dict[str, Any]:
    """An event as a JSON object."""
    severity = event.severity.name
    return {"time": event.time_us * 1e-6, "severity": severity, "source": event.source, "text": event.text}
