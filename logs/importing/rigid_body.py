"""The rigid body among markers and its attitude."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEAST_MARKERS = 3
MOST_MARKERS = 100
"""-; number of the most visible markers that are searched: all pairs of them are compared"""
LEAST_FRAMES = 10
"""frames; least common visibility of a pair of markers"""
RIGID = 0.005
"""m, and fraction of their distance (-): a pair whose distance varies less (5th to 95th percentile) is rigid"""
FLAT = 0.02
"""m; markers closer to a line than this (root mean square) determine no attitude"""


class RigidBody(NamedTuple):
    """Rigid body in a capture."""

    markers: tuple[int, ...]
    """indices of its markers"""
    position: Array
    """m; (N, 3), center of its markers, NaN if fewer than three of them are visible"""
    quaternion: Array
    """-; (N, 4), w first, of the rotation from body axes, which are those of the capture in the first complete frame
    """


def find_rigid_body(positions: Array) -> RigidBody | None:
    """Find the largest rigid body among markers; None without three markers that are not collinear.

    Args:
        positions: (markers, N, 3) m; NaN if a marker is not visible.
    """
    most_seen = np.argsort(-np.isfinite(positions).all(axis=2).sum(axis=1), kind="stable")[:MOST_MARKERS]
    looked_at = np.sort(most_seen)
    members = tuple(looked_at[list(_largest_group(_rigid_pairs(positions[looked_at])))].tolist())
    seen = np.isfinite(positions[list(members)]).all(axis=2)
    if len(members) < LEAST_MARKERS or not seen.all(axis=0).any():
        return None
    chosen = positions[list(members)].swapaxes(0, 1)
    shape = chosen[int(np.argmax(seen.all(axis=0)))]
    shape = shape - shape.mean(axis=0)
    if np.linalg.svd(shape, compute_uv=False)[1] < FLAT * np.sqrt(len(members)):
        return None
    return RigidBody(members, *fitted(shape, chosen))


def _rigid_pairs(positions: Array) -> NDArray[np.bool_]:
    """Which markers keep their distance, (markers, markers)."""
    count = len(positions)
    pairs = np.zeros((count, count), bool)
    for i in range(count):
        for j in range(i):
            distance = np.linalg.norm(positions[i] - positions[j], axis=1)
            distance = distance[np.isfinite(distance)]
            if len(distance) >= LEAST_FRAMES:
                low, middle, high = np.percentile(distance, (5.0, 50.0, 95.0))
                pairs[i, j] = pairs[j, i] = high - low <= max(RIGID, RIGID * middle)
    return pairs


def _largest_group(pairs: NDArray[np.bool_]) -> tuple[int, ...]:
    """Return the largest set of markers with constant mutual distances, grown from each marker in turn."""
    best: list[int] = []
    for first in range(len(pairs)):
        group = [first]
        # Markers with many constant distances first: two bodies may share a marker at their joint.
        for other in sorted(np.flatnonzero(pairs[first]), key=lambda marker: -int(pairs[marker].sum())):
            if all(pairs[other, member] for member in group):
                group.append(int(other))
        best = max(best, group, key=len)
    return tuple(sorted(best))


def fitted(shape: Array, frames: Array) -> tuple[Array, Array]:
    """Fit position and quaternion of ``shape`` (markers, 3) to every frame of ``frames`` (N, markers, 3).

    Least squares over the visible markers: Kabsch (1976), doi:10.1107/S0567739476001873.
    """
    seen = np.asarray(np.isfinite(frames).all(axis=2))
    weight = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1)
    there = np.where(seen[:, :, None], frames, 0.0)
    middle, own_middle = np.einsum("nm,nmi->ni", weight, there), weight @ shape
    product = np.einsum("nm,nmi,nmj->nij", weight, there - middle[:, None], shape[None] - own_middle[:, None])
    u, sizes, vt = np.linalg.svd(product)
    proper: Array = np.where(np.linalg.det(u @ vt) < 0.0, -1.0, 1.0)
    u[:, :, 2] *= proper[:, None]
    rotation = u @ vt
    position = middle - np.einsum("nij,nj->ni", rotation, own_middle)
    known = (seen.sum(axis=1) >= LEAST_MARKERS) & (sizes[:, 1] > FLAT**2)
    position[~known] = np.nan
    quaternion = np.full((len(frames), 4), np.nan)
    # Signs are continuous from the last visible frame; frames without an attitude are skipped.
    quaternion[known] = quaternions(rotation[known])
    return position, quaternion


def quaternions(rotation: Array) -> Array:
    """Convert rotation matrices (N, 3, 3) to quaternions (N, 4), w first, with continuous sign."""
    # 4 q q^T, of which the row with the greatest diagonal is the best conditioned (Shepperd 1978).
    xx, yy, zz = rotation[:, 0, 0], rotation[:, 1, 1], rotation[:, 2, 2]
    wx, wy, wz = (rotation[:, i, j] - rotation[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    xy, xz, yz = (rotation[:, i, j] + rotation[:, j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    table = np.stack(
        [
            np.stack([1.0 + xx + yy + zz, wx, wy, wz], axis=1),
            np.stack([wx, 1.0 + xx - yy - zz, xy, xz], axis=1),
            np.stack([wy, xy, 1.0 - xx + yy - zz, yz], axis=1),
            np.stack([wz, xz, yz, 1.0 - xx - yy + zz], axis=1),
        ],
        axis=1,
    )
    best = np.argmax(np.diagonal(table, axis1=1, axis2=2), axis=1)
    row = table[np.arange(len(table)), best]
    unit = row / np.linalg.norm(row, axis=1, keepdims=True)
    turns = np.where((unit[1:] * unit[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(unit * np.concatenate([[1.0], np.cumprod(turns)])[:, None], float)
