"""Power of the wing drives from ADC bursts: calibration, PWM, integrals."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics.messages import AdcBurst, PowerState
from avionics.sensing import power

GAINS = power.Gains()
OPEN_CIRCUIT = 8.0
RESISTANCE = 0.35


def pulses(duty: float, peak: float, phase: float, samples: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and current in V and A of a supply that sags under 300 Hz pulses, sampled at 6 kHz."""
    turns = np.arange(samples) * GAINS.pwm_frequency / GAINS.sample_rate + phase
    current = np.where(turns % 1.0 < duty, peak, 0.0)
    return OPEN_CIRCUIT - RESISTANCE * current, current


def burst(voltage: np.ndarray, current: np.ndarray, time_us: int = 0, gains: power.Gains = GAINS) -> AdcBurst:
    """Counts of a 10-bit ADC at 5 V."""
    lsb = gains.reference / gains.full_scale
    voltage_counts = np.rint(voltage * gains.divider / lsb).astype(int)
    current_counts = np.rint((gains.current_zero + gains.current_sensitivity * current) / lsb).astype(int)
    return AdcBurst(time_us, tuple(voltage_counts.tolist()), tuple(current_counts.tolist()))


@pytest.mark.parametrize(("duty", "peak"), [(0.25, 8.0), (0.5, 6.0), (0.75, 4.0)])
def test_mean_of_the_product_is_the_truth(duty: float, peak: float) -> None:
    """GIVEN a sagging supply under PWM THEN mean(V I) is the power and mean V times mean I is not."""
    true = duty * peak * (OPEN_CIRCUIT - RESISTANCE * peak)
    means = power.averages(GAINS, burst(*pulses(duty, peak, 0.01)))
    assert means.power == pytest.approx(true, rel=0.01)
    assert means.voltage * means.current > 1.03 * true


@given(duty=st.sampled_from([0.1, 0.35, 0.6, 0.9]), phase=st.floats(0.0, 1.0), peak=st.floats(1.0, 9.0))
def test_sums_over_counts_are_the_sums_over_values(duty: float, phase: float, peak: float) -> None:
    sample = burst(*pulses(duty, peak, phase))
    lsb = GAINS.reference / GAINS.full_scale
    v = np.array(sample.voltage_counts) * lsb / GAINS.divider
    i = (np.array(sample.current_counts) * lsb - GAINS.current_zero) / GAINS.current_sensitivity
    means = power.averages(GAINS, sample)
    assert means == pytest.approx((v.mean(), i.mean(), (v * i).mean()), rel=1e-9, abs=1e-9)


@given(samples=st.integers(1, 300), pwm=st.floats(20.0, 3000.0))
def test_window_is_the_largest_whole_number_of_periods(samples: int, pwm: float) -> None:
    count = power.whole_periods(GAINS._replace(pwm_frequency=pwm), samples)
    periods = samples * pwm / GAINS.sample_rate
    assert 1 <= count <= samples
    if periods >= 1.0:
        assert count == pytest.approx(int(periods + 1e-9) * GAINS.sample_rate / pwm, abs=0.51)
    else:
        assert count == samples


def test_partial_period_is_left_out() -> None:
    """GIVEN a burst of 70 samples (3.5 periods) THEN the power is that of 3 periods, whatever its phase."""
    powers = [
        power.averages(GAINS, burst(*pulses(0.35, 6.0, phase, 70))).power for phase in np.linspace(0.01, 0.96, 20)
    ]
    assert max(powers) - min(powers) < 0.01 * max(powers)


def test_smooth_current_uses_every_sample() -> None:
    assert power.whole_periods(GAINS._replace(pwm_frequency=0.0), 47) == 47


def test_offsets_and_zero_current() -> None:
    gains = GAINS._replace(voltage_offset=0.25, current_zero=2.4)
    sample = burst(np.full(60, 7.0), np.zeros(60), gains=gains)
    means = power.averages(gains, sample)
    assert means.voltage == pytest.approx(7.25, abs=0.01)
    assert means.current == pytest.approx(0.0, abs=0.015)


def steady(
    gains: power.Gains, seconds: float, duty: float = 0.5, peak: float = 6.0, resting: bool = False
) -> tuple[power.State, PowerState]:
    """The state after so long at one load."""
    state = power.State()
    voltage, current = pulses(duty, peak, 0.01)
    for k in range(round(100.0 * seconds)):
        state, message = power.step(gains, state, burst(voltage, current, 10000 * k), resting=resting)
    return state, message


def test_charge_and_energy() -> None:
    """GIVEN 60 s at a known load THEN charge and energy are right to 1 %."""
    _, message = steady(GAINS, 60.0)
    true_power = 0.5 * 6.0 * (OPEN_CIRCUIT - RESISTANCE * 6.0)
    assert message.charge == pytest.approx(3.0 * 60.0, rel=0.01)
    assert message.energy == pytest.approx(true_power * 60.0, rel=0.01)


