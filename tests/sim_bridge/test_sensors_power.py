from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensors_bench import SPEC, cruise, quiet, variance_bounds

from sim_bridge.observation import SIZE, Observation
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.power_sensor import PowerSensor, PowerSensorSpec, mean_square, pulse, supply, time_on

SEED = sensor_seed(11, 5)
VOLTS_PER_COUNT = 5.0 / 1024 / 0.5
AMPERES_PER_COUNT = 5.0 / 1024 / 0.2

fine: PowerSensorSpec = quiet(SPEC.power_sensor)._replace(bits=16)
"""no noise and an ADC whose rounding does not show"""


def physical(counts: tuple[tuple[int, ...], tuple[int, ...]], bits: int = 16) -> tuple[np.ndarray, np.ndarray]:
    volts = np.array(counts[0]) * (5.0 / (1 << bits) / 0.5)
    amperes = (np.array(counts[1]) * (5.0 / (1 << bits)) - 2.5) / 0.2
    return volts, amperes


EDGE_PERIODS = 300.0 / 6000.0
"""duration of an edge in periods of the modulation"""


def mean_power(observation: Observation, lost: float) -> float:
    """Mean of V I over a period for a pulse whose mean square is short of a sharp one's by ``lost`` periods."""
    array = np.zeros(SIZE)
    observation.fill(array)
    duty, amplitude, voltage, resistance = supply(array)
    return voltage * duty * amplitude - resistance * amplitude**2 * (duty - lost)


def burst_after(elapsed_us: int, observation: Observation) -> tuple[np.ndarray, np.ndarray]:
    sensor = PowerSensor(fine, SEED)
    sensor.read(observation)
    return physical(sensor.read(observation._replace(time_us=elapsed_us)))


@given(st.floats(0.5, 5.9), st.integers(10000, 20000))
def test_burst_means_are_the_analytic_ones(current: float, elapsed_us: int) -> None:
    observation = cruise(current=current, pulse_current=6.4)
    volts, amperes = burst_after(elapsed_us, observation)
    assert amperes.mean() == pytest.approx(current, abs=2e-4)
    assert volts.mean() == pytest.approx(8.0 - 0.08 * current, abs=2e-4)
    # Where on the edges the samples fall decides how much of the square is lost: none to half an edge.
    tolerance = 2e-3
    assert mean_power(observation, 0.0) - tolerance < np.mean(volts * amperes)
    assert np.mean(volts * amperes) < mean_power(observation, EDGE_PERIODS / 2.0) + tolerance


@pytest.mark.parametrize("current", [1.0, 3.26, 5.1])
def test_power_over_all_phases_is_that_of_the_trapezoid(current: float) -> None:
    observation = cruise(current=current, pulse_current=6.4)
    bursts = [burst_after(10000 + 10 * step, observation) for step in range(100)]
    power = np.mean([np.mean(volts * amperes) for volts, amperes in bursts])
    assert power == pytest.approx(mean_power(observation, EDGE_PERIODS / 3.0), rel=1e-4)


@pytest.mark.parametrize("edge", [0.02, 0.05, 0.3])
def test_mean_square_of_any_pulse(edge: float) -> None:
    """GIVEN any duty, edges longer than the pulse or its gap too THEN the mean of the squares is told."""
    for duty in np.linspace(0.0, 1.0, 41):
        heights = [pulse(phase, duty, edge) for phase in np.arange(2000) / 2000.0]
        assert mean_square(duty, edge) == pytest.approx(np.mean(np.square(heights)), abs=1e-3)


def test_mean_of_the_product_is_not_the_product_of_the_means() -> None:
    observation = cruise(current=2.0, battery_resistance=0.3)
    volts, amperes = physical(PowerSensor(fine, SEED).read(observation))
    shortfall = volts.mean() * amperes.mean() - np.mean(volts * amperes)
    assert shortfall == pytest.approx(0.3 * np.var(amperes), rel=0.01)
    assert shortfall > 1.0


def test_pulses_have_the_plants_height_and_the_voltage_sags_with_them() -> None:
    volts, amperes = physical(PowerSensor(fine, SEED).read(cruise(current=3.2, pulse_current=6.4)))
    assert amperes.max() == pytest.approx(6.4, abs=1e-3)
    assert amperes.min() == pytest.approx(0.0, abs=1e-3)
    assert volts == pytest.approx(8.0 - 0.08 * amperes, abs=5e-4)
    edges = np.count_nonzero(np.diff((amperes > 3.2).astype(int)))
    assert edges in (5, 6)


def test_phase_runs_on_from_burst_to_burst() -> None:
    # GIVEN a modulation that is no multiple of the burst rate and sharp pulses
    spec = fine._replace(edge=0.0)
    sensor = PowerSensor(spec, SEED)
    on: list[float] = []
    # WHEN bursts follow each other without a gap
    for burst in range(20):
        observation = cruise(2 * burst, current=1.6, pwm_frequency=307.0)
        on.extend(physical(sensor.read(observation))[1])
    # THEN the pulses are evenly spaced over the seams of the bursts
    starts = np.flatnonzero(np.diff((np.array(on) > 3.0).astype(int)) > 0)
    spacing = np.diff(starts)
    assert set(spacing.tolist()) <= {19, 20}
    assert spacing.mean() == pytest.approx(6000.0 / 307.0, rel=0.005)


