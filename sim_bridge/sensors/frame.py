"""What the sensors deliver: fields, order and units as the sensor messages of the flight computer.

``ImuSample(*raw_imu)`` is the conversion; the physics does not import the flight code, so the records are
declared again here and a test holds the two lists together.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

BURST_LENGTH = 60
"""samples; of one ADC burst"""
CHANNELS = 8
"""of the radio-control receiver"""
TICK_RATE = 200.0
"""Hz; IMU and encoders are sampled at every tick"""


class RawImu(NamedTuple):
    """Accelerometer, gyroscope and magnetometer in body axes; every value is a 32-bit float exactly."""

    time_us: int
    """us; since the start of the simulation"""
    accel_x: float
    """m/s^2; specific force along FRD x"""
    accel_y: float
    """m/s^2; along FRD y"""
    accel_z: float
    """m/s^2; along FRD z"""
    gyro_x: float
    """rad/s; about FRD x"""
    gyro_y: float
    """rad/s; about FRD y"""
    gyro_z: float
    """rad/s; about FRD z"""
    mag_x: float
    """gauss; along FRD x"""
    mag_y: float
    """gauss; along FRD y"""
    mag_z: float
    """gauss; along FRD z"""


_ON_THE_WIRE = struct.Struct("<9f")


def imu_on_the_wire(time_us: int, *values: float) -> RawImu:
    """A sample of the nine ``values`` of `RawImu`, each the nearest 32-bit float: MAVLink carries it as it is.

    Raises:
        struct.error: ``values`` are not nine.
    """
    return RawImu._make((time_us, *_ON_THE_WIRE.unpack(_ON_THE_WIRE.pack(*values))))


class RawEncoder(NamedTuple):
    """Quadrature counts of the wing encoders, and what their index pulses latched."""

    time_us: int
    """us; since the start of the simulation"""
    left_counts: int
    """counts; left wing, positive with the wing up"""
    right_counts: int
    """counts; right wing, positive with the wing up"""
    left_index_counts: int = 0
    """counts; of the left counter at its last index pulse"""
    right_index_counts: int = 0
    """counts; of the right counter at its last index pulse"""
    left_index_pulses: int = 0
    """-; of the left encoder's index since the start"""
    right_index_pulses: int = 0
    """-; of the right encoder's index since the start"""


class RawPressures(NamedTuple):
    """Barometer and pitot."""

    time_us: int
    """us; since the start of the simulation"""
    static_counts: int
    """counts; static pressure"""
    differential_counts: int
    """counts; pitot minus static"""
    temperature_counts: int
    """counts; air temperature"""


class RawAdc(NamedTuple):
    """One burst of supply voltage and current."""

    time_us: int
    """us; since the start of the simulation, at the last sample"""
    voltage_counts: tuple[int, ...]
    """counts; behind the divider"""
    current_counts: tuple[int, ...]
    """counts; of the current sensor"""


class RawTorque(NamedTuple):
    """Strain gauges on the wing drives."""

    time_us: int
    """us; since the start of the simulation"""
    left_counts: int
    """counts; positive when the drive moves the wing up"""
    right_counts: int
    """counts; positive when the drive moves the wing up"""


class RawGps(NamedTuple):
    """One fix, rounded as HIL_GPS carries it."""

    time_us: int
    """us; since the start of the simulation, when the fix arrived"""
    latitude: float
    """rad; a multiple of 1e-7 deg"""
    longitude: float
    """rad; a multiple of 1e-7 deg"""
    altitude: float
    """m; above mean sea level, a multiple of 1 mm"""
    v_north: float
    """m/s; a multiple of 1 cm/s"""
    v_east: float
    """m/s; a multiple of 1 cm/s"""
    v_down: float
    """m/s; a multiple of 1 cm/s"""
    horizontal_accuracy: float
    """m; one sigma as told by the receiver, a multiple of 1 cm"""
    vertical_accuracy: float
    """m; one sigma as told by the receiver, a multiple of 1 cm"""
    fix_type: int
    """-; 3 for a three-dimensional fix"""
    satellites: int
    """-; used in the fix"""


class RawReceiver(NamedTuple):
    """One frame of the radio-control receiver."""

    time_us: int
    """us; since the start of the simulation"""
    pulses: tuple[int, ...]
    """us; pulse widths of the channels, whole microseconds"""
    lost: int
    """-; 1 while the receiver does not hear its transmitter"""
    rssi: int
    """-; signal strength, 1 to 254, 0 when lost"""


class RawFrame(NamedTuple):
    """All that the sensors deliver in one tick; what was not sampled in it is None."""

    time_us: int
    """us; since the start of the simulation"""
    imu: RawImu
    encoder: RawEncoder | None = None
    pressures: RawPressures | None = None
    adc: RawAdc | None = None
    torque: RawTorque | None = None
    gps: RawGps | None = None
    receiver: RawReceiver | None = None
