"""Exceptions injected into what runs beside the flight code: recorder, views, terminal, files, links."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_onboard import TICK_US, Memory, Rest
from test_onboard_silence import Ear

from avionics import topics
from avionics.isolation import Isolation
from avionics.link.ground import GroundLink
from avionics.messages import ImuSample
from avionics.missions import load_mission
from avionics.runtime.flight_computer import UNRECORDED, FlightComputer
from avionics.vehicles import load_vehicle
from groundstation.command.console_status import Account, ReportingBoard
from groundstation.command.sim import IsolatedOutputs
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.recording_notes import note_inputs
from logs.replay.flight import replay_flight
from logs.scene import PLAIN_BIRD, SceneRecorder
from sim_bridge import topics as truth_topics
from wingbeat.message import Event, Severity

VEHICLE, MISSION = "robo_raven_ii_d", "circuit"
TICKS = 700
FAULT_AT = 200
"""-; tick in which an exception is injected"""


class Injected(Exception):
    """What no part raises by itself."""


def fail(*args: Any, **options: Any) -> Any:
    raise Injected("on purpose")


class Flight:
    """A flight computer at rest with one link; ``inject`` is called before tick `FAULT_AT`."""

    def __init__(self, recorder: Any = None, isolation: Isolation | None = None) -> None:
        self.memory = Memory() if recorder is None else recorder
        self.isolation, self.ear, self.now = isolation or Isolation(), Ear(), 0.0
        self.board = Rest(TICKS)
        self.lines: list[str] = []
        vehicle, mission = load_vehicle(VEHICLE), load_mission(MISSION)
        self.onboard = FlightComputer(
            vehicle, mission, self.memory, clock=lambda: self.now, clock_ns=lambda: 0, isolation=self.isolation
        )
        self.link = GroundLink([self.ear], self.onboard.view)
        account = Account(quiet=True)
        account.report = self.lines.append  # type: ignore[method-assign]
        self.account = account
        self.console = ReportingBoard(
            self.board, self.onboard.view, account, self.link.announced, every=1.0,
            guard=self.isolation.guard("terminal"),
        )  # fmt: skip

    def fly(self, inject: Callable[[Flight], None]) -> None:
        read = self.board.read

        def reading() -> Any:
            self.now += TICK_US * 1e-6
            if self.board.time_us == FAULT_AT * TICK_US:
                inject(self)
            frame = read()
            # As a board reads them, so that a replay has the same types.
            return frame and frame._replace(imu=ImuSample(frame.time_us, *map(float, frame.imu[1:])))

        self.board.read = reading  # type: ignore[method-assign]
        self.onboard.fly(self.console, self.link)
        self.link.close()

    def link_events(self) -> list[Event]:
        return [message for topic, message in self.memory.kept if topic is topics.LINK_EVENTS]

    def texts(self) -> str:
        return "".join(each.text for each in self.ear.received if each.get_type() == "STATUSTEXT")


def once(owner: Any, name: str) -> None:
    """The next call of a method raises; the later ones do not."""
    normal = getattr(owner, name)

    def failing(*args: Any, **options: Any) -> Any:
        setattr(owner, name, normal)
        fail()

    setattr(owner, name, failing)


PARTS: dict[str, Callable[[Flight], None]] = {
    "recorder": lambda flight: once(flight.memory, "record"),
    "parameter file": lambda flight: once(flight.onboard, "_keep"),
    "ground links": lambda flight: once(flight.link, "poll"),
    "terminal": lambda flight: once(flight.console, "_print_events"),
}


@pytest.mark.parametrize("part", PARTS)
def test_a_part_that_raises_costs_no_tick_and_is_reported_once(part: str) -> None:
    """GIVEN any part beside the flight code WHEN it raises THEN every frame is answered and the part goes on."""
    flight = Flight()
    flight.onboard.keep_parameters(object())  # type: ignore[arg-type]
    flight.onboard._keep = lambda file, armed: None  # type: ignore[method-assign]
    flight.fly(PARTS[part])
    assert [command.time_us for command in flight.board.answers] == [TICK_US * n for n in range(1, TICKS + 1)]
    errors = [event for event in flight.link_events() if event.severity is Severity.ERROR]
    traces = [event for event in flight.link_events() if event.severity is Severity.DEBUG]
    assert [event.source for event in errors] == [event.source for event in traces] == [part]
    assert "Traceback" in traces[0].text
    assert errors[0].text in flight.texts()
    shown = "\n".join(flight.lines)
    assert errors[0].text in shown and "Traceback" not in shown
    beats = [each for each in flight.ear.received if each.get_type() == "HEARTBEAT"]
    assert len(beats) >= TICKS * TICK_US * 1e-6 - 2.0
    imu = [message.time_us for topic, message in flight.memory.kept if topic is topics.IMU]
    assert TICKS - len(imu) <= (part == "recorder")


def test_a_recorder_that_always_raises_is_retried_and_the_flight_goes_on() -> None:
    flight = Flight()

    def break_recorder(flight: Flight) -> None:
        flight.memory.record = fail

    flight.fly(break_recorder)
    assert len(flight.board.answers) == TICKS
    assert "recorder restarts in 1 s: " in flight.texts()
    assert len(flight.onboard._announced) <= UNRECORDED < 20 * TICKS, "what cannot be recorded fills no memory"


def test_a_terminal_that_is_gone_costs_no_flight() -> None:
    def close_terminal(flight: Flight) -> None:
        def broken(text: str) -> None:
            raise BrokenPipeError(32, "Broken pipe")

        flight.account.report = broken  # type: ignore[method-assign]

    flight = Flight()
    flight.fly(close_terminal)
    assert len(flight.board.answers) == TICKS and "terminal restarts in 1 s: BrokenPipeError" in flight.texts()


def test_a_flight_with_faults_is_recorded_and_replayed_bit_for_bit(tmp_path: Path) -> None:
    """GIVEN faults of a service, a builder and the scene THEN the log is whole and its replay differs in nothing."""
    path = tmp_path / "faults.mcap"
    isolation = Isolation()
    with McapRecorder(path, start_epoch_ns=1_700_000_000_000_000_000) as inner:
        seen = SceneRecorder(inner, PLAIN_BIRD, inner.start_epoch_ns, True, isolation.guard("scene"))
        note_inputs(inner, load_vehicle(VEHICLE), load_mission(MISSION))
        flight = Flight(seen, isolation)

        def inject(flight: Flight) -> None:
            once(seen, "_updates_of")
            once(flight.link._services["FTP"].service, "step")
            flight.link._services["heartbeat"].service.step = fail  # type: ignore[method-assign]

        flight.fly(inject)
    with open_log(path) as log:
        events = log.events(topics.LINK_EVENTS)
        errors = {event.source for event in events if event.severity is Severity.ERROR}
        assert errors == {"scene", "FTP", "heartbeat"}
        assert sum("Traceback" in event.text for event in events) == 3
        assert log.topics[topics.IMU.name].messages == TICKS
        done = replay_flight(log)
        assert [each for each in done.differences if not each.same] == [] and done.ticks == TICKS


def test_what_an_output_of_the_world_raises_is_an_event_and_the_world_goes_on(capsys: Any) -> None:
    kept: list[tuple[Any, Any]] = []
    state = {"broken": False}

    def record(topic: Any, message: Any) -> None:
        if state["broken"]:
            state["broken"] = False
            fail()
        kept.append((topic, message))

    outputs = IsolatedOutputs({"recorder": record, "terminal": lambda topic, message: None}, Isolation())
    for number in range(400):
        state["broken"] = number % 20 == 5
        outputs(truth_topics.EVENTS, Event(number * 100_000, Severity.INFO, "world", str(number)))
    texts = [message.text for topic, message in kept]
    recorded = {int(text) for text in texts if text.isdigit()}
    assert {*range(105)} - recorded == {*range(5, 105, 20)}, "the first faults cost their messages alone"
    assert len(recorded) > 200 and 399 in recorded, "any number of faults leaves a recording"
    assert sum("Injected" in text for text in texts) >= 1
