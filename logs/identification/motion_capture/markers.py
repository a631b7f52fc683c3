"""Poses of rigid bodies from clouds of markers, with standard errors (Grauer et al. 2011, Eq. 8).

A marker k of a body is at ``r_k = r + R r_k'``, its position r_k' on the body known. Position and attitude are those
of least squares over the measured markers (Kabsch, `logs.importing.rigid_body`); the residuals give the markers'
noise, and that the errors of both. Two markers whose names are swapped are detected by the residuals too: with the
right names the bodies fit far better, while noise and inexact positions are the same in both.
"""

from __future__ import annotations

from itertools import combinations
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
"""-; robust standard deviations, above which a marker is rejected"""
JUMP = 9.0
"""-; of a marker's median second difference, above which a sample is rejected"""
MIN_JUMP = 0.002
"""m; a smaller one may be motion"""
MEDIAN_FRAMES = 7
"""-; frames of the median filter of second differences"""
MIN_FRAMES = 20
FALSE_ALARM = 1e-7
"""-; probability that a good frame is rejected"""
Places = dict[str, dict[str, tuple[float, float, float]]]
"""m; of the markers by their names in the axes of the bodies by theirs, from the bodies' origins"""
FRAMES = 100
"""-; of a record, in which the fits are compared"""
IMPROVEMENT = 3.0
"""-; ratio of root mean square residuals, from which names count as swapped"""
EXACT = 1e-5
"""m; residual of an exact fit"""


class MarkedBody(NamedTuple):
    """A rigid body with markers on it."""

    name: str
    """-; of the vehicle's tree"""
    places: Array
    """m; (m, 3), of its markers in the body's axes, from its origin"""


class Poses(NamedTuple):
    """Position and attitude of one body in N frames; NaN if too few of its markers were measured."""

    position: Array
    """m; (N, 3), of the body's origin, in the capture's axes"""
    quaternion: Array
    """-; (N, 4), w first, from the body's axes to the capture's"""
    covariance: Array
    """m^2, m rad, rad^2; (N, 6, 6), of position in the capture's axes and of a turn about the body's axes"""
    noise: float
    """m; standard deviation of a marker along each axis"""
    used: NDArray[np.bool_]
    """(m, N); markers that the pose was fitted to"""


def body_poses(body: MarkedBody, positions: Array) -> Poses:
    """Poses of ``body`` from ``positions`` (m, N, 3) m of its markers, NaN if not measured.

    A sample is rejected if it jumps against the frames around it, and, of at least four, the one of the largest
    residual if the frame does not fit. Of three that do not fit none can be singled out: the frame has no pose.

    Raises:
        InputError: fewer than three markers, markers in one line, shapes that differ, or too few frames with three.
    """
    _check(body, positions)
    tracks = np.where(jumps(positions)[:, :, None], np.nan, positions)
    position, quaternion, residuals = _fit(body.places, tracks)
    for _ in range(len(body.places) - LEAST_MARKERS):
        unfit, count = _unfit(residuals)
        wrong = unfit & (count > LEAST_MARKERS)
        if not wrong.any():
            break
        size = np.linalg.norm(residuals[:, wrong], axis=2)
        tracks[np.argmax(np.where(np.isfinite(size), size, -1.0), axis=0), wrong] = np.nan
        position, quaternion, residuals = _fit(body.places, tracks)
    unfit, _ = _unfit(residuals)
    position[unfit] = quaternion[unfit] = np.nan
    used = np.isfinite(residuals).all(axis=2) & ~unfit
    if int(np.isfinite(position[:, 0]).sum()) < MIN_FRAMES:
        raise InputError(f"{body.name}: fewer than {MIN_FRAMES} frames in which three of its markers agree")
    noise = _noise(residuals, used)
    return Poses(position, quaternion, _covariance(body.places, quaternion, used, noise), noise, used)


def jumps(positions: Array) -> NDArray[np.bool_]:
    """Samples of ``positions`` (m, N, 3) that jump against the frames before and after."""
    bend = np.full(positions.shape, np.nan)
    bend[:, 1:-1] = positions[:, 1:-1] - 0.5 * (positions[:, 2:] + positions[:, :-2])
    known = np.where(np.isfinite(bend), bend, 0.0)
    excess = np.where(np.isfinite(bend), bend - median_filter(known, (1, MEDIAN_FRAMES, 1)), 0.0)
    size, whole = np.linalg.norm(excess, axis=2), np.isfinite(bend).all(axis=2)
    rows = zip(size, whole, strict=True)
    scale = np.array([np.median(row[good]) if good.any() else np.inf for row, good in rows])
    far = size > np.maximum(JUMP * scale, MIN_JUMP)[:, None]
    # A wrong sample changes the second difference at the adjacent frames too, half as much.
    peak = size >= np.maximum(np.roll(size, 1, axis=1), np.roll(size, -1, axis=1))
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
        raise InputError(f"{body.name}: {len(body.places)} markers determine no attitude; three are needed")
    if np.linalg.svd(body.places - body.places.mean(axis=0), compute_uv=False)[1] < FLAT:
        raise InputError(f"{body.name}: its markers are in one line and determine no attitude")


