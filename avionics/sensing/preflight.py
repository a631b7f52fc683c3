"""Gyro calibration at standstill, and sensor checks before arming.

Standstill is detected from the scatter of gyro and accelerometer within a window and from the agreement of successive
window means, as in the boot calibrations of ArduPilot (AP_InertialSensor) and PX4 (gyro_calibration). No threshold
applies to the mean rate below the zero-rate offset of the data sheet, so that the result does not depend on an
estimated bias. A slow steady rotation has a constant mean rate as well. The directions of gravity and of the magnetic
field must therefore be constant, too. The means at standstill are then compared with 1 g, with the reference field
and with calm air.
"""

from __future__ import annotations

from enum import IntEnum
from math import asin, sqrt
from typing import Annotated, Final, NamedTuple

from avionics.limits import clip
from avionics.messages import ImuSample
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.units import Quantity

Vector = tuple[float, float, float]
Sums = tuple[float, float, float, float, float, float, float, float, float]

LONGEST_STEP: Final = 0.1
"""s; maximum interval between two samples; a longer one discards the window"""
NO_SUMS: Sums = (0.0,) * 9
ZERO: Vector = (0.0, 0.0, 0.0)


class Gains(NamedTuple):
    """Standstill detection and limits of the checks before arming."""

    window: Annotated[float, Quantity("s", 0.1, 10.0)] = 0.5
    """s; length of a window"""
    windows: Annotated[int, Quantity("-", 2, 20)] = 3
    """-; number of successive windows at standstill for a calibration. Default: complete 1.5 s after boot, before a
    scripted arming"""
    gyro_scatter: Annotated[float, Quantity("rad/s", 1e-4, 1.0)] = 0.05
    """rad/s; maximum standard deviation of an axis within a window. Default: six times the noise of the ITG-3200; a
    steady hand"""
    accel_scatter: Annotated[float, Quantity("m/s^2", 1e-3, 10.0)] = 0.5
    """m/s^2; maximum standard deviation of an axis within a window. Default: eight times the noise of the ADXL345"""
    gyro_spread: Annotated[float, Quantity("rad/s", 1e-4, 0.5)] = 0.025
    """rad/s; maximum difference between the mean rates of the windows, each axis. Default: a hand that sways by 0.3
    degrees at 0.4 Hz; the noise at rest is 0.001"""
    turn: Annotated[float, Quantity("rad", 1e-3, 0.5)] = 0.02
    """rad; maximum change of the directions of specific force and field between the windows. Default: a rotation of 1
    deg/s; less is within the range of the bias estimator"""
    gyro_offset: Annotated[float, Quantity("rad/s", 0.01, 2.0)] = 0.7
    """rad/s; maximum zero-rate offset of an axis. Default, published: ITG-3200 data sheet, zero-rate output +-40
    deg/s"""
    accel_error: Annotated[float, Quantity("m/s^2", 0.05, 10.0)] = 0.4
    """m/s^2; maximum difference of the specific force from 1 g. Default: 41 mg, over five sigma of offset and scale
    after a calibration"""
    strength_error: Annotated[float, Quantity("-", 0.01, 1.0)] = 0.1
    """-; maximum relative difference of the field strength from the reference. Default: over seven sigma of hard iron
    and scale after a calibration"""
    dip_error: Annotated[float, Quantity("rad", 0.01, 1.6)] = 0.1
    """rad; maximum difference of the inclination from the reference. Default: over five sigma of hard iron, mounting
    and accelerometer after a calibration"""
    suction: Annotated[float, Quantity("Pa", 1.0, 250.0)] = 10.0
    """Pa; maximum negative pressure of the pitot. Default: ten sigma of the zero after a calibration; the nose is in
    the wind"""
    pressure: Annotated[float, Quantity("Pa", 1.0, 250.0)] = 25.0
    """Pa; maximum steady pressure of the pitot. Default: 6.4 m/s of wind; in gusts of small_uav_light about 3 m/s one
    in a thousand"""
    pressure_spread: Annotated[float, Quantity("Pa", 0.1, 50.0)] = 2.0
    """Pa; maximum difference between the mean pressures of the windows for a steady pressure; wind varies more.
    Default: five sigma of the mean of a window; gusts about such a wind cause as much in a second"""


