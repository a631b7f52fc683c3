"""Refuses sensor samples that cannot be: not finite, outside the sensor's range, or older than the last one.

What is refused is counted, said once per sensor while it lasts, and replaced by nothing: the modules that
need the sample keep the last good one.
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

from avionics.messages import AdcBurst, EncoderSample, GpsFix, ImuSample, PressureSample, SensorFrame, TorqueSample
from wingbeat.records import constructor
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Ranges of the sensors, a little beyond what they can say; a gyro at the end of its range says nothing."""

    accel_max: Annotated[float, Quantity("m/s^2", 10.0, 2000.0)]
    """m/s^2; per axis"""
    gyro_max: Annotated[float, Quantity("rad/s", 1.0, 100.0)]
    """rad/s; per axis, from which it is at the end of its range: such a sample is refused"""
    mag_max: Annotated[float, Quantity("gauss", 0.1, 100.0)]
    """gauss; per axis"""
    counts_max: Annotated[float, Quantity("counts", 255.0, 16777216.0)]
    """counts; of pressures and strain gauges"""
    encoder_jump: Annotated[float, Quantity("counts", 1.0, 1000000.0)]
    """counts; greatest change of an encoder between samples"""
    gps_speed_max: Annotated[float, Quantity("m/s", 5.0, 1000.0)]
    """m/s; per axis"""
    accel_full: Annotated[float, Quantity("m/s^2", 5.0, 2000.0)]
    """m/s^2; from which an axis of the accelerometer is at the end of its range"""
    imu_repeats: Annotated[float, Quantity("-", 2.0, 1e9)]
    """-; equal samples in a row after which the IMU has frozen: its noise does not repeat"""
    fault_time: Annotated[float, Quantity("s", 0.01, 10.0)]
    """s; without a good IMU sample before it is a fault"""
    baro_time: Annotated[float, Quantity("s", 0.1, 1e9)] = 0.5
    """s; without a new static pressure before the barometer is lost: its noise does not repeat for so long"""


class State(NamedTuple):
    """What the check remembers."""

    rejected: int = 0
    """-; samples refused since boot"""
    bad: int = 0
    """-; flags of the sensors (see `SENSORS`) whose last sample was refused"""
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


SENSORS = ("IMU", "encoder", "pressures", "ADC", "torque", "GPS")
SATURATED = 3
"""samples in a row at the end of the range after which the accelerometer says nothing"""
TIME_PATIENCE = 20
"""frames in a row with such a time after which the clock has jumped: it is followed from there"""
LONGEST_GAP_US = 1_000_000
"""us; from one frame to the next: a frame further ahead is refused as an earlier one is"""
ENCODER_PATIENCE = 20
"""refused samples in a row after which a jump of the counts is believed: the counter was reset"""


def imu_plausible(gains: Gains, imu: ImuSample) -> bool:
    """Whether all nine values are finite and in range (a NaN fails every comparison)."""
    _, ax, ay, az, p, q, r, mx, my, mz = imu
    a, g, m = gains.accel_max, gains.gyro_max, gains.mag_max
    return (
        -a <= ax <= a and -a <= ay <= a and -a <= az <= a
        and -g <= p <= g and -g <= q <= g and -g <= r <= g
        and -m <= mx <= m and -m <= my <= m and -m <= mz <= m
    )  # fmt: skip


def pressures_plausible(gains: Gains, sample: PressureSample) -> bool:
    """Whether the counts are in range."""
    high = gains.counts_max
    return all(-high <= counts <= high for counts in sample[1:])


def adc_plausible(burst: AdcBurst) -> bool:
    """Whether the burst has samples and all counts are whole numbers of 16 bits, as the wire carries them.

    Packing them finds one that is not five times faster than comparing each.
    """
    _, voltage, current = burst
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


def torque_plausible(gains: Gains, sample: TorqueSample) -> bool:
    """Whether the counts are in range."""
    high = gains.counts_max
    return -high <= sample.left_counts <= high and -high <= sample.right_counts <= high


def gps_plausible(gains: Gains, fix: GpsFix) -> bool:
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


