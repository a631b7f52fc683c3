"""Motion of a vehicle from marker clouds: coordinates with standard errors, generalized speeds and their rates.

Coordinates are those of `coordinates` (Grauer et al. 2011, Eq. 8). In records without long gaps they are low-passed
without delay (Grauer IV.C: 50 Hz at 500 Hz) and differentiated as the cubic spline through them (Eq. 2 and the
inverse of Eq. 3 to 6). Each derivative raises the noise with the cut-off frequency: by its power 1.5 in a speed, 2.5
in an acceleration.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from logs.identification.findings import Entry, Finding, register
from logs.identification.motion_capture.coordinates import Coordinates, body_coordinates, fit_coordinates
from logs.identification.motion_capture.markers import MarkedBody, Places, Swap, find_swap
from logs.identification.results import Array, Estimate, estimate
from sim_bridge.mechanism import build_mechanism
from sim_bridge.vehicles import SimulatedVehicle, vehicle_bodies
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions
from wingbeat.text import pluralize

CUTOFF = 50.0
"""Hz; Grauer IV.C"""
ORDER = 4
LONGEST_GAP = 0.02
"""s; without coordinates, up to which a spline bridges it"""
BASE = ("north", "east", "down", "roll_axis", "pitch_axis", "yaw_axis")
"""position, and rotations about the base's axes"""
MAX_CUTOFF = 0.4
"""-; of the frame rate"""
MIN_FRAMES = 60
"""-; of a record that is differentiated"""
DISTANCE_FACTOR, DISTANCE_TOLERANCE = 1.8, 0.02
"""-; m; by which a distance between two markers of a body may differ from the map's"""
POSITION_ERROR = 0.01
"""m; largest error of a marker's position in the map; on a symmetric body it looks like swapped names"""

register({
    "marker_frames": Entry(
        "{subject}: {value} of {frames} determined, {rate:.4g} Hz", "Frames whose markers determine all coordinates."
    ),
    "markers_rejected": Entry("{percent:.1f} % of the measured samples rejected", "Jumps and outliers of markers."),
    "markers_not_measured": Entry(
        "never measured: {subject}", "The map has a marker that the record does not have.", "check its name"
    ),
    "markers_swapped": Entry(
        "{fit}: swapped, or inexact positions?", "With two names swapped the markers fit far better.",
        "swap the names of the two markers",
    ),
    "marker_speeds": Entry(
        "speeds over {seconds:.2f} s in {pieces} without a gap, low-passed at {cutoff:.3g} Hz",
        "Records whose coordinates are differentiated.",
    ),
})  # fmt: skip


class Cloud(NamedTuple):
    """Markers of one record."""

    name: str
    time: Array
    """s; (N,), equally spaced"""
    tracks: dict[str, Array]
    """m; (N, 3), NED, by the marker's name, NaN if not measured"""


class MarkerMotion(NamedTuple):
    """Motion of one record."""

    name: str
    time: Array
    """s; (N,)"""
    coordinates: Coordinates
    speeds: tuple[Speeds, ...]
    """of every piece without long gaps"""
    noise: Estimate
    """m; standard deviation of a marker along each axis"""
    cutoff: float
    """Hz; of the low-pass before the speeds, at most 0.4 of the frame rate"""
    unobserved: tuple[str, ...] = ()
    """-; markers of the map that were never measured"""
    swap: Swap | None = None
    """names that may be swapped, or positions that are inexact"""

    @property
    def known(self) -> Array:
        """-; (N,), whether the frame's coordinates are determined."""
        return np.asarray(np.isfinite(self.coordinates.position_ned[:, 0]))

    @property
    def errors(self) -> Array:
        """Standard errors (N, 6 + c): position m, turn rad in the base's axes, joint angles rad; NaN if not known."""
        return np.asarray(np.sqrt(np.diagonal(self.coordinates.covariance, axis1=1, axis2=2)))


def marker_motion(
    vehicle: SimulatedVehicle | None, places: Places, cloud: Cloud, cutoff: float = CUTOFF
) -> MarkerMotion:
    """Coordinates of ``vehicle`` and their speeds, low-passed at ``cutoff`` Hz, from the markers at ``places``.

    Without a vehicle ``places`` are those of one rigid body without joints.

    Raises:
        InputError: a body that the vehicle does not have, a base without three markers, markers that do not
            determine the coordinates, too few frames, or several bodies without a vehicle.
    """
    nowhere = np.full((len(cloud.time), 3), np.nan)
    positions = {
        body: np.stack([cloud.tracks.get(name, nowhere) for name in markers]) for body, markers in places.items()
    }
    at = {body: np.array(list(markers.values())) for body, markers in places.items()}
    try:
        swap = _check_names(places, positions)
        _check_distances(places, positions)
        coordinates = _rigid(at, positions) if vehicle is None else _jointed(vehicle, at, positions)
    except InputError as error:
        raise InputError(f"{cloud.name}: {error}") from None
    cutoff = min(cutoff, MAX_CUTOFF / float(np.mean(np.diff(cloud.time))))
    parts = _pieces(cloud.time, coordinates)
    pieces = tuple(generalized_speeds(cloud.time[part], _part(coordinates, part), cutoff) for part in parts)
    names = [name for markers in places.values() for name in markers]
    unobserved = [name for name in names if not np.isfinite(cloud.tracks.get(name, nowhere)).all(axis=1).any()]
    noise = _noise(coordinates, positions)
    return MarkerMotion(cloud.name, cloud.time, coordinates, pieces, noise, cutoff, tuple(unobserved), swap)


