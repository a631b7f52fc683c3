"""The flight computer as a process: board, autopilot, ground link and recorder around one loop.

The autopilot is deterministic; everything on the wall clock (link, run times) stays in here and reaches it only as
logged inputs.
"""

from __future__ import annotations

import gc
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from avionics import topics
from avionics.board.board import Board
from avionics.board.parameter_file import ParameterFile
from avionics.guidance.mission import Mission
from avionics.link.ground import GroundLink
from avionics.link.vehicle import NO_FRAMES
from avionics.messages import ChannelOverride, Command, Input, Severity
from avionics.processors import Stopwatch
from avionics.recorder import Recorder
from avionics.timebase import NOMINAL_US
from avionics.topics import Topic
from avionics.vehicles import FlightVehicle
from avionics.view import FlightView
from groundstation.command.waiting_inputs import SILENCE, WaitingInputs

POLL = 0.004
"""s; of wall-clock time between two looks at the ground links"""


class Onboard:
    """One flight computer; its ``view`` is what a ground link reads."""

    def __init__(
        self,
        vehicle: FlightVehicle,
        mission: Mission,
        recorder: Recorder,
        script: Sequence[Command] = (),
        clock: Callable[[], float] = time.monotonic,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
    ) -> None:
        """Build the autopilot; each command of ``script`` is applied at the first tick that has reached its time.

        That is the time since this flight computer's first tick: a board may have been on for long. ``clock`` tells
        the links the time in s, ``clock_ns`` measures run times.

        Raises:
            BadInput: the mission cannot be flown.
        """
        self._recorder = recorder
        self._clock = clock
        self._stopwatch = Stopwatch(clock_ns)
        self._script = sorted(script, key=lambda command: command.time_us)
        self._boot_us: int | None = None
        self._polled_at = float("-inf")
        self._file: ParameterFile | None = None
        self._link: GroundLink | None = None
        self._waiting = WaitingInputs()
        self._ticked_at = float("-inf")
        self._unrecorded = False
        self._thinking = False
        self._said: deque[tuple[Topic, Any]] = deque()
        self.view = FlightView(vehicle, mission, self._publish, self._stopwatch.schedule)

    def keep_parameters(self, file: ParameterFile) -> None:
        """Write changed parameters to ``file`` while disarmed, and at the end of the flight."""
        self._file = file

    def fly(self, board: Board, link: GroundLink | None = None) -> None:
        """Fly until the board says that the world is over.

        Raises:
            BoardSilent: the sensors stopped answering.
        """
        step = self.view.autopilot.step
        self._link = link
        kept = _keep_memory()
        try:
            while (frame := board.read()) is not None:
                self._stopwatch.begin()
                entering = [*self._due(frame.time_us), *self._arrived()]
                self._thinking = True
                board.write(step(frame, entering))
                self._write_down()
                self.idle()
                self._stopwatch.tick(frame.time_us, self._recorder.record)
                if self._file is not None:
                    self._keep(self._file, self.view.armed)
        finally:
            self._write_down()
            if kept:
                gc.unfreeze()
            if self._file is not None:
                self._keep(self._file, armed=False)

    def _publish(self, topic: Topic, message: Any) -> None:
        """Record what was said: of a tick once it is answered, so that the servos do not wait for the log."""
        if self._thinking:
            self._said.append((topic, message))
        else:
            self._recorder.record(topic, message)

    def _write_down(self) -> None:
        self._thinking, said, record = False, self._said, self._recorder.record
        # Ctrl-C may come between any two lines: what is left then is recorded at the end.
        while said:
            record(*said.popleft())

    def idle(self) -> None:
        """Serve the ground links: between two ticks, and for a board that waits for its next sensor frame."""
        self._watch_recorder()
        now = self._clock()
        if self._link is None or now - self._polled_at < POLL:
            return
        self._polled_at = now
        self._listen_for_frames(now)
        self._waiting.add(now, self._poll(self._link, now))

    def _watch_recorder(self) -> None:
        """A recording that has ended is told once, to the ground too; the flight goes on."""
        if self._recorder.failure and not self._unrecorded:
            self._unrecorded = True
            self.view.tell(Severity.ERROR, "recorder", self._recorder.failure)

    def _arrived(self) -> list[Input]:
        """What came from the ground for the tick that begins."""
        now = self._clock()
        self._listen_for_frames(now)
        self._ticked_at, self.view.silent = now, False
        return self._waiting.take()

    def _listen_for_frames(self, now: float) -> None:
        """Without sensor frames nothing is taken, and what was is forgotten but for what stops the wings."""
        self.view.silent = now - self._ticked_at > SILENCE
        dropped = self._waiting.drop_stale(now)
        for entry in dropped:
            if isinstance(entry, ChannelOverride):
                self._waiting.add(now, self.view.stops(entry))
        forgotten = list(dict.fromkeys(entry.kind.name for entry in dropped if isinstance(entry, Command)))
        if forgotten:
            self.view.tell(Severity.WARNING, "link", f"{NO_FRAMES}: {', '.join(forgotten)} not obeyed")

    def _keep(self, file: ParameterFile, armed: bool) -> None:
        try:
            file.keep(self.view.autopilot.memory.gains, armed)
        except OSError as error:
            text = f"parameters are not kept: {file.path}: {error.strerror}"
            self.view.tell(Severity.ERROR, "parameters", text)

    def _due(self, time_us: int) -> list[Command]:
        if self._boot_us is None:
            self._boot_us = time_us - NOMINAL_US
        due: list[Command] = []
        while self._script and self._script[0].time_us <= time_us - self._boot_us:
            due.append(self._script.pop(0))
        return due

    def _poll(self, link: GroundLink, now: float) -> list[Input]:
        inputs = link.poll(now)
        link.stream(now)
        for event in link.take_events():
            self._recorder.record(topics.LINK_EVENTS, event)
        return inputs


def _keep_memory() -> bool:
    """What is in memory now stays: no search for garbage among it may take a tick; False where somebody saw to it."""
    if gc.get_freeze_count():
        return False
    gc.collect()
    gc.freeze()
    return True
