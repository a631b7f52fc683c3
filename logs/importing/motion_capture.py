"""Motion capture as tables: OptiTrack's Motive (CSV export) and Vicon's Nexus (segments and trajectories).

Both laboratories' axes become NED and both bodies' axes FRD in the same way, the first axis being north and forward:
Motive's y and Nexus's z point up. So a body must have been created with its nose along the first axis. Where there
are markers alone the body is found among them, its nose along the first axis in the first frame that has them all.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics as t
from logs.importing.counterparts import Columns, checked
from logs.importing.rigid_body import find_rigid_body
from logs.importing.source import Dropped, ImportedTopic, Series, Source
from logs.importing.units import conversion
from wingbeat.errors import InputError

Array = NDArray[np.float64]
MOTIVE = "Format Version"
"""first cell of a Motive export"""
NEXUS = ("Segments", "Trajectories", "Model Outputs", "Joints", "Devices")
"""first cells of the sections of a Nexus export"""
_LENGTHS = {"Meters": "m", "Centimeters": "cm", "Millimeters": "mm"}
"""length units of Motive"""
NED_FROM_MOTIVE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_MARKER_AXES = {"X": "m", "Y": "m", "Z": "m"}
_BODY_AXES = {"RX": "rad", "RY": "rad", "RZ": "rad", "TX": "m", "TY": "m", "TZ": "m"}
"""body columns of Nexus, with the conversion of their units"""
NED_FROM_NEXUS = np.diag([1.0, -1.0, -1.0])


class Track(NamedTuple):
    """One rigid body or marker."""

    name: str
    time: Array
    """s; (N,), times of the frames"""
    position: Array
    """m; (N, 3), NED, NaN if not tracked"""
    quaternion: Array | None = None
    """-; (N, 4), w first, of r_ned_from_frd; None for a marker"""


Rows = Sequence[Sequence[str]]


def is_motion_capture(head: bytes) -> bool:
    """Return whether a file with this start is a Motive or Nexus export."""
    first = head[:64].decode("utf-8-sig", "replace").splitlines() or [""]
    cell = first[0].split(",")[0].strip().strip('"')
    return cell == MOTIVE or cell in NEXUS


def read_motion_capture(data: bytes) -> Source:
    """Read an export; the first body becomes attitude, position and altitude.

    Raises:
        InputError: an incomplete export, or nothing was tracked.
    """
    try:
        rows = list(csv.reader(io.StringIO(data.decode("utf-8-sig"))))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"it cannot be read as a table: {error}") from None
    motive = bool(rows and rows[0]) and rows[0][0].strip() == MOTIVE
    tracks = motive_tracks(rows) if motive else nexus_tracks(rows)
    return source_of(tracks, "OptiTrack Motive" if motive else "Vicon Nexus")


def source_of(tracks: Sequence[Track], system: str, damage: tuple[str, ...] = ()) -> Source:
    """Build the source from all tracked bodies and markers of a capture.

    Raises:
        InputError: there is none.
    """
    names = unique_names([track.name for track in tracks])
    tracks = [track._replace(name=name) for track, name in zip(tracks, names, strict=True) if _tracked(track).any()]
    if not tracks:
        raise InputError("no body and no marker was seen in it")
    notes = {"system": system}
    bodies = [track for track in tracks if track.quaternion is not None]
    if not bodies and (found := _body_of_markers(tracks)) is not None:
        body, markers = found
        tracks, bodies = [*tracks, body], [body]
        notes["body"] = f"found among the markers: {', '.join(markers)}"
    dropped = [Dropped(f"/mocap/{one.name}", "not seen", int((~_tracked(one)).sum())) for one in tracks]
    return Source(
        "motion capture",
        {track.name: _series(track) for track in tracks},
        bodies[0].name if bodies else "",
        notes=notes,
        damage=damage,
        dropped=tuple(one for one in dropped if one.rows),
        made=_topics_of(bodies[0]) if bodies else (),
        clock="since the first frame of the capture",
    )


def _body_of_markers(tracks: Sequence[Track]) -> tuple[Track, list[str]] | None:
    """Return the rigid body among markers visible in the same frames, and the owner of these markers."""
    time = tracks[0].time
    if any(len(track.time) != len(time) or not np.array_equal(track.time, time) for track in tracks):
        return None
    found = find_rigid_body(np.stack([track.position for track in tracks]))
    if found is None:
        return None
    taken = {track.name for track in tracks}
    name = next(name for name in ("body", *(f"body_{n}" for n in range(2, len(tracks) + 3))) if name not in taken)
    return Track(name, time, found.position, found.quaternion), [tracks[marker].name for marker in found.markers]


def _tracked(track: Track) -> NDArray[np.bool_]:
    whole = np.isfinite(track.position).all(axis=1)
    return np.asarray(whole if track.quaternion is None else whole & np.isfinite(track.quaternion).all(axis=1), bool)


# --- what the two systems write -----------------------------------------------------------------------------


def motive_tracks(rows: Rows) -> list[Track]:
    """Read bodies and markers of a Motive export.

    Raises:
        InputError: an incomplete header, or rotations that are not quaternions.
    """
    head = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    at = next((n for n, row in enumerate(rows) if row and row[0].strip() == "Frame"), None)
    if at is None or at < 4:
        raise InputError("no line of column names (Frame, Time) after the header")
    unit = head.get("Length Units", "Meters").strip()
    if unit not in _LENGTHS:
        raise InputError(f"its Length Units are {unit!r}; known: {', '.join(_LENGTHS)}")
    metre = conversion(_LENGTHS[unit])
    if "Quaternion" not in head.get("Rotation Type", "Quaternion"):
        raise InputError("its rotations are not quaternions: export it with Rotation Type Quaternion")
    names = next((row for row in rows[1:at] if len(row) > 1 and row[1].strip() == "Name"), [])
    kinds, axes = rows[at - 1], rows[at]
    table = _numbers(rows[at + 1 :], len(axes))
    groups: dict[str, dict[str, int]] = {}
    for place in range(2, min(len(axes), len(names), len(kinds))):
        groups.setdefault(names[place].strip(), {})[f"{kinds[place].strip()} {axes[place].strip()}"] = place
    found = (_motive_track(name, places, table, metre.factor) for name, places in groups.items())
    return [track for track in found if track is not None]


def _motive_track(name: str, places: Mapping[str, int], table: Array, metre: float) -> Track | None:
    spots = [places[key] for key in ("Position X", "Position Y", "Position Z") if key in places]
    turns = [places[key] for key in ("Rotation W", "Rotation X", "Rotation Y", "Rotation Z") if key in places]
    if not name or len(spots) < 3:
        return None
    position = table[:, spots] @ NED_FROM_MOTIVE.T * metre
    quaternion = None if len(turns) < 4 else turned(table[:, turns], NED_FROM_MOTIVE)
    return Track(plain_name(name), table[:, 1], position, quaternion)


def nexus_tracks(rows: Rows) -> list[Track]:
    """Read bodies of the section ``Segments`` and markers of ``Trajectories`` of a Nexus export."""
    tracks: list[Track] = []
    behind = 0
    for at, row in enumerate(rows):
        kind = row[0].strip() if row and at >= behind else ""
        if kind in ("Segments", "Trajectories") and len(rows) > at + 5:
            end = next((n for n in range(at + 5, len(rows)) if not any(cell.strip() for cell in rows[n])), len(rows))
            behind = end
            tracks += _nexus_part(rows[at + 1 : end], kind == "Segments")
    return tracks


def _nexus_part(rows: Rows, bodies: bool) -> list[Track]:
    """A part from the line with its rate on: rate, names, axes, units, then the frames."""
    try:
        rate = float(rows[0][0])
    except (ValueError, IndexError):
        raise InputError("the rate of a part (Hz, below its name) is missing") from None
    if not 1.0 <= rate <= 10_000.0:
        raise InputError(f"a rate of {rate:g} Hz cannot be")
    names, axes, units = rows[1], rows[2], rows[3]
    table = _numbers(rows[4:], len(axes))
    frames = table[:, 0]
    time = (frames - frames[np.isfinite(frames)][:1].sum()) / rate
    expected = _BODY_AXES if bodies else _MARKER_AXES
    tracks = []
    for place, name in enumerate(names):
        wanted = tuple(axis.strip() for axis in axes[place : place + len(expected)])
        if not name.strip() or wanted != tuple(expected):
            continue
        scales = [_scale(name, axis, units[place + n : place + n + 1]) for n, axis in enumerate(wanted)]
        values = table[:, place : place + len(wanted)] * scales
        position, quaternion = values[:, -3:] @ NED_FROM_NEXUS.T, None
        if bodies:
            quaternion = turned(of_rotation_vector(values[:, :3]), NED_FROM_NEXUS)
        tracks.append(Track(plain_name(name), time, position, quaternion))
    return tracks


def _scale(name: str, axis: str, unit_text: Sequence[str]) -> float:
    """Return the factor of a column to SI; ``unit_text`` is its unit, empty if the line is short."""
    unit = "".join(unit_text).strip().replace("°", "deg")
    known, expected = conversion(unit), (_BODY_AXES | _MARKER_AXES)[axis]
    if known.unit != expected:
        raise InputError(f"{axis} of {name.strip()} is in {unit!r}, where a unit of {expected} must be")
    return known.factor


def plain_name(name: str) -> str:
    """Convert a body or marker name to a part of a topic name."""
    return name.strip().removeprefix("Global Angle ").replace(":", "_").replace(" ", "_")


def unique_names(names: Sequence[str]) -> list[str]:
    """Return the names, with ``_2``, ``_3`` at repeated ones."""
    unique: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in itertools.count(2))
        unique.append(name if name not in unique else next(one for one in numbered if one not in unique))
    return unique


def _numbers(rows: Rows, width: int) -> Array:
    """A table of numbers, NaN where a cell is empty; rows without a frame's number are left out."""
    body = [[*row, *[""] * (width - len(row))][:width] for row in rows if row and row[0].strip()]
    if not body:
        raise InputError("there is no frame in it")
    return np.array([[_number(cell) for cell in row] for row in body])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


