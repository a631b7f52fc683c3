"""Clouds of markers to position and attitude of rigid bodies (Grauer et al. 2011, Eq. 8), with standard errors.

A marker k of a body is at r_k = r + R r_k', its place r_k' on the body known. Position and attitude are those of
least squares over the markers that were seen (Kabsch, `logs.importing.rigid_body`); the markers' noise is told by
what is left, and makes the errors of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import chdtri

from logs.identification.results import Array
from logs.importing.rigid_body import FLAT, LEAST_MARKERS, fitted
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

OUTLIER = 6.0
"""-; robust standard deviations from the others at which a marker is left out"""
LEAP = 9.0
"""-; times the usual size of a marker's noise in its second difference, at which a sample is left out"""
LEAST_LEAP = 0.002
"""m; less may be how the marker moves"""
NEIGHBOURS = 7
"""frames; whose median tells where a marker's second difference should be"""
LEAST_FRAMES = 20
MISTAKEN = 1e-7
"""-; share of good frames that may be taken for wrong ones"""
Places = dict[str, dict[str, tuple[float, float, float]]]
"""m; of the markers by their names in the axes of the bodies by theirs, from the bodies' origins"""


class MarkedBody(NamedTuple):
    """A rigid body with markers on it."""

    name: str
    """-; of the vehicle's tree"""
    places: Array
    """m; (m, 3), of its markers in the body's axes, from its origin"""


class Poses(NamedTuple):
    """Position and attitude of one body in N frames; NaN where too few of its markers were seen."""

    position: Array
    """m; (N, 3), of the body's origin, in the capture's axes"""
    quaternion: Array
    """-; (N, 4), w first, from the body's axes to the capture's"""
    covariance: Array
    """m^2, m rad, rad^2; (N, 6, 6), of position in the capture's axes and of a turn about the body's axes"""
    noise: float
    """m; standard deviation of a marker along each axis"""
    used: NDArray[np.bool_]
    """(m, N); markers that the pose was taken from"""


def body_poses(body: MarkedBody, positions: Array) -> Poses:
    """Poses of ``body`` from ``positions`` (m, N, 3) m of its markers, NaN where one was not seen.

    A marker is left out where it jumps against its own neighbouring frames, and, where at least four were seen, the
    one that fits worst if it is far out. Of three that do not fit, none can be told to be the wrong one: the frame
    has no pose.

    Raises:
        InputError: fewer than three markers, markers in one line, shapes that differ, or too few frames with three.
    """
    _check(body, positions)
    seen = np.where(jumps(positions)[:, :, None], np.nan, positions)
    position, quaternion, off = _fit(body.places, seen)
    for _ in range(len(body.places) - LEAST_MARKERS):
        unfit, count = _unfit(off)
        wrong = unfit & (count > LEAST_MARKERS)
        if not wrong.any():
            break
        size = np.linalg.norm(off[:, wrong], axis=2)
        seen[np.argmax(np.where(np.isfinite(size), size, -1.0), axis=0), wrong] = np.nan
        position, quaternion, off = _fit(body.places, seen)
    unfit, _ = _unfit(off)
    position[unfit] = quaternion[unfit] = np.nan
    used = np.isfinite(off).all(axis=2) & ~unfit
    if int(np.isfinite(position[:, 0]).sum()) < LEAST_FRAMES:
        raise InputError(f"{body.name}: fewer than {LEAST_FRAMES} frames in which three of its markers agree")
    noise = _noise(off, used)
    return Poses(position, quaternion, _covariance(body.places, quaternion, used, noise), noise, used)


def jumps(positions: Array) -> NDArray[np.bool_]:
    """Which samples of ``positions`` (m, N, 3) leap away from where their neighbours in time have the marker."""
    bend = np.full(positions.shape, np.nan)
    bend[:, 1:-1] = positions[:, 1:-1] - 0.5 * (positions[:, 2:] + positions[:, :-2])
    known = np.where(np.isfinite(bend), bend, 0.0)
    off = np.linalg.norm(np.where(np.isfinite(bend), bend - median_filter(known, (1, NEIGHBOURS, 1)), 0.0), axis=2)
    whole = np.isfinite(bend).all(axis=2)
    scale = np.array([np.median(row[good]) if good.any() else np.inf for row, good in zip(off, whole, strict=True)])
    far = off > np.maximum(LEAP * scale, LEAST_LEAP)[:, None]
    # A wrong sample bends the track at its neighbours too, half as much.
    peak = off >= np.maximum(np.roll(off, 1, axis=1), np.roll(off, -1, axis=1))
    return np.asarray(far & peak & whole)


def skew(vectors: Array) -> Array:
    """S(v) of Grauer Eq. 5, (..., 3, 3) of (..., 3): the matrix of ``v`` cross."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    o = np.zeros_like(x)
    return np.moveaxis(np.array(((o, -z, y), (z, o, -x), (-y, x, o))), (0, 1), (-2, -1))


def _check(body: MarkedBody, positions: Array) -> None:
    if body.places.shape != (len(body.places), 3) or positions.shape[::2] != (len(body.places), 3):
        raise InputError(f"{body.name}: positions of {len(body.places)} markers are needed, (markers, frames, 3)")
    if len(body.places) < LEAST_MARKERS:
        raise InputError(f"{body.name}: {len(body.places)} markers tell no attitude; three are needed")
    if np.linalg.svd(body.places - body.places.mean(axis=0), compute_uv=False)[1] < FLAT:
        raise InputError(f"{body.name}: its markers are in one line and tell no attitude")


def _fit(places: Array, seen: Array) -> tuple[Array, Array, Array]:
    """Positions, quaternions, and how far each marker (m, N, 3) is off, NaN where it was not used."""
    position, quaternion = fitted(places, seen.swapaxes(0, 1))
    model = position[None] + np.einsum("nij,mj->mni", dcms_from_quaternions(quaternion), places)
    return position, quaternion, np.asarray(seen - model)


def _unfit(off: Array) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which frames fit worse than noise makes them, and the markers of each; noise as in the frame of the middle.

    A frame's sum of squares has the chi-square distribution of 3 m - 6 degrees of freedom.
    """
    count = np.isfinite(off).all(axis=2).sum(axis=0)
    freedom = np.maximum(3.0 * count - 6.0, 1.0)
    size = np.nansum(np.square(off), axis=(0, 2))
    known = count >= LEAST_MARKERS
    square = float(np.median(size[known] / chdtri(freedom[known], 0.5))) if known.any() else 0.0
    return known & (size > square * chdtri(freedom, MISTAKEN)), np.asarray(count, np.int64)


def _noise(off: Array, used: NDArray[np.bool_]) -> float:
    """m; of a marker along one axis: six of a frame's 3 m numbers went into its pose."""
    freedom = float((3 * used.sum(axis=0) - 6)[used.any(axis=0)].sum())
    return float(np.sqrt(np.sum(np.square(off[used])) / freedom))


def _covariance(places: Array, quaternion: Array, used: NDArray[np.bool_], noise: float) -> Array:
    """(N, 6, 6): inverse of J^T J with J = [I, -R S(r_k')] of each marker, times the noise squared."""
    turn = -np.einsum("nij,mjk->nmik", dcms_from_quaternions(quaternion), skew(places))
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=3) * used.T[:, :, None, None]
    known = used.any(axis=0)
    out = np.full((len(quaternion), 6, 6), np.nan)
    out[known] = np.linalg.inv(np.einsum("nmij,nmik->njk", jacobian[known], jacobian[known])) * noise**2
    return out
