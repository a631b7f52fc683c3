"""Flights in one process, with what can go wrong on the way, and what is measured on them.

Everything is measured against the simulated world's truth, by other means than `logs.summary`.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from memory_log import MemoryLog
from scipy.spatial.transform import Rotation

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance.mission import ItemKind, Mission
from avionics.link.codec import quantized_command
from avionics.messages import ActuatorCommand, Command, SensorFrame, Stage
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.summary import CAPTURE_ALTITUDE, CAPTURE_HEADING
from sim_bridge import topics as truth_topics
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.faults import Fault, fault_commands
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
from wingbeat.topic import Topic

RAVEN, ARIZONA = "robo_raven_ii_d", "arizona_100cm"
DETERMINISTIC = tuple(topic for topic in topics.TOPICS + truth_topics.TOPICS if topic.deterministic)

Alter = Callable[[SensorFrame], SensorFrame]


class AlteredWorld:
    """A world whose sensor frames are changed on their way to the flight computer."""

    def __init__(self, world: SimulatedWorld, alter: Alter) -> None:
        self._world = world
        self._alter = alter
        self.scenario = world.scenario

    @property
    def finished(self) -> bool:
        return self._world.finished

    def step(self, command: ActuatorCommand) -> SensorFrame:
        return self._alter(self._world.step(command))

    def record(self) -> None:
        self._world.record()


class AltitudeHold(NamedTuple):
    """What was kept from the capture of a HOLD to its end."""

    duration: float
    """s"""
    altitude_rms: float
    """m"""
    course_rms: float
    """rad; course over ground"""


class Touchdown(NamedTuple):
    """The last moment before the first contact."""

    sink: float
    """m/s; positive down"""
    bank: float
    """rad"""


class Flight:
    """The messages of one flight, and measures of it."""

    def __init__(self, log: MemoryLog, mission: Mission) -> None:
        self.log = log
        self.mission = mission

    def of(self, topic: Topic) -> list[Any]:
        return self.log.messages[topic.name]

    def columns(self, topic: Topic) -> Mapping[str, Any]:
        return self.log.columns(topic)

    def events(self) -> list[str]:
        return [event.text for event in self.of(topics.EVENTS)]

    def event_time(self, text: str) -> float:
        """Time (s) of the first event that starts with this text."""
        times = [event.time_us * 1e-6 for event in self.of(topics.EVENTS) if event.text.startswith(text)]
        assert times, f"{text!r} not among {self.events()}"
        return float(times[0])

    @property
    def truth(self) -> Mapping[str, Any]:
        return self.columns(truth_topics.STATE)

    def true_attitude(self) -> tuple[Any, Any, Any]:
        """True roll, pitch and yaw (rad), one per truth message."""
        t = self.truth
        q = np.stack([t["quaternion_x"], t["quaternion_y"], t["quaternion_z"], t["quaternion_w"]], axis=1)
        yaw, pitch, roll = Rotation.from_quat(q).as_euler("ZYX").T
        return roll, pitch, yaw

    def air_time(self) -> tuple[float, float]:
        """Launch, and first contact or the end (s)."""
        time, ground = self.truth["time_us"] * 1e-6, self.truth["on_ground"]
        launched = int(np.argmin(ground))
        assert not ground[launched], "it was never launched"
        touched = np.flatnonzero(ground[launched:])
        return float(time[launched]), float(time[launched + touched[0] - 1] if len(touched) else time[-1])

    def touchdown(self) -> Touchdown:
        time, truth = self.truth["time_us"] * 1e-6, self.truth
        last = int(np.flatnonzero(time == self.air_time()[1])[0])
        assert last < len(time) - 1, "it was still in the air"
        return Touchdown(float(truth["v_down"][last]), float(self.true_attitude()[0][last]))

    def altitude(self) -> Any:
        """True altitude (m) above the altitude at boot, one per truth message."""
        return self.truth["down"][0] - self.truth["down"]

    def altitude_hold(self) -> AltitudeHold:
        """Of the mission's HOLD, from its capture to its end."""
        index = next(i for i, item in enumerate(self.mission) if item.kind == ItemKind.HOLD)
        wanted, navigation = self.mission[index], self.columns(topics.NAVIGATION)
        simulate = (navigation["item"] == index) & (navigation["stage"] == Stage.EN_ROUTE)
        begin, end = navigation["time_us"][simulate][[0, -1]]
        truth = self.truth
        inside = (truth["time_us"] >= begin) & (truth["time_us"] <= end)
        altitude_error = wanted.altitude - self.altitude()[inside]
        course = np.arctan2(truth["v_east"], truth["v_north"])[inside]
        course_error = (wanted.heading - course + np.pi) % (2 * np.pi) - np.pi
        captured = (np.abs(altitude_error) <= CAPTURE_ALTITUDE) & (np.abs(course_error) <= CAPTURE_HEADING)
        assert captured.any(), "the hold was never captured"
        first = int(np.argmax(captured))
        duration = (end - truth["time_us"][inside][first]) * 1e-6
        return AltitudeHold(float(duration), rms(altitude_error[first:]), rms(course_error[first:]))

    def attitude_error(self) -> tuple[float, float]:
        """RMS error (rad) of the estimated roll and pitch while flapping in the air."""
        attitude, wing = self.columns(topics.ATTITUDE), self.columns(topics.WING)
        launch, end = self.air_time()
        flapping = np.interp(attitude["time_us"], wing["time_us"], wing["flapping"]) == 1.0
        chosen = flapping & (attitude["time_us"] >= launch * 1e6) & (attitude["time_us"] <= end * 1e6)
        assert chosen.sum() > 1000
        times = attitude["time_us"][chosen]
        roll, pitch, _ = (np.interp(times, self.truth["time_us"], angle) for angle in self.true_attitude())
        return rms(attitude["roll"][chosen] - roll), rms(attitude["pitch"][chosen] - pitch)

    def airspeed_error(self) -> float:
        """RMS error (m/s) of the measured airspeed in the air."""
        air, (launch, end) = self.columns(topics.AIR_DATA), self.air_time()
        inside = (air["time_us"] >= launch * 1e6) & (air["time_us"] <= end * 1e6)
        true = np.interp(air["time_us"][inside], self.truth["time_us"], self.truth["airspeed"])
        return rms(air["airspeed"][inside] - true)

    def energy(self) -> tuple[float, float]:
        """Energy (J) drawn in the air as the power processor measured it, and as it was."""
        power, wing, (launch, end) = self.columns(topics.POWER), self.columns(truth_topics.WING), self.air_time()
        inside = (wing["time_us"] > launch * 1e6) & (wing["time_us"] <= end * 1e6)
        true = float(np.sum(wing["electrical_power"][inside])) * 0.005
        at_launch, at_end = np.interp((launch * 1e6, end * 1e6), power["time_us"], power["energy"])
        return float(at_end - at_launch), true


