"""What a flight's log gives of the simulated vehicle, beside the truth."""

from __future__ import annotations

import math
import sys
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
import pytest
from memory_log import MemoryLog, flown

from avionics import topics
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.identification.data import Aircraft
from logs.identification.report import identify
from logs.identification.short_period import Mode
from sim_bridge import topics as truth_topics
from sim_bridge.flight.world import Scenario
from sim_bridge.flight_mechanics.averaged import ShortPeriod, short_period_of, stroke_averaged_model
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.vehicles import load_vehicle

VEHICLE = "robo_raven_ii_d"
SEEDS = range(1, 21)
INPUTS_OVER = 83.0
"""s; the circuit's doublets are flown by then"""


class Result(NamedTuple):
    seed: int
    true: ShortPeriod
    modes: tuple[Mode, ...]
    agree: bool | None
    torque: dict[str, tuple[float, float, float]]


def true_short_period(log: MemoryLog) -> ShortPeriod:
    """Of the vehicle linearised about the mean true flight condition of the inputs."""
    excitation, state = log.columns(topics.EXCITATION), log.columns(truth_topics.STATE)
    active = excitation["time_us"][excitation["active"] > 0]
    during = (state["time_us"] >= active[0]) & (state["time_us"] <= active[-1])
    airspeed, climb = float(state["airspeed"][during].mean()), -float(state["v_down"][during].mean())
    vehicle = load_vehicle(VEHICLE)
    return short_period_of(stroke_averaged_model(vehicle, trim(vehicle, airspeed, climb)))


def identified(seed: int) -> Result:
    log = flown(VEHICLE, Scenario(seed=seed, duration=INPUTS_OVER))
    airframe = load_flight_vehicle(VEHICLE).airframe
    found = identify(log, "all", Aircraft(airframe.imu_x, airframe.imu_z, airframe.tail_time_constant))
    assert found.modes is not None
    assert found.torque is not None
    torque = {e.name: (e.value, e.low, e.high) for e in found.torque.estimates}
    return Result(seed, true_short_period(log), found.modes.modes, found.modes.agree, torque)


def test_the_circuits_doublets_give_the_short_period_and_the_torque_constants() -> None:
    result = identified(1)
    for mode in result.modes:
        assert mode.frequency is not None
        assert mode.damping is not None
        assert mode.frequency.low <= result.true.natural_frequency <= mode.frequency.high
        assert mode.frequency.high - mode.frequency.low <= 0.4 * mode.frequency.value
        assert mode.damping.value == pytest.approx(result.true.damping, abs=0.08)
    assert result.agree
    drive = load_vehicle(VEHICLE).drive
    for name, true in (("K_tau", drive.torque_constant), ("K_tau0", drive.torque_offset)):
        _, low, high = result.torque[name]
        assert low <= true <= high


@pytest.mark.validate
def test_twenty_flights_cover_the_true_short_period() -> None:
    with get_context("spawn").Pool(2) as pool:
        results = pool.map(identified, SEEDS, chunksize=1)
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
