"""Speed of a batch of vehicles, beside processes with one environment each (``make bench``)."""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import numpy as np
import pytest
from rows import Row, leave, peer

gymnasium = pytest.importorskip("gymnasium")
ID = "wingbeat.gym:wingbeat/Flapping-v0"
VEHICLES, PROCESSES = 64, 2
STEPS, STEP = 50, 0.02
"""-; steps of one round; s of flight in a step"""
ROUNDS = 5
BIRD_SECONDS = 250.0
"""s; of flight that 64 vehicles must fly in a second on two cores"""


def flight_rate(env: Any, vehicles: int) -> tuple[float, float]:
    """Return the seconds of flight per second of wall time and per second of processor time, of the best rounds."""
    actions = np.zeros((vehicles, 4), np.float32)
    env.reset(seed=1)
    env.step(actions)
    walls, times = [], []
    for _ in range(ROUNDS):
        wall, used = time.perf_counter(), time.process_time()
        for _ in range(STEPS):
            env.step(actions)
        walls.append(time.perf_counter() - wall)
        times.append(time.process_time() - used)
    flown = vehicles * STEPS * STEP
    return flown / min(walls), flown / min(times)


@pytest.mark.bench
def test_batch_of_vehicles_beside_processes() -> None:
    """64 vehicles in gusts, physics at 1 kHz, launches not counted; required on two cores, by processor time.

    The peer is Gymnasium's `AsyncVectorEnv` of the single environment, whose flight computer is in the loop.
    """
    batch = gymnasium.make_vec(ID, num_envs=VEHICLES, launches=4, turbulence="light", handover=0.6)
    wall, processor = flight_rate(batch, VEHICLES)
    batch.close()
    processes = gymnasium.make_vec(
        ID, num_envs=PROCESSES, vectorization_mode="async", launches=4, turbulence="light", handover=0.6
    )
    beside, _ = flight_rate(processes, PROCESSES)
    processes.close()
    two_cores = processor * min(2, os.cpu_count() or 1)
    sys.stdout.write(f"wall time {wall:.0f}, by processor time on two cores {two_cores:.0f}, peer {beside:.0f}\n")
    leave(
        Row(
            f"vector environment, {VEHICLES} vehicles, physics at 1 kHz", max(wall, two_cores), beside,
            "s of flight a second", f"{peer('gymnasium')}, AsyncVectorEnv, {PROCESSES} processes",
            f"at least {BIRD_SECONDS:g}",
        )
    )  # fmt: skip
    assert max(wall, two_cores) >= BIRD_SECONDS
