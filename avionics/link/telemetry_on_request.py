"""Telemetry on request: raw sensors, estimator status, odometry.

The messages are as those of PX4 and ArduPilot. Every builder takes the vehicle and returns a message, or None if
there is no content.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

from avionics import messages as m
from avionics import topics as t
from avionics.link import sensor_codec
from avionics.link.dialect import mavlink
from avionics.link.mission_codec import to_degrees
from avionics.link.telemetry import boot_ms, home_place, int16
from avionics.link.vehicle import VehicleView
from avionics.sensors import Sensor
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.quaternions import frd_from_ned

T = TypeVar("T")
INNOVATION_GATE = 5.0
"""standard deviations; gate of PX4 and ArduPilot that normalizes their test ratios"""
_UNKNOWN_TILT = math.pi


def scaled_imu(vehicle: VehicleView) -> Any:
    """Return SCALED_IMU: mG, mrad/s, mgauss, body FRD axes."""
    now = vehicle.latest(t.IMU)
    return None if now is None else mavlink.MAVLink_scaled_imu_message(boot_ms(now.time_us), *_milli(now))


def raw_imu(vehicle: VehicleView) -> Any:
    """Return RAW_IMU in the units of SCALED_IMU, as ArduPilot does."""
    now = vehicle.latest(t.IMU)
    return None if now is None else mavlink.MAVLink_raw_imu_message(now.time_us, *_milli(now))


def _milli(imu: m.ImuSample) -> tuple[int, ...]:
    return tuple(
        int16(1e3 * value) for value in (*(each / STANDARD_GRAVITY for each in imu.accel), *imu.gyro, *imu.mag)
    )


def highres_imu(vehicle: VehicleView) -> Any:
    """Return HIGHRES_IMU: m/s^2, rad/s, gauss, hPa, m, degC; body FRD axes."""
    now, air = vehicle.latest(t.IMU), vehicle.latest(t.AIR_DATA)
    if now is None:
        return None
    pressures = (0.0, 0.0, 0.0, 0.0)
    if air is not None:
        celsius = air.temperature - 273.15
        pressures = (air.static_pressure / 100.0, air.dynamic_pressure / 100.0, air.pressure_altitude, celsius)
    fields_updated = 0x1FF | (0x1E00 if air is not None else 0)
    return mavlink.MAVLink_highres_imu_message(
        now.time_us, *now.accel, *now.gyro, *now.mag, *pressures, fields_updated
    )


def scaled_pressure(vehicle: VehicleView) -> Any:
    """Return SCALED_PRESSURE: hPa and 0.01 degC."""
    air = vehicle.latest(t.AIR_DATA)
    if air is None:
        return None
    return mavlink.MAVLink_scaled_pressure_message(
        boot_ms(air.time_us),
        air.static_pressure / 100.0,
        air.dynamic_pressure / 100.0,
        int16((air.temperature - 273.15) * 100.0),
    )


def altitude(vehicle: VehicleView) -> Any:
    """Return ALTITUDE: m; terrain unknown."""
    now = vehicle.latest(t.ALTITUDE)
    if now is None:
        return None
    above_sea = now.altitude + (vehicle.home.altitude if vehicle.home is not None else math.nan)
    local = now.altitude
    return mavlink.MAVLink_altitude_message(now.time_us, local, above_sea, local, local, math.nan, math.nan)


def gps_global_origin(vehicle: VehicleView) -> Any:
    """Return GPS_GLOBAL_ORIGIN of the local frame: degE7 and mm.

    The result is None before the first fix.
    """
    home = vehicle.home
    if home is None:
        return None
    return mavlink.MAVLink_gps_global_origin_message(*home_place(home), vehicle.time_us)


def _estimator_flags(vehicle: VehicleView) -> int:
    """Return the ESTIMATOR_STATUS_FLAGS that EKF_STATUS_FLAGS also has."""
    turn, height, place = vehicle.latest(t.ATTITUDE), vehicle.latest(t.ALTITUDE), vehicle.latest(t.POSITION)
    health = vehicle.latest(t.HEALTH)
    failures = health.failsafe if health is not None else 0
    flags = 0
    if turn is not None and turn.tilt_sigma < _UNKNOWN_TILT:
        flags |= mavlink.ESTIMATOR_ATTITUDE
    if height is not None and not failures & m.Failsafe.BARO_LOST:
        flags |= mavlink.ESTIMATOR_VELOCITY_VERT | mavlink.ESTIMATOR_POS_VERT_ABS
    if place is not None and place.valid and not failures & m.Failsafe.GPS_LOST:
        flags |= mavlink.ESTIMATOR_VELOCITY_HORIZ | mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
        flags |= mavlink.ESTIMATOR_PRED_POS_HORIZ_REL | mavlink.ESTIMATOR_PRED_POS_HORIZ_ABS
    return flags


def _ratio(innovation: float, variance: float) -> float:
    """Return the innovation over the gate in standard deviations; 0 before the first."""
    return abs(innovation) / (INNOVATION_GATE * math.sqrt(variance)) if variance > 0.0 else 0.0


def _ratios(vehicle: VehicleView) -> tuple[float, float, float, float, float]:
    """Return the test ratios, 1 at the gate.

    The order is velocity, horizontal position, altitude, magnetic field, airspeed.
    """
    place, height = vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE)
    turn, air = vehicle.latest(t.ATTITUDE), vehicle.latest(t.AIR_DATA)
    velocity = horizontal = vertical = field = airspeed = 0.0
    if place is not None:
        innovation = math.hypot(place.innovation_v_north, place.innovation_v_east)
        velocity = _ratio(innovation, place.velocity_innovation_variance)
        horizontal = _ratio(
            math.hypot(place.innovation_north, place.innovation_east), place.place_innovation_variance
        )
    if height is not None:
        vertical = _ratio(height.innovation, height.innovation_variance)
    if turn is not None:
        field = float(turn.magnetometer_disturbed)  # the AHRS has no variance of this innovation
    if air is not None:
        airspeed = _ratio(air.innovation, air.innovation_variance)
    return velocity, horizontal, vertical, field, airspeed


def ekf_status(vehicle: VehicleView) -> Any:
    """Return EKF_STATUS_REPORT as ArduPilot does: test ratios, 1 at the gate."""
    if vehicle.latest(t.ATTITUDE) is None:
        return mavlink.MAVLink_ekf_status_report_message(mavlink.EKF_UNINITIALIZED, 0.0, 0.0, 0.0, 0.0, 0.0)
    velocity, horizontal, vertical, field, airspeed = _ratios(vehicle)
    flags = _estimator_flags(vehicle)
    if not flags & mavlink.ESTIMATOR_POS_HORIZ_ABS:
        flags |= mavlink.EKF_CONST_POS_MODE
    return mavlink.MAVLink_ekf_status_report_message(flags, velocity, horizontal, vertical, field, 0.0, airspeed)


def estimator_status(vehicle: VehicleView) -> Any:
    """Return ESTIMATOR_STATUS as PX4 does: squared test ratios, 1 at the gate.

    The accuracies are one sigma in m.
    """
    place, height = vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE)
    if place is None or height is None:
        return None
    velocity, horizontal, vertical, field, airspeed = (ratio * ratio for ratio in _ratios(vehicle))
    flags = _estimator_flags(vehicle)
    if horizontal > 1.0 or velocity > 1.0:
        flags |= mavlink.ESTIMATOR_GPS_GLITCH
    return mavlink.MAVLink_estimator_status_message(
        place.time_us,
        flags,
        velocity,
        horizontal,
        vertical,
        field,
        0.0,
        airspeed,
        math.sqrt(place.position_variance),
        math.sqrt(height.altitude_variance),
    )


def odometry(vehicle: VehicleView) -> Any:
    """Return ODOMETRY.

    The position is in local NED (m), velocity (m/s) and rates (rad/s) in body FRD. Only the variances are known.
    """
    turn, place, height = vehicle.latest(t.ATTITUDE), vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE)
    if turn is None or height is None or place is None or not place.valid:
        return None
    quaternion = (turn.quaternion_w, turn.quaternion_x, turn.quaternion_y, turn.quaternion_z)
    horizontal, tilt, heading = place.position_variance, turn.tilt_sigma**2, turn.heading_sigma**2
    speed = place.velocity_variance
    return mavlink.MAVLink_odometry_message(
        turn.time_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_BODY_FRD,
        place.north,
        place.east,
        -height.altitude,
        list(quaternion),
        *frd_from_ned(quaternion, (place.v_north, place.v_east, -height.climb_rate)),
        turn.roll_rate,
        turn.pitch_rate,
        turn.yaw_rate,
        _covariance(horizontal, horizontal, height.altitude_variance, tilt, tilt, heading),
        _covariance(speed, speed, height.climb_variance, math.nan, math.nan, math.nan),
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        0,
    )


def _covariance(*variances: float) -> list[float]:
    """Return the upper triangle (21,) by rows of a 6 by 6 matrix with ``variances``.

    The other elements are unknown.
    """
    triangle = [math.nan] * 21
    for row, variance in enumerate(variances):
        triangle[row * 6 - row * (row - 1) // 2] = variance
    return triangle


def vibration(vehicle: VehicleView) -> Any:
    """Return VIBRATION: m/s^2, and number of samples with a saturated axis."""
    now = vehicle.latest(t.VIBRATION)
    if now is None:
        return None
    levels = (now.level_x, now.level_y, now.level_z)
    return mavlink.MAVLink_vibration_message(now.time_us, *levels, int(now.clipped), 0, 0)


def actuator_outputs(vehicle: VehicleView) -> Any:
    """Return ACTUATOR_OUTPUT_STATUS.

    The order is wings (rad), elevator (rad), rudder (rad), throttle (0 to 1).
    """
    now = vehicle.latest(t.ACTUATORS)
    if now is None:
        return None
    outputs = (now.wing_left, now.wing_right, now.elevator, now.rudder, now.throttle)
    return mavlink.MAVLink_actuator_output_status_message(
        now.time_us, (1 << len(outputs)) - 1, [*outputs, *([0.0] * (32 - len(outputs)))]
    )


_TARGET_MASK = 0b1001_1111_1000
"""POSITION_TARGET_TYPEMASK: velocity, acceleration and yaw rate are ignored"""
_NO_POSITION = 0b11


def position_target_global(vehicle: VehicleView) -> Any:
    """Return POSITION_TARGET_GLOBAL_INT: degE7, m above mean sea level, rad.

    The position is masked if there is none.
    """
    now, home, destination = vehicle.latest(t.NAVIGATION), vehicle.home, vehicle.destination
    if now is None or home is None:
        return None
    latitude, longitude = (0.0, 0.0) if destination is None else to_degrees(home, *destination)
    mask = _TARGET_MASK | (_NO_POSITION if destination is None else 0)
    place = (round(latitude * 1e7), round(longitude * 1e7), home.altitude + now.altitude_setpoint)
    return mavlink.MAVLink_position_target_global_int_message(
        boot_ms(now.time_us), mavlink.MAV_FRAME_GLOBAL_INT, mask, *place, *(0.0,) * 6, now.heading_setpoint, 0.0
    )


def position_target_local(vehicle: VehicleView) -> Any:
    """Return POSITION_TARGET_LOCAL_NED: m, rad.

    The position is masked if there is none.
    """
    now, destination = vehicle.latest(t.NAVIGATION), vehicle.destination
    if now is None:
        return None
    north, east = destination or (0.0, 0.0)
    mask = _TARGET_MASK | (_NO_POSITION if destination is None else 0)
    place = (north, east, -now.altitude_setpoint)
    return mavlink.MAVLink_position_target_local_ned_message(
        boot_ms(now.time_us), mavlink.MAV_FRAME_LOCAL_NED, mask, *place, *(0.0,) * 6, now.heading_setpoint, 0.0
    )


def sensor_message(sensor: Sensor[T]) -> Callable[[VehicleView], Any]:
    """Return the builder of the standard message of a sensor."""

    def build(vehicle: VehicleView) -> Any:
        sample = vehicle.latest(sensor.topic)
        return None if sample is None else sensor_codec.message(sensor, sample)

    return build