def _fit(places: Array, tracks: Array) -> tuple[Array, Array, Array]:
    """Positions, quaternions, and residuals (m, N, 3), NaN if not used."""
    position, quaternion = fitted(places, tracks.swapaxes(0, 1))
    model = position[None] + np.einsum("nij,mj->mni", dcms_from_quaternions(quaternion), places)
    return position, quaternion, np.asarray(tracks - model)


def _unfit(residuals: Array) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Frames that fit worse than noise explains, and the number of markers of each; noise as in the median frame.

    A frame's sum of squares has a chi-square distribution with 3 m - 6 degrees of freedom.
    """
    count = np.isfinite(residuals).all(axis=2).sum(axis=0)
    freedom = np.maximum(3.0 * count - 6.0, 1.0)
    size = np.nansum(np.square(residuals), axis=(0, 2))
    known = count >= LEAST_MARKERS
    square = float(np.median(size[known] / chdtri(freedom[known], 0.5))) if known.any() else 0.0
    return known & (size > square * chdtri(freedom, FALSE_ALARM)), np.asarray(count, np.int64)


def _noise(residuals: Array, used: NDArray[np.bool_]) -> float:
    """m; of a marker along one axis: six of a frame's 3 m degrees of freedom are the pose."""
    freedom = float((3 * used.sum(axis=0) - 6)[used.any(axis=0)].sum())
    return float(np.sqrt(np.sum(np.square(residuals[used])) / freedom))


def _covariance(places: Array, quaternion: Array, used: NDArray[np.bool_], noise: float) -> Array:
    """(N, 6, 6): inverse of J^T J with J = [I, -R S(r_k')] of each marker, times the noise squared."""
    turn = -np.einsum("nij,mjk->nmik", dcms_from_quaternions(quaternion), skew(places))
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), turn.shape), turn], axis=3) * used.T[:, :, None, None]
    known = used.any(axis=0)
    out = np.full((len(quaternion), 6, 6), np.nan)
    out[known] = np.linalg.inv(np.einsum("nmij,nmik->njk", jacobian[known], jacobian[known])) * noise**2
    return out


# --- swapped names ------------------------------------------------------------------------------------------


class Swap(NamedTuple):
    """Two markers whose names are swapped."""

    one: str
    other: str
    named: float
    """m; root mean square residual of both bodies' markers as they are named"""
    swapped: float
    """m; the same with the two names swapped"""


class _Marker(NamedTuple):
    body: str
    place: int


Bodies = dict[str, Array]


def find_swap(places: Places, positions: Bodies) -> Swap | None:
    """The swap of the largest improvement, if one makes the markers fit far better.

    Args:
        places: m; of the markers.
        positions: m; (markers, N, 3) of each body, NaN if not measured.
    """
    at = {body: np.array(list(markers.values())) for body, markers in places.items()}
    tracks = {body: track[:, :: max(track.shape[1] // FRAMES, 1)] for body, track in positions.items()}
    named = {body: _misfit(at[body], tracks[body]) for body in places}
    markers = {
        name: _Marker(body, place)
        for body, group in places.items()
        for place, name in enumerate(group)
        if np.isfinite(tracks[body][place]).any()
    }
    swaps = [
        Swap(one, other, *_distances(at, tracks, named, markers[one], markers[other]))
        for one, other in combinations(markers, 2)
    ]
    improved = [each for each in swaps if each.named > max(IMPROVEMENT * each.swapped, EXACT)]
    return max(improved, key=lambda each: each.named**2 - each.swapped**2, default=None)


def _distances(
    at: Bodies, tracks: Bodies, named: dict[str, float], one: _Marker, other: _Marker
) -> tuple[float, float]:
    """m; root mean square residual of both bodies, as they are named and with the two swapped."""
    bodies = {one.body, other.body}
    changed = {body: tracks[body].copy() for body in bodies}
    changed[one.body][one.place] = tracks[other.body][other.place]
    changed[other.body][other.place] = tracks[one.body][one.place]
    count = sum(len(at[body]) for body in bodies)
    before, after = sum(named[b] for b in bodies), sum(_misfit(at[b], changed[b]) for b in bodies)
    return float(np.sqrt(before / count)), float(np.sqrt(after / count))


def _misfit(at: Array, tracks: Array) -> float:
    """m^2; sum of squares of the best rigid fit in the median frame, 0 if there is none.

    Of two markers, or of more in a line, by their distances.
    """
    there = np.isfinite(tracks).any(axis=(1, 2))
    at, tracks = at[there], tracks[there][:, np.isfinite(tracks[there]).all(axis=(0, 2))]
    if len(at) < 2 or not tracks.shape[1]:
        return 0.0
    if len(at) >= LEAST_MARKERS:
        position, quaternion = fitted(at, tracks.swapaxes(0, 1))
        if np.isfinite(position).all():
            rotated = np.einsum("nij,mj->mni", dcms_from_quaternions(quaternion), at)
            return float(np.median(np.sum((tracks - position - rotated) ** 2, axis=(0, 2))))
    pairs = np.array(list(combinations(range(len(at)), 2))).T
    measured, mapped = (np.linalg.norm(each[pairs[0]] - each[pairs[1]], axis=-1) for each in (tracks, at))
    return float(np.median(np.sum((measured - mapped[:, None]) ** 2, axis=0))) / len(at)
