"""Start-up errors of the sensors: found before arming, or estimated in flight."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulate import ARIZONA, RAVEN, Alter, Flight, rms, simulate

from avionics import topics
from avionics.messages import SensorFrame
from avionics.sensing import air_data
from sim_bridge.environment.home import COLLEGE_PARK
from sim_bridge.environment.magnetic import field_ned
from sim_bridge.flight.world import Scenario
from sim_bridge.vehicles import load_vehicle

IN_HAND = 6.0
"""s; before the throw"""
ARMED = 2.0
"""s; when a scripted start arms"""
G = 9.80665
LEARNED = {"accel_x": 6.0, "accel_y": 12.0}
"""s; after the launch, or after the first change of course by 60 degrees, by when the offset is estimated"""


def imu_error(**errors: float) -> Alter:
    """Constants added to fields of the IMU sample."""

    def alter(frame: SensorFrame) -> SensorFrame:
        imu = frame.imu
        return frame._replace(imu=imu._replace(**{name: getattr(imu, name) + e for name, e in errors.items()}))

    return alter


def gyro_error(offset_deg_s: float) -> Alter:
    offset = math.radians(offset_deg_s)
    return imu_error(gyro_x=offset, gyro_y=-offset, gyro_z=offset)


def pitot_error(pressure: float) -> Alter:
    gains = air_data.Gains()
    counts = round(pressure * (gains.differential_high - gains.differential_low) / (2.0 * gains.differential_range))

    def alter(frame: SensorFrame) -> SensorFrame:
        sample = frame.pressures
        if sample is None:
            return frame
        return frame._replace(pressures=sample._replace(differential_counts=sample.differential_counts + counts))

    return alter


def turning_iron(vehicle: str, angle_deg: float) -> Alter:
    """A hard iron that turns the field about the vertical at rest, facing north: strength and dip are right."""
    held = Rotation.from_euler("ZYX", (0.0, load_vehicle(vehicle).launch.pitch, 0.0))
    field = np.array(field_ned(COLLEGE_PARK.magnetic))
    iron = held.inv().apply(Rotation.from_euler("z", math.radians(angle_deg)).apply(field) - field)
    return imu_error(mag_x=float(iron[0]), mag_y=float(iron[1]), mag_z=float(iron[2]))


def errors(flight: Flight) -> tuple[Any, Any]:
    """Times (s) and errors (n, 3) in degrees of roll, pitch and yaw."""
    attitude = flight.columns(topics.ATTITUDE)
    true = [np.interp(attitude["time_us"], flight.truth["time_us"], np.unwrap(a)) for a in flight.true_attitude()]
    told = [attitude[name] for name in ("roll", "pitch", "yaw")]
    difference = np.stack(told, axis=1) - np.stack(true, axis=1)
    return attitude["time_us"] * 1e-6, np.degrees((difference + np.pi) % (2.0 * np.pi) - np.pi)


def refusal(flight: Flight) -> str:
    """The reason of a refused arming; empty if the vehicle was armed at `ARMED`."""
    reasons = [text for text in flight.events() if text.startswith("arming denied")]
    if not reasons:
        assert flight.event_time("armed") == pytest.approx(ARMED, abs=0.01)
    return "; ".join(reasons)


def turned_at(flight: Flight) -> float:
    """Time (s) at which the course had changed by 60 degrees since the launch."""
    launch, _ = flight.air_time()
    time, truth = flight.truth["time_us"] * 1e-6, flight.truth
    flying = time > launch + 1.0
    course = np.unwrap(np.arctan2(truth["v_east"], truth["v_north"])[flying])
    return float(time[flying][np.argmax(np.abs(course - course[0]) > math.radians(60.0))])


@pytest.mark.parametrize("offset_deg_s", [5.7, 20.0])
def test_gyro_offset_is_calibrated_in_the_hand(offset_deg_s: float) -> None:
    """GIVEN a gyro offset at boot THEN it is armed, level within 2 degrees and its heading stands still."""
    flight = simulate(RAVEN, Scenario(seed=1, duration=IN_HAND), alter=gyro_error(offset_deg_s))
    assert refusal(flight) == ""
    time, error = errors(flight)
    assert np.abs(error[time > 1.6, :2]).max() < 2.0
    assert abs(np.polyfit(time[time > 2.0], error[time > 2.0, 2], 1)[0]) < 0.2


@pytest.mark.parametrize(
    ("vehicle", "alter", "sensor"),
    [
        (RAVEN, gyro_error(50.0), "gyro"),
        (RAVEN, imu_error(accel_z=-0.15 * G), "accelerometer"),
        (ARIZONA, imu_error(accel_z=0.15 * G), "accelerometer"),
        (RAVEN, imu_error(accel_x=0.15 * G), "magnetometer or accelerometer"),
        (RAVEN, imu_error(mag_x=0.25), "magnetometer"),
        (RAVEN, imu_error(mag_z=-0.25), "magnetometer"),
        (ARIZONA, imu_error(mag_x=-0.25), "magnetometer"),
        (RAVEN, pitot_error(30.0), "pitot"),
        (ARIZONA, pitot_error(-30.0), "pitot"),
    ],
)
def test_errors_observable_at_rest_forbid_arming(vehicle: str, alter: Alter, sensor: str) -> None:
    flight = simulate(vehicle, Scenario(seed=1, duration=ARMED + 0.1), alter=alter)
    assert sensor in refusal(flight)


@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
@pytest.mark.parametrize("seeds", [range(1, 4), pytest.param(range(4, 41), marks=pytest.mark.validate)])
def test_healthy_vehicle_in_gusts_is_armed(vehicle: str, seeds: range) -> None:
    for seed in seeds:
        air = {"wind_speed": 3.0, "wind_from": 1.3 * seed, "turbulence": "small_uav_light"}
        flight = simulate(vehicle, Scenario(seed=seed, duration=ARMED + 0.1, **air))  # type: ignore[arg-type]
        assert refusal(flight) == ""


@pytest.mark.parametrize("corner_seed", range(1, 4))
def test_two_sigma_of_every_sensor_is_armed(corner_seed: int) -> None:
    flight = simulate(RAVEN, Scenario(seed=corner_seed, duration=ARMED + 0.1, sensor_corner=2.0))
    assert refusal(flight) == ""


def test_launch_corrects_a_turned_compass() -> None:
    """GIVEN a hard iron that turns the field by 71 degrees WHEN it is thrown THEN the heading is right 1 s later."""
    flight = simulate(RAVEN, Scenario(seed=1, duration=14.0), alter=turning_iron(RAVEN, 71.0))
    assert refusal(flight) == ""
    time, error = errors(flight)
    launch, _ = flight.air_time()
    assert abs(error[time < launch, 2][-1]) > 60.0
    flying = time > launch + 1.0
    assert rms(error[flying, 2]) < 3.0
    assert rms(error[flying, :2]) < 1.5


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("offset_deg_s", [5.7, 20.0])
def test_flight_with_a_gyro_offset(vehicle: str, seed: int, offset_deg_s: float) -> None:
    flight = simulate(vehicle, Scenario(seed=seed, duration=60.0), alter=gyro_error(offset_deg_s))
    assert refusal(flight) == ""
    time, error = errors(flight)
    flying = time > flight.air_time()[0]
    assert max(rms(error[flying, 0]), rms(error[flying, 1])) < 1.5
    assert rms(error[flying, 2]) < 3.0


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("angle_deg", [-71.0, 12.0, 71.0])
def test_flight_with_a_turned_compass(vehicle: str, seed: int, angle_deg: float) -> None:
    flight = simulate(vehicle, Scenario(seed=seed, duration=60.0), alter=turning_iron(vehicle, angle_deg))
    assert refusal(flight) == ""
    time, error = errors(flight)
    flying = time > flight.air_time()[0] + 1.0
    assert max(rms(error[flying, 0]), rms(error[flying, 1])) < 1.5
    assert rms(error[flying, 2]) < 4.0


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("axis", "wind_from"), [("accel_y", 0.0), ("accel_x", 0.5 * math.pi)])
@pytest.mark.parametrize("offset", [-0.15, 0.15])
def test_flight_with_a_horizontal_accelerometer_offset(
    vehicle: str, seed: int, axis: str, wind_from: float, offset: float
) -> None:
    """GIVEN 150 mg across the field's meridian, which rest does not show THEN not armed, or estimated in flight."""
    check_offset(vehicle, Scenario(seed=seed, duration=75.0, wind_from=wind_from), axis, offset)


