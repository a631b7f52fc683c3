"""Robo Raven in the vortex lattice for 10 s: how fast, and how much memory."""

from __future__ import annotations

import math
import resource
import sys
import time

import numpy as np
import pytest
from rows import Row, leave

from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant
from sim_bridge.vehicles import load_vehicle, with_model

pytestmark = pytest.mark.bench

SECONDS, TICK, REAL_TIME = 10.0, 0.005, 0.2


def test_ten_seconds_of_flapping_flight_keep_a_fifth_of_real_time_and_no_memory() -> None:
    plant = Plant(with_model(load_vehicle("robo_raven_ii_d"), "vortex_lattice"))
    plant.y[2], plant.y[7] = -100.0, 6.8
    around = k.Surroundings(0.0, 0.0, 0.0, 1.225, k.HELD, 0.0, 0.0, 0.0)

    def fly(seconds: float) -> float:
        begun = time.perf_counter()
        for tick in range(round(seconds / TICK)):
            start, end = (0.2 + 0.3 * math.sin(8.0 * math.pi * TICK * (tick + i)) for i in (0, 1))
            plant.advance(k.Controls(start, end, start, end, 0.0, 0.0, 0.0, TICK, 1.0), around)
        return time.perf_counter() - begun

    fly(1.0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    halves = [fly(SECONDS / 2) for _ in range(2)]
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    sys.stdout.write(
        f"\n{SECONDS:g} s in {sum(halves):.2f} s: {SECONDS / sum(halves):.1f} times real time, the second half"
        f" {halves[1] / halves[0]:.2f} times as long as the first, {grown / 1024:.1f} MB grown\n"
    )
    speed, requested = SECONDS / sum(halves), f"at least {REAL_TIME:g}"
    leave(Row("coupled flight, vortex lattice, 10 s", speed, None, "times real time", requested=requested))
    assert np.all(np.isfinite(plant.y))
    assert SECONDS / sum(halves) > REAL_TIME
    assert grown < 20 * 1024
