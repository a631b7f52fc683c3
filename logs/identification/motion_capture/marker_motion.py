"""From marker clouds to a vehicle's motion, told: coordinates with standard errors, generalized speeds (Grauer, IV).

The markers of one record give position and attitude of the base and the joint angles (`coordinates`, Eq. 8); where
they are told without long gaps, the speeds of Eq. 2 and their rates (`speeds`), and with masses and hinges of the
vehicle the wings' aerodynamic coefficients (Eq. 13 to 19).
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from logs.identification.motion_capture.coordinates import Coordinates, body_coordinates, fit_coordinates
from logs.identification.motion_capture.markers import MarkedBody, Places
from logs.identification.motion_capture.speeds import CUTOFF, LONGEST_GAP, Speeds, generalized_speeds
from logs.identification.motion_capture.swapped_markers import Exchange, exchanged
from logs.identification.results import Array, Estimate, estimate
from sim_bridge.mechanism import build_mechanism
from sim_bridge.vehicles import SimulatedVehicle, vehicle_bodies
from wingbeat.errors import InputError
from wingbeat.text import pluralize

BASE = ("north", "east", "down", "roll_axis", "pitch_axis", "yaw_axis")
"""position, and turns about the base's axes"""
HIGHEST = 0.4
"""-; of the frame rate, to which the cut-off is lowered"""
LEAST_FRAMES = 60
"""frames; of a stretch whose speeds are told"""
FAR = 1.8
"""-; by which a distance between two markers of a body may differ from the map's, with `SLACK`"""
SLACK = 0.02
"""m"""
INEXACT = 0.01
"""m; by which places are measured wrongly at most; on a body of like distances it looks like exchanged names"""


class Cloud(NamedTuple):
    """Markers of one record."""

    name: str
    time: Array
    """s; (N,), equally spaced"""
    tracks: dict[str, Array]
    """m; (N, 3), NED, by the marker's name, NaN where it was not seen"""


class MarkerMotion(NamedTuple):
    """What one record tells."""

    name: str
    time: Array
    """s; (N,)"""
    coordinates: Coordinates
    speeds: tuple[Speeds, ...]
    """of every stretch without long gaps"""
    noise: Estimate
    """m; standard deviation of a marker along each axis"""
    cutoff: float
    """Hz; of the low-pass before the speeds, at most 0.4 of the frame rate"""
    never: tuple[str, ...] = ()
    """-; markers that the map has and nobody saw"""
    doubt: Exchange | None = None
    """names that seem exchanged, by no more than an inexact place might"""

    @property
    def told(self) -> Array:
        """-; (N,), whether the frame's coordinates are known."""
        return np.asarray(np.isfinite(self.coordinates.position_ned[:, 0]))

    @property
    def errors(self) -> Array:
        """Standard errors (N, 6 + c): position m, turn rad in the base's axes, joint angles rad; NaN if not told."""
        return np.asarray(np.sqrt(np.diagonal(self.coordinates.covariance, axis1=1, axis2=2)))


def marker_motion(
    vehicle: SimulatedVehicle | None, places: Places, cloud: Cloud, cutoff: float = CUTOFF
) -> MarkerMotion:
    """Coordinates of ``vehicle`` and their speeds, low-passed at ``cutoff`` Hz, from the markers at ``places``.

    Without a vehicle ``places`` are those of one rigid body without joints.

    Raises:
        InputError: a body that the vehicle does not have, a base without three markers, markers that do not tell the
            coordinates, too few frames, or no vehicle to tell how several bodies hang together.
    """
    nowhere = np.full((len(cloud.time), 3), np.nan)
    positions = {
        body: np.stack([cloud.tracks.get(name, nowhere) for name in markers]) for body, markers in places.items()
    }
    at = {body: np.array(list(markers.values())) for body, markers in places.items()}
    try:
        doubt = _check_names(places, positions)
        _check_distances(places, positions)
        found = _rigid(at, positions) if vehicle is None else _jointed(vehicle, at, positions)
    except InputError as error:
        raise InputError(f"{cloud.name}: {error}") from None
    used = min(cutoff, HIGHEST / float(np.mean(np.diff(cloud.time))))
    stretches = _stretches(cloud.time, found)
    pieces = tuple(generalized_speeds(cloud.time[part], _part(found, part), used) for part in stretches)
    names = [name for markers in places.values() for name in markers]
    never = [name for name in names if not np.isfinite(cloud.tracks.get(name, nowhere)).all(axis=1).any()]
    return MarkerMotion(cloud.name, cloud.time, found, pieces, _noise(found, positions), used, tuple(never), doubt)