def _check_names(places: Places, positions: dict[str, Array]) -> Swap | None:
    """Two names that may be swapped; refused if errors of their positions are too small to explain it."""
    swap = find_swap(places, positions)
    if swap is not None and swap.named > POSITION_ERROR:
        raise InputError(f"{_swap_text(swap)}: exchange the two")
    return swap


def _swap_text(swap: Swap) -> str:
    return (
        f"the markers are {1e3 * swap.named:.3g} mm from their places, and with the names of {swap.one} and"
        f" {swap.other} exchanged {1e3 * swap.swapped:.2g} mm"
    )


def _check_distances(places: Places, positions: dict[str, Array]) -> None:
    """Refuse markers whose distances are far from those of the map: another unit, or another marker."""
    for body, markers in places.items():
        for (one, first), (other, second) in combinations(zip(markers, positions[body], strict=True), 2):
            distance = np.linalg.norm(first - second, axis=1)
            if not np.isfinite(distance).any():
                continue
            measured, mapped = float(np.nanmedian(distance)), math.dist(markers[one], markers[other])
            low, high = mapped / DISTANCE_FACTOR, mapped * DISTANCE_FACTOR
            if not low - DISTANCE_TOLERANCE < measured < high + DISTANCE_TOLERANCE:
                raise InputError(
                    f"{one} and {other} are {measured:.3g} m apart, and {mapped:.3g} m by markers.places.{body}:"
                    " is the unit another, or are names exchanged?"
                )


def _rigid(places: dict[str, Array], positions: dict[str, Array]) -> Coordinates:
    if len(places) != 1:
        raise InputError(f"{' and '.join(places)} need a vehicle with their joints")
    ((name, at),) = places.items()
    return body_coordinates(MarkedBody(name, at), positions[name])


def _jointed(vehicle: SimulatedVehicle, places: dict[str, Array], positions: dict[str, Array]) -> Coordinates:
    tree = [body.name for body in vehicle_bodies(vehicle)[1]]
    unknown = next((name for name in places if name not in tree), None)
    if unknown is not None:
        raise InputError(f"markers.places.{unknown}: {vehicle.name} has no such body; it has: {', '.join(tree)}")
    marked = {body: (tree.index(body), at) for body, at in places.items()}
    return fit_coordinates(build_mechanism(vehicle), marked, positions)


def _noise(coordinates: Coordinates, positions: dict[str, Array]) -> Estimate:
    """Noise of a marker, by the residuals of every frame's fit."""
    measured = sum(int(np.isfinite(each).all(axis=2).sum()) for each in positions.values())
    known = int(np.isfinite(coordinates.position_ned[:, 0]).sum())
    degrees = max(3.0 * measured * (1.0 - coordinates.unused) - known * (6 + len(coordinates.names)), 1.0)
    return estimate("marker_noise", "m", coordinates.noise, coordinates.noise / np.sqrt(2.0 * degrees), degrees)


def _part(coordinates: Coordinates, part: slice) -> Coordinates:
    return coordinates._replace(
        position_ned=coordinates.position_ned[part],
        quaternion=coordinates.quaternion[part],
        angles=coordinates.angles[part],
        covariance=coordinates.covariance[part],
    )


def _pieces(time: Array, coordinates: Coordinates) -> list[slice]:
    """Pieces with coordinates, with gaps that `generalized_speeds` bridges."""
    at = np.flatnonzero(np.isfinite(coordinates.position_ned[:, 0]))
    longest = LONGEST_GAP + 1.5 * float(time[1] - time[0])
    edges = np.flatnonzero(np.diff(time[at]) > longest) + 1
    parts = [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, edges) if len(run)]
    return [part for part in parts if part.stop - part.start >= MIN_FRAMES]


def findings_of(motion: MarkerMotion) -> tuple[Finding, ...]:
    """Findings of a record."""
    known, unused, count = int(motion.known.sum()), motion.coordinates.unused, len(motion.speeds)
    rate = float(1.0 / np.mean(np.diff(motion.time)))
    frames = {"frames": pluralize(len(motion.time), "frame"), "rate": rate}
    findings = [Finding("marker_frames", "info", motion.name, known, details=frames)]
    if unused > 0.0:
        findings.append(Finding("markers_rejected", "info", value=unused, details={"percent": 100.0 * unused}))
    if motion.unobserved:
        findings.append(Finding("markers_not_measured", "warning", ", ".join(motion.unobserved)))
    if motion.swap is not None:
        subject = f"{motion.swap.one}, {motion.swap.other}"
        details = {"fit": _swap_text(motion.swap)}
        findings.append(Finding("markers_swapped", "warning", subject, motion.swap.named, details=details))
    seconds = sum(float(one.time[-1] - one.time[0]) for one in motion.speeds)
    speeds = {"seconds": seconds, "pieces": pluralize(count, "record"), "cutoff": motion.cutoff}
    return (*findings, Finding("marker_speeds", "info", value=float(count), details=speeds))


