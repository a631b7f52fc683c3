"""Power of the wing drives from ADC bursts: calibration, PWM, integrals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.messages import AdcBurst
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
@settings(max_examples=60, deadline=None)
def test_sums_over_counts_are_the_sums_over_values(duty: float, phase: float, peak: float) -> None:
    sample = burst(*pulses(duty, peak, phase))
    lsb = GAINS.reference / GAINS.full_scale
    v = np.array(sample.voltage_counts) * lsb / GAINS.divider
    i = (np.array(sample.current_counts) * lsb - GAINS.current_zero) / GAINS.current_sensitivity
    means = power.averages(GAINS, sample)
    assert means == pytest.approx((v.mean(), i.mean(), (v * i).mean()), rel=1e-9, abs=1e-9)


@given(samples=st.integers(1, 300), pwm=st.floats(20.0, 3000.0))
@settings(max_examples=100, deadline=None)
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


def test_charge_energy_and_battery() -> None:
    """GIVEN 60 s at a known load THEN charge and energy are right to 1 % and the battery shows it."""
    gains = GAINS._replace(capacity=1000.0)
    state = power.State()
    voltage, current = pulses(0.5, 6.0, 0.01)
    for k in range(6000):
        state, message = power.step(gains, state, burst(voltage, current, 10000 * k))
    true_power = 0.5 * 6.0 * (OPEN_CIRCUIT - RESISTANCE * 6.0)
    assert message.charge == pytest.approx(3.0 * 60.0, rel=0.01)
    assert message.energy == pytest.approx(true_power * 60.0, rel=0.01)
    assert message.battery_remaining == pytest.approx(1.0 - 180.0 / 1000.0, abs=0.005)


def test_energy_per_stroke() -> None:
    """GIVEN 4 strokes a second THEN each costs a quarter of a second's energy, though a stroke is 25 bursts."""
    state = power.State()
    voltage, current = pulses(0.5, 6.0, 0.01)
    for k in range(400):
        state, message = power.step(GAINS, state, burst(voltage, current, 10000 * k), strokes=k // 25)
    assert message.energy_per_stroke == pytest.approx(message.power / 4.0, rel=1e-6)


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
    state = power.State(time_us=0, charge=5000.0)
    _, message = power.step(GAINS, state, burst(*pulses(0.5, 6.0, 0.01), time_us=10000))
    assert message.battery_remaining == 0.0
