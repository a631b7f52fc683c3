"""How fast a flight is flown: the parts in one process, and the lockstep pair with logging (``make bench``)."""

from __future__ import annotations

import itertools
import json
import math
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from avionics.autopilot import Autopilot
from avionics.missions import load_mission
from avionics.vehicles import load_vehicle as load_flight_vehicle
from groundstation.command.onboard import scripted_start
from sim_bridge import plant_kernel as k
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle, with_model

VEHICLE = "robo_raven_ii_d"
PART = 40.0
"""s; of flight time in which the parts are timed"""
REAL_TIME = 5.0
"""-; what the lockstep flight with logging must reach"""


def say(line: str) -> None:
    sys.stdout.write(line + "\n")


@pytest.mark.bench
def test_the_parts_of_a_tick() -> None:
    world = SimulatedWorld(load_vehicle(VEHICLE), Scenario(duration=PART))
    autopilot = Autopilot(load_flight_vehicle(VEHICLE), load_mission("circuit"), lambda topic, message: None)
    script, command = list(scripted_start()), NEUTRAL
    worlds, computers = [], []
    while not world.finished:
        begun = time.perf_counter()
        frame = world.step(command)
        between = time.perf_counter()
        due = [entry for entry in script if entry.time_us <= frame.time_us]
        script = script[len(due) :]
        command = autopilot.step(frame, due)
        worlds.append(between - begun)
        computers.append(time.perf_counter() - between)
    for what, times in (("world, 5 steps of 1 ms", worlds), ("flight computer", computers)):
        ordered = sorted(times)
        median, late = statistics.median(ordered), ordered[int(0.99 * len(ordered))]
        say(f"{what:24} {median * 1e6:6.0f} us a tick at the median, {late * 1e6:6.0f} us at the 99th percentile")
    say(f"both in one process      {PART / (sum(worlds) + sum(computers)):6.1f} times real time")


PLANT_REAL_TIME = 60.0
"""-; what the coupled physics of Robo Raven alone must reach, strip theory, 1 kHz, one core"""


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
    say(f"physics, {model:15} {2.0 / best:6.1f} times real time on one core{needed}")
    assert np.all(np.isfinite(plant.y))
    assert model != "strip_theory" or 2.0 / best >= PLANT_REAL_TIME


def flown(log: Path, *words: str) -> tuple[float, float]:
    """Flight time and wall time in s of ``wingbeat fly``."""
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--json", "--log", str(log), *words]
    ran = subprocess.run(command, check=True, capture_output=True, text=True)
    document = json.loads(ran.stdout)
    return document["speed"] * document["wall_time"], document["wall_time"]


@pytest.mark.bench
def test_the_lockstep_flight_with_logging(tmp_path: Path) -> None:
    """The whole command: two processes, MAVLink over TCP, two recorders; what starting them takes is taken off."""
    flown(tmp_path / "warm.mcap", "--duration", "10")
    short, starting = flown(tmp_path / "short.mcap", "--duration", "10")
    whole, wall = flown(tmp_path / "whole.mcap")
    speed = (whole - short) / (wall - starting)
    say(f"lockstep pair, logging   {speed:6.1f} times real time (needed: {REAL_TIME:g})")
    say(f"  with starting          {whole / wall:6.1f}")
    assert speed >= REAL_TIME