@pytest.mark.parametrize(
    "changes",
    [
        {"pwm_frequency": 0.0},
        {"current": 7.0},
        {"current": -0.4},
        {"current": 0.0},
        {"pulse_current": 0.0},
    ],
)
def test_what_no_pulse_can_give_is_smooth(changes: dict[str, Any]) -> None:
    observation = cruise(**changes)
    _, amperes = physical(PowerSensor(fine, SEED).read(observation))
    assert amperes == pytest.approx(observation.current, abs=1e-3)


def test_ten_bits_resolve_and_saturate() -> None:
    sensor = PowerSensor(quiet(SPEC.power_sensor), SEED)
    smooth: dict[str, Any] = {"pwm_frequency": 0.0, "battery_resistance": 0.0}
    voltage, current = sensor.read(cruise(current=0.0, open_circuit_voltage=8.0, **smooth))
    assert set(voltage) == {round(8.0 / VOLTS_PER_COUNT)}
    assert set(current) == {512}
    voltage, current = sensor.read(cruise(current=60.0, open_circuit_voltage=20.0, **smooth))
    assert set(voltage) == {1023}
    assert set(current) == {round(512 + 10.0 / AMPERES_PER_COUNT)}
    voltage, current = sensor.read(cruise(current=-60.0, open_circuit_voltage=-1.0, **smooth))
    assert set(voltage) == {0}
    assert set(current) == {round(512 - 10.0 / AMPERES_PER_COUNT)}


def test_noise_of_both_channels() -> None:
    sensor = PowerSensor(SPEC.power_sensor._replace(bits=16), SEED)
    observation = cruise(pwm_frequency=0.0)
    bursts = [physical(sensor.read(observation)) for _ in range(200)]
    volts, amperes = (np.concatenate(channel) for channel in zip(*bursts, strict=True))
    low, high = variance_bounds(len(volts), (0.003 / 0.5) ** 2)
    assert low < np.var(volts, ddof=1) < high
    low, high = variance_bounds(len(amperes), 0.02**2)
    assert low < np.var(amperes, ddof=1) < high
    assert abs(np.corrcoef(volts, amperes)[0, 1]) < 5.0 / math.sqrt(len(volts))


@pytest.mark.parametrize("current", [0.0, 1.5, 6.0])
def test_commutation_ripple_grows_with_the_current(current: float) -> None:
    """GIVEN a ripple of 4 % WHEN currents are measured THEN it adds 4 % of them in quadrature to the noise, and the
    voltage over the resistance to that of the voltage."""
    sensor = PowerSensor(SPEC.power_sensor._replace(bits=16), SEED)
    sensor.burst.ripple[0] = 0.04
    observation = cruise(pwm_frequency=0.0, current=current, battery_resistance=0.5)
    bursts = [physical(sensor.read(observation)) for _ in range(200)]
    volts, amperes = (np.concatenate(channel) for channel in zip(*bursts, strict=True))
    for measured, noise, ripple in ((volts, 0.003 / 0.5, 0.5 * 0.04 * current), (amperes, 0.02, 0.04 * current)):
        low, high = variance_bounds(len(measured), noise**2 + ripple**2)
        assert low < np.var(measured, ddof=1) < high


def test_current_that_is_off_has_no_ripple() -> None:
    """GIVEN pulses and a ripple of 4 % WHEN a burst is read THEN it is in the pulses alone."""
    sensor = PowerSensor(fine._replace(edge=0.0), SEED)
    sensor.burst.ripple[0] = 0.04
    amperes = np.concatenate([physical(sensor.read(cruise(2 * burst)))[1] for burst in range(50)])
    on = amperes > 3.0
    assert np.std(amperes[on]) == pytest.approx(0.04 * 6.4, rel=0.1)
    assert np.std(amperes[~on]) < 1e-3


def test_units_errors_are_in_the_mean() -> None:
    sensor = PowerSensor(SPEC.power_sensor._replace(bits=16), SEED)
    observation = cruise(pwm_frequency=0.0, battery_resistance=0.0)
    bursts = [physical(sensor.read(observation)) for _ in range(100)]
    volts, amperes = (np.mean(channel) for channel in zip(*bursts, strict=True))
    errors = sensor.errors
    assert volts == pytest.approx(8.0 * (1.0 + errors.divider), abs=5e-4)
    assert amperes == pytest.approx(3.26 * (1.0 + errors.current_scale) + errors.current_zero, abs=2e-3)


@given(st.floats(-3.0, 3.0), st.floats(0.0, 1.0), st.floats(0.001, 2.0))
def test_pulse_is_periodic_bounded_and_keeps_its_mean(phase: float, duty: float, edge: float) -> None:
    height = pulse(phase, duty, edge)
    assert -1e-9 <= height <= 1.0 + 1e-9
    assert pulse(phase + 1.0, duty, edge) == pytest.approx(height, abs=1e-9 / edge)
    assert time_on(phase + 5.0, duty) - time_on(phase, duty) == pytest.approx(5.0 * duty, abs=1e-12)
    phases = phase + np.arange(1000) / 1000.0
    assert np.mean([pulse(p, duty, edge) for p in phases]) == pytest.approx(duty, abs=2e-3)
