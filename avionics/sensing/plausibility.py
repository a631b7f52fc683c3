"""Refuses sensor samples that cannot be: not finite, outside the sensor's range, or older than the last one.

What is refused is counted, said once per sensor while it lasts, and replaced by nothing: the modules that
need the sample keep the last good one.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Annotated, Any, NamedTuple, Protocol

from avionics.messages import AdcBurst, EncoderSample, GpsFix, ImuSample, PressureSample, SensorFrame, TorqueSample
from wingbeat.records import constructor
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Ranges of the sensors, a little beyond what they can say; a gyro at the end of its range says nothing."""

    accel_max: Annotated[float, Quantity("m/s^2", 10.0, 2000.0)] = 200.0
    """m/s^2; per axis. Default: the ADXL345's 16 g and its tolerance"""
    gyro_max: Annotated[float, Quantity("rad/s", 1.0, 100.0)] = 34.9
    """rad/s; per axis, from which it is at the end of its range: such a sample is refused. Default: the ITG-3200's
    2000 deg/s, six counts short of it"""
    mag_max: Annotated[float, Quantity("gauss", 0.1, 100.0)] = 10.0
    """gauss; per axis. Default: the HMC5883L's 8 G and its tolerance"""
    counts_max: Annotated[float, Quantity("counts", 255.0, 16777216.0)] = 16777216.0
    """counts; of pressures and strain gauges. Default: 24-bit pressure counts are the widest"""
    encoder_jump: Annotated[float, Quantity("counts", 1.0, 1000000.0)] = 200.0
    """counts; greatest change of an encoder between samples. Default: 36 degrees in 5 ms, four times the fastest
    stroke"""
    gps_speed_max: Annotated[float, Quantity("m/s", 5.0, 1000.0)] = 100.0
    """m/s; per axis. Default: far above any ornithopter in any wind it flies in"""
    accel_full: Annotated[float, Quantity("m/s^2", 5.0, 2000.0)] = 156.0
    """m/s^2; from which an axis of the accelerometer is at the end of its range. Default: the ADXL345's 16 g, a
    count short of it"""
    imu_repeats: Annotated[float, Quantity("-", 2.0, 1e9)] = 10.0
    """-; equal samples in a row after which the IMU has frozen: its noise does not repeat. Default: 50 ms; the noise
    of six axes never repeats twice"""
    fault_time: Annotated[float, Quantity("s", 0.01, 10.0)] = 0.2
    """s; without a good IMU sample before it is a fault. Default: a stroke without attitude is too much"""
    baro_time: Annotated[float, Quantity("s", 0.1, 1e9)] = 0.5
    """s; without a new static pressure before the barometer is lost: its noise does not repeat for so long. Default:
    25 samples; the noise of 0.01 Pa counts never repeats so often"""


class State(NamedTuple):
    """What the check remembers."""

    rejected: int = 0
    """-; samples refused since boot"""
    bad: int = 0
    """-; flags of the sensors (see `step`) whose last sample was refused"""
    imu_time_us: int = -1
    """us; of the last good IMU sample, -1 before the first"""
    encoder: tuple[int, int] | None = None
    """counts; last good left and right"""
    encoder_refused: int = 0
    """-; encoder samples refused in a row"""
    gps_time_us: int = -1
    """us; of the last good fix with a position, -1 before the first"""
    time_refused: int = 0
    """-; frames in a row refused because of their time"""
    time_offset_us: int = 0
    """us; added to the sensors' time since their clock jumped"""
    inertial: tuple[float, ...] = ()
    """m/s^2, rad/s; last accelerometer and gyro reading"""
    repeated: int = 0
    """-; times that it has been read again"""
    saturated: int = 0
    """-; samples in a row with the accelerometer at the end of its range"""
    static: int = 0
    """counts; last good static pressure"""
    static_us: int = -1
    """us; when it last was another, -1 before the first"""


SATURATED = 3
"""samples in a row at the end of the range after which the accelerometer says nothing"""
TIME_PATIENCE = 20
"""frames in a row with such a time after which the clock has jumped: it is followed from there"""
LONGEST_GAP_US = 1_000_000
"""us; from one frame to the next: a frame further ahead is refused as an earlier one is"""
ENCODER_PATIENCE = 20
"""refused samples in a row after which a jump of the counts is believed: the counter was reset"""


IMU, ENCODER = "IMU", "encoder"


class Check(Protocol):
    """What is known of a sensor here; satisfied by `avionics.sensors.Sensor`."""

    @property
    def field(self) -> str:
        """Field of `SensorFrame`."""

    @property
    def name(self) -> str:
        """Name in events."""

    @property
    def is_plausible(self) -> Callable[[Gains, State, Any], bool]:
        """Whether a sample is finite and in range."""


def always_plausible(gains: Gains, state: State, sample: object) -> bool:
    """Accept every sample: another module judges it."""
    return True


def imu_plausible(gains: Gains, imu: ImuSample) -> bool:
    """Whether all nine values are finite and in range (a NaN fails every comparison)."""
    (ax, ay, az), (p, q, r), (mx, my, mz) = imu.accel, imu.gyro, imu.mag
    a, g, m = gains.accel_max, gains.gyro_max, gains.mag_max
    return (
        -a <= ax <= a and -a <= ay <= a and -a <= az <= a
        and -g <= p <= g and -g <= q <= g and -g <= r <= g
        and -m <= mx <= m and -m <= my <= m and -m <= mz <= m
    )  # fmt: skip


def pressures_plausible(gains: Gains, state: State, sample: PressureSample) -> bool:
    """Whether the counts are in range."""
    high = gains.counts_max
    return (
        -high <= sample.static_counts <= high
        and -high <= sample.differential_counts <= high
        and -high <= sample.temperature_counts <= high
    )


