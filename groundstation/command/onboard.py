"""The flight computer as a process: board, autopilot, ground link and recorder around one loop.

The autopilot is deterministic; everything on the wall clock (link, run times) stays in here and reaches it only as
logged inputs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from avionics import parameters, topics
from avionics.autopilot import Autopilot
from avionics.board.board import Board
from avionics.guidance.mission import Mission
from avionics.inputs import receive
from avionics.link.ground import GroundLink
from avionics.link.vehicle import Home, Parameter
from avionics.messages import Command, CommandKind, Event, GpsFix, Mode, PilotInput, SensorFrame, Severity
from avionics.processors import Stopwatch
from avionics.recorder import Recorder
from avionics.topics import Topic
from avionics.vehicles import FlightVehicle

POLL = 0.004
"""s; of wall-clock time between two looks at the ground links"""
SCRIPT = "script"
START_US = 1_000_000
"""us; since boot, when a scripted flight is armed and switched to AUTO"""


def scripted_start() -> tuple[Command, ...]:
    """What `wingbeat fly` commands, at a fixed tick, so that the log does not depend on when a person acts."""
    return (
        Command(START_US, CommandKind.ARM, source=SCRIPT),
        Command(START_US, CommandKind.SET_MODE, name=Mode.AUTO.name, source=SCRIPT),
    )


class Onboard:
    """One flight computer; also the `VehicleView` that its ground link reads."""

    def __init__(
        self,
        vehicle: FlightVehicle,
        mission: Mission,
        recorder: Recorder,
        script: Sequence[Command] = (),
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Build the autopilot; ``script`` is applied at the first tick whose time has reached each command's.

        Raises:
            BadInput: the mission cannot be flown.
        """
        self._recorder = recorder
        self._clock = clock
        self._stopwatch = Stopwatch(time.perf_counter_ns)
        self._latest: dict[str, Any] = {}
        self._events: list[Event] = []
        self._home: Home | None = None
        self._time_us = 0
        self._autopilot = Autopilot(vehicle, mission, self._publish, self._stopwatch.schedule)
        self._table = parameters.parameter_table(vehicle.gains)
        self._script = sorted(script, key=lambda command: command.time_us)
        self._polled_at = float("-inf")

    # --- what the ground link reads -----------------------------------------------------------------------

    @property
    def time_us(self) -> int:
        """us; since boot, of the last tick."""
        return self._time_us

    @property
    def mode(self) -> Mode:
        """Flight mode."""
        return Mode(self._autopilot.state.modes.mode)

    @property
    def armed(self) -> bool:
        """The wings may move."""
        return bool(self._autopilot.state.modes.armed)

    @property
    def mission(self) -> Mission:
        """The mission on board."""
        return self._autopilot.state.mission

    @property
    def home(self) -> Home | None:
        """None before the first fix."""
        return self._home

    @property
    def parameters(self) -> Sequence[Parameter]:
        """The parameter table with the values that hold now."""
        gains = self._autopilot.state.gains
        return [Parameter(p.name, parameters.get(gains, p), p.low, p.high) for p in self._table.values()]

    def latest(self, topic: Topic) -> Any:
        """The last message of ``topic``, or None before the first."""
        return self._latest.get(topic.name)

    def events(self, after: int) -> Sequence[Event]:
        """The events since boot but for the first ``after``."""
        return self._events[after:]

    def refusal(self, command: Command) -> str:
        """Why the flight core would refuse ``command``: what it says when a copy of it is asked."""
        heard: list[str] = []

        def listen(topic: Topic, message: Any) -> None:
            if topic is topics.EVENTS and message.severity <= Severity.WARNING:
                heard.append(message.text)

        receive(self._autopilot.state, listen, [command])
        return heard[0] if heard else ""

    # --- the loop -----------------------------------------------------------------------------------------

    def fly(self, board: Board, link: GroundLink | None) -> None:
        """Fly until the board says that the world is over.

        Raises:
            BoardSilent: the sensors stopped answering.
        """
        inputs: list[Command | PilotInput] = []
        while (frame := board.read()) is not None:
            board.write(self._autopilot.step(frame, [*self._due(frame.time_us), *inputs]))
            self._time_us = frame.time_us
            self._stopwatch.tick(frame.time_us, self._publish)
            self._note_home(frame)
            inputs = self._poll(link)

    def _due(self, time_us: int) -> list[Command]:
        due: list[Command] = []
        while self._script and self._script[0].time_us <= time_us:
            due.append(self._script.pop(0))
        return due

    def _poll(self, link: GroundLink | None) -> list[Command | PilotInput]:
        now = self._clock()
        if link is None or now - self._polled_at < POLL:
            return []
        self._polled_at = now
        inputs = link.poll(now)
        link.stream(now)
        for event in link.take_events():
            self._recorder.record(topics.LINK_EVENTS, event)
        return inputs

    def _publish(self, topic: Topic, message: Any) -> None:
        self._latest[topic.name] = message
        if topic is topics.EVENTS:
            self._events.append(message)
        self._recorder.record(topic, message)

    def _note_home(self, frame: SensorFrame) -> None:
        if frame.gps is None or self._home is not None:
            return
        home = self._autopilot.state.position_filter
        if home.valid:
            self._home = _home_of(home.home, frame.gps, self._latest.get(topics.ALTITUDE.name))


def _home_of(place: tuple[float, float], fix: GpsFix, altitude: Any) -> Home:
    climbed = 0.0 if altitude is None else altitude.altitude
    return Home(place[0], place[1], fix.altitude - climbed)
