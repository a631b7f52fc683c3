"""How fast a flight is flown: the parts in one process, and the lockstep pair with logging (``make bench``)."""

from __future__ import annotations

import copy
import itertools
import json
import math
import subprocess
import sys
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from rows import Row, leave

from avionics.autopilot import Autopilot
from avionics.messages import ActuatorCommand, Command, SensorFrame
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.outline import shape_of
from logs.recorder import McapRecorder
from logs.scene import SceneRecorder
from sim_bridge import plant_kernel as k
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle, with_model

VEHICLE = "robo_raven_ii_d"
PART = 40.0
"""s; of flight time in which the parts are timed"""
REAL_TIME = 12.0
"""-; what the lockstep flight with logging must reach"""
LOGGED_TIME, UNLOGGED_TIME = 18.0, 22.0
"""-; what a flight in one process must reach on its core, with logging and without"""


REALTIME = "times real time"


def send(line: str) -> None:
    sys.stdout.write(line + "\n")


FLIGHTS = 4
"""-; of the same seed: what a tick takes is the least of them, the rest is what else the machine did"""
AGAIN = 3
"""-; times that a flight computer is given the frames of each flight alone: a world in its caches makes it slower"""
MEDIAN_TICK = 80.0
"""us; of processor time, asked of the flight computer's tick at the median of a flight"""
LATE_TICK = 300.0
"""us; asked at the 99th percentile"""


class Parts:
    """A flight, and the processor time in us of each tick's parts; the garbage collector as the command runs it."""

    def __init__(self) -> None:
        """Fly it."""
        self.frames: list[tuple[SensorFrame, list[Command]]] = []
        self.worlds: list[float] = []
        self.computers: list[float] = []
        world, autopilot = SimulatedWorld(load_vehicle(VEHICLE), Scenario(duration=PART)), computer()
        script, command, begun = list(scripted_start()), NEUTRAL, time.perf_counter()
        while not world.finished:
            start = time.thread_time_ns()
            frame = world.step(command)
            due = [entry for entry in script if entry.time_us <= frame.time_us]
            between = time.thread_time_ns()
            command = autopilot.step(frame, due)
            self.computers.append(1e-3 * (time.thread_time_ns() - between))
            self.worlds.append(1e-3 * (between - start))
            self.frames.append((frame, due))
            script = script[len(due) :]
        self.wall = time.perf_counter() - begun

    def again(self) -> list[float]:
        """us; the flight computer's ticks without a world that shares its caches."""
        autopilot, clock, ticks = computer(), time.thread_time_ns, []
        for frame, due in self.frames:
            begun = clock()
            autopilot.step(frame, due)
            ticks.append(1e-3 * (clock() - begun))
        return ticks


def computer() -> Autopilot:
    return Autopilot(load_flight_vehicle(VEHICLE), load_mission("circuit"), lambda topic, message: None)


def report(what: str, ticks: list[list[float]], requested: str = "") -> tuple[float, float]:
    """Say and return the median and the 99th percentile in us of the least time of each tick."""
    median, late = np.percentile(np.min(ticks, axis=0), (50.0, 99.0))
    send(f"{what:24} {median:6.0f} us a tick at the median, {late:6.0f} us at the 99th percentile{requested}")
    return float(median), float(late)


@pytest.mark.bench
def test_the_parts_of_a_tick() -> None:
    flights, alone = [], []
    for _ in range(FLIGHTS):
        flights.append(Parts())
        alone += [flights[-1].again() for _ in range(AGAIN)]
        flights[-1].frames.clear()
    report("world, 5 steps of 1 ms", [flight.worlds for flight in flights])
    report("flight computer, with it", [flight.computers for flight in flights])
    median, late = report("flight computer alone", alone, f" (asked: {MEDIAN_TICK:g}, {LATE_TICK:g})")
    mean = float(np.mean(np.min(alone, axis=0)))
    leave(Row("flight computer's tick, mean", mean, None, "us"))
    leave(Row("flight computer's tick, median", median, None, "us", requested=f"at most {MEDIAN_TICK:g}"))
    leave(Row("flight computer's tick, 99th percentile", late, None, "us", requested=f"at most {LATE_TICK:g}"))
    assert median <= MEDIAN_TICK
    assert late <= LATE_TICK


PLANT_REAL_TIME = 75.0
"""-; what Robo Raven's coupled physics must reach alone, strip theory, 1 kHz, one core"""


@pytest.mark.bench
@pytest.mark.parametrize("model", ["strip_theory", "quasi_steady", "blade_element"])
def test_the_coupled_physics_alone(model: str) -> None:
    """Bodies, wings, air and drives in flapping flight: eight times two seconds, the best counts."""
    plant = Plant(with_model(load_vehicle(VEHICLE), model))
    start, around = plant.y.copy(), k.Surroundings(0.0, 0.0, 0.0, 1.225, k.FREE, 0.0, 0.0, 0.0)
    start[2], start[7] = -500.0, 7.0
    angles = [0.2 + 0.4 * math.sin(2.0 * math.pi * 4.0 * tick / 200.0) for tick in range(401)]
    ticks = [k.Controls(a, b, a, b, 0.5, 0.0, 0.0, 0.005, 1.0) for a, b in itertools.pairwise(angles)]
    plant.follow(ticks[:1], around)  # compiled
    best = math.inf
    for _ in range(8):
        plant.y[:] = start
        begun = time.perf_counter()
        plant.follow(ticks, around)
        best = min(best, time.perf_counter() - begun)
    needed = f" (needed: {PLANT_REAL_TIME:g})" if model == "strip_theory" else ""
    send(f"physics, {model:15} {2.0 / best:6.1f} times real time on one core{needed}")
    requested = f"at least {PLANT_REAL_TIME:g}" if needed else ""
    leave(Row(f"physics alone, {model}", 2.0 / best, None, REALTIME, requested=requested))
    assert np.all(np.isfinite(plant.y))
    assert model != "strip_theory" or 2.0 / best >= PLANT_REAL_TIME


