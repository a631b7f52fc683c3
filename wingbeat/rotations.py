"""Rotations on plain floats: direction cosine matrices, and their quaternions (w, x, y, z) and Euler angles.

A direction cosine matrix (DCM) is nine numbers, row by row. Euler angles are roll, pitch and yaw in rad, for
rotations about z, y, x in this order. `wingbeat.rotation_arrays` has the same for columns of a table.
"""

from __future__ import annotations

from math import asin, atan2, copysign, cos, sin, sqrt
from typing import Final

Vector = tuple[float, float, float]
Matrix = tuple[float, float, float, float, float, float, float, float, float]
Quaternion = tuple[float, float, float, float]

SMALL_ANGLE_SQUARED: Final = 1e-14


def dcm_from_rotation_vector(x: float, y: float, z: float) -> Matrix:
    """Compute the matrix of the rotation by ``|v|`` rad about ``v = (x, y, z)``, exactly (Rodrigues)."""
    square = x * x + y * y + z * z
    if square < SMALL_ANGLE_SQUARED:
        a, b = 1.0, 0.5
    else:
        angle = sqrt(square)
        a = sin(angle) / angle
        b = (1.0 - cos(angle)) / square
    bx, by, bz = b * x, b * y, b * z
    ax, ay, az = a * x, a * y, a * z
    xy, xz, yz = bx * y, bx * z, by * z
    xx, yy, zz = bx * x, by * y, bz * z
    return (1.0 - yy - zz, xy - az, xz + ay, xy + az, 1.0 - xx - zz, yz - ax, xz - ay, yz + ax, 1.0 - xx - yy)


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Compute the product ``a b``."""
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = a
    b0, b1, b2, b3, b4, b5, b6, b7, b8 = b
    return (
        a0 * b0 + a1 * b3 + a2 * b6, a0 * b1 + a1 * b4 + a2 * b7, a0 * b2 + a1 * b5 + a2 * b8,
        a3 * b0 + a4 * b3 + a5 * b6, a3 * b1 + a4 * b4 + a5 * b7, a3 * b2 + a4 * b5 + a5 * b8,
        a6 * b0 + a7 * b3 + a8 * b6, a6 * b1 + a7 * b4 + a8 * b7, a6 * b2 + a7 * b5 + a8 * b8,
    )  # fmt: skip


def rotate(r: Matrix, v: Vector) -> Vector:
    """Compute ``r v``: with r_ned_from_frd, transform a body vector to earth axes."""
    x, y, z = v
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r
    return (r0 * x + r1 * y + r2 * z, r3 * x + r4 * y + r5 * z, r6 * x + r7 * y + r8 * z)


def rotate_back(r: Matrix, v: Vector) -> Vector:
    """Compute ``r' v``: with r_ned_from_frd, transform an earth vector to body axes."""
    x, y, z = v
    return (r[0] * x + r[3] * y + r[6] * z, r[1] * x + r[4] * y + r[7] * z, r[2] * x + r[5] * y + r[8] * z)


def cross(a: Vector, b: Vector) -> Vector:
    """Compute the vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def norm(v: Vector) -> float:
    """Compute the length of a vector."""
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def unit(v: Vector) -> Vector | None:
    """Return ``v`` at length 1; None for a vector without a direction."""
    length = norm(v)
    if not length > 1e-9:
        return None
    return (v[0] / length, v[1] / length, v[2] / length)


def orthonormalize(r: Matrix) -> Matrix:
    """Remove round-off from the rows of ``r`` (Gram-Schmidt, last row kept)."""
    down = unit((r[6], r[7], r[8])) or (0.0, 0.0, 1.0)
    east = unit(cross(down, (r[0], r[1], r[2]))) or (0.0, 1.0, 0.0)
    return (*cross(east, down), *east, *down)


def euler_from_dcm(r: Matrix) -> Vector:
    """Compute roll, pitch and yaw in rad from r_ned_from_frd."""
    r0, _, _, r3, _, _, r6, r7, r8 = r
    return (atan2(r7, r8), asin(-r6 if -1.0 <= r6 <= 1.0 else -copysign(1.0, r6)), atan2(r3, r0))


def quaternion_from_dcm(r: Matrix) -> Quaternion:
    """Compute the quaternion with w >= 0 of a matrix, from its largest component (Shepperd 1978)."""
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r
    if r0 + r4 + r8 > 0.0:
        s = sqrt(1.0 + r0 + r4 + r8)
        t = 0.5 / s
        return (0.5 * s, (r7 - r5) * t, (r2 - r6) * t, (r3 - r1) * t)
    if r0 >= r4 and r0 >= r8:
        s = sqrt(1.0 + r0 - r4 - r8)
        t = 0.5 / s
        w, x, y, z = (r7 - r5) * t, 0.5 * s, (r1 + r3) * t, (r2 + r6) * t
    elif r4 >= r8:
        s = sqrt(1.0 - r0 + r4 - r8)
        t = 0.5 / s
        w, x, y, z = (r2 - r6) * t, (r1 + r3) * t, 0.5 * s, (r5 + r7) * t
    else:
        s = sqrt(1.0 - r0 - r4 + r8)
        t = 0.5 / s
        w, x, y, z = (r3 - r1) * t, (r2 + r6) * t, (r5 + r7) * t, 0.5 * s
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)
