"""Accelerometer calibration: offset and scale from poses at rest.

The magnitude of the reading at rest is gravity in any attitude. Six sides determine the six unknowns (three offsets,
three scales) by least squares of the norm: a pose need not be exact, and a rotated mounting has no effect. Each pose
has four means of half a second, so that the residual contains noise and motion. A nonlinearity of the sensor is
visible only with more than six poses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.calibration.result import NOTHING_NEW, Result, Took, triple
from avionics.sensing.inertial import Gains
from wingbeat.constants import STANDARD_GRAVITY

BLOCK = 100
"""samples of one mean: half a second"""
BLOCKS = 4
"""means of one pose"""
STILL = 0.35
"""m/s^2; maximum RMS deviation within a mean at rest: three times the noise of the ADXL345"""
SAME_POSE = 0.5
"""m/s^2; maximum difference between the means of one pose"""
ON_A_SIDE = 0.8
"""-; minimum fraction of gravity along one axis on a side"""
GREATEST_OFFSET = 5.0
"""m/s^2; maximum plausible offset; a larger one indicates a defect or an acceleration"""
SCALES = (0.8, 1.25)
"""-; range of plausible scales"""
TILT = 0.35
"""-; maximum fraction of gravity across the vertical in a level pose"""
SIDES = ("nose down", "nose up", "left side up", "right side up", "level", "on its back")
"""sides by axis, negative specific force first (along x, y, z of FRD); level is -z"""

Vector = tuple[float, float, float]
Array = NDArray[np.float64]


class State(NamedTuple):
    """Collected samples."""

    samples: int = 0
    """-; samples in the present mean"""
    first: Vector = (0.0, 0.0, 0.0)
    """m/s^2; first sample of the mean, reference of the sums"""
    total: Vector = (0.0, 0.0, 0.0)
    """m/s^2; sum of the differences"""
    square: float = 0.0
    """m^2/s^4; sum of their squares"""
    pose: tuple[Vector, ...] = ()
    """m/s^2; means of the present pose"""
    sides: tuple[int, ...] = ()
    """-; completed sides, see `SIDES`"""
    means: tuple[Vector, ...] = ()
    """m/s^2; means of all completed poses"""


def step(state: State, force: Vector) -> tuple[State, Took]:
    """Add a sample (m/s^2, FRD) to a calibration on six sides."""
    state, mean, moving = _mean(state, force)
    if mean is None:
        return state, NOTHING_NEW
    state = _follow_pose(state, mean, moving)
    side = side_of(mean)
    if len(state.pose) < BLOCKS or side < 0 or side in state.sides:
        return state, NOTHING_NEW
    state = state._replace(sides=(*state.sides, side), means=state.means + state.pose, pose=())
    missing = [name for number, name in enumerate(SIDES) if number not in state.sides]
    note = f"pose {len(state.sides)} of {len(SIDES)}: {SIDES[side]}"
    left = f"; remaining: {', '.join(missing)}" if missing else ""
    return state, Took(note + left, complete=not missing)


def step_level(state: State, force: Vector) -> tuple[State, Took]:
    """Add a sample (m/s^2, FRD) to a calibration at level rest."""
    state, mean, moving = _mean(state, force)
    if mean is None:
        return state, NOTHING_NEW
    if moving:
        return state, Took(cancelled="vehicle moved")
    state = state._replace(means=(*state.means, mean))
    return state, Took(complete=len(state.means) == BLOCKS)


def side_of(mean: Vector) -> int:
    """Return the index in `SIDES` of the upper side; -1 between two sides."""
    size = math.sqrt(sum(value * value for value in mean))
    axis = max(range(3), key=lambda i: abs(mean[i]))
    return -1 if abs(mean[axis]) < ON_A_SIDE * size else 2 * axis + int(mean[axis] > 0.0)


def progress(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    return len(state.means) / (BLOCKS * len(SIDES))


def progress_level(state: State) -> float:
    """Return the completed fraction, 0 to 1."""
    return len(state.means) / BLOCKS


def _mean(state: State, force: Vector) -> tuple[State, Vector | None, bool]:
    """Add a sample; return the mean at the end of a block, and whether it moved."""
    first = state.first if state.samples else force
    x, y, z = force[0] - first[0], force[1] - first[1], force[2] - first[2]
    tx, ty, tz = state.total if state.samples else (0.0, 0.0, 0.0)
    count, total = state.samples + 1, (tx + x, ty + y, tz + z)
    square = (state.square if state.samples else 0.0) + x * x + y * y + z * z
    if count < BLOCK:
        return state._replace(samples=count, first=first, total=total, square=square), None, False
    mx, my, mz = (value / count for value in total)
    variance = square / count - (mx * mx + my * my + mz * mz)
    mean = (first[0] + mx, first[1] + my, first[2] + mz)
    return state._replace(samples=0), mean, variance > STILL * STILL


def _follow_pose(state: State, mean: Vector, moving: bool) -> State:
    """Update the means of the pose; motion or a new attitude begins another pose."""
    if moving:
        return state._replace(pose=())
    if state.pose and math.dist(mean, state.pose[0]) > SAME_POSE:
        return state._replace(pose=(mean,))
    return state._replace(pose=(*state.pose, mean)[-BLOCKS:])


def finish(state: State) -> tuple[Result, str]:
    """Return offsets and scales by least squares, and an error text.

    The model is | scale (reading - offset) | = g. The text is empty on success.
    """
    means = np.array(state.means)
    offset = 0.5 * (means.max(axis=0) + means.min(axis=0))
    scale = np.ones(3)
    for _ in range(20):
        centred = means - offset
        size = np.linalg.norm(centred * scale, axis=1)
        slope = np.hstack((-(scale**2) * centred, scale * centred**2)) / size[:, None]
        change = np.linalg.lstsq(slope, STANDARD_GRAVITY - size, rcond=None)[0]
        offset, scale = offset + change[:3], scale + change[3:]
    left = np.linalg.norm((means - offset) * scale, axis=1) - STANDARD_GRAVITY
    return _result(offset, scale, left)


def finish_level(state: State, gains: Gains) -> tuple[Result, str]:
    """Return the offsets that level the mean reading with known scales.

    The second value is an error text, empty on success.
    """
    means = np.array(state.means)
    mean = means.mean(axis=0)
    if math.hypot(mean[0], mean[1]) > TILT * STANDARD_GRAVITY or mean[2] > 0.0:
        return Result((), 0.0, "m/s^2", len(means)), "vehicle is not level"
    scale = np.array(gains.accel_scale)
    offset = mean - np.array((0.0, 0.0, -STANDARD_GRAVITY)) / scale
    left = np.linalg.norm(means - mean, axis=1)
    return _result(offset, scale, left)


def _result(offset: Array, scale: Array, left: Array) -> tuple[Result, str]:
    settings = triple("imu", "accel_offset", offset) + triple("imu", "accel_scale", scale)
    residual = math.sqrt(float(np.mean(np.square(left))))
    refusal = ""
    if np.max(np.abs(offset)) > GREATEST_OFFSET or not np.all((scale >= SCALES[0]) & (scale <= SCALES[1])):
        refusal = "offset or scale out of range: check the accelerometer"
    return Result(settings, residual, "m/s^2", len(left)), refusal
