"""The altitude filter: shaking, honest variances, spikes."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from avionics.estimation import altitude
from avionics.estimation.kalman import filterpy, update_first
from avionics.messages import AirData, Altitude

GAINS = altitude.Gains()
NOISE = 0.3


def air(time_us: int, pressure_altitude: float) -> AirData:
    return AirData(time_us, 0.0, 0.0, 0.0, 101325.0, 288.15, 1.225, pressure_altitude, 0.0, 0.0, 0.0)


class Flight:
    """A climb and descent by 5 m, shaken along the vertical, sampled by the filter."""

    def __init__(
        self,
        heave: float,
        frequency: float,
        bias: float = 0.2,
        seed: int = 1,
        seconds: float = 60.0,
        gains: altitude.Gains = GAINS,
    ) -> None:
        rng = np.random.default_rng(seed)
        omega = math.tau * frequency
        state, messages, truth, smooth = altitude.State(), [], [], []
        for k in range(round(200 * seconds)):
            t = k / 200.0
            accel = -0.2 * math.sin(0.2 * t) + heave * math.cos(omega * t)
            height = 5.0 * math.sin(0.2 * t) - heave / omega**2 * (math.cos(omega * t) - 1.0)
            state = altitude.accumulate(state, -(accel + bias + rng.normal(0.0, 0.5)))
            if k % 4 == 0:
                reading = height + rng.normal(0.0, NOISE)
                state, message = altitude.step(gains, state, air(5000 * k, reading), frequency)
                messages.append(message)
                truth.append(height)
                smooth.append(math.cos(0.2 * t))
        self.state = state
        self.messages: list[Altitude] = messages
        self.altitude_error = np.array([m.altitude for m in messages]) - truth
        self.climb_error = np.array([m.climb_rate for m in messages]) - smooth


@pytest.mark.parametrize(("heave_g", "frequency"), [(4.0, 5.91), (2.5, 4.0), (4.0, 12.0), (0.0, 5.0)])
def test_altitude_under_shaking(heave_g: float, frequency: float) -> None:
    """GIVEN +-4 g of heave WHEN the path climbs and sinks THEN the altitude holds within 0.3 m at every moment."""
    flight = Flight(heave_g * 9.80665, frequency)
    assert np.abs(flight.altitude_error[250:]).max() < 0.3


def test_climb_rate_is_that_of_the_path() -> None:
    """GIVEN a fuselage that heaves at 1 m/s THEN the climb rate is the path's within 0.1 m/s RMS."""
    flight = Flight(4.0 * 9.80665, 5.91)
    assert np.sqrt(np.mean(flight.climb_error[250:] ** 2)) < 0.1


def test_acceleration_bias_is_found() -> None:
    assert Flight(20.0, 5.0, bias=1.0).messages[-1].accel_bias == pytest.approx(1.0, abs=0.15)


def test_variance_is_honest() -> None:
    """GIVEN the noise that the filter believes in THEN innovations and errors have the size it says."""
    # The white noise of `Flight`, 0.5 m/s^2, is averaged over the four samples between two readings.
    told = GAINS._replace(baro_noise=NOISE, accel_noise=0.25, bias_walk=0.003, baro_drift=0.0)
    squares = []
    for seed in range(4):
        flight = Flight(10.0, 5.0, seed=seed, seconds=25.0, gains=told)
        rows = [(m.innovation**2, m.innovation_variance, m.altitude_variance) for m in flight.messages[500:]]
        innovation, expected, altitude_variance = np.array(rows).T
        climb = np.mean(flight.climb_error[500:] ** 2) / flight.messages[-1].climb_variance
        error = np.mean(flight.altitude_error[500:] ** 2 / altitude_variance)
        squares.append((np.mean(innovation / expected), error, climb))
    innovation, error, climb = np.mean(squares, axis=0)
    assert 0.9 < innovation < 1.1
    assert 0.5 < error < 2.0
    assert 0.3 < climb < 2.0


def test_drift_of_the_barometer_is_in_the_variance() -> None:
    """GIVEN a barometer that drifts as weather makes it THEN the variance has what a minute has made of it."""
    state, _ = altitude.step(GAINS, altitude.State(), air(100_000_000, 0.0))
    _, early = altitude.step(GAINS, state, air(100_020_000, 0.0))
    _, late = altitude.step(GAINS, state._replace(since_us=40_000_000), air(100_020_000, 0.0))
    drift = GAINS.baro_drift**2 * (1.0 - math.exp(-120.0 / GAINS.baro_drift_time))
    assert late.altitude_variance - early.altitude_variance == pytest.approx(drift, rel=0.01)
    assert late.innovation_variance == early.innovation_variance


def test_spike_is_refused_and_a_lasting_step_believed() -> None:
    state, _ = altitude.step(GAINS, altitude.State(), air(0, 0.0))
    for k in range(1, 200):
        state, message = altitude.step(GAINS, state, air(20000 * k, 50.0 if k == 100 else 0.0))
        assert abs(message.altitude) < 0.1
    for k in range(200, 400):
        state, message = altitude.step(GAINS, state, air(20000 * k, 50.0))
        if k == 240:
            assert abs(message.altitude) < 1.0
    assert message.altitude == pytest.approx(50.0, abs=1.0)


