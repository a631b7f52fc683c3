"""Quaternions (w, x, y, z) on plain floats; the simulator compiles `frd_from_ned` with Numba, from its source.

Euler angles are roll, pitch and yaw in rad, for rotations about z, y, x in this order.
"""

from __future__ import annotations

from math import cos, sin

from wingbeat.rotations import Matrix, Quaternion, Vector


def dcm_from_quaternion(q: Quaternion) -> Matrix:
    """Compute the matrix of the unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def quaternion_from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Compute the quaternion of r_ned_from_frd from roll, pitch and yaw in rad."""
    cr, sr = cos(roll / 2), sin(roll / 2)
    cp, sp = cos(pitch / 2), sin(pitch / 2)
    cy, sy = cos(yaw / 2), sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def frd_from_ned(quaternion: Quaternion, v_ned: Vector) -> Vector:
    """Rotate a vector from NED to body axes; the quaternion of r_ned_from_frd need not be of unit length."""
    w, x, y, z = quaternion
    a, b, c = v_ned
    s = 2.0 / (w * w + x * x + y * y + z * z)
    tx, ty, tz = s * (y * c - z * b), s * (z * a - x * c), s * (x * b - y * a)
    return (
        a - w * tx + y * tz - z * ty,
        b - w * ty + z * tx - x * tz,
        c - w * tz + x * ty - y * tx,
    )