# --- speeds -------------------------------------------------------------------------------------------------


class Speeds(NamedTuple):
    """Coordinates of Eq. 1, speeds of Eq. 2 and their rates at N instants, smoothed."""

    time: Array
    """s; (N,)"""
    position_ned: Array
    """m; (N, 3)"""
    quaternion: Array
    """-; (N, 4), of r_ned_from_frd"""
    angles: Array
    """rad; (N, c)"""
    speeds: Array
    """m/s, rad/s; (N, 6 + c), velocity and angular velocity of the base in its axes, rates of the angles"""
    rates: Array
    """m/s^2, rad/s^2; (N, 6 + c), time derivatives of ``speeds``"""


def generalized_speeds(time: Array, coordinates: Coordinates, cutoff: float = CUTOFF) -> Speeds:
    """Smoothed coordinates, speeds and rates at ``time`` (N,) s, equally spaced; ``cutoff`` in Hz.

    Raises:
        InputError: the record is too short for the filter or has gaps too long to bridge, or the cut-off is too high.
    """
    step = _step(time, cutoff)
    table = np.column_stack([coordinates.position_ned, coordinates.quaternion, coordinates.angles])
    smooth = low_passed(bridged(time, table), step, cutoff)
    smooth[:, 3:7] /= np.linalg.norm(smooth[:, 3:7], axis=1, keepdims=True)
    spline = CubicSpline(time, smooth)
    first, second = spline(time, 1), spline(time, 2)
    quaternion = smooth[:, 3:7]
    to_body = dcms_from_quaternions(quaternion).swapaxes(1, 2)
    omega = 2.0 * _vector(quaternion, first[:, 3:7])
    v = np.einsum("nij,nj->ni", to_body, first[:, :3])
    v_rate = np.einsum("nij,nj->ni", to_body, second[:, :3]) - np.cross(omega, v)
    omega_rate = 2.0 * _vector(quaternion, second[:, 3:7])
    speeds = np.column_stack([v, omega, first[:, 7:]])
    return Speeds(
        time, smooth[:, :3], quaternion, smooth[:, 7:], speeds, np.column_stack([v_rate, omega_rate, second[:, 7:]])
    )


def low_passed(values: Array, step: float, cutoff: float) -> Array:
    """``values`` (N, k) low-passed without delay.

    Initial states are those at which forward and backward filtering agree (Gustafsson 1996), so that the noise of the
    end samples does not remain; the straight line through the record is not filtered.
    """
    x = np.linspace(-1.0, 1.0, len(values))[:, None]
    line = values.mean(axis=0) + x * (x * values).sum(axis=0) / float(np.sum(x * x))
    below, above = butter(ORDER, cutoff, fs=1.0 / step)
    return np.asarray(line + filtfilt(below, above, values - line, axis=0, method="gust"))


def bridged(time: Array, table: Array) -> Array:
    """``table`` (N, k) with the rows that are NaN filled by a spline.

    Raises:
        InputError: a gap is longer than `LONGEST_GAP`, or at an end.
    """
    known = np.asarray(np.isfinite(table).all(axis=1))
    at = np.flatnonzero(known)
    if len(at) < 4 or not (known[0] and known[-1]):
        raise InputError("the record begins or ends without coordinates: cut it to where its markers were measured")
    longest = float(np.max(np.diff(time[at])))
    if longest > LONGEST_GAP + 1.5 * (time[1] - time[0]):
        raise InputError(f"no coordinates for {longest:.3f} s: cut the record there ({LONGEST_GAP:g} s are bridged)")
    return table if known.all() else np.where(known[:, None], table, CubicSpline(time[at], table[at])(time))


def _step(time: Array, cutoff: float) -> float:
    steps = np.diff(time)
    if len(time) < 30 or not np.all(np.isfinite(steps)) or not np.ptp(steps) < 0.01 * np.mean(steps):
        raise InputError("speeds need a record of 30 frames or more, equally spaced in time")
    step = float(np.mean(steps))
    if not 0.0 < cutoff < 0.45 / step:
        raise InputError(f"a cut-off of {cutoff:g} Hz must lie below 0.45 of the frame rate {1.0 / step:g} Hz")
    return step


def _vector(quaternion: Array, rate: Array) -> Array:
    """Vector part of the conjugate of ``quaternion`` times ``rate``, (N, 3)."""
    w, v = quaternion[:, :1], quaternion[:, 1:]
    return np.asarray(w * rate[:, 1:] - rate[:, :1] * v - np.cross(v, rate[:, 1:]))
