"""What `identify path` gives of simulated flights, beside what their IMU told too much."""

from __future__ import annotations

import sys
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
import pytest
from identified import known
from memory_log import simulate
from simulate import ARIZONA, RAVEN

from logs.identification.results import Estimate
from logs.identification.sources.flight_path import identify_path, imu_truths
from sim_bridge.flight.world import Scenario

DURATION = 100.0
"""s; the circuit with its inputs, where gusts did not put the launch off for long"""
KINDS = ((RAVEN, "none"), (RAVEN, "light"), (ARIZONA, "none"), (ARIZONA, "light"))
FLIGHTS = [(vehicle, level, 401 + 8 * kind + k) for kind, (vehicle, level) in enumerate(KINDS) for k in range(8)]
"""of seeds that nothing was chosen by, no IMU twice"""
RATES, FORCES = ("bias_p", "bias_q", "bias_r"), ("bias_a_x", "bias_a_y", "bias_a_z")


class Row(NamedTuple):
    """One number of one flight."""

    result: Estimate
    true: float

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return self.result.contains(self.true)


def of_flight(vehicle: str, level: str, seed: int) -> list[Row]:
    """Every error of the IMU in one flight, beside the truth."""
    log = simulate(vehicle, Scenario(seed=seed, duration=DURATION, turbulence=level))
    aircraft = known(vehicle)
    path = identify_path(log, aircraft)
    true = imu_truths(log, aircraft, path.spans)
    return [Row(one, true[one.name]) for one in path.result.estimates]


@pytest.mark.validate
def test_the_imus_errors_are_held_in_flights_of_both_vehicles_and_in_gusts() -> None:
    """85 % of the intervals of every error, 90 of gyros and accelerometers each; all flights give all numbers."""
    with get_context("spawn").Pool(2) as pool:
        rows = [row for each in pool.starmap(of_flight, FLIGHTS, chunksize=1) for row in each]
    assert len(rows) == len(FLIGHTS) * len(RATES + FORCES)
    by_name = {name: [row for row in rows if row.result.name == name] for name in RATES + FORCES}
    shares = {name: float(np.mean([row.inside for row in each])) for name, each in by_name.items()}
    halves = {
        name: float(np.median([r.result.high - r.result.value for r in each])) for name, each in by_name.items()
    }
    for name, share in shares.items():
        sys.stdout.write(f"{name}: {100 * share:.0f} % of {len(FLIGHTS)} held, half interval {halves[name]:.2g}\n")
    assert min(shares.values()) >= 0.85
    assert min(np.mean([shares[name] for name in names]) for names in (RATES, FORCES)) >= 0.90
    assert max(halves["bias_p"], halves["bias_q"]) < 0.0015 and halves["bias_r"] < 0.002
    assert max(halves["bias_a_x"], halves["bias_a_y"]) < 0.15 and halves["bias_a_z"] < 0.03
