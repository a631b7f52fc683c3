"""The loop of the flight computer's process on a board that plays frames."""

from __future__ import annotations

import json
from typing import Any

import pytest

from avionics import topics
from avionics.board.board import BoardSilent
from avionics.messages import ActuatorCommand, Command, CommandKind, ImuSample, Mode, PowerState, SensorFrame
from avionics.missions import load_mission
from avionics.missions.script import START_US, scripted_start
from avionics.processors import WHOLE_TICK
from avionics.recorder import NullRecorder
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import load_vehicle
from groundstation.command.console_status import Account, ReportingBoard
from wingbeat.message import Event
from wingbeat.topic import Topic

TICK_US = 5000


class Rest:
    """A vehicle at rest, level, for ``ticks`` frames; then the world is over, or silent."""

    def __init__(self, ticks: int, falls_silent: bool = False) -> None:
        self.left = ticks
        self.time_us = 0
        self.silent = falls_silent
        self.answers: list[ActuatorCommand] = []

    def read(self) -> SensorFrame | None:
        if not self.left:
            if self.silent:
                raise BoardSilent("nobody answers")
            return None
        self.left -= 1
        self.time_us += TICK_US
        return SensorFrame(self.time_us, ImuSample(self.time_us, 0, 0, -9.81, 0, 0, 0, 0.2, 0.0, 0.45))

    def write(self, command: ActuatorCommand) -> None:
        self.answers.append(command)

    def close(self) -> None:
        pass


class Memory(NullRecorder):
    """Keeps what it is handed."""

    def __init__(self) -> None:
        self.kept: list[tuple[Topic, Any]] = []

    def record(self, topic: Topic, message: Any) -> None:
        self.kept.append((topic, message))


class Ground:
    """A ground link with one command to hand over, on the wall clock."""

    def __init__(self) -> None:
        self.waiting = [Command(0, CommandKind.SET_MODE, name="STABILIZED", source="test")]
        self.streamed = 0

    def poll(self, now: float) -> list[Command]:
        waiting, self.waiting = self.waiting, []
        return waiting

    def stream(self, now: float) -> None:
        self.streamed += 1

    def take_events(self) -> list[Any]:
        return []


def fly(board: Rest, script: tuple[Command, ...] = (), link: Any = None) -> Memory:
    memory = Memory()
    clock = iter(range(10**6))
    onboard = FlightComputer(
        load_vehicle("robo_raven_ii_d"), load_mission("circuit"), memory, script, clock=lambda: 0.005 * next(clock)
    )
    onboard.fly(board, link)
    return memory


def inputs(memory: Memory) -> list[dict[str, Any]]:
    return [json.loads(message.text) for topic, message in memory.kept if topic is topics.INPUTS]


def test_every_frame_is_answered_with_its_own_time() -> None:
    board = Rest(50)
    fly(board)
    assert [command.time_us for command in board.answers] == [TICK_US * n for n in range(1, 51)]


