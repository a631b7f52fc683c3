"""Magnetometer calibration: hard and soft iron by an ellipsoid fit.

The vehicle is rotated, so that the field vector describes an ellipsoid. The ellipsoid is fitted by linear least
squares of its quadric. Its center is the hard iron. The symmetric matrix that transforms it to a sphere of the same
volume corrects soft iron and scale errors. With insufficient coverage a sphere is fitted instead, and with less
coverage there is no result.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.calibration.result import NOTHING_NEW, Result, Setting, Took, triple

SPACING = 0.07
"""gauss; minimum distance between two stored samples: about nine degrees"""
MOST = 200
"""maximum number of stored samples"""
ENOUGH = 60
"""minimum number of samples at the automatic end, for any coverage"""
FEWEST = 12
"""minimum number of samples for a fit"""
COMPLETE, ELLIPSOID, SPHERE = 0.9, 0.75, 0.5
"""-; coverage at the automatic end, and minimum for an ellipsoid and for a sphere"""
NEAR = math.cos(math.radians(25.0))
"""-; cosine of the maximum angle between a covered direction and a sample: 25 degrees"""
DIRECTIONS = 100
"""uniformly distributed directions of the coverage"""
SCALES = (0.5, 2.0)
"""-; range of plausible axes of the correction matrix"""

Vector = tuple[float, float, float]
Array = NDArray[np.float64]


class State(NamedTuple):
    """Collected samples."""

    points: tuple[Vector, ...] = ()
    """gauss; readings"""
    coverage: float = 0.0
    """-; fraction of all directions"""
    reported: int = 0
    """-; reported tenths of the coverage"""


def step(state: State, field: Vector) -> tuple[State, Took]:
    """Add a reading (gauss, FRD); it is stored if distant from all others."""
    x, y, z = field
    near = SPACING * SPACING
    for a, b, c in state.points:
        if (x - a) * (x - a) + (y - b) * (y - b) + (z - c) * (z - c) < near:
            return state, NOTHING_NEW
    points = (*state.points, field)[:MOST]
    covered = coverage(np.array(points))
    tenths = int(10.0 * covered)
    note = f"{100.0 * covered:.0f} % of all directions covered" if tenths > state.reported else ""
    complete = covered >= COMPLETE and len(points) >= ENOUGH
    return State(points, covered, max(tenths, state.reported)), Took(note, complete or len(points) >= MOST)


def progress(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    return min(state.coverage / COMPLETE, 1.0)


def coverage(points: Array) -> float:
    """Return the fraction of all directions with a sample nearby.

    Directions are relative to the center of the sphere through ``points`` (N, 3).
    """
    if len(points) < FEWEST:
        return 0.0
    offsets = points - _sphere_centre(points)
    unit = offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-9)
    return float(np.mean(np.max(_directions() @ unit.T, axis=1) > NEAR))


@cache
def _directions() -> Array:
    """Return uniformly distributed unit vectors (N, 3), by the golden angle."""
    number = np.arange(DIRECTIONS)
    height = 1.0 - (2.0 * number + 1.0) / DIRECTIONS
    angle, flat = math.pi * (3.0 - math.sqrt(5.0)) * number, np.sqrt(1.0 - height**2)
    return np.column_stack((flat * np.cos(angle), flat * np.sin(angle), height))


def finish(state: State) -> tuple[Result, str]:
    """Return hard and soft iron, and an error text (empty on success)."""
    points = np.array(state.points).reshape(-1, 3)
    if state.coverage < SPHERE or len(points) < FEWEST:
        return Result((), 0.0, "gauss", len(points)), (
            f"only {100.0 * state.coverage:.0f} % of all directions covered, {100.0 * SPHERE:.0f} % required"
        )
    fitted = _ellipsoid(points) if state.coverage >= ELLIPSOID else None
    centre, matrix = fitted if fitted is not None else (_sphere_centre(points), np.eye(3))
    size = np.linalg.norm((points - centre) @ matrix, axis=1)
    residual = float(np.std(size))
    low, high = np.linalg.eigvalsh(matrix)[[0, -1]]
    settings = _settings(centre, matrix)
    refusal = "" if SCALES[0] <= low and high <= SCALES[1] else "samples do not fit an ellipsoid: move away from iron"
    return Result(settings, residual, "gauss", len(points)), refusal


def _settings(centre: Array, matrix: Array) -> tuple[Setting, ...]:
    diagonal = (matrix[0, 0], matrix[1, 1], matrix[2, 2])
    cross = (matrix[0, 1], matrix[0, 2], matrix[1, 2])
    return (
        triple("imu", "mag_offset", (centre[0], centre[1], centre[2]))
        + triple("imu", "mag_scale", diagonal)
        + triple("imu", "mag_cross", cross)
    )


def _sphere_centre(points: Array) -> Array:
    """Return the center (3,) of the sphere through ``points`` (N, 3).

    Least squares of |p|^2 = 2 p.c + r^2 - |c|^2.
    """
    design = np.column_stack((2.0 * points, np.ones(len(points))))
    solution = np.linalg.lstsq(design, np.sum(points**2, axis=1), rcond=None)[0]
    return np.asarray(solution[:3])


def _ellipsoid(points: Array) -> tuple[Array, Array] | None:
    """Return center (3,) and correction matrix (3, 3) of an ellipsoid.

    The symmetric matrix with determinant 1 transforms it to a sphere. The result is None if the quadric is not an
    ellipsoid.
    """
    middle = _sphere_centre(points)
    size = float(np.mean(np.linalg.norm(points - middle, axis=1)))
    x, y, z = ((points - middle) / size).T
    design = np.column_stack((x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, 2 * x, 2 * y, 2 * z))
    a, b, c, d, e, f, *linear = np.linalg.lstsq(design, np.ones(len(points)), rcond=None)[0]
    quadric = np.array([[a, d, e], [d, b, f], [e, f, c]])
    if np.min(np.linalg.eigvalsh(quadric)) <= 0.0:
        return None
    centre = -np.linalg.solve(quadric, linear)
    lengths, axes = np.linalg.eigh(quadric)
    root = axes @ np.diag(np.sqrt(lengths)) @ axes.T
    return middle + size * centre, root / np.linalg.det(root) ** (1.0 / 3.0)
