"""Rotations as arrays, of all rows of a table: quaternions (w, x, y, z) of r_ned_from_frd, Euler angles, matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def quaternions_from_euler(roll: Array, pitch: Array, yaw: Array) -> tuple[Array, Array, Array, Array]:
    """Compute w, x, y, z of r_ned_from_frd from angles in rad; rotations about z, y, x in this order."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(0.5 * angle), np.sin(0.5 * angle)) for angle in (roll, pitch, yaw))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def euler_from_quaternions(w: Array, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
    """Compute roll, pitch and yaw in rad from unit quaternions r_ned_from_frd."""
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return roll, pitch, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def dcms_from_quaternions(quaternion: Array) -> Array:
    """Compute rotation matrices (N, 3, 3) of unit quaternions (N, 4), w first."""
    w, x, y, z = quaternion.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)