class Underway:
    """A flight that can be stopped, copied as it stands, and flown on with something failing."""

    def __init__(self, vehicle: str, scenario: Scenario, mission: Mission) -> None:
        self.log = MemoryLog()
        self.mission = mission
        self.world = SimulatedWorld(load_vehicle(vehicle), scenario, self.log.publish)
        self._autopilot = Autopilot(load_flight_vehicle(vehicle), mission, self.log.publish)
        self._command = NEUTRAL
        self._script = list(scripted_start())

    def until(self, seconds: float) -> None:
        """Fly on until that time since boot, or until the world is over."""
        while not self.world.finished and self.world.time_us < seconds * 1e6:
            frame = self.world.step(self._command)
            due = [command for command in self._script if command.time_us <= self.world.time_us]
            self._script = [command for command in self._script if command not in due]
            self._command = quantized_command(self._autopilot.step(frame, due))

    def branch(self, fault: Fault | None, commands: Sequence[Command] = ()) -> Underway:
        """The same flight, on which something may fail, with more commands."""
        twin = copy.deepcopy(self)
        if fault is not None:
            twin.world.faults.inject(fault)
            twin._script += fault_commands([fault])
        twin._script += commands
        return twin

    def flight(self) -> Flight:
        return Flight(self.log, self.mission)


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def unaltered(frame: SensorFrame) -> SensorFrame:
    return frame


def simulate(
    vehicle: str,
    scenario: Scenario,
    mission: str | Mission = "circuit",
    commands: Sequence[Command] = (),
    alter: Alter = unaltered,
    script: Sequence[Command] | None = None,
    avionics: str = "",
) -> Flight:
    """Fly in one process, as `wingbeat fly` does, with more commands and with sensors that fail.

    ``script`` stands for its scripted start, ``avionics`` for the flight computer's vehicle file.
    """
    log = MemoryLog()
    items = load_mission(mission) if isinstance(mission, str) else mission
    world = SimulatedWorld(load_vehicle(vehicle), scenario, log.publish)
    autopilot = Autopilot(load_flight_vehicle(avionics or vehicle), items, log.publish)
    fly(AlteredWorld(world, alter), autopilot, [*(scripted_start() if script is None else script), *commands])
    return Flight(log, items)


def differing(one: MemoryLog, other: MemoryLog, since_us: int = 0) -> list[str]:
    """Deterministic topics whose messages after ``since_us`` are not the same bit for bit."""

    def exact(log: MemoryLog, topic: Topic) -> str:
        # repr tells -0.0 from 0.0 and finds a nan equal to itself, as the bytes of a log do.
        return repr([message for message in log.messages[topic.name] if message.time_us > since_us])

    return [topic.name for topic in DETERMINISTIC if exact(one, topic) != exact(other, topic)]
