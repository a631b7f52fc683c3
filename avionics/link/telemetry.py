"""Telemetry codec: topics of the vehicle as MAVLink messages in wire units.

Every builder takes the vehicle and returns a message, or None if there is no content.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from avionics import messages as m
from avionics import topics as t
from avionics.link.codec import FULL_DEFLECTION
from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home, VehicleView
from wingbeat.topic import Topic

_UNKNOWN_U16 = 0xFFFF
CHANNELS_SENT = 18
"""channels of RC_CHANNELS"""
_COULOMB_PER_MAH = 3.6
_JOULE_PER_HJ = 100.0


def boot_ms(time_us: int) -> int:
    """Return ``time_boot_ms``: milliseconds since boot in 32 bits."""
    return time_us // 1000 & 0xFFFFFFFF


def clamped(value: float, low: int, high: int) -> int:
    """Return ``value`` rounded and limited to the range of a field.

    A value that is not finite becomes ``low``.
    """
    return min(max(round(value), low), high) if math.isfinite(value) else low


def int16(value: float) -> int:
    """Return ``value`` as the nearest 16-bit integer."""
    return clamped(value, -32768, 32767)


def _u16(value: float) -> int:
    return clamped(value, 0, _UNKNOWN_U16 - 1)


def int32(value: float) -> int:
    """Return ``value`` as the nearest 32-bit integer."""
    return clamped(value, -(2**31), 2**31 - 1)


def degrees_e7(angle: float) -> int:
    """Return a latitude or longitude (rad) as degE7."""
    return int32(math.degrees(angle) * 1e7)


def heading_cdeg(yaw: float) -> int:
    """Return a heading (rad) as 0 to 35999 hundredths of a degree."""
    return round(math.degrees(yaw) * 100.0) % 36000


def attitude(vehicle: VehicleView) -> Any:
    """Return ATTITUDE."""
    now = vehicle.latest(t.ATTITUDE)
    if now is None:
        return None
    return mavlink.MAVLink_attitude_message(
        boot_ms(now.time_us), now.roll, now.pitch, now.yaw, now.roll_rate, now.pitch_rate, now.yaw_rate
    )


def attitude_quaternion(vehicle: VehicleView) -> Any:
    """Return ATTITUDE_QUATERNION."""
    now = vehicle.latest(t.ATTITUDE)
    if now is None:
        return None
    quaternion = (now.quaternion_w, now.quaternion_x, now.quaternion_y, now.quaternion_z)
    return mavlink.MAVLink_attitude_quaternion_message(
        boot_ms(now.time_us), *quaternion, now.roll_rate, now.pitch_rate, now.yaw_rate
    )


def _mean_sea_level(vehicle: VehicleView) -> float:
    return vehicle.home.altitude if vehicle.home is not None else 0.0


def _throttle(vehicle: VehicleView) -> float:
    if vehicle.mode in (m.Mode.MANUAL, m.Mode.STABILIZED):
        pilot = vehicle.latest(t.PILOT)
        return 0.0 if pilot is None else float(pilot.throttle)
    loop = vehicle.latest(t.ALTITUDE_LOOP)
    return 0.0 if loop is None else float(loop.throttle)


def vfr_hud(vehicle: VehicleView) -> Any:
    """Return VFR_HUD: m/s, integer degrees, percent, altitude above mean sea level."""
    air, height, turn = vehicle.latest(t.AIR_DATA), vehicle.latest(t.ALTITUDE), vehicle.latest(t.ATTITUDE)
    place = vehicle.latest(t.POSITION)
    if air is None or height is None or turn is None:
        return None
    ground_speed = math.hypot(place.v_north, place.v_east) if place is not None else 0.0
    return mavlink.MAVLink_vfr_hud_message(
        air.airspeed,
        ground_speed,
        heading_cdeg(turn.yaw) // 100,
        clamped(_throttle(vehicle) * 100.0, 0, 100),
        _mean_sea_level(vehicle) + height.altitude,
        height.climb_rate,
    )


def global_position(vehicle: VehicleView) -> Any:
    """Return GLOBAL_POSITION_INT: degE7, mm, cm/s, cdeg; None before the first fix."""
    place, height, turn = vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE), vehicle.latest(t.ATTITUDE)
    if place is None or not place.valid or height is None:
        return None
    return mavlink.MAVLink_global_position_int_message(
        boot_ms(place.time_us),
        degrees_e7(place.latitude),
        degrees_e7(place.longitude),
        int32((_mean_sea_level(vehicle) + height.altitude) * 1e3),
        int32(height.altitude * 1e3),
        int16(place.v_north * 100.0),
        int16(place.v_east * 100.0),
        int16(-height.climb_rate * 100.0),
        heading_cdeg(turn.yaw) if turn is not None else _UNKNOWN_U16,
    )


def local_position(vehicle: VehicleView) -> Any:
    """Return LOCAL_POSITION_NED."""
    place, height = vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE)
    if place is None or not place.valid or height is None:
        return None
    return mavlink.MAVLink_local_position_ned_message(
        boot_ms(place.time_us),
        place.north,
        place.east,
        -height.altitude,
        place.v_north,
        place.v_east,
        -height.climb_rate,
    )


def gps_raw(vehicle: VehicleView) -> Any:
    """Return GPS_RAW_INT: accuracies in ``h_acc``, ``v_acc`` in mm; dilutions unknown."""
    fix = vehicle.latest(t.GPS)
    if fix is None:
        return None
    speed = math.hypot(fix.v_north, fix.v_east)
    return mavlink.MAVLink_gps_raw_int_message(
        fix.time_us,
        fix.fix_type,
        degrees_e7(fix.latitude),
        degrees_e7(fix.longitude),
        int32(fix.altitude * 1e3),
        _UNKNOWN_U16,
        _UNKNOWN_U16,
        _u16(speed * 100.0),
        heading_cdeg(math.atan2(fix.v_east, fix.v_north)),
        min(fix.satellites, 254),
        h_acc=clamped(fix.horizontal_accuracy * 1e3, 0, 2**32 - 1),
        v_acc=clamped(fix.vertical_accuracy * 1e3, 0, 2**32 - 1),
    )


def battery(vehicle: VehicleView) -> Any:
    """Return BATTERY_STATUS: mV, cA, mAh, hJ, percent.

    The voltage of the pack is in the first cell.
    """
    power = vehicle.latest(t.POWER)
    if power is None:
        return None
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        [_u16(power.voltage * 1e3)] + [_UNKNOWN_U16] * 9,
        int16(power.current * 100.0),
        int32(power.charge / _COULOMB_PER_MAH),
        int32(power.energy / _JOULE_PER_HJ),
        clamped(power.battery_remaining * 100.0, 0, 100),
    )


_GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
_ACCELEROMETER = mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
_MAGNETOMETER = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
_BAROMETER = mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
_PITOT = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
_GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
_BATTERY = mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
_AHRS = mavlink.MAV_SYS_STATUS_AHRS
_CHECK = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_IMU = _GYRO | _ACCELEROMETER | _MAGNETOMETER
_RECEIVER = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
_SENSORS: tuple[tuple[Topic[Any], int], ...] = (
    (t.IMU, _IMU),
    (t.PRESSURES, _BAROMETER | _PITOT),
    (t.GPS, _GPS),
    (t.ADC, _BATTERY),
    (t.RECEIVER, _RECEIVER),
    (t.ATTITUDE, _AHRS),
)
_FAULTS = (
    (m.Failsafe.IMU_FAULT, _IMU | _AHRS),
    (m.Failsafe.ACCEL_SATURATED, _ACCELEROMETER),
    (m.Failsafe.MAG_DISTURBED, _MAGNETOMETER),
    (m.Failsafe.BARO_REFUSED, _BAROMETER),
    (m.Failsafe.BARO_LOST, _BAROMETER),
    (m.Failsafe.PITOT_BLOCKED, _PITOT),
    (m.Failsafe.GPS_LOST, _GPS),
    (m.Failsafe.BATTERY_LOW, _BATTERY),
    (m.Failsafe.RECEIVER_LOST, _RECEIVER),
)


def _ready(vehicle: VehicleView) -> bool:
    """Return whether the vehicle is armed, or arming would be accepted."""
    return vehicle.armed or not vehicle.refusal(m.Command(vehicle.time_us, m.CommandKind.ARM))


def sys_status(vehicle: VehicleView) -> Any:
    """Return SYS_STATUS: sensors present, enabled and healthy; mV, cA, percent.

    The bit of the prearm check is healthy if the flight core would arm.
    """
    present = sum(bits for topic, bits in _SENSORS if vehicle.latest(topic) is not None)
    state = vehicle.latest(t.HEALTH)
    failures = state.failsafe if state is not None else 0
    sick = sum(bits for flag, bits in _FAULTS if failures & flag)
    # Ground stations report a fence that is not healthy as a breach, even without a fence.
    fence = 0 if failures & m.Failsafe.FENCE else mavlink.MAV_SYS_STATUS_GEOFENCE
    check = _CHECK if _ready(vehicle) else 0
    power = vehicle.latest(t.POWER)
    rejected = state.rejected_samples if state is not None else 0
    return mavlink.MAVLink_sys_status_message(
        present | _CHECK,
        present | _CHECK,
        present & ~sick | fence | check,
        0,
        _u16(power.voltage * 1e3) if power is not None else _UNKNOWN_U16,
        int16(power.current * 100.0) if power is not None else -1,
        clamped(power.battery_remaining * 100.0, 0, 100) if power is not None else -1,
        0,
        0,
        min(rejected, _UNKNOWN_U16),
        0,
        0,
        0,
    )


_LANDED = {
    m.Stage.ON_GROUND: mavlink.MAV_LANDED_STATE_ON_GROUND,
    m.Stage.WAIT_LAUNCH: mavlink.MAV_LANDED_STATE_ON_GROUND,
    m.Stage.CLIMB_OUT: mavlink.MAV_LANDED_STATE_TAKEOFF,
    m.Stage.EN_ROUTE: mavlink.MAV_LANDED_STATE_IN_AIR,
    m.Stage.APPROACH: mavlink.MAV_LANDED_STATE_LANDING,
    m.Stage.FLARE: mavlink.MAV_LANDED_STATE_LANDING,
    m.Stage.LANDED: mavlink.MAV_LANDED_STATE_ON_GROUND,
}


def landed_state(vehicle: VehicleView) -> int:
    """Return MAV_LANDED_STATE from the flight stage."""
    navigation = vehicle.latest(t.NAVIGATION)
    unknown: int = mavlink.MAV_LANDED_STATE_UNDEFINED
    return unknown if navigation is None else _LANDED.get(navigation.stage, unknown)


def extended_sys_state(vehicle: VehicleView) -> Any:
    """Return EXTENDED_SYS_STATE."""
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, landed_state(vehicle))


def home_place(home: Home) -> tuple[int, int, int]:
    """Return latitude and longitude in degE7, altitude above mean sea level in mm."""
    return degrees_e7(home.latitude), degrees_e7(home.longitude), int32(home.altitude * 1e3)


def home_position(vehicle: VehicleView) -> Any:
    """Return HOME_POSITION: degE7 and mm; None before the first fix."""
    home = vehicle.home
    if home is None:
        return None
    return mavlink.MAVLink_home_position_message(
        *home_place(home),
        0.0,
        0.0,
        0.0,
        [1.0, 0.0, 0.0, 0.0],
        0.0,
        0.0,
        0.0,
        vehicle.time_us,
    )


def wind(vehicle: VehicleView) -> Any:
    """Return WIND_COV, with one sigma of the wind as its accuracy."""
    place, height = vehicle.latest(t.POSITION), vehicle.latest(t.ALTITUDE)
    if place is None or not place.valid:
        return None
    nan = math.nan
    altitude = _mean_sea_level(vehicle) + height.altitude if height is not None else nan
    sigma = math.sqrt(place.wind_variance)
    return mavlink.MAVLink_wind_cov_message(
        place.time_us, place.wind_north, place.wind_east, nan, nan, nan, altitude, sigma, 0.0
    )


def _pulse(control: float) -> int:
    return clamped(1500.0 + 500.0 * control, 1000, 2000)


def servo_output(vehicle: VehicleView) -> Any:
    """Return SERVO_OUTPUT_RAW: 1000 to 2000 us in the order of HIL_ACTUATOR_CONTROLS.

    The throttle is 1000 at 0.
    """
    now = vehicle.latest(t.ACTUATORS)
    if now is None:
        return None
    angles = (now.wing_left, now.wing_right, now.elevator, now.rudder)
    pulses = [_pulse(angle / FULL_DEFLECTION) for angle in angles]
    throttle = clamped(1000.0 + 1000.0 * now.throttle, 1000, 2000)
    return mavlink.MAVLink_servo_output_raw_message(now.time_us & 0xFFFFFFFF, 0, *pulses, throttle, 0, 0, 0)


def rc_channels(vehicle: VehicleView) -> Any:
    """Return RC_CHANNELS: receiver pulses in us; missing ones are marked as unused.

    The strength is 0 while the receiver is lost. Channels overridden by a ground station are not included.
    """
    now = vehicle.latest(t.RECEIVER)
    if now is None:
        return None
    pulses = [min(max(pulse, 0), _UNKNOWN_U16 - 1) for pulse in now.pulses]
    unused = [_UNKNOWN_U16] * (CHANNELS_SENT - len(pulses))
    health = vehicle.latest(t.HEALTH)
    lost = now.lost or (health is not None and health.failsafe & m.Failsafe.RECEIVER_LOST)
    strength = 0 if lost else clamped(now.rssi, 0, 254)
    return mavlink.MAVLink_rc_channels_message(boot_ms(now.time_us), len(pulses), *pulses, *unused, strength)


_BREACHES = {
    m.Breach.NONE: mavlink.FENCE_BREACH_NONE,
    m.Breach.FLOOR: mavlink.FENCE_BREACH_MINALT,
    m.Breach.CEILING: mavlink.FENCE_BREACH_MAXALT,
    m.Breach.BORDER: mavlink.FENCE_BREACH_BOUNDARY,
}


def fence_status(vehicle: VehicleView) -> Any:
    """Return FENCE_STATUS: ms since boot; the speed is not limited at the fence."""
    now = vehicle.latest(t.FENCE)
    if now is None:
        return None
    return mavlink.MAVLink_fence_status_message(
        now.outside,
        min(now.breaches, _UNKNOWN_U16),
        _BREACHES[now.kind],
        round(now.since * 1e3) & 0xFFFFFFFF,
        mavlink.FENCE_MITIGATE_NONE,
    )


def navigation_output(vehicle: VehicleView) -> Any:
    """Return NAV_CONTROLLER_OUTPUT: degrees and meters."""
    now = vehicle.latest(t.NAVIGATION)
    if now is None:
        return None
    roll, pitch = vehicle.latest(t.HEADING_LOOP), vehicle.latest(t.ALTITUDE_LOOP)
    bearing = heading_cdeg(now.heading_setpoint) // 100
    return mavlink.MAVLink_nav_controller_output_message(
        math.degrees(roll.roll_setpoint) if roll is not None else 0.0,
        math.degrees(pitch.pitch_setpoint) if pitch is not None else 0.0,
        bearing,
        bearing,
        _u16(now.distance),
        pitch.altitude_error if pitch is not None else 0.0,
        0.0,
        now.cross_track,
    )


def mission_current(vehicle: VehicleView, first_item: int, chosen: int | None = None) -> Any:
    """Return MISSION_CURRENT, with items numbered from ``first_item``.

    ``chosen`` is a number just set by a client.
    """
    now = vehicle.latest(t.NAVIGATION)
    flying = vehicle.mode == m.Mode.AUTO
    state = mavlink.MISSION_STATE_ACTIVE if flying else mavlink.MISSION_STATE_NOT_STARTED
    if not vehicle.mission:
        state = mavlink.MISSION_STATE_NO_MISSION
    current = first_item + (now.item if now is not None else 0) if chosen is None else chosen
    return mavlink.MAVLink_mission_current_message(current, len(vehicle.mission), state, 1 if flying else 2)


def wing_state(vehicle: VehicleView) -> Any:
    """Return WINGBEAT_WING_STATE."""
    now = vehicle.latest(t.WING)
    if now is None:
        return None
    return mavlink.MAVLink_wingbeat_wing_state_message(boot_ms(now.time_us), *now[1:])


def power_state(vehicle: VehicleView) -> Any:
    """Return WINGBEAT_POWER."""
    now = vehicle.latest(t.POWER)
    if now is None:
        return None
    return mavlink.MAVLink_wingbeat_power_message(boot_ms(now.time_us), *now[1:])


def navigation_state(vehicle: VehicleView) -> Any:
    """Return WINGBEAT_NAVIGATION."""
    now = vehicle.latest(t.NAVIGATION)
    if now is None:
        return None
    return mavlink.MAVLink_wingbeat_navigation_message(
        boot_ms(now.time_us),
        now.distance,
        now.cross_track,
        now.altitude_setpoint,
        now.heading_setpoint,
        now.item,
        int(now.stage),
        now.frozen,
    )


def excitation_state(vehicle: VehicleView) -> Any:
    """Return WINGBEAT_EXCITATION."""
    now = vehicle.latest(t.EXCITATION)
    if now is None:
        return None
    return mavlink.MAVLink_wingbeat_excitation_message(
        boot_ms(now.time_us), now.manoeuvre, now.elevator, now.throttle, now.rudder, now.active, now.aborted
    )


class Mirror(NamedTuple):
    """Value also sent as NAMED_VALUE_FLOAT, for ground stations without the dialect."""

    name: bytes
    """-; at most 10 characters"""
    topic: Topic[Any]
    field: str


MIRRORS = (
    Mirror(b"wing_left", t.WING, "angle_left"),
    Mirror(b"wing_right", t.WING, "angle_right"),
    Mirror(b"flap_freq", t.WING, "frequency"),
    Mirror(b"power_w", t.POWER, "power"),
)
"""values in rad, rad, Hz and W"""


def mirrors(vehicle: VehicleView) -> list[Any]:
    """Return NAMED_VALUE_FLOAT of every available entry of `MIRRORS`."""
    found = [(mirror, vehicle.latest(mirror.topic)) for mirror in MIRRORS]
    return [
        mavlink.MAVLink_named_value_float_message(boot_ms(now.time_us), mirror.name, getattr(now, mirror.field))
        for mirror, now in found
        if now is not None
    ]
