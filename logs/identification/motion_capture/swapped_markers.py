"""Markers whose names are exchanged: with one pair's names changed, the bodies fit the capture far better.

No bound on distances tells them: exchanged, those of a small body differ by a few centimetres or not at all (left
and right of a plane in which the others lie: only a mirror makes that body). What tells is how far the markers are
from the rigid body that fits them best (Kabsch, `logs.importing.rigid_body`), as they are named and with two names
exchanged: noise, and places that were measured inexactly, are in both.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from logs.identification.motion_capture.markers import Places
from logs.identification.results import Array
from logs.importing.rigid_body import LEAST_MARKERS, fitted
from wingbeat.rotation_arrays import dcms_from_quaternions

FRAMES = 100
"""-; of a record, equally far apart, that the fits are compared in"""
BETTER = 3.0
"""-; times nearer to their places (root mean square) are the markers of both bodies with the right names"""
EXACT = 1e-5
"""m; nearer than this nothing is to be mended"""


class Exchange(NamedTuple):
    """Two names that should change places."""

    one: str
    other: str
    named: float
    """m; root mean square distance of the markers of their bodies from where they should be, as they are named"""
    exchanged: float
    """m; the same with the two exchanged"""


class _Marker(NamedTuple):
    body: str
    place: int


Bodies = dict[str, Array]


def exchanged(places: Places, positions: Bodies) -> Exchange | None:
    """The exchange that mends most, if one makes the markers fit far better.

    Args:
        places: m; of the markers.
        positions: m; (markers, N, 3) of each body, NaN where one was not seen.
    """
    at = {body: np.array(list(markers.values())) for body, markers in places.items()}
    seen = {body: tracks[:, :: max(tracks.shape[1] // FRAMES, 1)] for body, tracks in positions.items()}
    named = {body: _misfit(at[body], seen[body]) for body in places}
    markers = {
        name: _Marker(body, place)
        for body, group in places.items()
        for place, name in enumerate(group)
        if np.isfinite(seen[body][place]).any()
    }
    found = [
        Exchange(one, other, *_distances(at, seen, named, markers[one], markers[other]))
        for one, other in combinations(markers, 2)
    ]
    told = [each for each in found if each.named > max(BETTER * each.exchanged, EXACT)]
    return max(told, key=lambda each: each.named**2 - each.exchanged**2, default=None)


def _distances(
    at: Bodies, seen: Bodies, named: dict[str, float], one: _Marker, other: _Marker
) -> tuple[float, float]:
    """m; of the markers of both bodies from their places, as they are named and with the two exchanged."""
    bodies = {one.body, other.body}
    changed = {body: seen[body].copy() for body in bodies}
    changed[one.body][one.place] = seen[other.body][other.place]
    changed[other.body][other.place] = seen[one.body][one.place]
    count = sum(len(at[body]) for body in bodies)
    before, after = sum(named[b] for b in bodies), sum(_misfit(at[b], changed[b]) for b in bodies)
    return float(np.sqrt(before / count)), float(np.sqrt(after / count))


def _misfit(at: Array, seen: Array) -> float:
    """m^2; sum of squares from the best rigid fit in the middle one of all frames, 0 where nothing tells it.

    Of two markers, or of more in a line, the distances tell it: of two each is off by half of what theirs is.
    """
    there = np.isfinite(seen).any(axis=(1, 2))
    at, seen = at[there], seen[there][:, np.isfinite(seen[there]).all(axis=(0, 2))]
    if len(at) < 2 or not seen.shape[1]:
        return 0.0
    if len(at) >= LEAST_MARKERS:
        position, quaternion = fitted(at, seen.swapaxes(0, 1))
        if np.isfinite(position).all():
            turned = np.einsum("nij,mj->mni", dcms_from_quaternions(quaternion), at)
            return float(np.median(np.sum((seen - position - turned) ** 2, axis=(0, 2))))
    pairs = np.array(list(combinations(range(len(at)), 2))).T
    apart, mapped = (np.linalg.norm(each[pairs[0]] - each[pairs[1]], axis=-1) for each in (seen, at))
    return float(np.median(np.sum((apart - mapped[:, None]) ** 2, axis=0))) / len(at)