def adc_plausible(gains: Gains, state: State, burst: AdcBurst) -> bool:
    """Whether the burst has samples and all counts are whole numbers of 16 bits, as the wire carries them.

    Packing them finds one that is not five times faster than comparing each.
    """
    voltage, current = burst.voltage_counts, burst.current_counts
    samples = len(voltage)
    if not samples or samples != len(current):
        return False
    pack = _whole(samples).pack
    try:
        pack(*voltage)
        pack(*current)
    except struct.error:
        return False
    return True


@lru_cache(maxsize=8)
def _whole(samples: int) -> struct.Struct:
    """So many whole numbers of 16 bits."""
    return struct.Struct(f"{samples}H")


def torque_plausible(gains: Gains, state: State, sample: TorqueSample) -> bool:
    """Whether the counts are in range."""
    high = gains.counts_max
    return -high <= sample.left_counts <= high and -high <= sample.right_counts <= high


def gps_plausible(gains: Gains, state: State, fix: GpsFix) -> bool:
    """Whether place, velocity and accuracy are finite and possible."""
    v = gains.gps_speed_max
    return (
        abs(fix.latitude) <= 0.5 * math.pi
        and abs(fix.longitude) <= math.pi
        and abs(fix.altitude) <= 1e5
        and -v <= fix.v_north <= v
        and -v <= fix.v_east <= v
        and -v <= fix.v_down <= v
        and 0.0 <= fix.horizontal_accuracy < math.inf
        and 0.0 <= fix.vertical_accuracy < math.inf
    )


def encoder_plausible(gains: Gains, state: State, sample: EncoderSample) -> bool:
    """Whether the counts moved no further than a wing can, or have jumped for good."""
    if state.encoder is None or state.encoder_refused >= ENCODER_PATIENCE:
        return True
    jump = gains.encoder_jump
    left, right = state.encoder
    return abs(sample.left_counts - left) <= jump and abs(sample.right_counts - right) <= jump


def step(
    gains: Gains, state: State, frame: SensorFrame, checks: Sequence[Check]
) -> tuple[State, SensorFrame, tuple[str, ...]]:
    """Check one frame.

    Args:
        gains: ranges of the sensors.
        state: memory.
        frame: as the board delivered it.
        checks: of the sensors beside the IMU, in the order of their bits in `State.bad`.

    Returns:
        The new state; the frame without the rejected samples, but for the IMU sample, whose rejection is bit 0 of
        `State.bad`; names of the sensors whose samples were accepted before and are rejected now.
    """
    imu, full = frame.imu, gains.accel_full
    inertial = (*imu.accel, *imu.gyro)
    repeated = state.repeated + 1 if inertial == state.inertial else 0
    bad = 0 if repeated < gains.imu_repeats and imu_plausible(gains, imu) else 1
    x, y, z, _, _, _ = inertial
    within = -full < x < full and -full < y < full and -full < z < full
    saturated = 0 if within or bad else state.saturated + 1
    sampled, bit = 1, 1
    for check in checks:
        bit <<= 1
        sample = getattr(frame, check.field)
        if sample is not None:
            sampled |= bit
            if not check.is_plausible(gains, state, sample):
                bad |= bit
    names: tuple[str, ...] = ()
    if bad:
        fresh = bad & ~state.bad
        names = tuple(name for i, name in enumerate((IMU, *(check.name for check in checks))) if fresh >> i & 1)
        rejected: dict[str, Any] = {check.field: None for i, check in enumerate(checks, 1) if bad >> i & 1}
        jumped = ENCODER in rejected
        frame = frame._replace(**rejected)
        state = state._replace(
            rejected=state.rejected + bad.bit_count(), encoder_refused=state.encoder_refused + jumped
        )
    health = (state.time_offset_us, inertial, repeated, saturated)
    return _accept(state, frame, state.bad & ~sampled | bad, health), frame, names


def refuse_time(state: State) -> State:
    """A whole frame whose time does not rise, or rises too far, was refused."""
    return state._replace(rejected=state.rejected + 1, time_refused=state.time_refused + 1)


def imu_age(state: State, time_us: int) -> float:
    """Seconds since the last good IMU sample; infinite before the first."""
    return math.inf if state.imu_time_us < 0 else (time_us - state.imu_time_us) * 1e-6


def gps_age(state: State, time_us: int) -> float:
    """Seconds since the last good fix with a position; infinite before the first."""
    return math.inf if state.gps_time_us < 0 else (time_us - state.gps_time_us) * 1e-6


def baro_lost(gains: Gains, state: State, time_us: int) -> bool:
    """Whether the barometer was heard once and has said nothing new for too long."""
    return 0 <= state.static_us < time_us - gains.baro_time * 1e6


Health = tuple[int, tuple[float, ...], int, int]


_new_state = constructor(State)


def _accept(state: State, frame: SensorFrame, bad: int, health: Health) -> State:
    """Remember the accepted samples of a frame and which sensors are bad."""
    encoder, pressures, gps = frame.encoder, frame.pressures, frame.gps
    static, static_us = state.static, state.static_us
    if pressures is not None and (pressures.static_counts != static or static_us < 0):
        static, static_us = pressures.static_counts, frame.time_us
    counts, encoder_refused = state.encoder, state.encoder_refused
    if encoder is not None:
        counts, encoder_refused = (encoder.left_counts, encoder.right_counts), 0
    gps_time_us = frame.time_us if gps is not None and gps.fix_type >= 2 else state.gps_time_us
    imu_time_us = state.imu_time_us if bad & 1 else frame.time_us
    return _new_state(
        state.rejected, bad, imu_time_us, counts, encoder_refused, gps_time_us, 0, *health, static, static_us
    )
