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
    """Lines on stderr, or none where nobody is to read them."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet

    def report(self, text: str) -> None:
        """Write one line, at once."""
        if not self._quiet:
            print(text, file=sys.stderr, flush=True)


class FlightOutcome(NamedTuple):
    """What came of a flight."""

    frames: int = 0
    """-; sensor frames read"""
    time: float = 0.0
    """s; since boot, of the last sensor frame"""


class ReportingBoard:
    """A `Board` that tells of its first sensor frame, and after each what was said aboard meanwhile."""

    def __init__(
        self,
        board: Board,
        view: FlightView,
        account: Account,
        announced: Sequence[Event] = (),
        every: float = math.inf,
        guard: Guard | None = None,
    ) -> None:
        """Tell of ``board``.

        Args:
            board: whose sensor frames come.
            view: of the flight computer.
            account: where it is said.
            announced: grows by what the ground links say of themselves, which is no event of the vehicle.
            every: s; of flight time between two lines of where the vehicle is and how fast; infinite for none.
            guard: catches what the terminal raises.
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
        """Say what was said aboard since it was last told."""
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
    """What the flight computer knows of itself, as a ground station would hear it; None where it does not yet.

    The power is the mean since the supply was as ``since`` tells, None for since boot.
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
    """An event as a JSON object."""
    severity = event.severity.name
    return {"time": event.time_us * 1e-6, "severity": severity, "source": event.source, "text": event.text}
