"""Airspeed and pressure altitude from raw counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.messages import AirData, PressureSample
from avionics.sensing import air_data
from avionics.sensing.air_data import Gate
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.pitot import Pitot
from sim_bridge.vehicles import load_vehicle
from wingbeat.atmosphere import GAS_CONSTANT, SEA_LEVEL_TEMPERATURE, pressure_altitude

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


@given(airspeed=st.floats(4.0, 18.0))
@settings(max_examples=30, deadline=None)
def test_true_airspeed(airspeed: float) -> None:
    density = BOOT / (GAS_CONSTANT * 303.15)
    pressure = 0.5 * density * airspeed**2
    last = measured([sample(t, differential=pressure, kelvin=303.15) for t in times(1.0)])[-1]
    assert last.density == pytest.approx(density, rel=1e-4)
    assert last.airspeed == pytest.approx(airspeed, rel=0.002)


def test_zero_is_learned_on_the_ground_and_kept_in_flight() -> None:
    """GIVEN a pitot 2 Pa off THEN on the ground it reads nothing and at 8 m/s the right speed."""
    dynamic = 0.5 * BOOT / (GAS_CONSTANT * 288.15) * 64.0
    samples = [sample(t, differential=2.0 + (dynamic if t >= 5.0 else 0.0)) for t in times(15.0)]
    messages = measured(samples, on_ground_until=5.0)
    assert abs(messages[240].dynamic_pressure) < 0.05
    assert messages[-1].airspeed == pytest.approx(8.0, abs=0.02)


def test_wind_on_the_ground_is_no_zero() -> None:
    """GIVEN 6 m/s of wind along the tube before the launch THEN no more than the limit becomes a zero."""
    dynamic = 0.5 * BOOT / (GAS_CONSTANT * 288.15) * 36.0
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
    expected = pressure_altitude(BOOT - 600.0) - pressure_altitude(BOOT)
    assert climbed.pressure_altitude == pytest.approx(expected, abs=0.2)


def test_flapping_flow_gives_the_mean_airspeed() -> None:
    """GIVEN a flow that swings by 1.5 m/s at 5.91 Hz around 9.2 m/s THEN the speed swings by less than 0.2."""
    density = BOOT / (GAS_CONSTANT * 288.15)
    flow = 9.2 + 1.5 * np.sin(math.tau * 5.91 * times(10.0))
    samples = [sample(t, differential=0.5 * density * u**2) for t, u in zip(times(10.0), flow, strict=True)]
    speeds = np.array([m.airspeed for m in measured(samples)])[150:]
    assert np.mean(speeds) == pytest.approx(9.2, abs=0.1)
    assert np.ptp(speeds) / 2.0 < 0.2


def test_rate_of_a_steady_acceleration() -> None:
    density = BOOT / (GAS_CONSTANT * 288.15)
    samples = [sample(t, differential=0.5 * density * (5.0 + t) ** 2) for t in times(6.0)]
    assert measured(samples)[-1].airspeed_rate == pytest.approx(1.0, abs=0.05)


CRUISE = 7.0
DENSITY = BOOT / (GAS_CONSTANT * 288.15)
STILL = 0.5 * DENSITY * CRUISE**2
"""Pa; of the cruise in still air"""
THROWN = 6.0
"""s; on the ground before"""


class Pitots:
    """A pitot of the vehicle's spec through air whose gusts of standard deviation ``gusts`` (m/s) last 1.5 s."""

    def __init__(self, seed: int, gusts: float, breeze: float = 0.0, seconds: float = 40.0) -> None:
        pitot = Pitot(load_vehicle("robo_raven_ii_d").sections["pitot"], sensor_seed(seed, 0), 0.02)
        rng = np.random.default_rng(seed)
        state, gust = air_data.State(), 0.0
        rows = []
        for t in times(seconds):
            gust += -gust * 0.02 / 1.5 + gusts * math.sqrt(2.0 * 0.02 / 1.5) * rng.normal()
            true = CRUISE + gust if t >= THROWN else breeze
            pitot.sense((true, 0.0, 0.0), DENSITY)
            one = sample(t)._replace(differential_counts=pitot.read())
            # What the hand throws is not watched, as in `tasks.sense`.
            gate = Gate.WATCHED if t >= THROWN + 1.0 else Gate.OPEN
            state, message = air_data.step(GAINS, state, one, t < THROWN, gate)
            rows.append((true - message.airspeed, message.airspeed_variance, message.innovation,
                         message.innovation_variance, state.refused))  # fmt: skip
        settled = np.array(rows)[round(50 * (THROWN + 14.0)) :]
        self.error, self.variance, self.innovation, self.expected, self.refused = settled.T


@pytest.mark.parametrize("gusts", [0.0, 0.4, 1.0])
def test_variances_of_airspeed_and_innovation_are_honest(gusts: float) -> None:
    """GIVEN calm to gusty air THEN errors and innovations have the size that is told, and few readings are refused.

    The zero is one figure for what a breeze on the ground may do: from none to 1.7 m/s along the tube.
    """
    flights = [Pitots(seed, gusts, breeze=0.15 * seed) for seed in range(12)]
    assert 0.8 < np.mean([np.mean(f.innovation**2 / f.expected) for f in flights]) < 1.2
    assert 0.4 < np.mean([np.mean(f.error**2 / f.variance) for f in flights]) < 2.0
    assert np.mean([np.mean(f.refused > 0.0) for f in flights]) < 0.002


def test_a_zero_that_a_breeze_brought_to_its_limit_counts_for_the_limit() -> None:
    """GIVEN 3 m/s along the tube in the hand THEN the airspeed is off by what it says."""
    flights = [Pitots(seed, 0.2, breeze=3.0, seconds=28.0) for seed in range(8)]
    assert 0.4 < np.mean([np.mean(f.error**2 / f.variance) for f in flights]) < 2.5


