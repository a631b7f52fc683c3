"""Vibration levels and clipping of the accelerometer."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.messages import ImuSample, VibrationStatus
from wingbeat.records import constructor

HIGH_PASS = 5.0
"""Hz; corner below which acceleration is motion and not vibration"""
LEVEL = 2.0
"""Hz; corner of the low-pass filter of the squares"""


class State(NamedTuple):
    """Filters of three axes, and the count."""

    mean_x: float = 0.0
    """m/s^2; low-pass filtered specific force along FRD x"""
    mean_y: float = 0.0
    """m/s^2; along FRD y"""
    mean_z: float = 0.0
    """m/s^2; along FRD z"""
    square_x: float = 0.0
    """m^2/s^4; low-pass filtered square of what the high-pass leaves along FRD x"""
    square_y: float = 0.0
    """m^2/s^4; along FRD y"""
    square_z: float = 0.0
    """m^2/s^4; along FRD z"""
    clipped: int = 0
    """-; samples with an axis at the end of the range since boot"""


_new_state = constructor(State)


def step(full_scale: float, state: State, imu: ImuSample, dt: float) -> State:
    """One sample: first-order filters, as ArduPilot's vibration levels.

    Args:
        full_scale: m/s^2; end of the accelerometer's range.
        state: of the sample before.
        imu: the sample; FRD.
        dt: s; since the sample before.
    """
    mx, my, mz, qx, qy, qz, clipped = state
    _, ax, ay, az, *_ = imu
    low = math.tau * HIGH_PASS * dt / (1.0 + math.tau * HIGH_PASS * dt)
    level = math.tau * LEVEL * dt / (1.0 + math.tau * LEVEL * dt)
    mx, my, mz = mx + low * (ax - mx), my + low * (ay - my), mz + low * (az - mz)
    dx, dy, dz = ax - mx, ay - my, az - mz
    at_end = abs(ax) >= full_scale or abs(ay) >= full_scale or abs(az) >= full_scale
    squares = (qx + level * (dx * dx - qx), qy + level * (dy * dy - qy), qz + level * (dz * dz - qz))
    return _new_state(mx, my, mz, *squares, clipped + at_end)


def status(state: State, time_us: int) -> VibrationStatus:
    """The levels as of ``time_us``."""
    x, y, z = math.sqrt(state.square_x), math.sqrt(state.square_y), math.sqrt(state.square_z)
    return VibrationStatus(time_us, x, y, z, state.clipped)