@pytest.mark.bench
@pytest.mark.parametrize(("vibration", "needed"), [(0.0, 110.0), (1.0, 100.0)], ids=["calm", "vibration"])
def test_the_world_with_gusts_and_sensors(vibration: float, needed: float) -> None:
    """Launched and flapping, sensor frames at 200 Hz, no recorder: sixteen times four seconds, the best counts."""
    scenario = Scenario(turbulence="light", launch_time=0.5, vibration=vibration)
    world = SimulatedWorld(load_vehicle(VEHICLE), scenario)
    commands = [
        ActuatorCommand(0, angle, angle, 0.0, 0.0, 0.0, 1)
        for angle in (0.2 + 0.4 * math.sin(2.0 * math.pi * 4.0 * tick / 200.0) for tick in range(800))
    ]
    while not world.launched or world.time_us < 1_500_000:
        world.step(commands[0])
    start, best = copy.deepcopy(world), math.inf
    for _ in range(16):
        world = copy.deepcopy(start)
        world.plant.y[2] = -500.0
        begun = time.process_time()
        for command in commands:
            world.step(command)
        best = min(best, time.process_time() - begun)
        assert np.all(np.isfinite(world.plant.y))
    what = f"world with gusts and sensors, {'with' if vibration else 'without'} vibration"
    send(f"{what} {4.0 / best:6.1f} times real time on one core (needed: {needed:g})")
    leave(Row(what, 4.0 / best, None, REALTIME, requested=f"at least {needed:g}"))
    assert 4.0 / best >= needed


@pytest.mark.bench
@pytest.mark.parametrize("logged", [True, False], ids=["logging", "no logging"])
def test_a_flight_in_one_process(logged: bool, tmp_path: Path) -> None:
    """World, wire's rounding and flight computer, a log as campaigns keep it or none: processor time of the best.

    In a process of its own, as a campaign's worker is: beside what other benchmarks have loaded here a flight took 8
    to 9 % longer.
    """
    needed = LOGGED_TIME if logged else UNLOGGED_TIME
    with get_context("spawn").Pool(1) as pool:
        best = pool.apply(quickest, (tmp_path if logged else None,))
    what = "in one process, logging" if logged else "in one process, no log"
    send(f"{what:24} {PART / best:6.1f} times real time (needed: {needed:g})")
    ONE_PROCESS[logged] = PART / best
    leave(Row(f"flight {what}", PART / best, None, REALTIME, requested=f"at least {needed:g}"))
    assert PART / best >= needed


ONE_PROCESS: dict[bool, float] = {}
"""times real time of this run, by whether it was recorded"""


def quickest(logs: Path | None) -> float:
    """Processor time in s of the quickest of some flights of `PART`, each with a log in the folder ``logs``."""
    times = []
    for turn in range(FLIGHTS):
        begun = time.process_time()
        fly_once(None if logs is None else logs / f"{turn}.mcap")
        times.append(time.process_time() - begun)
    return min(times)


def fly_once(log: Path | None) -> None:
    vehicle, scenario = load_vehicle(VEHICLE), Scenario(duration=PART)
    if log is None:
        fly(SimulatedWorld(vehicle, scenario), computer(), scripted_start())
        return
    with McapRecorder(log) as recorder:
        publish = SceneRecorder(recorder, shape_of(vehicle), recorder.start_epoch_ns).record
        flying = Autopilot(load_flight_vehicle(VEHICLE), load_mission("circuit"), publish)
        fly(SimulatedWorld(vehicle, scenario, publish), flying, scripted_start())


def simulate(log: Path, *words: str) -> tuple[float, float]:
    """Flight time and wall time in s of ``wingbeat fly``."""
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--json", "--log", str(log), *words]
    ran = subprocess.run(command, check=True, capture_output=True, text=True)
    document = json.loads(ran.stdout)
    return document["speed"] * document["wall_time"], document["wall_time"]


@pytest.mark.bench
def test_the_lockstep_flight_with_logging(tmp_path: Path) -> None:
    """The whole command: two processes, MAVLink over TCP, two recorders; what starting them takes is taken off."""
    simulate(tmp_path / "warm.mcap", "--duration", "10")
    short, starting = simulate(tmp_path / "short.mcap", "--duration", "10")
    whole, wall = simulate(tmp_path / "whole.mcap")
    speed = (whole - short) / (wall - starting)
    send(f"lockstep pair, logging   {speed:6.1f} times real time (needed: {REAL_TIME:g})")
    send(f"  with starting          {whole / wall:6.1f}")
    limit = ONE_PROCESS.get(True)
    requested = f"at least {REAL_TIME:g}"
    leave(Row("lockstep pair over MAVLink, logging", speed, limit, REALTIME, "in one process, logging", requested))
    assert speed >= REAL_TIME
