from __future__ import annotations

import math

import numpy as np
import pytest
from sensors_bench import SPEC, cruise, perfect, quiet, variance_bounds

from sim_bridge.environment.geodesy import ned_from_geodetic
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.sensors.gps import Gps, GpsSpec
from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.suite import SensorSuite
from wingbeat.samples import GpsFix

PERIOD = 0.2


def receiver(spec: GpsSpec, seed: int = 1) -> Gps:
    return Gps(spec._replace(latency=0.0), sensor_seed(seed, 7), COLLEGE_PARK, PERIOD)


def fix_of(gps: Gps, tick: int = 0, **changes: object) -> GpsFix:
    observation = cruise(tick, **changes)
    gps.measure(observation)
    fix = gps.arrived(observation.time_us)
    assert fix is not None
    return fix


def ned(fix: GpsFix) -> tuple[float, float, float]:
    return ned_from_geodetic(COLLEGE_PARK, fix.latitude, fix.longitude, fix.altitude)


def test_fix_without_errors_is_the_place_to_the_resolution_of_the_wire() -> None:
    fix = fix_of(receiver(quiet(SPEC.gps)), position_ned=(123.4, -56.7, -40.1234), v_ned=(7.756, -0.124, 0.331))
    assert ned(fix)[:2] == pytest.approx((123.4, -56.7), abs=0.006)
    assert fix.altitude == pytest.approx(60.123, abs=1e-9)
    assert fix[4:7] == pytest.approx((7.76, -0.12, 0.33), abs=1e-9)
    assert (fix.fix_type, fix.satellites) == (3, 9)


def test_fix_tells_of_the_past_by_its_latency() -> None:
    # GIVEN a receiver with 150 ms of latency on a vehicle that flies north at 10 m/s
    suite = SensorSuite(perfect(), 1, COLLEGE_PARK)
    arrivals = []
    # WHEN two seconds pass
    for tick in range(400):
        observation = cruise(tick, position_ned=(10.0 * 0.005 * tick, 0.0, -40.0), v_ned=(10.0, 0.0, 0.0))
        gps = suite.sample(observation, tick).gps
        if gps is not None:
            arrivals.append((tick, gps))
    # THEN ten fixes arrived, each 30 ticks after its measurement and 1.5 m behind
    assert [tick for tick, _ in arrivals] == list(range(30, 400, 40))
    for tick, gps in arrivals:
        assert gps.time_us == tick * 5000
        assert ned(gps)[0] == pytest.approx(0.05 * (tick - 30), abs=0.006)


def test_latency_longer_than_the_period_loses_no_fix() -> None:
    slow = perfect()._replace(gps=quiet(SPEC.gps)._replace(latency=0.5))
    suite = SensorSuite(slow, 1, COLLEGE_PARK)
    ticks = [tick for tick in range(400) if suite.sample(cruise(tick), tick).gps is not None]
    assert ticks == list(range(100, 400, 40))


def test_error_has_the_specified_size_and_correlation() -> None:
    lag = 25  # 5 s
    errors = []
    for seed in range(300):
        gps = receiver(SPEC.gps, seed)
        fixes = [fix_of(gps, 40 * k, position_ned=(0.0, 0.0, -40.0)) for k in range(lag + 1)]
        errors.append([ned(fixes[0]), ned(fixes[-1])])
    first, later = np.array(errors)[:, 0], np.array(errors)[:, 1]
    first[:, 2] += 40.0
    later[:, 2] += 40.0
    for axis, sigma in enumerate((2.1, 2.1, 4.0)):
        low, high = variance_bounds(300, sigma**2 + 0.2**2)
        assert low < np.mean(first[:, axis] ** 2) < high
        assert low < np.mean(later[:, axis] ** 2) < high
    expected = math.exp(-5.0 / 60.0) * np.array((2.1, 2.1, 4.0)) ** 2
    change = np.mean((later - first) ** 2, axis=0)
    assert change == pytest.approx(2.0 * (np.array((2.1, 2.1, 4.0)) ** 2 - expected + 0.04), rel=0.4)
    assert abs(np.corrcoef(first[:, 0], first[:, 1])[0, 1]) < 5.0 / math.sqrt(300)


def test_velocity_noise_is_white() -> None:
    gps = receiver(SPEC.gps)
    v = np.array([fix_of(gps, 40 * k).v_east for k in range(5000)])
    low, high = variance_bounds(len(v), 0.1**2 + 0.01**2 / 12.0)
    assert low < np.var(v, ddof=1) < high
    assert abs(np.corrcoef(v[1:], v[:-1])[0, 1]) < 5.0 / math.sqrt(len(v))


def test_accuracy_is_told_in_centimetres() -> None:
    fix = fix_of(receiver(SPEC.gps))
    assert (fix.horizontal_accuracy, fix.vertical_accuracy) == pytest.approx((2.97, 4.0), abs=1e-9)