def _check_names(places: Places, positions: dict[str, Array]) -> Exchange | None:
    """Two names that seem exchanged; refused where no place was measured so badly."""
    found = exchanged(places, positions)
    if found is not None and found.named > INEXACT:
        raise InputError(f"{_fit_of(found)}: exchange the two")
    return found


def _fit_of(found: Exchange) -> str:
    return (
        f"the markers are {1e3 * found.named:.3g} mm from their places, and with the names of {found.one} and"
        f" {found.other} exchanged {1e3 * found.exchanged:.2g} mm"
    )


def _check_distances(places: Places, positions: dict[str, Array]) -> None:
    """Refuse markers whose distances are nowhere near those of the map: another unit, or another marker."""
    for body, markers in places.items():
        for (one, first), (other, second) in combinations(zip(markers, positions[body], strict=True), 2):
            apart = np.linalg.norm(first - second, axis=1)
            if not np.isfinite(apart).any():
                continue
            seen, mapped = float(np.nanmedian(apart)), math.dist(markers[one], markers[other])
            if not mapped / FAR - SLACK < seen < mapped * FAR + SLACK:
                raise InputError(
                    f"{one} and {other} are {seen:.3g} m apart, and {mapped:.3g} m by markers.places.{body}:"
                    " is the unit another, or are names exchanged?"
                )


def _rigid(places: dict[str, Array], positions: dict[str, Array]) -> Coordinates:
    if len(places) != 1:
        raise InputError(f"{' and '.join(places)} need a vehicle that tells how they hang together")
    ((name, at),) = places.items()
    return body_coordinates(MarkedBody(name, at), positions[name])


def _jointed(vehicle: SimulatedVehicle, places: dict[str, Array], positions: dict[str, Array]) -> Coordinates:
    tree = [body.name for body in vehicle_bodies(vehicle)[1]]
    unknown = next((name for name in places if name not in tree), None)
    if unknown is not None:
        raise InputError(f"markers.places.{unknown}: {vehicle.name} has no such body; it has: {', '.join(tree)}")
    marked = {body: (tree.index(body), at) for body, at in places.items()}
    return fit_coordinates(build_mechanism(vehicle), marked, positions)


def _noise(found: Coordinates, positions: dict[str, Array]) -> Estimate:
    """Of a marker; every frame's coordinates are fitted to what was seen in it."""
    seen = sum(int(np.isfinite(each).all(axis=2).sum()) for each in positions.values())
    told = int(np.isfinite(found.position_ned[:, 0]).sum())
    degrees = max(3.0 * seen * (1.0 - found.unused) - told * (6 + len(found.names)), 1.0)
    return estimate("marker_noise", "m", found.noise, found.noise / np.sqrt(2.0 * degrees), degrees)


def _part(found: Coordinates, part: slice) -> Coordinates:
    return found._replace(
        position_ned=found.position_ned[part],
        quaternion=found.quaternion[part],
        angles=found.angles[part],
        covariance=found.covariance[part],
    )


def _stretches(time: Array, found: Coordinates) -> list[slice]:
    """Where coordinates are told, gaps as long as `generalized_speeds` bridges them among them."""
    at = np.flatnonzero(np.isfinite(found.position_ned[:, 0]))
    longest = LONGEST_GAP + 1.5 * float(time[1] - time[0])
    edges = np.flatnonzero(np.diff(time[at]) > longest) + 1
    parts = [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, edges) if len(run)]
    return [part for part in parts if part.stop - part.start >= LEAST_FRAMES]


def said(motion: MarkerMotion) -> tuple[str, ...]:
    """What is to be said of a record beside its numbers, one clause each."""
    told, frames = int(motion.told.sum()), len(motion.time)
    unused = motion.coordinates.unused
    lines = [
        f"{motion.name}: {told} of {pluralize(frames, 'frame')} told, {1.0 / np.mean(np.diff(motion.time)):.4g} Hz"
    ]
    lines += [f"{100.0 * unused:.1f} % of the samples seen were left out as wrong"] if unused > 0.0 else []
    lines += [f"never seen: {', '.join(motion.never)}"] if motion.never else []
    lines += [f"{_fit_of(motion.doubt)}: exchanged, or inexact places?"] if motion.doubt is not None else []
    seconds = sum(float(one.time[-1] - one.time[0]) for one in motion.speeds)
    pieces = f"{pluralize(len(motion.speeds), 'record')} without a gap"
    lines.append(f"speeds over {seconds:.2f} s in {pieces}, low-passed at {motion.cutoff:.3g} Hz")
    return tuple(lines)
