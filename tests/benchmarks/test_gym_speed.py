"""Speed of a batch of vehicles, beside processes with one environment each (``make bench``)."""

from __future__ import annotations

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


def flight_rate(env: Any, vehicles: int) -> float:
    """Return the seconds of flight per second of wall time, of the best round."""
    actions = np.zeros((vehicles, 4), np.float32)
    env.reset(seed=1)
    env.step(actions)
    walls = []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        for _ in range(STEPS):
            env.step(actions)
        walls.append(time.perf_counter() - begun)
    return vehicles * STEPS * STEP / min(walls)


@pytest.mark.bench
def test_batch_of_vehicles_beside_processes() -> None:
    """64 vehicles in gusts, physics at 1 kHz, launches not counted; required on two cores, by wall time.

    The peer is Gymnasium's `AsyncVectorEnv` of the single environment, whose flight computer is in the loop.
    """
    batch = gymnasium.make_vec(ID, num_envs=VEHICLES, launches=4, turbulence="light", handover=0.6)
    rate = flight_rate(batch, VEHICLES)
    batch.close()
    processes = gymnasium.make_vec(
        ID, num_envs=PROCESSES, vectorization_mode="async", launches=4, turbulence="light", handover=0.6
    )
    beside = flight_rate(processes, PROCESSES)
    processes.close()
    sys.stdout.write(f"{rate:.0f} s of flight a second, peer {beside:.0f}\n")
    leave(
        Row(
            f"vector environment, {VEHICLES} vehicles, physics at 1 kHz", rate, beside,
            "s of flight a second", f"{peer('gymnasium')}, AsyncVectorEnv, {PROCESSES} processes",
            f"at least {BIRD_SECONDS:g}",
        )
    )  # fmt: skip
    assert rate >= BIRD_SECONDS