@pytest.mark.parametrize("frequency", [3.1, 4.0, 4.7, 12.0])
def test_energy_per_stroke_whatever_bursts_fit_into_it(frequency: float) -> None:
    """GIVEN a steady load THEN a stroke costs the power's share, though strokes do not end with bursts."""
    state = power.State()
    voltage, current = pulses(0.5, 6.0, 0.01)
    for k in range(400):
        beat = power.Beat(int(k * 0.01 * frequency), frequency)
        state, message = power.step(GAINS, state, burst(voltage, current, 10000 * k), beat)
    assert message.energy_per_stroke == pytest.approx(message.power / frequency, rel=1e-6)


# --- the current sensor's zero --------------------------------------------------------------------------


def shifted(sample: AdcBurst, counts: int) -> AdcBurst:
    return sample._replace(current_counts=tuple(c + counts for c in sample.current_counts))


def test_zero_is_learned_at_rest_and_taken_off_current_and_power() -> None:
    """GIVEN a sensor 2 counts (49 mA) high THEN 2 s at the rest's 0.3 A teach it, and the flight is right."""
    gains = GAINS._replace(rest_current=0.3)
    state = power.State()
    rest, load = burst(*pulses(0.05, 6.0, 0.01)), burst(*pulses(0.5, 6.0, 0.01))
    for k in range(200):
        state, message = power.step(gains, state, shifted(rest, 2)._replace(time_us=10000 * k), resting=True)
    assert message.current_zero == pytest.approx(0.049, abs=0.002)
    _, message = power.step(gains, state, shifted(load, 2)._replace(time_us=2_000_000))
    true = power.averages(gains, load)
    assert (message.current, message.power) == pytest.approx((true.current, true.power), abs=0.02)


def test_a_loaded_drive_is_no_zero() -> None:
    gains = GAINS._replace(rest_current=0.24)
    state, _ = steady(gains, 5.0, duty=0.1, resting=True)
    assert state.zero == 0.0


def learned(angles: list[float]) -> float:
    """Zero (A) learned from 2 counts of offset while the left wing is at ``angles`` (rad), a burst each."""
    gains, state = GAINS._replace(rest_current=0.3), power.State()
    sample = shifted(burst(*pulses(0.05, 6.0, 0.01)), 2)
    for k, angle in enumerate(angles):
        at = sample._replace(time_us=10000 * k)
        state, message = power.step(gains, state, at, power.Beat(left=angle), resting=True)
    return message.current_zero


def test_zero_is_learned_only_while_the_wings_are_at_rest() -> None:
    """GIVEN a wing rocked by gusts THEN nothing is learned, though the current is within the limit."""
    travel, wait = power.Gains().rest_travel, round(100.0 * power.Gains().rest_time)
    assert learned([0.1] * 200) == pytest.approx(0.049, abs=0.002)
    assert learned([0.1 + 0.9 * travel * math.sin(0.2 * k) for k in range(200)]) == pytest.approx(0.049, abs=0.002)
    assert learned([3.0 * travel * math.sin(0.2 * k) for k in range(200)]) == 0.0
    assert learned([0.1] * (wait - 1)) == 0.0


def test_rest_begins_anew_after_disarming() -> None:
    gains = GAINS._replace(rest_current=0.3)
    sample, state = burst(*pulses(0.05, 6.0, 0.01)), power.State()
    for k in range(200):
        disarmed = k < 20 or k > 170
        state, message = power.step(gains, state, sample._replace(time_us=10000 * k), resting=disarmed)
    assert message.current_zero == 0.0


def test_zero_is_not_learned_in_flight() -> None:
    state, _ = steady(GAINS._replace(rest_current=0.27), 5.0, duty=0.05)
    assert state.zero == 0.0


@given(st.lists(st.floats(-2.0, 2.0), max_size=50))
def test_zero_stays_within_its_limit(currents: list[float]) -> None:
    zero = span = 0.0
    for current in currents:
        zero, span = power.learned_zero(GAINS, zero, span, current, 0.01)
        assert abs(zero) <= GAINS.zero_limit


def test_current_beyond_the_range_is_counted() -> None:
    state = power.State()
    for k, peak in enumerate((6.0, 9.7, 11.0, 20.0)):
        sample = burst(OPEN_CIRCUIT * np.ones(60), np.minimum(np.full(60, peak), 10.0), 40000 * k)
        state, message = power.step(GAINS, state, sample)
    assert message.clipped == 2


# --- the battery ----------------------------------------------------------------------------------------

BATTERY = GAINS._replace(capacity=1000.0, open_circuit=(7.2, 8.4), resistance=0.06)


