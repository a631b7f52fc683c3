"""Console output of ``wingbeat avionics``: events and periodic state."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics import topics
from avionics.board.board import Board
from avionics.isolation import Guard, Isolation
from avionics.messages import ActuatorCommand, PowerState, SensorFrame, Stage
from avionics.view import FlightView
from groundstation.link.vehicle_state import StatusLine, VehicleState
from groundstation.views.flight_view import event_line, progress_line
from wingbeat.message import Event


class Account:
    """Writer of lines to stderr, or to nowhere if ``quiet``."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet

    def report(self, text: str) -> None:
        """Write one line and flush it."""
        if not self._quiet:
            print(text, file=sys.stderr, flush=True)


class FlightOutcome(NamedTuple):
    """Duration of a flight."""

    frames: int = 0
    """-; sensor frames read"""
    time: float = 0.0
    """s; since boot, of the last sensor frame"""


class ReportingBoard:
    """`Board` that reports its first sensor frame, and the vehicle's events after each frame."""

    def __init__(
        self,
        board: Board,
        view: FlightView,
        account: Account,
        announced: Sequence[Event] = (),
        every: float = math.inf,
        guard: Guard | None = None,
    ) -> None:
        """Wrap ``board``.

        Args:
            board: source of the sensor frames.
            view: of the flight computer.
            account: output.
            announced: list to which the ground links append their own events.
            every: s; of flight time between two status lines; infinite for none.
            guard: catches exceptions of the terminal.
        """
        self._board = board
        self._guard = guard or Isolation().guard("terminal")
        self._every, self._due = every, every
        self._view = view
        self._account = account
        self._announced = announced
        self._reported = self._reported_links = 0
        self._supplied: PowerState | None = None
        self.outcome = FlightOutcome()

    def read(self) -> SensorFrame | None:
        """See `Board.read`."""
        frame = self._board.read()
        if frame is not None:
            if not self.outcome.frames:
                self._guard.run(self._account.report, f"first sensor frame at {frame.time_us * 1e-6:.3f} s")
            self.outcome = FlightOutcome(self.outcome.frames + 1, frame.time_us * 1e-6)
        return frame

    def write(self, command: ActuatorCommand) -> None:
        """See `Board.write`."""
        self._board.write(command)
        self.print_events()
        if math.isfinite(self._every) and self.outcome.time >= self._due:
            self._due = (self.outcome.time // self._every + 1.0) * self._every
            self._guard.run(self._print_progress)

    def _print_progress(self) -> None:
        state = known_state(self._view, self._supplied)
        self._supplied = self._view.latest(topics.POWER)
        self._account.report(progress_line(state, self._view.mode.name.replace("_", " ")))

    def print_events(self) -> None:
        """Print the new events of the vehicle."""
        self._guard.run(self._print_events)

    def _print_events(self) -> None:
        events, announced = self._view.events(self._reported), self._announced[self._reported_links :]
        self._reported += len(events)
        self._reported_links += len(announced)
        for event in (*events, *announced):
            self._account.report(event_line(StatusLine(event.time_us * 1e-6, event.severity, event.text)))

    def close(self) -> None:
        """See `Board.close`."""
        self._board.close()


def known_state(view: FlightView, since: PowerState | None = None) -> VehicleState:
    """Return the flight computer's state in the form of a ground station's; None before the first data.

    The power is the mean since the supply state ``since``, None for since boot.
    """
    attitude, altitude = view.latest(topics.ATTITUDE), view.latest(topics.ALTITUDE)
    air, wing, power = view.latest(topics.AIR_DATA), view.latest(topics.WING), view.latest(topics.POWER)
    navigation = view.latest(topics.NAVIGATION)
    return VehicleState(
        time=view.time_us * 1e-6,
        yaw=None if attitude is None else attitude.yaw,
        altitude=None if altitude is None else altitude.altitude,
        airspeed=None if air is None else air.airspeed,
        flap_frequency=None if wing is None else wing.frequency,
        power=None if power is None else _mean_power(power, since),
        mean_supply=power is not None,
        stage=None if navigation is None else Stage(navigation.stage),
        item=None if navigation is None or navigation.item < 0 else navigation.item,
    )


def _mean_power(now: PowerState, since: PowerState | None) -> float:
    """W; by the energy drawn meanwhile: a message's own power is that of 10 ms, one phase of the stroke."""
    began, before = (0, 0.0) if since is None else (since.time_us, since.energy)
    span = (now.time_us - began) * 1e-6
    return (now.energy - before) / span if span > 0.0 else now.power


def event_record(event: Event) -> dict[str, Any]:
    """Convert an event to a JSON object."""
    severity = event.severity.name
    return {"time": event.time_us * 1e-6, "severity": severity, "source": event.source, "text": event.text}