# --- rotations ------------------------------------------------------------------------------------------------


def turned(quaternion: Array, axes: Array) -> Array:
    """Transform rotations (N, 4), w first, with the proper rotation ``axes`` of both frames; of unit length."""
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    unit = quaternion / np.where(length > 0.5, length, np.nan)
    return np.concatenate([unit[:, :1], unit[:, 1:] @ axes.T], axis=1)


def of_rotation_vector(vector: Array) -> Array:
    """Convert rotation vectors in rad (N, 3) to quaternions (N, 4)."""
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    return np.concatenate([np.cos(0.5 * angle), 0.5 * np.sinc(0.5 * angle / np.pi) * vector], axis=1)


def body_rates(time: Array, quaternion: Array) -> Array:
    """Compute body rates in rad/s, (N, 3), by central differences; NaN at the ends and beside gaps."""
    rates = np.full((len(time), 3), np.nan)
    if len(time) > 2:
        before, behind = quaternion[:-2], quaternion[2:]
        w = (before * behind).sum(axis=1, keepdims=True)
        v = before[:, :1] * behind[:, 1:] - behind[:, :1] * before[:, 1:] - np.cross(before[:, 1:], behind[:, 1:])
        size = np.linalg.norm(v, axis=1, keepdims=True)
        angle = 2.0 * np.arctan2(size, np.abs(w)) * np.sign(np.where(w == 0.0, 1.0, w))
        span = (time[2:] - time[:-2])[:, None]
        rates[1:-1] = angle * v / np.maximum(size, 1e-12) / np.where(span > 0.0, span, np.nan)
    return rates