class Cell:
    """A battery that is drawn from in strokes at 4 Hz, and the flight code that watches it."""

    def __init__(self, gains: power.Gains, share: float, capacity: float = 1000.0, resistance: float = 0.06) -> None:
        self.gains, self.share, self.capacity, self.resistance = gains, share, capacity, resistance
        self.state, self.message, self.tick = power.State(), None, 0

    def draw(self, seconds: float, mean: float = 2.5) -> PowerState:
        """``mean`` A in strokes that swing the current between nothing and twice as much."""
        for _ in range(round(seconds * 100.0)):
            current = mean * (1.0 + math.sin(math.tau * 4.0 * self.tick * 0.01))
            self.share -= current * 0.01 / self.capacity
            low, high = 7.2, 8.4
            volts = low + (high - low) * self.share - self.resistance * current
            sample = burst(np.full(60, volts), np.full(60, current), 10000 * self.tick, self.gains)
            dithered = tuple(c + (i % 4 == self.tick % 4) for i, c in enumerate(sample.voltage_counts))
            self.state, message = power.step(self.gains, self.state, sample._replace(voltage_counts=dithered))
            self.tick += 1
        return message


@pytest.mark.parametrize("share", [1.0, 0.7, 0.45, 0.2])
def test_a_battery_that_was_not_full_is_known_from_its_voltage(share: float) -> None:
    """GIVEN any state of charge at boot THEN it is known at once at rest, and through a flight, within 3 %."""
    cell = Cell(BATTERY, share)
    assert cell.draw(0.5, mean=0.0).battery_remaining == pytest.approx(share, abs=0.03)
    for _ in range(6):
        assert cell.draw(10.0, mean=2.5).battery_remaining == pytest.approx(cell.share, abs=0.03)


@pytest.mark.parametrize("resistance", [0.03, 0.06, 0.18])
def test_the_sag_of_a_tired_battery_is_measured_not_taken_for_empty(resistance: float) -> None:
    """GIVEN a resistance up to three times the bench's THEN it is found, and the share stays within 3 %."""
    cell = Cell(BATTERY, 0.8, resistance=resistance)
    message = cell.draw(60.0)
    assert message.resistance == pytest.approx(resistance, rel=0.05)
    assert message.open_circuit_voltage == pytest.approx(7.2 + 1.2 * cell.share, abs=0.02)
    assert message.battery_remaining == pytest.approx(cell.share, abs=0.03)


def test_an_aged_capacity_shows_in_the_voltage() -> None:
    """GIVEN 70 % of the believed capacity THEN the share at the end is nearer the truth than the charge tells."""
    cell = Cell(BATTERY, 1.0, capacity=700.0)
    message = cell.draw(200.0)
    by_charge = 1.0 - message.charge / BATTERY.capacity
    assert by_charge - cell.share > 0.2
    assert abs(message.battery_remaining - cell.share) < 0.1


def test_a_steady_current_tells_no_resistance() -> None:
    _, message = steady(BATTERY, 10.0)
    assert message.resistance == BATTERY.resistance


@given(st.lists(st.floats(6.0, 9.0), min_size=2, max_size=6, unique=True).map(sorted), st.floats(0.0, 1.0))
def test_share_is_read_off_the_curve(points: list[float], share: float) -> None:
    """GIVEN any rising curve THEN the voltage at a share gives that share back, and stays within 0 and 1 beyond."""
    voltage = float(np.interp(share, np.linspace(0.0, 1.0, len(points)), points))
    closest = min(b - a for a, b in pairwise(points))
    assert power.share_of(tuple(points), voltage) == pytest.approx(share, abs=1e-12 + 1e-14 / closest)
    assert power.share_of(tuple(points), points[0] - 1.0) == 0.0
    assert power.share_of(tuple(points), points[-1] + 1.0) == 1.0


def test_lost_bursts_are_bridged_and_time_never_runs_back() -> None:
    sample = burst(*pulses(0.5, 6.0, 0.01))
    state, first = power.step(GAINS, power.State(), sample)
    state, second = power.step(GAINS, state, sample._replace(time_us=50000))
    assert second.energy - first.energy == pytest.approx(second.power * 0.05)
    state, third = power.step(GAINS, state, sample._replace(time_us=20000))
    assert (third.energy, state.time_us) == (second.energy, 50000)
    _, fourth = power.step(GAINS, state, sample._replace(time_us=100_000_000))
    assert fourth.energy - third.energy == pytest.approx(fourth.power * power.LONGEST_GAP)


def test_battery_is_never_below_empty() -> None:
    flat = AdcBurst(0, (600,) * 60, (612,) * 60)
    state = power.State()
    for k in range(300):
        state, message = power.step(GAINS, state, flat._replace(time_us=10000 * k))
        assert message.battery_remaining == pytest.approx(0.0, abs=1e-12)


def test_pwm_off_its_nominal_frequency_averages_out() -> None:
    """GIVEN a modulation at 303 Hz where 300 is believed THEN the mean over a second is right to 1 %."""
    duty, peak = 0.35, 6.0
    found = []
    for k in range(100):
        turns = np.arange(60) * 303.0 / GAINS.sample_rate + k * 0.0303 * 100.0
        current = np.where(turns % 1.0 < duty, peak, 0.0)
        found.append(power.averages(GAINS, burst(OPEN_CIRCUIT - RESISTANCE * current, current)).power)
    assert np.mean(found) == pytest.approx(duty * peak * (OPEN_CIRCUIT - RESISTANCE * peak), rel=0.01)
