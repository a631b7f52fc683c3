"""Classic corrections of the Razor AHRS for comparison, applied at each sample.

W. Premerlani and P. Bizard, Direction Cosine Matrix IMU: Theory, 2009, as implemented in the firmware of SparkFun's
Razor. The first error is the vector product of measured and computed down, weighted by the deviation of the sample
from 1 g. The second is the difference between compass and heading. Both correct the rates by a proportional and an
integral term. The constants of the firmware are for counts (256 to 1 g) and a loop at 50 Hz; those here are per g and
per second.

A periodically accelerated airframe passes through 1 g at times when its acceleration does not point down, so that the
weight selects the wrong samples: see docs/validation/estimation.md.
"""

from __future__ import annotations

from math import cos, hypot, sin
from typing import Final, NamedTuple

from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.rotations import Matrix, Vector, norm, orthonormalize, rotate

WEIGHT_SLOPE: Final = 2.0
"""-; the weight is 1 at 1 g and 0 at 0.5 and 1.5 g"""


class Gains(NamedTuple):
    """Gains of the four terms.

    The values of the firmware are 0.02 * 256, 0.00002 * 256 * 50, 1.2 and 0.00002 * 50.
    """

    tilt: float
    """1/s; proportional gain of the tilt"""
    tilt_rate: float
    """1/s^2; integral gain of the tilt"""
    yaw: float
    """1/s; proportional gain of the heading"""
    yaw_rate: float
    """1/s^2; integral gain of the heading"""
    declination: float
    """rad; magnetic declination, positive east"""


def step(
    gains: Gains, r: Matrix, bias: Vector, rates: Vector, vectors: tuple[Vector, Vector], dt: float
) -> tuple[Matrix, Vector]:
    """Return the matrix and the gyro bias after one sample.

    Args:
        gains: parameters.
        r: r_ned_from_frd.
        bias: rad/s; body axes.
        rates: rad/s; measured, body axes.
        vectors: specific force in m/s^2 and magnetic field in gauss, body axes.
        dt: s; since the last sample.
    """
    force, field = vectors
    tx, ty, tz = _tilt_error(r, force)
    heading = _heading_error(gains, r, field)
    yx, yy, yz = heading * r[6], heading * r[7], heading * r[8]
    p, q, i, k = gains.tilt, gains.yaw, gains.tilt_rate * dt, gains.yaw_rate * dt
    bias = (bias[0] - i * tx - k * yx, bias[1] - i * ty - k * yy, bias[2] - i * tz - k * yz)
    x = (rates[0] - bias[0] + p * tx + q * yx) * dt
    y = (rates[1] - bias[1] + p * ty + q * yy) * dt
    z = (rates[2] - bias[2] + p * tz + q * yz) * dt
    r0, r1, r2, r3, r4, r5, r6, r7, r8 = r
    turned = (
        r0 + r1 * z - r2 * y, r1 + r2 * x - r0 * z, r2 + r0 * y - r1 * x,
        r3 + r4 * z - r5 * y, r4 + r5 * x - r3 * z, r5 + r3 * y - r4 * x,
        r6 + r7 * z - r8 * y, r7 + r8 * x - r6 * z, r8 + r6 * y - r7 * x,
    )  # fmt: skip
    return orthonormalize(turned), bias


def _tilt_error(r: Matrix, force: Vector) -> Vector:
    """Return the weighted product of measured and computed down (g, body axes)."""
    weight = max(0.0, 1.0 - WEIGHT_SLOPE * abs(1.0 - norm(force) / STANDARD_GRAVITY)) / STANDARD_GRAVITY
    x, y, z = -weight * force[0], -weight * force[1], -weight * force[2]
    return (y * r[8] - z * r[7], z * r[6] - x * r[8], x * r[7] - y * r[6])


def _heading_error(gains: Gains, r: Matrix, field: Vector) -> float:
    """Return the sine of the heading error times the cosine of the pitch.

    The error is the heading of the compass minus that of the matrix.
    """
    north, east, _ = rotate(r, field)
    level = hypot(north, east)
    if level == 0.0:
        return 0.0
    # A field east of the declination indicates a heading error to the right.
    return hypot(r[0], r[3]) * (sin(gains.declination) * north - cos(gains.declination) * east) / level
