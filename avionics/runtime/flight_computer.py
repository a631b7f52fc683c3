"""Flight computer process: board, autopilot, ground link and recorder in one loop.

The autopilot is deterministic. All parts on the wall clock (link, run times) are in this module, and reach it only as
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
from avionics.isolation import Isolation, fault_events
from avionics.link.ground import GroundLink
from avionics.link.vehicle import NO_FRAMES
from avionics.messages import ChannelOverride, Command, Input
from avionics.processors import Stopwatch
from avionics.recorder import Recorder
from avionics.runtime.input_queue import SILENCE, InputQueue
from avionics.timebase import NOMINAL_US
from avionics.vehicles import FlightVehicle
from avionics.view import FlightView
from wingbeat.message import Severity
from wingbeat.topic import Topic

POLL = 0.004
"""s; wall-clock interval of polls of the ground links"""


UNRECORDED = 4096
"""messages; buffer during a restart of the recorder, beyond which the oldest are lost"""


class FlightComputer:
    """Flight computer; ``view`` is its interface to a ground link."""

    def __init__(
        self,
        vehicle: FlightVehicle,
        mission: Mission,
        recorder: Recorder,
        script: Sequence[Command] = (),
        clock: Callable[[], float] = time.monotonic,
        clock_ns: Callable[[], int] = time.perf_counter_ns,
        isolation: Isolation | None = None,
    ) -> None:
        """Build the autopilot.

        Each command of ``script`` is executed at the first tick at or after its time, which is relative to the first
        tick of this flight computer, because a board may have been on before. ``clock`` (s) is the time of the links,
        ``clock_ns`` measures run times. Faults caught by the guards of ``isolation`` are reported with those of the
        recorder, the parameter file and the links.

        Raises:
            InputError: the mission cannot be flown.
        """
        self._recorder = recorder
        self._isolation = isolation or Isolation()
        # One message is lost with each fault: with a back-off all messages during it would be lost.
        self._recording = self._isolation.guard("recorder", backoff=0.0, vital=True)
        self._keeping = self._isolation.guard("parameter file")
        self._linking = self._isolation.guard("ground links", vital=True)
        self._clock = clock
        self._stopwatch = Stopwatch(clock_ns)
        self._script = sorted(script, key=lambda command: command.time_us)
        self._boot_us: int | None = None
        self._polled_at = float("-inf")
        self._file: ParameterFile | None = None
        self._link: GroundLink | None = None
        self._waiting = InputQueue()
        self._ticked_at = float("-inf")
        self._unrecorded = False
        self._thinking = False
        self._announced: deque[tuple[Topic[Any], Any]] = deque(maxlen=UNRECORDED)
        self.view = FlightView(vehicle, mission, self._publish, self._stopwatch.schedule)

    def keep_parameters(self, file: ParameterFile) -> None:
        """Write changed parameters to ``file`` while disarmed, and after the flight."""
        self._file = file

    def fly(self, board: Board, link: GroundLink | None = None) -> None:
        """Fly until the board reports the end of the simulation.

        Raises:
            BoardSilent: timeout of the sensors.
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
                self._stopwatch.tick(frame.time_us, self._record)
                if self._file is not None:
                    self._keeping.run(self._keep, self._file, self.view.armed)
        finally:
            self._write_down()
            if kept:
                gc.unfreeze()
            if self._file is not None:
                self._keeping.run(self._keep, self._file, armed=False)
            self._report_faults()

    def _publish(self, topic: Topic[Any], message: Any) -> None:
        """Record a message; those of a tick follow its actuator command.

        The servos are thus not delayed by the log.
        """
        if self._thinking:
            self._announced.append((topic, message))
        else:
            self._record(topic, message)

    def _record(self, topic: Topic[Any], message: Any) -> None:
        self._recording.run(self._recorder.record, topic, message)

    def _write_down(self) -> None:
        self._thinking = False
        self._recording.run(self._record_tick)

    def _record_tick(self) -> None:
        said, record = self._announced, self._recorder.record
        # A KeyboardInterrupt may occur between any two lines; remaining messages are recorded at the end.
        while said:
            record(*said.popleft())

    def idle(self) -> None:
        """Serve the ground links between two ticks, and while a board waits for a frame."""
        self._recording.run(self._watch_recorder)
        now = self._clock()
        self._isolation.advance(now)
        self._report_faults()
        if self._link is None or now - self._polled_at < POLL:
            return
        self._polled_at = now
        self._listen_for_frames(now)
        self._waiting.add(now, self._linking.run(self._link.poll, now) or ())
        self._linking.run(self._stream, self._link, now)

    def _watch_recorder(self) -> None:
        """Report the end of the recording once, also to the ground; the flight continues."""
        if self._recorder.failure and not self._unrecorded:
            self._unrecorded = True
            self.view.send_statustext(Severity.ERROR, "recorder", self._recorder.failure)

    def _arrived(self) -> list[Input]:
        """Return the inputs from the ground for the next tick."""
        now = self._clock()
        self._listen_for_frames(now)
        self._ticked_at, self.view.silent = now, False
        return self._waiting.take()

    def _listen_for_frames(self, now: float) -> None:
        """Discard inputs without sensor frames, except those that stop the wings."""
        self.view.silent = now - self._ticked_at > SILENCE
        dropped = self._waiting.drop_stale(now)
        if not dropped:
            return
        for entry in dropped:
            if isinstance(entry, ChannelOverride):
                self._waiting.add(now, self.view.stops(entry))
        forgotten = list(dict.fromkeys(entry.kind.name for entry in dropped if isinstance(entry, Command)))
        if forgotten:
            self.view.send_statustext(Severity.WARNING, "link", f"{NO_FRAMES}: {', '.join(forgotten)} dropped")

    def _keep(self, file: ParameterFile, armed: bool) -> None:
        try:
            file.keep(self.view.autopilot.memory.gains, armed)
        except OSError as error:
            text = f"parameters not stored: {file.path}: {error.strerror}"
            self.view.send_statustext(Severity.ERROR, "parameters", text)

    def _due(self, time_us: int) -> list[Command]:
        if self._boot_us is None:
            self._boot_us = time_us - NOMINAL_US
        due: list[Command] = []
        while self._script and self._script[0].time_us <= time_us - self._boot_us:
            due.append(self._script.pop(0))
        return due

    def _stream(self, link: GroundLink, now: float) -> None:
        link.stream(now)
        for event in link.take_events():
            self._record(topics.LINK_EVENTS, event)

    def _report_faults(self) -> None:
        """Report faults of the guards: one line to the ground, the traceback to the log."""
        for fault in self._isolation.take_faults():
            event, *details = fault_events(fault, self.view.time_us)
            self.view.send_statustext(event.severity, event.source, event.text)
            for detail in details:
                self._record(topics.LINK_EVENTS, detail)


def _keep_memory() -> bool:
    """Exclude existing objects from garbage collection, which could delay a tick.

    The result is False if the caller has frozen them already.
    """
    if gc.get_freeze_count():
        return False
    gc.collect()
    gc.freeze()
    return True
