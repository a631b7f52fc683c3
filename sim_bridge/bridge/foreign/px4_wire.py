"""PX4's simulator interface in its own units: a group of HIL_SENSOR counts with all of its bits alone.

Sources: the MAVLink definitions of HIL_SENSOR and HIL_ACTUATOR_CONTROLS, and what PX4's simulator module reads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.link import codec, sensor_codec
from avionics.link.dialect import mavlink
from avionics.messages import ImuSample, PressureSample, ReceiverSample, SensorFrame
from avionics.sensing import air_data
from wingbeat.atmosphere import pressure_altitude
from wingbeat.constants import STANDARD_GRAVITY

BAROMETER, DIFFERENTIAL_PRESSURE = 0x1A00, 0x400
"""``fields_updated`` of pressure, pressure altitude and temperature, and of the pitot"""
ACCEL_LIMIT = 16.0 * STANDARD_GRAVITY * (1.0 - 2.0**-15)
"""m/s^2; PX4 stores the specific force as 16-bit counts of 16 g: one more would overflow"""
GYRO_LIMIT = math.radians(2000.0) * (1.0 - 2.0**-15)
"""rad/s; limit for the same reason"""
KELVIN = 273.15
PASCAL_PER_HECTOPASCAL = 100.0

HIL_SENSOR: int = sensor_codec.HIL_SENSOR
HIL_ACTUATOR_CONTROLS: int = codec.HIL_ACTUATOR_CONTROLS
RC_CHANNELS: int = mavlink.MAVLINK_MSG_ID_RC_CHANNELS
_SENSOR = mavlink.mavlink_map[HIL_SENSOR].unpacker
_ACTUATORS = mavlink.mavlink_map[HIL_ACTUATOR_CONTROLS].unpacker


class Controls(NamedTuple):
    """Decoded HIL_ACTUATOR_CONTROLS."""

    time_us: int
    """us; PX4's time, at a constant offset from that of the sensors in lockstep"""
    values: tuple[float, ...]
    """(16,) -; -1 to 1 for a servo, 0 to 1 for a motor; all zero while disarmed"""
    armed: int
    lockstep: int
    """-; 1 if PX4's clock is that of the sensors"""


def decode_controls(payload: bytes) -> Controls:
    """Decode a HIL_ACTUATOR_CONTROLS payload, whose trailing zeros MAVLink 2 may have truncated."""
    size = _ACTUATORS.size
    time_us, flags, *rest = _ACTUATORS.unpack(payload.ljust(size, b"\0")[:size])
    return Controls(time_us, tuple(rest[:16]), int(bool(rest[16] & codec.ARMED)), int(flags & codec.LOCKSTEP))


def encode_sensors(frame: SensorFrame, field_is_new: bool, gains: air_data.Gains) -> bytes:
    """Encode the payload of HIL_SENSOR.

    Args:
        frame: IMU, and pressures where there are some.
        field_is_new: whether the magnetometer was read in this tick.
        gains: transfer functions of the pressure sensors.
    """
    pressures, fields = _pressures(frame.pressures, gains)
    fields |= sensor_codec.ACCELEROMETER | sensor_codec.GYROSCOPE | (sensor_codec.MAGNETOMETER if field_is_new else 0)
    payload: bytes = _SENSOR.pack(*_within_range(frame.imu), *pressures, fields, 0)
    return payload


def _within_range(imu: ImuSample) -> tuple[float, ...]:
    force = (min(max(value, -ACCEL_LIMIT), ACCEL_LIMIT) for value in imu.accel)
    rates = (min(max(value, -GYRO_LIMIT), GYRO_LIMIT) for value in imu.gyro)
    return (imu.time_us, *force, *rates, *imu.mag)


def _pressures(sample: PressureSample | None, gains: air_data.Gains) -> tuple[tuple[float, ...], int]:
    """Static and differential pressure in hPa, pressure altitude in m and temperature in deg C, and their bits."""
    if sample is None:
        return (0.0, 0.0, 0.0, 0.0), 0
    static = sample.static_counts * gains.static_scale
    differential = air_data.differential(gains, sample.differential_counts)
    celsius = sample.temperature_counts * gains.temperature_scale - KELVIN
    values = (static / PASCAL_PER_HECTOPASCAL, differential / PASCAL_PER_HECTOPASCAL)
    return (*values, pressure_altitude(static), celsius), BAROMETER | DIFFERENTIAL_PRESSURE


def rc_channels(sample: ReceiverSample) -> object:
    """Encode the receiver's data as RC_CHANNELS; missing channels are marked as unknown."""
    pulses = [*sample.pulses, *([sensor_codec.UNKNOWN_U16] * (18 - len(sample.pulses)))]
    return mavlink.MAVLink_rc_channels_message(
        sample.time_us // 1000, len(sample.pulses), *pulses, min(sample.rssi, 254)
    )
