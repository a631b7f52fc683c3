"""The same seed gives the same bytes: twice, after a restored snapshot, and over the bridge."""

from __future__ import annotations

import socket
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from memory_log import MemoryLog
from simulate import ARIZONA, DETERMINISTIC, RAVEN, Flight, differing, simulate

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.board.hil import HilBoard
from avionics.messages import ActuatorCommand, Command, SensorFrame
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.server import BridgeServer, BridgeStatistics
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
from wingbeat.topic import Topic

MID_STROKE_US = 12_345_000


@pytest.fixture(scope="module")
def first() -> Flight:
    return simulate(RAVEN, Scenario(seed=7, duration=10.0))


def test_the_same_seed_gives_the_same_bytes_on_every_deterministic_topic(first: Flight) -> None:
    again = simulate(RAVEN, Scenario(seed=7, duration=10.0))
    assert differing(first.log, again.log) == []
    silent = {topic.name for topic in DETERMINISTIC if not first.of(topic)}
    entered = {topics.PILOT.name, topics.OVERRIDE.name, topics.RECEIVER.name, topics.CALIBRATION.name}
    optional = {topics.RANGE.name, topics.CHANGES.name, topics.EXCITATION.name, truth_topics.EVENTS.name}
    assert silent <= {*entered, *optional}


def test_another_seed_differs_from_the_first_sample(first: Flight) -> None:
    other = simulate(RAVEN, Scenario(seed=8, duration=10.0))
    different = differing(first.log, other.log)
    assert {topics.IMU.name, topics.ATTITUDE.name, topics.ACTUATORS.name, truth_topics.STATE.name} <= set(different)
    assert first.of(topics.IMU)[0] != other.of(topics.IMU)[0]


class Handover:
    """A flight computer, and a second one that is restored from its snapshot and flies along from then on."""

    def __init__(self, vehicle: str, logs: tuple[MemoryLog, MemoryLog]) -> None:
        believed, mission = load_flight_vehicle(vehicle), load_mission("circuit")
        self.flying, self.restored = (Autopilot(believed, mission, log.publish) for log in logs)
        self.ticks_together = 0

    def step(self, frame: SensorFrame, commands: Sequence[Command]) -> ActuatorCommand:
        """The first computer's answer; both must give the same once there are two."""
        command = self.flying.step(frame, commands)
        if frame.time_us == MID_STROKE_US:
            self.restored.restore(self.flying.snapshot())
        elif frame.time_us > MID_STROKE_US:
            assert self.restored.step(frame, commands) == command
            self.ticks_together += 1
        return command


@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
def test_a_flight_computer_restored_in_mid_stroke_continues_bit_for_bit(vehicle: str) -> None:
    logs = MemoryLog(), MemoryLog()
    world, pair = SimulatedWorld(load_vehicle(vehicle), Scenario(seed=3, duration=16.0)), Handover(vehicle, logs)
    fly(world, pair, scripted_start())
    assert pair.ticks_together > 700
    assert differing(*logs, since_us=MID_STROKE_US) == []
    assert pair.flying.state == pair.restored.state
    assert logs[0].messages[topics.WING.name][-1].flapping == 1


class OnboardLog(MemoryLog):
    """A recorder in memory."""

    failure = ""

    def record(self, topic: Topic, message: Any) -> None:
        self.publish(topic, message)

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Forget a note."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Forget a file."""


def over_the_bridge(vehicle: str, scenario: Scenario) -> tuple[MemoryLog, BridgeStatistics]:
    """Fly with the world behind TCP and MAVLink, as two processes do; one log of both sides."""
    log, tallies = OnboardLog(), []
    world = SimulatedWorld(load_vehicle(vehicle), scenario, log.publish)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"tcp:127.0.0.1:{free.getsockname()[1]}"
    server = BridgeServer(url)
    serving = threading.Thread(target=lambda: tallies.append(server.serve(world)))
    serving.start()
    board = HilBoard(url)
    try:
        FlightComputer(load_flight_vehicle(vehicle), load_mission("circuit"), log, scripted_start()).fly(board)
    finally:
        board.close()
        serving.join(30.0)
        server.close()
    return log, tallies[0]


@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
def test_a_flight_over_the_bridge_is_the_flight_in_one_process(vehicle: str) -> None:
    scenario = Scenario(seed=5, duration=12.0, wind_speed=1.0)
    log, tally = over_the_bridge(vehicle, scenario)
    alone = simulate(vehicle, scenario)
    assert (tally.frames, tally.stale, tally.bad_bytes) == (len(alone.of(topics.IMU)), 0, 0)
    assert differing(alone.log, log) == []
    assert alone.truth["on_ground"][-1] == 0