def test_noise_of_a_pitot_at_rest_is_in_its_variance() -> None:
    """GIVEN no flow THEN the airspeed is the root of noise, and its variance of that size."""
    rng = np.random.default_rng(5)
    samples = [sample(t, differential=1.9 * rng.normal()) for t in times(40.0)]
    said = [(m.airspeed**2, m.airspeed_variance) for m in measured(samples, on_ground_until=40.0)[250:]]
    square, variance = np.mean(said, axis=0)
    assert square < variance < 6.0 * square


class Gated:
    """Ten seconds of the cruise, then readings of ``pressure`` Pa for ``seconds``."""

    def __init__(self, pressure: float, seconds: float, gate: Gate = Gate.WATCHED) -> None:
        self.state, self.messages = air_data.State(), []
        rng = np.random.default_rng(2)
        for k in range(round(50 * (10.0 + seconds))):
            reading = (STILL if k < 500 else pressure) + rng.normal(0.0, 1.9)
            watched = gate if k >= 250 else Gate.OPEN
            self.state, message = air_data.step(
                GAINS, self.state, sample(0.02 * k, differential=reading), False, watched
            )
            self.messages.append(message)
        self.before, self.after = self.messages[499], self.messages[500:]


@pytest.mark.parametrize("pressure", [0.0, 120.0, 248.0])
def test_a_blocked_or_pressurised_pitot_does_not_go_through(pressure: float) -> None:
    """GIVEN a tube that tells static or ram pressure of its own THEN the airspeed stays, less and less certain."""
    flight = Gated(pressure, 0.9 * GAINS.gate_timeout)
    assert {message.airspeed for message in flight.after} == {flight.before.airspeed}
    variances = [message.airspeed_variance for message in flight.after]
    assert variances == sorted(variances) and variances[-1] > 1.5 * variances[0]
    innovation = flight.after[-1].innovation
    assert innovation == pytest.approx(pressure - STILL, abs=10.0)
    assert innovation**2 > GAINS.gate**2 * flight.after[-1].innovation_variance
    # What the tube tells is still known to `airspeed_check`.
    told = air_data.ungated(flight.state, flight.after[-1].density)
    assert told == pytest.approx(math.sqrt(2.0 * pressure / DENSITY), abs=2.0)


def test_one_spike_leaves_nothing() -> None:
    spiked, clean = air_data.State(), air_data.State()
    for k in range(600):
        one = sample(0.02 * k, differential=STILL)
        clean, _ = air_data.step(GAINS, clean, one, False, Gate.WATCHED)
        other = sample(0.02 * k, differential=240.0) if k == 500 else one
        spiked, message = air_data.step(GAINS, spiked, other, False, Gate.WATCHED)
        assert message.airspeed == pytest.approx(CRUISE, abs=0.05)
    assert spiked.dynamic_pressure == pytest.approx(clean.dynamic_pressure, abs=0.01)


@pytest.mark.parametrize(("gate", "timeout"), [(Gate.WATCHED, "gate_timeout"), (Gate.SUSPECT, "gate_reset_time")])
def test_what_lasts_is_believed_after_the_patience(gate: Gate, timeout: str) -> None:
    """GIVEN an airspeed that has really changed THEN it is told when the patience is over, sooner without doubt."""
    faster = 0.5 * DENSITY * 12.0**2
    times_believed = [i for i, m in enumerate(Gated(faster, 6.0, gate).after) if m.airspeed > 11.0]
    assert 0.02 * times_believed[0] == pytest.approx(getattr(GAINS, timeout), abs=0.05)
    assert Gated(faster, 6.0, gate).after[-1].airspeed == pytest.approx(12.0, abs=0.2)


def test_an_open_gate_refuses_nothing() -> None:
    """GIVEN the throw from the hand THEN the airspeed follows at once."""
    after = Gated(0.5 * DENSITY * 12.0**2, 1.5, Gate.OPEN).after
    assert after[-1].airspeed == pytest.approx(12.0, abs=0.2)


def test_a_throw_that_outruns_the_filter_is_followed() -> None:
    """The gate closes at the launch, while the filter is still far behind the accepted readings."""
    state, flown = air_data.State(), []
    for t in times(10.0):
        thrown = min(max((t - 8.0) / 0.3, 0.0), 1.0)
        gate = Gate.OPEN if t < 8.3 else Gate.WATCHED
        pressure = 43.0 * thrown**2
        state, message = air_data.step(GAINS, state, sample(t, differential=pressure), on_ground=t < 8.0, gate=gate)
        flown.append(message.dynamic_pressure)
    # In 0.75 s the low-pass filter of 0.25 s has all but a twentieth.
    assert flown[round(50.0 * (8.3 + 0.75))] > 0.9 * 43.0
    state, message = air_data.step(GAINS, state, sample(10.0, differential=200.0), on_ground=False, gate=Gate.WATCHED)
    assert message.dynamic_pressure == flown[-1]  # what comes later is refused as ever


def test_suction_and_broken_thermometer_are_survived() -> None:
    message = measured([sample(0.0, differential=-100.0, kelvin=0.0)])[-1]
    assert message.airspeed == 0.0
    assert message.temperature == SEA_LEVEL_TEMPERATURE


@given(
    st.lists(
        st.tuples(st.integers(-5, 10**6), st.integers(-1, 2**31 - 1), st.integers(-1, 2**15), st.integers(-1, 10**6)),
        min_size=1,
        max_size=40,
    ),
    st.booleans(),
)
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
