from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensors_bench import SPEC, quiet, variance_bounds

from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.environment.magnetic import field_ned
from sim_bridge.sensors.accelerometer import Accelerometer
from sim_bridge.sensors.gyroscope import Gyroscope
from sim_bridge.sensors.low_pass import corner, low_pass
from sim_bridge.sensors.magnetometer import Magnetometer
from sim_bridge.sensors.noise import sensor_seed
from wingbeat.quaternions import frd_from_ned, quaternion_from_euler

PERIOD = 0.005
SEED = sensor_seed(7, 0)
MILLI_G = 9.80665e-3
DEGREE = math.pi / 180.0


def test_accelerometer_resolves_and_saturates_as_its_data_sheet() -> None:
    sensor = Accelerometer(quiet(SPEC.accelerometer)._replace(bandwidth=0.0), SEED, PERIOD)
    lsb = 9.80665 / 256.0
    assert sensor.read((0.4 * lsb, 0.6 * lsb, -9.80665)) == pytest.approx((0.0, lsb, -9.80665))
    assert sensor.read((200.0, -200.0, 156.0)) == pytest.approx((4095 * lsb, -4096 * lsb, 4072 * lsb))


def test_gyroscope_resolves_and_saturates_as_its_data_sheet() -> None:
    sensor = Gyroscope(quiet(SPEC.gyroscope)._replace(bandwidth=0.0), SEED, PERIOD)
    lsb = DEGREE / 14.375
    assert sensor.read((0.4 * lsb, 0.6 * lsb, 100.0 * DEGREE)) == pytest.approx((0.0, lsb, 1438 * lsb), abs=1e-12)
    assert sensor.read((40.0, -40.0, 0.0)) == pytest.approx((2000 * DEGREE, -2000 * DEGREE, 0.0))


def test_magnetometer_saturates_as_its_data_sheet() -> None:
    strong = COLLEGE_PARK.magnetic._replace(strength=30.0, declination=0.0)
    x, y, z = Magnetometer(quiet(SPEC.magnetometer), SEED, strong).read((1.0, 0.0, 0.0, 0.0))
    assert (x, y, z) == pytest.approx((8.1, 0.0, 8.1))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_noise_at_rest_has_the_data_sheet_variance(axis: int) -> None:
    samples = 20000
    accelerometer = Accelerometer(SPEC.accelerometer, SEED, PERIOD)
    gyroscope = Gyroscope(SPEC.gyroscope._replace(bias_walk_deg_s=0.0), SEED, PERIOD)
    magnetometer = Magnetometer(SPEC.magnetometer, SEED, COLLEGE_PARK.magnetic)
    level = (1.0, 0.0, 0.0, 0.0)
    force = [accelerometer.read((0.0, 0.0, -9.81))[axis] * 256.0 / 9.80665 for _ in range(samples)]
    rate = [gyroscope.read((0.0, 0.0, 0.0))[axis] * 14.375 / DEGREE for _ in range(samples)]
    field = [magnetometer.read(level)[axis] * 230.0 for _ in range(samples)]
    rounding = 1.0 / 12.0
    low, high = variance_bounds(samples, SPEC.accelerometer.noise[axis] ** 2 + rounding)
    assert low < np.var(force, ddof=1) < high
    low, high = variance_bounds(samples, (0.38 * 14.375) ** 2 + rounding)
    assert low < np.var(rate, ddof=1) < high
    # Noise of less than half a count: rounding no longer adds a twelfth of a count, only its mean is told.
    assert 0.0 < np.var(field, ddof=1) < 0.6
    assert len(set(field)) <= 5


def test_units_differ_as_their_sigmas_say() -> None:
    units = [Accelerometer(SPEC.accelerometer, sensor_seed(seed, 0), PERIOD).errors for seed in range(400)]
    offsets = np.array([unit.offset for unit in units]).ravel()
    scales = np.array([unit.scale for unit in units]).ravel()
    low, high = variance_bounds(len(offsets), (5.0 * MILLI_G) ** 2)
    assert low < np.var(offsets, ddof=1) < high
    low, high = variance_bounds(len(scales), 0.003**2)
    assert low < np.var(scales, ddof=1) < high


def test_mean_reading_shows_the_units_offset_scale_and_misalignment() -> None:
    sensor = Accelerometer(SPEC.accelerometer, SEED, PERIOD)
    errors = sensor.errors
    force = np.array((3.0, -2.0, -9.81))
    mean = np.mean([sensor.read(tuple(force.tolist())) for _ in range(20000)], axis=0)
    turned = force - np.cross(errors.misalignment, force)
    expected = (1.0 + np.array(errors.scale)) * turned + errors.offset
    assert mean == pytest.approx(expected, abs=5.0 * 0.06 / math.sqrt(20000))
    assert np.abs(mean - force).max() > 0.01


def test_gyro_bias_walks_with_the_square_root_of_time() -> None:
    ticks, units = 2000, 60
    spec = quiet(SPEC.gyroscope)._replace(bias_walk_deg_s=0.01)
    walks: list[float] = []
    for seed in range(units):
        sensor = Gyroscope(spec, sensor_seed(seed, 1), PERIOD)
        assert sensor.bias == (0.0, 0.0, 0.0)
        for _ in range(ticks):
            sensor.read((0.0, 0.0, 0.0))
        walks.extend(sensor.bias)
    low, high = variance_bounds(3 * units, (0.01 * DEGREE) ** 2 * ticks * PERIOD)
    assert low < np.mean(np.square(walks)) < high


def gain_at(frequency: float, bandwidth: float) -> float:
    filtered, previous, peak = 0.0, 0.0, 0.0
    keep, before, now = low_pass(corner(bandwidth), PERIOD)
    for tick in range(4000):
        value = math.sin(math.tau * frequency * tick * PERIOD)
        filtered = keep * filtered + before * previous + now * value
        previous = value
        peak = max(peak, abs(filtered)) if tick > 1000 else peak
    return peak


@pytest.mark.parametrize("frequency", [0.7, 4.3, 11.7])
def test_low_pass_gain_is_that_of_a_first_order_lag(frequency: float) -> None:
    assert gain_at(frequency, 10.0) == pytest.approx(1.0 / math.hypot(1.0, frequency / 10.0), rel=0.02)


def test_no_bandwidth_is_no_filter() -> None:
    assert low_pass(corner(0.0), PERIOD) == (0.0, 0.0, 1.0)
    assert sum(low_pass(corner(98.0), PERIOD)) == pytest.approx(1.0)


def test_first_reading_starts_settled() -> None:
    sensor = Accelerometer(quiet(SPEC.accelerometer)._replace(bandwidth=5.0), SEED, PERIOD)
    assert sensor.read((0.0, 0.0, -9.80665))[2] == pytest.approx(-9.80665)
    assert sensor.read((0.0, 0.0, 9.80665))[2] < -6.0


angles = st.floats(-1.4, 1.4)


@given(angles, angles, st.floats(-3.0, 3.0))
def test_field_turns_with_the_body(roll: float, pitch: float, yaw: float) -> None:
    field = field_ned(COLLEGE_PARK.magnetic)
    body = frd_from_ned(quaternion_from_euler(roll, pitch, yaw), field)
    assert math.hypot(*body) == pytest.approx(0.506)
    nose = (
        math.cos(pitch) * math.cos(yaw) * field[0] + math.cos(pitch) * math.sin(yaw) * field[1]
        - math.sin(pitch) * field[2]
    )  # fmt: skip
    assert body[0] == pytest.approx(nose, abs=1e-12)