def step(gains: Gains, state: State, frame: SensorFrame) -> tuple[State, SensorFrame, tuple[str, ...]]:
    """Check one frame.

    Returns the new state, the frame with refused samples taken out (a refused IMU sample stays in it, bit 0 of
    `State.bad` tells), and the names of the sensors that have just gone bad.
    """
    imu, full = frame.imu, gains.accel_full
    inertial = imu[1:7]
    repeated = state.repeated + 1 if inertial == state.inertial else 0
    bad = 0 if repeated < gains.imu_repeats and imu_plausible(gains, imu) else 1
    x, y, z, _, _, _ = inertial
    within = -full < x < full and -full < y < full and -full < z < full
    saturated = 0 if within or bad else state.saturated + 1
    _, _, encoder, pressures, adc, torque, gps, _ = frame
    if encoder is not None:
        bad |= 0 if encoder_plausible(gains, state, encoder) else 2
    if pressures is not None:
        bad |= 0 if pressures_plausible(gains, pressures) else 4
    if adc is not None:
        bad |= 0 if adc_plausible(adc) else 8
    if torque is not None:
        bad |= 0 if torque_plausible(gains, torque) else 16
    if gps is not None:
        bad |= 0 if gps_plausible(gains, gps) else 32
    health = (state.time_offset_us, inertial, repeated, saturated)
    if bad:
        return _refuse(state, frame, bad, health)
    return _accept(state, frame, 0, health), frame, ()


def refuse_time(state: State) -> State:
    """A whole frame whose time does not rise, or rises too far, was refused."""
    return state._replace(rejected=state.rejected + 1, time_refused=state.time_refused + 1)


def shifted(frame: SensorFrame, offset_us: int) -> SensorFrame:
    """The frame with ``offset_us`` added to every time in it."""
    _, imu, *others = frame
    samples: list[Any] = [sample and sample._replace(time_us=sample.time_us + offset_us) for sample in others]
    return SensorFrame(frame.time_us + offset_us, imu._replace(time_us=imu.time_us + offset_us), *samples)


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
    """Remember the good samples of a frame, and which sensors are bad (those without a sample keep their flag)."""
    rejected, was_bad, imu_time_us, counts, encoder_refused, gps_time_us, _, _, _, _, _, static, static_us = state
    time_us, _, encoder, pressures, adc, torque, gps, _ = frame
    if pressures and not bad & 4 and (pressures.static_counts != static or static_us < 0):
        static, static_us = pressures.static_counts, time_us
    if was_bad:
        sampled = 1 | (2 if encoder else 0) | (4 if pressures else 0)
        sampled |= (8 if adc else 0) | (16 if torque else 0) | (32 if gps else 0)
        was_bad &= ~sampled
    if not bad & 1:
        imu_time_us = time_us
    if encoder and not bad & 2:
        counts, encoder_refused = encoder[1:3], 0
    if gps and not bad & 32 and gps.fix_type >= 2:
        gps_time_us = time_us
    return _new_state(
        rejected, was_bad | bad, imu_time_us, counts, encoder_refused, gps_time_us, 0, *health, static, static_us
    )  # fmt: skip


def _refuse(state: State, frame: SensorFrame, bad: int, health: Health) -> tuple[State, SensorFrame, tuple[str, ...]]:
    """Take the refused samples out of a frame; its IMU sample stays, `State.bad` says that it is bad."""
    fresh = bad & ~state.bad
    names = tuple(name for i, name in enumerate(SENSORS) if fresh >> i & 1)
    after = _accept(state, frame, bad, health)._replace(rejected=state.rejected + bad.bit_count())
    if bad & 2:
        after = after._replace(encoder_refused=state.encoder_refused + 1)
    kept = SensorFrame(
        frame.time_us,
        frame.imu,
        None if bad & 2 else frame.encoder,
        None if bad & 4 else frame.pressures,
        None if bad & 8 else frame.adc,
        None if bad & 16 else frame.torque,
        None if bad & 32 else frame.gps,
        frame.receiver,
    )
    return after, kept, names