def test_starts_at_the_first_reading_and_survives_bad_times() -> None:
    state, message = altitude.step(GAINS, altitude.State(), air(1000, 12.0))
    assert (message.altitude, message.climb_rate) == (12.0, 0.0)
    assert altitude.step(GAINS, state, air(1000, 90.0))[0] == state
    assert altitude.step(GAINS, state, air(500, 90.0))[0] == state


def test_state_survives_json() -> None:
    state = Flight(10.0, 5.0, seconds=2.0).state
    plain = json.loads(json.dumps(state))
    assert tuple(plain[1]) == state.x
    assert tuple(tuple(row) for row in plain[2]) == state.p


@pytest.mark.parametrize("noise", [1.0, 2.0, 6.0])
def test_a_fix_counts_by_its_noise_without_a_barometer(noise: float) -> None:
    """GIVEN variances P WHEN a fix of variance R comes THEN altitude and climb rate take P / (P + R) of it."""
    before = altitude.State(time_us=0, p=((4.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.01)))
    before = altitude.accumulate(before, 0.0)
    deaf = GAINS._replace(accel_noise=0.001, gps_altitude_noise=100.0, gps_climb_noise=20.0)
    higher, _ = altitude.coast(
        deaf._replace(gps_altitude_noise=noise), before, 20_000, altitude.Climb(altitude=10.0, climb_rate=0.0)
    )
    assert higher.x[0] == pytest.approx(10.0 * 4.0 / (4.0 + noise**2), rel=0.01)
    rising, _ = altitude.coast(
        deaf._replace(gps_climb_noise=noise), before, 20_000, altitude.Climb(altitude=0.0, climb_rate=5.0)
    )
    assert rising.x[1] == pytest.approx(5.0 / (1.0 + noise**2), rel=0.01)


def test_the_written_out_update_is_that_of_filterpy_to_the_bit() -> None:
    random = np.random.default_rng(1)
    for _ in range(500):
        root = random.normal(size=(3, 3)) * 10.0 ** random.uniform(-3.0, 1.0)
        x, p, variance = random.normal(size=3) * 50.0, root @ root.T, float(random.uniform(1e-3, 3.0))
        z = float(x[0] + random.normal())
        one_measurement = np.array((z,)), np.array([[variance]])
        expected = filterpy().update(x, p, *one_measurement, H=np.array([[1.0, 0.0, 0.0]]))
        result = update_first(x.tolist(), p.tolist(), z, variance)
        assert [np.array(one).tobytes() for one in result] == [one.tobytes() for one in expected]


def test_the_written_out_prediction_is_that_of_filterpy() -> None:
    random = np.random.default_rng(2)
    for _ in range(200):
        root = random.normal(size=(3, 3)) * 10.0 ** random.uniform(-3.0, 1.0)
        x, p, dt = random.normal(size=3) * 50.0, root @ root.T, float(random.uniform(0.005, 0.5))
        p = 0.5 * (p + p.T)
        dt, accel, count = round(1e6 * dt) * 1e-6, float(random.normal()), int(random.integers(0, 5))
        state = altitude.State(0, tuple(x.tolist()), tuple(map(tuple, p.tolist())), accel * count, count)
        effect = np.array((0.5 * dt * dt, dt, 0.0))
        transition = np.array(((1.0, dt, -effect[0]), (0.0, 1.0, -dt), (0.0, 0.0, 1.0)))
        sigma = GAINS.accel_noise if count else altitude.UNKNOWN_ACCELERATION
        noise = np.outer(effect, effect) * sigma**2 + np.diag((0.0, 0.0, GAINS.bias_walk**2 * dt))
        expected = filterpy().predict(x, p, F=transition, Q=noise, u=accel if count else float(x[2]), B=effect)
        result, _ = altitude.coast(GAINS, state, round(1e6 * dt), None)
        np.testing.assert_allclose(result.x, expected[0], rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(result.p, expected[1], rtol=1e-10, atol=1e-13 * np.abs(expected[1]).max())


def test_a_lasting_jump_is_taken_with_an_inflated_variance() -> None:
    """GIVEN a jump beyond the gate WHEN it lasts longer than the timeout THEN the variance is inflated."""
    state = Flight(10.0, 5.0, seconds=2.0).state._replace(accel_sum=0.0, accel_count=0)
    transition = np.array(((1.0, 0.02, -0.0002), (0.0, 1.0, -0.02), (0.0, 0.0, 1.0)))
    effect, rejected = np.array((0.0002, 0.02, 0.0)), 0
    noise = np.outer(effect, effect) * GAINS.accel_noise**2 + np.diag((0.0, 0.0, GAINS.bias_walk**2 * 0.02))
    pressure_altitude = state.x[0] + 30.0
    while rejected < 200:
        before = altitude.accumulate(state, 0.0)
        x, p = filterpy().predict(np.array(before.x), np.array(before.p), F=transition, Q=noise, u=0.0, B=effect)
        state, _ = altitude.step(GAINS, before, air(before.time_us + 20_000, pressure_altitude))
        if state.refused == 0.0:
            break
        np.testing.assert_allclose(state.x, x, rtol=1e-12, atol=1e-9)
        rejected += 1
    assert rejected == pytest.approx(GAINS.gate_timeout / 0.02, abs=1)
    innovation = pressure_altitude - x[0]
    p[0, 0] += innovation**2
    x, p = filterpy().update(x, p, pressure_altitude, GAINS.baro_noise**2, H=np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(state.x, x.ravel(), rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(state.p, p, rtol=1e-8, atol=1e-9)