def _velocity(track: Track) -> Array:
    if len(track.time) < 3:
        return np.full_like(track.position, np.nan)
    return np.asarray(np.gradient(track.position, track.time, axis=0), float)


# --- topics -----------------------------------------------------------------------------------------------------


def _series(track: Track) -> Series:
    columns: Columns = dict(zip(("north", "east", "down"), track.position.T, strict=True))
    units = dict.fromkeys(columns, "m")
    if track.quaternion is not None:
        columns |= dict(zip([f"quaternion_{axis}" for axis in "wxyz"], track.quaternion.T, strict=True))
    return Series(track.name, _stamps(track), columns, units).taken(_tracked(track))


def _stamps(track: Track) -> NDArray[np.int64]:
    """Return the times in us; a frame without a time gets one out of range, so that it is dropped."""
    return np.nan_to_num(np.rint(track.time * 1e6), nan=-1.0).clip(-1, 2**62).astype(np.int64)


def _topics_of(track: Track) -> tuple[ImportedTopic, ...]:
    """Attitude, position and altitude of a body, at the frames in which it was seen."""
    tracked = _tracked(track) & (_stamps(track) >= 0)
    track = track._replace(time=track.time[tracked], position=track.position[tracked])
    assert track.quaternion is not None
    quaternion = track.quaternion[tracked]
    rates, velocity = body_rates(track.time, quaternion), _velocity(track)
    series = Series(track.name, _stamps(track), {}, {})
    names = [f"quaternion_{axis}" for axis in "wxyz"]
    attitude = dict(zip([*names, "roll_rate", "pitch_rate", "yaw_rate"], [*quaternion.T, *rates.T], strict=True))
    position = {"north": track.position[:, 0], "east": track.position[:, 1]}
    position |= {"v_north": velocity[:, 0], "v_east": velocity[:, 1]}
    altitude = {"altitude": -track.position[:, 2], "climb_rate": -velocity[:, 2]}
    made = ((t.ATTITUDE, attitude), (t.POSITION, position), (t.ALTITUDE, altitude))
    return tuple(checked(topic, series, columns)._replace(source=f"body {track.name}") for topic, columns in made)
