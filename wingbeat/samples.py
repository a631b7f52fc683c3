"""Samples of the sensors: what the board, or the simulator in its place, delivers to the flight computer.

Conventions of units and axes, and the types of fields, as in `wingbeat.message`.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.message import Counts, Number, Time, Wire

Vector = tuple[float, float, float]
BURST_LENGTH = 60
"""samples; of one ADC burst"""
Burst = Annotated[tuple[int, ...], Wire("fixed32", BURST_LENGTH)]


class ImuSample(NamedTuple):
    """One sample of accelerometer, gyroscope and magnetometer in body axes."""

    time_us: Time
    """us; since boot"""
    accel_x: float
    """m/s^2; specific force along FRD x (forward)"""
    accel_y: float
    """m/s^2; specific force along FRD y (right)"""
    accel_z: float
    """m/s^2; specific force along FRD z (down), -9.81 at rest"""
    gyro_x: float
    """rad/s; roll rate"""
    gyro_y: float
    """rad/s; pitch rate"""
    gyro_z: float
    """rad/s; yaw rate"""
    mag_x: float
    """gauss; magnetic field along FRD x"""
    mag_y: float
    """gauss; magnetic field along FRD y"""
    mag_z: float
    """gauss; magnetic field along FRD z"""

    @property
    def accel(self) -> Vector:
        """m/s^2; specific force, FRD"""
        return self.accel_x, self.accel_y, self.accel_z

    @property
    def gyro(self) -> Vector:
        """rad/s; angular rate, FRD"""
        return self.gyro_x, self.gyro_y, self.gyro_z

    @property
    def mag(self) -> Vector:
        """gauss; magnetic field, FRD"""
        return self.mag_x, self.mag_y, self.mag_z


class EncoderSample(NamedTuple):
    """Quadrature counts of the wing encoders, accumulated since power-on, and what their index pulses latched."""

    time_us: Time
    """us; since boot"""
    left_counts: Counts
    """counts; left wing, positive with the wing up"""
    right_counts: Counts
    """counts; right wing, positive with the wing up"""
    left_index_counts: Counts = 0
    """counts; of the left counter at its encoder's last index pulse"""
    right_index_counts: Counts = 0
    """counts; of the right counter at its encoder's last index pulse"""
    left_index_pulses: Number = 0
    """-; of the left encoder's index since power-on; 0 where there is none"""
    right_index_pulses: Number = 0
    """-; of the right encoder's index since power-on; 0 where there is none"""


class PressureSample(NamedTuple):
    """Raw readings of the barometer and of the pitot's differential pressure sensor."""

    time_us: Time
    """us; since boot"""
    static_counts: Counts
    """counts; static pressure"""
    differential_counts: Counts
    """counts; pitot minus static"""
    temperature_counts: Counts
    """counts; air temperature"""


class AdcBurst(NamedTuple):
    """Sixty samples of supply voltage and current at 6 kHz: three periods of the servos' 300 Hz PWM."""

    time_us: Time
    """us; since boot, at the last sample"""
    voltage_counts: Burst
    """counts; supply voltage behind the divider"""
    current_counts: Burst
    """counts; current sensor shared by the wing drive"""


class TorqueSample(NamedTuple):
    """Raw readings of the strain gauges on the wing drives (instrumented vehicles only)."""

    time_us: Time
    """us; since boot"""
    left_counts: Counts
    """counts; left drive, positive when it drives the wing up"""
    right_counts: Counts
    """counts; right drive, positive when it drives the wing up"""


class GpsFix(NamedTuple):
    """One fix of the GPS receiver."""

    time_us: Time
    """us; since boot, when the fix arrived"""
    latitude: float
    """rad; WGS-84"""
    longitude: float
    """rad; WGS-84"""
    altitude: float
    """m; above mean sea level"""
    v_north: float
    """m/s; ground velocity"""
    v_east: float
    """m/s; ground velocity"""
    v_down: float
    """m/s; ground velocity"""
    horizontal_accuracy: float
    """m; one sigma as reported by the receiver"""
    vertical_accuracy: float
    """m; one sigma as reported by the receiver"""
    fix_type: Number
    """-; 0 none, 2 two-, 3 three-dimensional"""
    satellites: Number
    """-; used in the fix"""


CHANNELS = 8
"""of the radio-control receiver"""


class ReceiverSample(NamedTuple):
    """One frame of the radio-control receiver."""

    time_us: Time
    """us; since boot"""
    pulses: Annotated[tuple[int, ...], Wire("fixed32", CHANNELS)]
    """us; pulse widths of the channels, counted in whole microseconds"""
    lost: Number
    """-; 1 while the receiver reports that it receives no transmitter"""
    rssi: Number
    """-; signal strength, 0 to 254, 255 for unknown"""


class RangeSample(NamedTuple):
    """One reading of the downward rangefinder."""

    time_us: Time
    """us; since boot"""
    distance: float
    """m; along the beam, 0 without an echo"""
    min_distance: float
    """m; least distance that the sensor can measure"""
    max_distance: float
    """m; greatest distance that the sensor can measure"""
    quality: Number
    """%; of the signal, 0 without an echo, 255 if the sensor does not report it"""


class SensorFrame(NamedTuple):
    """All samples that the board delivers in one tick; a sensor without a sample in this tick is None."""

    time_us: int
    """us; since boot, of the IMU sample"""
    imu: ImuSample
    encoder: EncoderSample | None = None
    pressures: PressureSample | None = None
    adc: AdcBurst | None = None
    torque: TorqueSample | None = None
    gps: GpsFix | None = None
    receiver: ReceiverSample | None = None
    rangefinder: RangeSample | None = None

    def shifted(self, offset_us: int) -> SensorFrame:
        """Return the frame with ``offset_us`` added to the time of every sample."""
        moved = {}
        for name in self._fields[1:]:
            sample = getattr(self, name)
            moved[name] = sample and sample._replace(time_us=sample.time_us + offset_us)
        return SensorFrame(self.time_us + offset_us, **moved)
