"""An IMU that repeats itself, or stands at its range."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from avionics.messages import ImuSample
from avionics.sensing import imu_health as health
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.observation import Observation
from sim_bridge.sensors.suite import SensorSuite, sensor_spec
from sim_bridge.vehicles import load_vehicle

sys.path.insert(0, str(Path(__file__).parent))

from flapping_airframe import SLOW_HAWK, fly

GAINS = health.Gains()
TICK_US = 5000


def run(samples: list[ImuSample], frequency: float = 0.0, gains: health.Gains = GAINS) -> list[health.Flags]:
    state, flags = health.State(), []
    for imu in samples:
        state, flag = health.step(gains, state, imu, frequency)
        flags.append(flag)
    return flags


def noisy(count: int, seed: int = 3) -> list[ImuSample]:
    values = np.random.default_rng(seed).normal(0.0, 0.05, (count, 6)).tolist()
    return [ImuSample((k + 1) * TICK_US, *row, 0.2, 0.0, 0.4) for k, row in enumerate(values)]


def resting_suite_samples(count: int) -> list[ImuSample]:
    """The modelled sensors of a vehicle at rest: counts of a data sheet's resolution and noise."""
    suite = SensorSuite(sensor_spec(load_vehicle("robo_raven_ii_d").sections), 5, COLLEGE_PARK)
    still = Observation(
        TICK_US, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -9.80665), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0), 101325.0, 288.15, 1.225, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.05, 5.0, 300.0,
    )  # fmt: skip
    return [ImuSample(*suite.sample(still._replace(time_us=(k + 1) * TICK_US), k).imu) for k in range(count)]


def test_identical_samples_are_frozen_after_a_tenth_of_a_second() -> None:
    """GIVEN a sensor that repeats its last sample THEN it is frozen from 0.1 s on, not before."""
    samples = noisy(100)
    stuck = [samples[-1]._replace(time_us=samples[-1].time_us + k * TICK_US) for k in range(1, 60)]
    flags = run(samples + stuck)
    frozen = [k for k, flag in enumerate(flags) if flag.frozen]
    assert frozen == list(range(99 + 20, 159))


def test_a_changed_axis_thaws_it() -> None:
    samples = noisy(2)
    stuck = [samples[-1]._replace(time_us=samples[-1].time_us + k * TICK_US) for k in range(1, 60)]
    alive = stuck[-1]._replace(time_us=stuck[-1].time_us + TICK_US, gyro_z=stuck[-1].gyro_z + 0.001)
    flags = run([*samples, *stuck, alive])
    assert (flags[-2].frozen, flags[-1].frozen) == (1, 0)


def test_a_living_sensor_at_rest_is_never_frozen() -> None:
    """GIVEN the modelled sensors' noise and resolution WHEN the vehicle lies still for 20 s THEN none is frozen."""
    assert not any(flag.frozen for flag in run(resting_suite_samples(4000)))


def test_the_magnetometer_may_repeat_itself() -> None:
    assert not any(flag.frozen for flag in run(noisy(200)))


def test_flapping_within_the_range_is_not_saturated() -> None:
    flags = run(fly(SLOW_HAWK, 3.0).samples, SLOW_HAWK.frequency)
    assert not any(flag.saturated for flag in flags)


def test_the_share_of_a_stroke_at_the_range_is_told() -> None:
    """GIVEN a heave clipped by a sensor of a smaller range THEN the share is the sine's time above it."""
    rate, amplitude, limit = 5.0, 40.0, 30.0
    gains = GAINS._replace(accel_range=limit, range_share=1.0)
    samples = [
        imu._replace(accel_z=max(-limit, min(limit, amplitude * math.sin(math.tau * rate * k / 200.0))))
        for k, imu in enumerate(noisy(1000))
    ]
    flags = run(samples, rate, gains)
    expected = 2.0 * math.acos(limit / amplitude) / math.pi
    assert flags[-1].saturated == 1
    assert flags[-1].saturated_share == pytest.approx(expected, abs=0.06)


def test_saturation_ends_two_strokes_after_it() -> None:
    samples = noisy(300)
    samples[100:140] = [imu._replace(gyro_x=34.9) for imu in samples[100:140]]
    flags = run(samples, 5.0)
    saturated = [k for k, flag in enumerate(flags) if flag.saturated]
    assert 100 <= saturated[0] <= 103
    assert 139 <= saturated[-1] <= 139 + 80
    assert not flags[-1].saturated


def test_time_that_does_not_rise_changes_nothing() -> None:
    samples = noisy(3)
    state, _ = health.step(GAINS, health.State(), samples[2])
    assert health.step(GAINS, state, samples[1])[0] == state