class Obstacle(IntEnum):
    """Reason for a window without a calibration."""

    NONE = 0
    MOTION = 1
    """motion of the vehicle, or scatter of the sensors"""
    OFFSET = 2
    """mean rate beyond the zero-rate offset of the data sheet"""


class Finding(IntEnum):
    """Sensor error that prevents arming."""

    GYRO_UNCALIBRATED = 1
    GYRO_OFFSET = 2
    ACCELEROMETER = 3
    FIELD_STRENGTH = 4
    FIELD_DIP = 5
    PITOT = 6


class Means(NamedTuple):
    """Means over one or more windows."""

    rate: Vector
    """rad/s; FRD"""
    force: Vector
    """m/s^2; specific force, FRD"""
    field: Vector
    """gauss; FRD"""
    pressure: float
    """Pa; differential, 0 without a pitot sample"""


class Rest(NamedTuple):
    """Result of the last standstill."""

    means: Means
    """means over all windows"""
    pressure_spread: float
    """Pa; maximum difference between the mean pressures of the windows"""


class State(NamedTuple):
    """State of the standstill detection."""

    time_us: int = -1
    """us; time of the last sample, -1 before the first"""
    samples: int = 0
    """-; number of samples in the present window"""
    span: float = 0.0
    """s; time since the present window began"""
    sums: Sums = NO_SUMS
    """SI; sums of rates, specific force and field"""
    squares: Sums = NO_SUMS
    """SI; sums of the squares, not used for the field"""
    pressure: tuple[float, int] = (0.0, 0)
    """Pa, -; sum of the pitot samples and their number"""
    windows: tuple[Means, ...] = ()
    """the last windows at standstill, oldest first"""
    obstacle: int = Obstacle.NONE
    """-; see `Obstacle`"""
    rest: Rest | None = None
    """None before the first standstill"""


class Reference(NamedTuple):
    """Local geomagnetic field; a strength of 0 is unknown."""

    strength: float
    """gauss"""
    dip: float
    """rad; inclination, positive down"""


def step(gains: Gains, state: State, imu: ImuSample, pressure: float | None = None) -> tuple[State, bool]:
    """Add one sample; to be called while disarmed on the ground.

    Args:
        gains: windows and limits.
        state: result of the last step, ``State()`` at boot.
        imu: calibrated sample.
        pressure: Pa; calibrated differential pressure, None without a new one.

    Returns:
        The state, and whether this sample completed a standstill with a new ``State.rest``.
    """
    dt = (imu.time_us - state.time_us) * 1e-6
    if state.time_us < 0 or not 0.0 < dt <= LONGEST_STEP:
        return State(imu.time_us, obstacle=state.obstacle, rest=state.rest), False
    sums, squares, (total, readings) = state.sums, state.squares, state.pressure
    pressures = state.pressure if pressure is None else (total + pressure, readings + 1)
    values = (*imu.accel, *imu.gyro, *imu.mag)
    a, b, c, d, e, f, g, h, i = values
    sums = (
        sums[0] + a, sums[1] + b, sums[2] + c, sums[3] + d, sums[4] + e, sums[5] + f,
        sums[6] + g, sums[7] + h, sums[8] + i,
    )  # fmt: skip
    squares = (
        squares[0] + a * a, squares[1] + b * b, squares[2] + c * c, squares[3] + d * d, squares[4] + e * e,
        squares[5] + f * f, 0.0, 0.0, 0.0,
    )  # fmt: skip
    count, span = state.samples + 1, state.span + dt
    if span < gains.window - 0.5 * dt:
        return State(
            imu.time_us, count, span, sums, squares, pressures, state.windows, state.obstacle, state.rest
        ), False  # fmt: skip
    return _closed(gains, state, imu.time_us, (count, sums, squares, pressures))


