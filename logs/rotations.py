"""Rotations as columns: quaternions (w, x, y, z) of r_ned_from_frd, and roll, pitch and yaw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quaternion_of(roll: Array, pitch: Array, yaw: Array) -> tuple[Array, Array, Array, Array]:
    """w, x, y, z of r_ned_from_frd, from angles in rad of yaw, pitch, roll in turn."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(0.5 * angle), np.sin(0.5 * angle)) for angle in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def angles_of(w: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Roll, pitch and yaw in rad of unit quaternions r_ned_from_frd."""
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return roll, pitch, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
