"""What many flights' logs give of the simulated vehicle, beside the truth; one flight's: `test_sitl_whole_flight`."""

from __future__ import annotations

import math
import sys
from multiprocessing import get_context

import numpy as np
import pytest
from identified import INPUTS_OVER, Result, identified
from memory_log import flown

from sim_bridge.flight.world import Scenario

VEHICLE = "robo_raven_ii_d"
SEEDS = range(1, 21)


def of_flight(seed: int) -> Result:
    return identified(VEHICLE, flown(VEHICLE, Scenario(seed=seed, duration=INPUTS_OVER)))


@pytest.mark.validate
def test_twenty_flights_cover_the_true_short_period() -> None:
    with get_context("spawn").Pool(2) as pool:
        results = pool.map(of_flight, SEEDS, chunksize=1)
    for index, method in enumerate(mode.method for mode in results[0].modes):
        table = [_row(result, index) for result in results]
        inside, half, ratio, damping = (np.array(column) for column in zip(*table, strict=True))
        sys.stdout.write(
            f"\n{method}: frequency inside {int(inside.sum())} of {len(results)}, half width {half.max():.1%},"
            f" at most, {np.median(half):.1%} median; {np.median(ratio) - 1:+.1%} +- {ratio.std():.1%};"
            f" damping off {np.median(np.abs(damping)):.3f} at the median\n"
        )
        assert inside.sum() >= 17
        assert half.max() <= 0.20
        assert np.median(np.abs(damping)) <= 0.05
    agreeing = sum(bool(result.agree) for result in results)
    sys.stdout.write(f"the two methods agree in {agreeing} of {len(results)}\n")
    assert agreeing >= 17


def _row(result: Result, index: int) -> tuple[bool, float, float, float]:
    mode, true = result.modes[index], result.true
    if mode.frequency is None or mode.damping is None:
        return False, math.inf, math.nan, math.nan
    frequency = mode.frequency
    inside = frequency.low <= true.natural_frequency <= frequency.high
    half = (frequency.high - frequency.low) / 2.0 / frequency.value
    return inside, half, frequency.value / true.natural_frequency, mode.damping.value - true.damping