def test_the_script_is_applied_at_its_tick_whatever_the_wall_clock_says() -> None:
    memory = fly(Rest(START_US // TICK_US + 5), scripted_start())
    assert [(entry["kind"], entry["time_us"]) for entry in inputs(memory)] == [
        ("ARM", START_US),
        ("SET_MODE", START_US),
    ]


def test_the_script_counts_from_the_first_frame_of_a_board_that_was_on_before() -> None:
    board = Rest(START_US // TICK_US + 5)
    board.time_us = 3_600_000_000
    memory = fly(board, scripted_start())
    assert [entry["time_us"] for entry in inputs(memory)] == [3_600_000_000 + START_US] * 2


def test_what_the_ground_sends_enters_at_the_next_tick_and_is_logged() -> None:
    ground = Ground()
    memory = fly(Rest(20), link=ground)
    assert [(entry["kind"], entry["time_us"], entry["source"]) for entry in inputs(memory)] == [
        ("SET_MODE", 2 * TICK_US, "test")
    ]
    assert ground.streamed == 20


@pytest.mark.parametrize("link", [None, Ground()])
def test_a_recording_that_has_ended_is_told_once_and_the_flight_goes_on(link: Any) -> None:
    memory = Memory()
    memory.failure = "recording to flight.mcap ended: No space left on device"
    board = Rest(50)
    FlightComputer(load_vehicle("robo_raven_ii_d"), load_mission("circuit"), memory).fly(board, link)
    told = [message for topic, message in memory.kept if topic is topics.LINK_EVENTS and message.source == "recorder"]
    assert [(event.severity.name, event.text) for event in told] == [("ERROR", memory.failure)]
    assert len(board.answers) == 50


def test_a_tick_that_is_interrupted_while_it_is_written_down_is_recorded_whole() -> None:
    """GIVEN Ctrl-C between two messages of the last tick THEN what came behind it is in the log all the same."""

    class Interrupted(Memory):
        def record(self, topic: Any, message: Any) -> None:
            super().record(topic, message)
            if topic is topics.IMU and message.time_us == 3 * TICK_US:
                raise KeyboardInterrupt

    whole, memory = fly(Rest(3)), Interrupted()
    with pytest.raises(KeyboardInterrupt):
        FlightComputer(load_vehicle("robo_raven_ii_d"), load_mission("circuit"), memory).fly(Rest(10))
    told = [(topic.name, m.time_us) for topic, m in memory.kept]
    assert told == [(topic.name, m.time_us) for topic, m in whole.kept]


def test_run_times_are_recorded_once_a_second() -> None:
    memory = fly(Rest(450))
    timings = [message for topic, message in memory.kept if topic is topics.TIMING]
    assert [timing.processor for timing in timings] == [0, 1, 2, 3, WHOLE_TICK] * 2


def test_what_a_link_takes_is_the_ticks_overrun_and_no_processors() -> None:
    """GIVEN a link that takes 20 ms in every tick WHEN a second is over THEN each tick of it has overrun."""
    now_ns = [0]

    class Slow(Ground):
        def stream(self, now: float) -> None:
            now_ns[0] += 20_000_000

    memory, time = Memory(), iter(range(10**6))
    vehicle, mission = load_vehicle("robo_raven_ii_d"), load_mission("circuit")
    onboard = FlightComputer(vehicle, mission, memory, (), lambda: 0.005 * next(time), lambda: now_ns[0])
    onboard.fly(Rest(201), Slow())  # type: ignore[arg-type]
    overruns = {each.processor: each.overruns for topic, each in memory.kept if topic is topics.TIMING}
    assert overruns == {0: 0, 1: 0, 2: 0, 3: 0, WHOLE_TICK: 201}


def test_silence_of_the_board_is_not_swallowed() -> None:
    with pytest.raises(BoardSilent, match="nobody answers"):
        fly(Rest(3, falls_silent=True))


# --- what is told ---------------------------------------------------------------------------------------


class Supplied:
    """A view that knows the power and nothing else."""

    mode = Mode.AUTO

    def __init__(self) -> None:
        self.power: PowerState | None = None

    @property
    def time_us(self) -> int:
        return 0 if self.power is None else self.power.time_us

    def latest(self, topic: Topic) -> PowerState | None:
        return self.power if topic is topics.POWER else None

    def events(self, after: int) -> tuple[Event, ...]:
        return ()


def test_the_power_of_a_line_is_the_mean_since_the_line_before_not_that_of_a_burst() -> None:
    class Lines(Account):
        def report(self, text: str) -> None:
            told.append(text)

    told: list[str] = []
    view: Any = Supplied()
    board = ReportingBoard(Rest(4000), view, Lines(True), every=10.0)
    none = PowerState(*[0] * len(PowerState._fields))
    while (frame := board.read()) is not None:
        seconds = frame.time_us * 1e-6
        energy = 20.0 * min(seconds, 10.0) + 30.0 * max(seconds - 10.0, 0.0)
        view.power = none._replace(time_us=frame.time_us, power=8.0, energy=energy)
        board.write(ActuatorCommand(frame.time_us, *[0] * (len(ActuatorCommand._fields) - 1)))
    lines = [line for line in told if "power" in line]
    assert [line.partition("power")[2].split()[:2] for line in lines] == [["20.0", "W"], ["30.0", "W"]]
