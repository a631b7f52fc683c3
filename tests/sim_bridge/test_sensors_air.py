from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensors_bench import SPEC, cruise, quiet, variance_bounds

from sim_bridge.sensors.barometer import Barometer
from sim_bridge.sensors.encoder import Counter, Encoder, EncoderSpec
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.pitot import Pitot
from sim_bridge.sensors.torque_cell import TorqueCell

SEED = sensor_seed(3, 0)
PASCALS_PER_COUNT = 2.0 * 248.84 / (14746 - 1638)


def pitot_at_rest(**changes: float) -> Pitot:
    return Pitot(quiet(SPEC.pitot)._replace(time_constant=0.0, **changes), SEED, 0.005)


def counts_at(pitot: Pitot, v_air: tuple[float, float, float]) -> int:
    pitot.sense(v_air, 1.225)
    return pitot.read()


def test_pitot_reads_the_impact_pressure() -> None:
    counts = counts_at(pitot_at_rest(), (10.0, 0.0, 0.0))
    pressure = (counts - 1638) * PASCALS_PER_COUNT - 248.84
    assert pressure == pytest.approx(0.5 * 1.225 * 100.0, abs=0.5 * PASCALS_PER_COUNT)


def test_pitot_range_ends_are_10_and_90_percent_and_the_word_saturates() -> None:
    at_range = math.sqrt(2.0 * 248.84 / 1.225)
    pitot = pitot_at_rest()
    assert counts_at(pitot, (0.0, 0.0, 0.0)) == 8192
    assert counts_at(pitot, (at_range, 0.0, 0.0)) == 14746
    assert counts_at(pitot, (-at_range, 0.0, 0.0)) == 1638
    assert counts_at(pitot, (60.0, 0.0, 0.0)) == 16383
    assert counts_at(pitot, (-60.0, 0.0, 0.0)) == 0


def test_pitot_sees_only_the_flow_along_the_tube() -> None:
    angle = 0.3
    flow = (8.0 * math.cos(angle), 3.0, 8.0 * math.sin(angle))
    along = counts_at(pitot_at_rest(), (8.0, 0.0, 0.0))
    assert counts_at(pitot_at_rest(incidence_deg=-math.degrees(angle)), flow) == along
    assert counts_at(pitot_at_rest(), flow) < along


def test_pitot_noise_is_a_fifth_of_a_metre_per_second_at_cruise() -> None:
    pitot = Pitot(SPEC.pitot, SEED, 0.005)
    samples = 20000
    pitot.sense((7.75, 0.0, 0.0), 1.225)
    pressure = np.array([pitot.read() for _ in range(samples)]) * PASCALS_PER_COUNT
    low, high = variance_bounds(samples, (1.225 * 7.75 * 0.2) ** 2)
    assert low < np.var(pressure, ddof=1) < high


def test_air_column_lags() -> None:
    pitot = Pitot(quiet(SPEC.pitot)._replace(time_constant=0.05), SEED, 0.005)
    rest = counts_at(pitot, (0.0, 0.0, 0.0))
    pitot.sense((10.0, 0.0, 0.0), 1.225)
    for _ in range(10):
        pitot.sense((10.0, 0.0, 0.0), 1.225)
    lagging = pitot.read() - rest
    full = counts_at(pitot_at_rest(), (10.0, 0.0, 0.0)) - rest
    # Ten ticks are one time constant; the ramp of the first tick adds about half a tick.
    assert lagging / full == pytest.approx(1.0 - math.exp(-1.05), abs=0.02)


def test_barometer_counts_hundredths() -> None:
    barometer = Barometer(quiet(SPEC.barometer), SEED, 0.02)
    assert barometer.read(100613.004, 287.756) == (10061300, 28776)


@pytest.mark.parametrize(("pressure", "counts"), [(500.0, 100000), (130000.0, 12000000)])
def test_barometer_saturates(pressure: float, counts: int) -> None:
    assert Barometer(quiet(SPEC.barometer), SEED, 0.02).read(pressure, 288.0)[0] == counts


def test_barometer_noise() -> None:
    samples = 20000
    barometer = Barometer(SPEC.barometer._replace(drift_sigma=0.0), SEED, 0.02)
    readings = np.array([barometer.read(1e5, 288.0) for _ in range(samples)]) * 0.01
    low, high = variance_bounds(samples, 3.0**2)
    assert low < np.var(readings[:, 0], ddof=1) < high
    low, high = variance_bounds(samples, 0.02**2 + 0.01**2 / 12.0)
    assert low < np.var(readings[:, 1], ddof=1) < high
    assert readings[:, 0].mean() == pytest.approx(1e5 + barometer.errors.pressure, abs=0.1)


