"""Flights in gusts: launch, a triangle, home, landing; wind, throw and sensors are drawn by a seed.

One by hand, from `tests/sitl`: ``python gusts.py LEVEL SEED...`` prints a line for each.
"""

from __future__ import annotations

import math
import os
import random
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np
from simulate import RAVEN, Flight, simulate

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.messages import Stage
from avionics.vehicles import load_vehicle
from sim_bridge.flight.world import Scenario, Throw

SEEDS = range(1, 201)
"""of the 200 flights of every level"""
STRONGEST = 4.0
"""m/s; mean wind, from any side"""
THROW = 0.3
"""-; either way, of the launch speed"""
TILT = math.radians(15.0)
"""rad; either way, of the launch pitch and bank"""
SIGMAS = 2.0
"""-; standard deviations of the data sheets by which every bias and scale factor is off"""
SINK, BANK = 2.0, math.radians(30.0)
"""m/s and rad; a touchdown beyond them is a crash"""
LONGEST = 600.0
"""s; who has not landed by then is lost: 300 s of flight, and as long as the launcher may wait for a lull to end"""
TRIANGLE = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.WAYPOINT, north=60.0, east=0.0, altitude=40.0),
    MissionItem(ItemKind.WAYPOINT, north=60.0, east=60.0, altitude=40.0),
    MissionItem(ItemKind.RETURN),
)


class Outcome(NamedTuple):
    """What became of a flight."""

    level: str
    seed: int
    lost: str
    """why it counts as lost; empty when it came home"""
    sink: float
    """m/s; at the touchdown"""
    bank: float
    """rad; at the touchdown"""
    duration: float
    """s; in the air"""

    @property
    def line(self) -> str:
        word = f"LOST: {self.lost}" if self.lost else "home"
        return (
            f"{self.level} {self.seed:3d}: {word}; {self.duration:.0f} s, "
            f"sink {self.sink:.2f} m/s, bank {math.degrees(self.bank):.0f} deg"
        )


def scenario(level: str, seed: int) -> Scenario:
    """Wind, throw and sensors of one flight in gusts of a ``level``."""
    draw = random.Random(seed)
    return Scenario(
        seed=seed,
        wind_speed=draw.uniform(0.0, STRONGEST),
        wind_from=draw.uniform(-math.pi, math.pi),
        turbulence=level,
        duration=LONGEST,
        throw=Throw(
            1.0 + draw.uniform(-THROW, THROW), pitch=draw.uniform(-TILT, TILT), bank=draw.uniform(-TILT, TILT)
        ),
        sensor_corner=SIGMAS,
    )


def outcome(level: str, seed: int, vehicle: str = RAVEN) -> Outcome:
    """Fly and judge one flight."""
    flight = simulate(vehicle, scenario(level, seed), TRIANGLE)
    begun, ended = flight.air_time()
    at = int(np.flatnonzero(flight.truth["time_us"] * 1e-6 == ended)[0])
    sink, bank = float(flight.truth["v_down"][at]), float(abs(flight.true_attitude()[0][at]))
    return Outcome(level, seed, lost(flight, vehicle, at), sink, bank, ended - begun)


def lost(flight: Flight, vehicle: str, at: int) -> str:
    """Why a flight counts as lost whose last moment in the air is the truth's row ``at``; empty when it does not."""
    truth = flight.truth
    if not all(np.isfinite(truth[name]).all() for name in ("north", "east", "down", "quaternion_w")):
        return "not a number"
    fence = load_vehicle(vehicle).gains.modes
    away = np.hypot(truth["north"], truth["east"]).max()
    if away > fence.fence_radius or flight.altitude().max() > fence.fence_altitude:
        return f"out of the fence, {away:.0f} m away"
    if at == len(truth["down"]) - 1:
        return "still in the air"
    stage = _stage(flight, int(truth["time_us"][at]))
    if stage not in (Stage.APPROACH, Stage.FLARE):
        return f"on the ground in {Stage(stage).name}"
    sink, bank = truth["v_down"][at], abs(flight.true_attitude()[0][at])
    hard = sink > SINK or bank > BANK
    return f"touchdown with {sink:.1f} m/s and {math.degrees(bank):.0f} deg" if hard else ""


def _stage(flight: Flight, time_us: int) -> int:
    navigation: Any = flight.columns(topics.NAVIGATION)
    return int(navigation["stage"][np.searchsorted(navigation["time_us"], time_us) - 1])


def outcomes(level: str, seeds: Iterable[int]) -> Iterator[Outcome]:
    """Of every seed, flown on all cores."""
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn"), max_tasks_per_child=25) as pool:
        yield from pool.map(partial(outcome, level), seeds)


def summary(flights: Sequence[Outcome]) -> str:
    """How many are lost, of what."""
    reasons = Counter(" ".join(flight.lost.split()[:3]).rstrip(",") for flight in flights if flight.lost)
    told = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common()) or "none"
    return f"{len(flights)} flights in {flights[0].level} gusts, lost {sum(reasons.values())}: {told}"


if __name__ == "__main__":
    for number in sys.argv[2:]:
        sys.stdout.write(outcome(sys.argv[1], int(number)).line + "\n")
        sys.stdout.flush()
