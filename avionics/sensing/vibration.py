"""Vibration levels and clipping of the accelerometer."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from avionics.messages import ImuSample, VibrationStatus
from wingbeat.records import constructor

HIGH_PASS: Final = 5.0
"""Hz; high-pass corner that separates vibration from motion"""
LEVEL: Final = 2.0
"""Hz; low-pass corner of the squared vibration"""


class State(NamedTuple):
    """Filter states of three axes and clipping count."""

    mean_x: float = 0.0
    """m/s^2; low-pass filtered specific force along FRD x"""
    mean_y: float = 0.0
    """m/s^2; along FRD y"""
    mean_z: float = 0.0
    """m/s^2; along FRD z"""
    square_x: float = 0.0
    """m^2/s^4; low-pass filtered square of the high-pass output along FRD x"""
    square_y: float = 0.0
    """m^2/s^4; along FRD y"""
    square_z: float = 0.0
    """m^2/s^4; along FRD z"""
    clipped: int = 0
    """-; number of samples with a saturated axis since boot"""


_new_state: Final = constructor(State)


def step(full_scale: float, state: State, imu: ImuSample, dt: float) -> State:
    """Update the vibration levels by first-order filters, as in ArduPilot.

    Args:
        full_scale: m/s^2; limit of the accelerometer range.
        state: state after the previous sample.
        imu: sample; FRD.
        dt: s; since the previous sample.
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
    """Return the vibration levels at ``time_us``."""
    x, y, z = math.sqrt(state.square_x), math.sqrt(state.square_y), math.sqrt(state.square_z)
    return VibrationStatus(time_us, x, y, z, state.clipped)
