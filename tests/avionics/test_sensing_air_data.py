"""Airspeed and pressure altitude from raw counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.messages import AirData, PressureSample
from avionics.sensing import air_data

GAINS = air_data.Gains()
BOOT = 100000.0


def sample(time: float, static: float = BOOT, differential: float = 0.0, kelvin: float = 288.15) -> PressureSample:
    """Counts of pressures in Pa and a temperature in K, the pitot's clipped as its 14-bit word clips."""
    share = 0.5 * (1.0 + differential / GAINS.differential_range)
    counts = GAINS.differential_low + share * (GAINS.differential_high - GAINS.differential_low)
    return PressureSample(
        round(time * 1e6), round(static * 100.0), min(max(round(counts), 0), 16383), round(kelvin * 100.0)
    )


def measured(samples: list[PressureSample], on_ground_until: float = 0.0) -> list[AirData]:
    state = air_data.State()
    messages = []
    for one in samples:
        state, message = air_data.step(GAINS, state, one, on_ground=one.time_us < on_ground_until * 1e6)
        messages.append(message)
    return messages


def times(seconds: float) -> np.ndarray:
    return np.arange(round(seconds * 50.0)) / 50.0


@pytest.mark.parametrize(
    ("altitude", "pressure"), [(-500.0, 107478.0), (0.0, 101325.0), (1000.0, 89874.6), (5000.0, 54019.9)]
)
def test_isa_altitude_is_that_of_the_published_table(altitude: float, pressure: float) -> None:
    assert air_data.isa_altitude(pressure) == pytest.approx(altitude, abs=0.2)


@given(airspeed=st.floats(4.0, 18.0))
@settings(max_examples=30, deadline=None)
def test_true_airspeed(airspeed: float) -> None:
    density = BOOT / (air_data.AIR_GAS_CONSTANT * 303.15)
    pressure = 0.5 * density * airspeed**2
    last = measured([sample(t, differential=pressure, kelvin=303.15) for t in times(1.0)])[-1]
    assert last.density == pytest.approx(density, rel=1e-4)
    assert last.airspeed == pytest.approx(airspeed, rel=0.002)


def test_zero_is_learned_on_the_ground_and_kept_in_flight() -> None:
    """GIVEN a pitot 2 Pa off THEN on the ground it reads nothing and at 8 m/s the right speed."""
    dynamic = 0.5 * BOOT / (air_data.AIR_GAS_CONSTANT * 288.15) * 64.0
    samples = [sample(t, differential=2.0 + (dynamic if t >= 5.0 else 0.0)) for t in times(15.0)]
    messages = measured(samples, on_ground_until=5.0)
    assert abs(messages[240].dynamic_pressure) < 0.05
    assert messages[-1].airspeed == pytest.approx(8.0, abs=0.02)


def test_wind_on_the_ground_is_no_zero() -> None:
    """GIVEN 6 m/s of wind along the tube before the launch THEN no more than the limit becomes a zero."""
    dynamic = 0.5 * BOOT / (air_data.AIR_GAS_CONSTANT * 288.15) * 36.0
    last = measured([sample(t, differential=dynamic) for t in times(5.0)], on_ground_until=5.0)[-1]
    assert last.dynamic_pressure == pytest.approx(dynamic - GAINS.zero_limit, abs=0.1)


def test_altitude_is_relative_to_the_mean_of_the_first_second() -> None:
    rng = np.random.default_rng(3)
    noise = 3.0 * rng.standard_normal(1000)
    samples = [sample(t, BOOT + n) for t, n in zip(times(20.0), noise, strict=True)]
    altitudes = [m.pressure_altitude for m in measured(samples)]
    assert altitudes[0] == 0.0
    assert abs(np.mean(altitudes[100:])) < 0.15
    climbed = measured([*samples[:60], *(sample(20.0 + t, BOOT - 600.0) for t in times(1.0))])[-1]
    expected = air_data.isa_altitude(BOOT - 600.0) - air_data.isa_altitude(BOOT)
    assert climbed.pressure_altitude == pytest.approx(expected, abs=0.2)


def test_flapping_flow_gives_the_mean_airspeed() -> None:
    """GIVEN a flow that swings by 1.5 m/s at 5.91 Hz around 9.2 m/s THEN the speed swings by less than 0.2."""
    density = BOOT / (air_data.AIR_GAS_CONSTANT * 288.15)
    flow = 9.2 + 1.5 * np.sin(math.tau * 5.91 * times(10.0))
    samples = [sample(t, differential=0.5 * density * u**2) for t, u in zip(times(10.0), flow, strict=True)]
    speeds = np.array([m.airspeed for m in measured(samples)])[150:]
    assert np.mean(speeds) == pytest.approx(9.2, abs=0.1)
    assert np.ptp(speeds) / 2.0 < 0.2


def test_rate_of_a_steady_acceleration() -> None:
    density = BOOT / (air_data.AIR_GAS_CONSTANT * 288.15)
    samples = [sample(t, differential=0.5 * density * (5.0 + t) ** 2) for t in times(6.0)]
    assert measured(samples)[-1].airspeed_rate == pytest.approx(1.0, abs=0.05)


def test_suction_and_broken_thermometer_are_survived() -> None:
    message = measured([sample(0.0, differential=-100.0, kelvin=0.0)])[-1]
    assert message.airspeed == 0.0
    assert message.temperature == air_data.SEA_LEVEL_TEMPERATURE


@given(
    st.lists(
        st.tuples(st.integers(-5, 10**6), st.integers(-1, 2**31 - 1), st.integers(-1, 2**15), st.integers(-1, 10**6)),
        min_size=1,
        max_size=40,
    ),
    st.booleans(),
)
@settings(max_examples=100, deadline=None)
def test_any_counts_give_finite_messages(steps: list[tuple[int, int, int, int]], on_ground: bool) -> None:
    state = air_data.State()
    time_us = 0
    for dt, static, differential, temperature in steps:
        time_us = max(0, time_us + dt)
        one = PressureSample(time_us, static, differential, temperature)
        state, message = air_data.step(GAINS, state, one, on_ground)
        assert all(math.isfinite(value) for value in message)
        assert message.airspeed >= 0.0
        assert abs(state.zero) <= GAINS.zero_limit