def test_barometer_drift_starts_at_nothing_and_settles_to_its_sigma() -> None:
    spec = quiet(SPEC.barometer)._replace(drift_sigma=5.0, drift_time_constant=10.0)
    early, late = [], []
    for seed in range(300):
        barometer = Barometer(spec, sensor_seed(seed, 4), 1.0)
        drift = [barometer.read(1e5, 288.0)[0] * 0.01 - 1e5 for _ in range(60)]
        early.append(drift[0])
        late.append(drift[-1])
    low, high = variance_bounds(300, 25.0 * (1.0 - math.exp(-0.2)))
    assert low < np.mean(np.square(early)) < high
    low, high = variance_bounds(300, 25.0)
    assert low < np.mean(np.square(late)) < high


def test_encoder_counts_edges_of_a_2000_count_turn() -> None:
    encoder = Encoder(EncoderSpec(2000, 0.0, 0.0, 0.15, 0.15), sensor_seed(1, 11))
    step = math.tau / 2000
    assert encoder.read(0.5 * step, -0.5 * step)[:2] == (0, -1)
    assert encoder.read(10.5 * step, -10.5 * step)[:2] == (10, -11)
    assert encoder.read(math.tau + 1e-9, 0.0)[:2] == (2000, 0)


def test_encoder_zero_moves_the_counts() -> None:
    encoder = Encoder(EncoderSpec(2000, 100.0, -37.5, 0.15, 0.15), sensor_seed(1, 11))
    assert encoder.read(1e-9, 1e-9)[:2] == (100, -38)


def test_a_magnetic_encoder_has_its_noise_and_that_of_a_count() -> None:
    encoder = Encoder(EncoderSpec(4096, 0.0, 0.0, 3.1, 3.1, noise=2.0), sensor_seed(1, 11))
    readings = np.array([encoder.read(0.0, 0.3)[:2] for _ in range(3000)])
    low, high = variance_bounds(3000, 4.0 + 1.0 / 12.0)
    for side in (0, 1):
        assert low < np.var(readings[:, side]) < high
    assert abs(np.corrcoef(readings.T)[0, 1]) < 0.1


def test_index_latches_the_same_count_from_below_and_from_above() -> None:
    """GIVEN an index at 0.15 rad (count 48 of a zero at 0.3) THEN each passage latches 48, nothing else does."""
    counter = Counter(2000, 0.3, 0.15)
    angles = [0.0, 0.1, 0.14, 0.2, 0.3, 0.16, 0.1, -0.2, 0.14, 0.151, 0.149]
    seen = [counter.read(angle)[1:] for angle in angles]
    assert seen == [(0, 0)] * 3 + [(48, 1)] * 3 + [(48, 2)] * 3 + [(48, 3)] * 2


def test_index_tells_what_the_counter_missed() -> None:
    counter = Counter(2000, 0.0, 0.15)
    counter.read(0.0)
    assert counter.read(0.3) == (95, 47, 1)
    counter.lose(7)
    assert counter.read(0.3) == (88, 47, 1)
    assert counter.read(0.0) == (-7, 40, 2)


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=40))
def test_index_pulses_once_for_every_passage_of_its_place(angles: list[float]) -> None:
    counter = Counter(2000, 0.0, 0.15)
    places = [math.floor(angle * 2000 / math.tau) for angle in angles]
    passed = sum((a < 47) != (b < 47) if 47 not in (a, b) else a != b == 47 for a, b in pairwise(places))
    assert [counter.read(angle) for angle in angles][-1][2] == passed


def torques(cell: TorqueCell, left: float, right: float) -> tuple[int, int]:
    sample = cell.read(cruise(torque_left=left, torque_right=right))
    assert sample is not None
    return sample.left_counts, sample.right_counts


def test_torque_cell_reads_counts_noise_and_saturates() -> None:
    spec = quiet(SPEC.optional["torque_cell"])
    assert torques(TorqueCell(spec, SEED), 1.0011, -0.5009) == (501, -250)
    assert torques(TorqueCell(spec, SEED), 50.0, -50.0) == (2500, -2500)
    samples = 20000
    cell = TorqueCell(SPEC.optional["torque_cell"], SEED)
    readings = np.array([torques(cell, 0.8, -0.3) for _ in range(samples)])
    low, high = variance_bounds(samples, 2.5**2 + 1.0 / 12.0)
    for side in (0, 1):
        assert low < np.var(readings[:, side], ddof=1) < high
    assert abs(np.corrcoef(readings.T)[0, 1]) < 5.0 / math.sqrt(samples)
