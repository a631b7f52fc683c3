"""Whether the IMU is alive: a sensor that repeats itself is frozen, one that stands at its range is saturated.

Pure functions for the failsafes. The noise of a real gyro and accelerometer is above their resolution (ITG-3200: 5
counts RMS, ADXL345: 1 count), so two samples are seldom the same on all six axes; twenty are never. The magnetometer
is slower than the IMU and repeats its last reading, so it is not looked at.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.messages import ImuSample
from avionics.quantities import Quantity


class Gains(NamedTuple):
    """Ranges of the sensors, and what is tolerated."""

    accel_range: Annotated[float, Quantity("m/s^2", 1.0, 2000.0)] = 156.9
    """m/s^2; per axis, either way: the greatest the sensor can tell"""
    gyro_range: Annotated[float, Quantity("rad/s", 0.1, 100.0)] = 34.9
    """rad/s; per axis, either way"""
    range_share: Annotated[float, Quantity("-", 0.5, 1.0)] = 0.99
    """-; share of the range from which on a reading counts as saturated"""
    frozen_time: Annotated[float, Quantity("s", 0.005, 10.0)] = 0.1
    """s; of identical samples after which the sensor is called frozen"""
    saturated_limit: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.05
    """-; share of a stroke's samples at the range from which on the attitude is in doubt"""
    stroke_time: Annotated[float, Quantity("s", 0.05, 5.0)] = 0.5
    """s; taken for a stroke while no flapping is measured"""


class State(NamedTuple):
    """What the check remembers."""

    time_us: int = -1
    """us; of the last sample, -1 before the first"""
    reading: tuple[float, ...] = ()
    """SI; the last sample's six axes"""
    same_since_us: int = -1
    """us; since when the reading has been this one"""
    span: float = 0.0
    """s; since the present stroke's window began"""
    saturated: float = 0.0
    """s; of it with an axis at its range"""
    share: float = 0.0
    """-; the same of the last whole window"""


class Flags(NamedTuple):
    """What is wrong."""

    frozen: int
    """-; 1 while the sensor repeats itself for longer than `Gains.frozen_time`"""
    saturated: int
    """-; 1 while the last or the present stroke had more than `Gains.saturated_limit` of its samples at the range"""
    saturated_share: float
    """-; of the last whole stroke's time with an axis at its range"""


def step(gains: Gains, state: State, imu: ImuSample, frequency: float = 0.0) -> tuple[State, Flags]:
    """One sample on.

    Args:
        gains: ranges and limits.
        state: what the last step returned, ``State()`` at boot.
        imu: sample; one that is not later than the last changes nothing.
        frequency: Hz; measured flapping frequency, 0 when the wings rest.
    """
    time_us = imu[0]
    if time_us <= state.time_us:
        return state, _flags(gains, state, frequency)
    reading = imu[1:7]
    since = state.same_since_us if reading == state.reading else time_us
    dt = (time_us - state.time_us) * 1e-6 if state.time_us >= 0 else 0.0
    span = state.span + dt
    saturated = state.saturated + dt if at_range(gains, imu) else state.saturated
    share = state.share
    if span >= _window(gains, frequency):
        span, saturated, share = 0.0, 0.0, saturated / span
    state = State(time_us, reading, since, span, saturated, share)
    return state, _flags(gains, state, frequency)


def at_range(gains: Gains, imu: ImuSample) -> bool:
    """Whether an axis of accelerometer or gyro stands at its range."""
    _, ax, ay, az, p, q, r, _, _, _ = imu
    a, g = gains.range_share * gains.accel_range, gains.range_share * gains.gyro_range
    return not (-a < ax < a and -a < ay < a and -a < az < a and -g < p < g and -g < q < g and -g < r < g)


def _window(gains: Gains, frequency: float) -> float:
    return 1.0 / frequency if frequency > 0.0 else gains.stroke_time


def _flags(gains: Gains, state: State, frequency: float) -> Flags:
    frozen = state.time_us - state.same_since_us >= gains.frozen_time * 1e6
    present = state.saturated / _window(gains, frequency)
    return Flags(int(frozen), int(max(state.share, present) > gains.saturated_limit), state.share)