def check_offset(vehicle: str, scenario: Scenario, axis: str, offset: float) -> None:
    flight = simulate(vehicle, scenario, alter=imu_error(**{axis: offset * G}))
    if refusal(flight):
        return
    time, error = errors(flight)
    since = turned_at(flight) if axis == "accel_y" else flight.air_time()[0]
    known = (time > since + LEARNED[axis]) & (time < flight.air_time()[1])
    assert known.sum() > 1000
    assert max(rms(error[known, 0]), rms(error[known, 1])) < 1.5


@pytest.mark.parametrize("vehicle", [RAVEN, pytest.param(ARIZONA, marks=pytest.mark.validate)])
def test_accelerometer_offset_along_body_x_is_estimated_before_the_first_turn(vehicle: str) -> None:
    """GIVEN 150 mg across the field's meridian WHEN it is launched THEN roll and pitch are right 6 s later."""
    check_offset(vehicle, Scenario(seed=1, duration=20.0, wind_from=0.5 * math.pi), "accel_x", -0.15)


@pytest.mark.validate
@pytest.mark.parametrize("vehicle", [RAVEN, ARIZONA])
@pytest.mark.parametrize(("seed", "offset"), [(3, 0.15), (4, -0.15)])
def test_accelerometer_offset_along_body_x_is_estimated_in_gusts(vehicle: str, seed: int, offset: float) -> None:
    air = {"wind_speed": 3.0, "wind_from": 0.5 * math.pi, "turbulence": "small_uav_light"}
    check_offset(vehicle, Scenario(seed=seed, duration=100.0, **air), "accel_x", offset)  # type: ignore[arg-type]