def findings(gains: Gains, state: State, reference: Reference) -> tuple[Finding, ...]:
    """Return the sensor errors that prevent arming; empty if none."""
    if state.rest is None:
        return (Finding.GYRO_OFFSET if state.obstacle == Obstacle.OFFSET else Finding.GYRO_UNCALIBRATED,)
    means, spread = state.rest
    found = []
    if abs(_norm(means.force) - STANDARD_GRAVITY) > gains.accel_error:
        found.append(Finding.ACCELEROMETER)
    if reference.strength > 0.0 and _norm(means.field) > 0.0:
        if abs(_norm(means.field) - reference.strength) > gains.strength_error * reference.strength:
            found.append(Finding.FIELD_STRENGTH)
        if abs(dip(means) - reference.dip) > gains.dip_error:
            found.append(Finding.FIELD_DIP)
    steady = spread <= gains.pressure_spread
    if means.pressure < -gains.suction or (steady and means.pressure > gains.pressure):
        found.append(Finding.PITOT)
    return tuple(found)


def dip(means: Means) -> float:
    """Return the inclination (rad) of the mean field.

    The reference plane is perpendicular to the mean specific force.
    """
    size = _norm(means.force) * _norm(means.field)
    along = sum(f * m for f, m in zip(means.force, means.field, strict=True))
    return asin(clip(-along / size, -1.0, 1.0)) if size > 0.0 else 0.0


def _closed(
    gains: Gains, state: State, time_us: int, filled: tuple[int, Sums, Sums, tuple[float, int]]
) -> tuple[State, bool]:
    """Return the state after the end of a window."""
    count, sums, squares, (total, samples) = filled
    m = tuple(value / count for value in sums)
    deviation = [sqrt(max(0.0, square / count - mean * mean)) for square, mean in zip(squares, m, strict=True)]
    means = Means((m[3], m[4], m[5]), (m[0], m[1], m[2]), (m[6], m[7], m[8]), total / samples if samples else 0.0)
    if max(deviation[3:6]) > gains.gyro_scatter or max(deviation[0:3]) > gains.accel_scatter:
        return State(time_us, obstacle=Obstacle.MOTION, rest=state.rest), False
    if max(abs(rate) for rate in means.rate) > gains.gyro_offset:
        return State(time_us, obstacle=Obstacle.OFFSET, rest=state.rest), False
    windows = (*state.windows, means)[-gains.windows :]
    if not _agreeing(gains, windows):
        return State(time_us, windows=(means,), obstacle=Obstacle.MOTION, rest=state.rest), False
    if len(windows) < gains.windows:
        return State(time_us, windows=windows, obstacle=state.obstacle, rest=state.rest), False
    pressures = [window.pressure for window in windows]
    rest = Rest(_mean(windows), max(pressures) - min(pressures))
    return State(time_us, windows=windows, rest=rest), True


def _agreeing(gains: Gains, windows: tuple[Means, ...]) -> bool:
    """Return whether the rates and directions of the windows agree."""
    last = windows[-1]
    force, field = gains.turn * _norm(last.force), gains.turn * _norm(last.field)
    return all(
        max(abs(a - b) for a, b in zip(one.rate, last.rate, strict=True)) <= gains.gyro_spread
        and _distance(one.force, last.force) <= force
        and _distance(one.field, last.field) <= field
        for one in windows[:-1]
    )


def _mean(windows: tuple[Means, ...]) -> Means:
    return Means(
        _mean_vector([window.rate for window in windows]),
        _mean_vector([window.force for window in windows]),
        _mean_vector([window.field for window in windows]),
        sum(window.pressure for window in windows) / len(windows),
    )


def _mean_vector(vectors: list[Vector]) -> Vector:
    x, y, z = (sum(values) / len(vectors) for values in zip(*vectors, strict=True))
    return x, y, z


def _norm(v: Vector) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def _distance(a: Vector, b: Vector) -> float:
    return _norm((a[0] - b[0], a[1] - b[1], a[2] - b[2]))
