"""[markers] of a map: positions of markers on a vehicle, for the log of a capture or a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.wing_coefficients import AeroResult, identify_coefficients
from logs.identification.models.inverse_dynamics import LOW_PASS, WingMotion, coefficients, moved_by_speeds
from logs.identification.motion_capture.markers import Places
from logs.identification.motion_capture.motion import CUTOFF, Cloud, MarkerMotion, marker_motion
from logs.identification.results import Array
from logs.identification.sources.table.columns import Layout, read_columns
from logs.identification.sources.table.signals import SignalEntry, TimeSection, records_of
from logs.reader import Log
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError
from wingbeat.schema import read_document, read_record

TOPIC = "/mocap/"
FIELDS = ("north", "east", "down")
SLIP = 0.1
"""-; of a frame, by which a time stamp may differ from the even time base"""
NED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
Row = tuple[float, float, float]


class MarkersSection(NamedTuple):
    """Section [markers]."""

    places: dict[str, dict[str, Row]]
    """m; by body and marker"""
    vehicle: str | None = None
    axes: tuple[Row, Row, Row] = NED
    """-; rows: north, east, down in a table's axes"""
    cutoff: float = CUTOFF
    """Hz"""
    aero: bool = False
    wind: Row = (0.0, 0.0, 0.0)
    """m/s; NED"""
    density: float = 1.225
    """kg/m^3"""

    def names(self) -> list[str]:
        """Markers of all bodies."""
        return [name for markers in self.places.values() for name in markers]


class MarkersMap(NamedTuple):
    """A map; all sections but [markers] are of tables."""

    markers: MarkersSection
    signals: dict[str, SignalEntry] = {}
    time: TimeSection = TimeSection()
    table: Layout = Layout()


class MarkersResult(NamedTuple):
    """Motion of a vehicle by markers."""

    vehicle: str
    """-; its name, or that of a single rigid body"""
    motions: tuple[MarkerMotion, ...]
    """one per record"""
    notes: tuple[str, ...] = ()


def load_markers_map(path: Path) -> MarkersMap:
    """A map with a section [markers].

    Raises:
        InputError: it cannot be read, or a key of it is wrong; the text names the key.
    """
    document = read_document(path, "map")
    try:
        found: MarkersMap = read_record(MarkersMap, document, "")
        _check(found.markers)
    except InputError as error:
        raise InputError(f"map {path}: {error}") from None
    return found


def _check(section: MarkersSection) -> None:
    names, axes = section.names(), np.array(section.axes)
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise InputError(f"markers.places: {twice} is on two bodies")
    if not np.allclose(axes @ axes.T, np.eye(3), atol=1e-3) or np.linalg.det(axes) < 0.0:
        raise InputError("markers.axes must be a rotation: rows of unit length at right angles, right-handed")
    if not section.density > 0.0:
        raise InputError("markers.density must be above 0")
    if not section.cutoff > 0.0:
        raise InputError("markers.cutoff must be above 0")


def cloud_of_log(log: Log, section: MarkersSection) -> Cloud:
    """The markers under /mocap/ of a log that `wingbeat log import` made.

    Raises:
        InputError: none of the map's markers is there, or their frames are not of one rate.
    """
    there = [name for name in section.names() if TOPIC + name in log.topics]
    if not there:
        recorded = ", ".join(name.removeprefix(TOPIC) for name in log.topics if name.startswith(TOPIC))
        raise InputError(f"{log.path} has none of the map's markers under {TOPIC}; it has: {recorded or 'none'}")
    columns = {name: log.columns(TOPIC + name) for name in there}
    stamps = np.unique(np.concatenate([np.asarray(one.time, float) for one in columns.values()]))
    if len(stamps) < 2:
        raise InputError(f"{log.path}: its markers were measured in a single frame")
    step = float(np.median(np.diff(stamps)))
    time = stamps[0] + step * np.arange(round(float(stamps[-1] - stamps[0]) / step) + 1)
    tracks = {}
    for name, one in columns.items():
        at = (np.asarray(one.time, float) - stamps[0]) / step
        if np.max(np.abs(at - np.rint(at))) > SLIP + 1e-6 * len(time):
            raise InputError(f"{log.path}: {TOPIC}{name} has frames between those of {1.0 / step:.4g} Hz")
        tracks[name] = np.full((len(time), 3), np.nan)
        tracks[name][np.rint(at).astype(int)] = np.column_stack([np.asarray(one[field], float) for field in FIELDS])
    return Cloud(log.path.name, time, tracks)


def clouds_of_tables(paths: Sequence[Path], chosen: MarkersMap) -> tuple[tuple[Cloud, ...], tuple[str, ...]]:
    """The markers of tables, a cloud for every record, and notes on their time base.

    Raises:
        InputError: a marker has no three signals NAME_x, NAME_y, NAME_z in m, or a table cannot be read.
    """
    if not chosen.signals:
        raise InputError("the map has no [signals] that say which columns of the table are the markers'")
    chosen.time.check()
    section, notes, clouds = chosen.markers, [], []
    there = [name for name in section.names() if any(f"{name}_{axis}" in chosen.signals for axis in "xyz")]
    for name in [f"{marker}_{axis}" for marker in there for axis in "xyz"]:
        if name not in chosen.signals or chosen.signals[name].unit != "m":
            raise InputError(f"signals.{name} must be there, in a unit of length")
    if not there:
        raise InputError("no marker of markers.places has signals NAME_x, NAME_y and NAME_z")
    for path in paths:
        records, record_notes = records_of(read_columns(path, chosen.table), chosen.signals, chosen.time, None)
        notes += [one.text for one in record_notes]
        for number, record in enumerate(records, 1):
            name = record.file if len(records) == 1 else f"record {number} of {record.file}"
            clouds.append(Cloud(name, record.time, {one: _track(record.signals, one, section) for one in there}))
    return tuple(clouds), tuple(notes)


def _track(signals: dict[str, Array], name: str, section: MarkersSection) -> Array:
    track = np.column_stack([signals[f"{name}_{axis}"] for axis in "xyz"])
    track[~np.isfinite(track).all(axis=1)] = np.nan
    return np.asarray(track @ np.array(section.axes).T)


def identify_markers(
    vehicle: SimulatedVehicle | None, section: MarkersSection, clouds: Sequence[Cloud], notes: tuple[str, ...] = ()
) -> MarkersResult:
    """Coordinates and speeds of every record; without a vehicle of the one rigid body that has markers.

    Raises:
        InputError: as of `marker_motion`.
    """
    places: Places = section.places
    name = vehicle.name if vehicle is not None else next(iter(places))
    return MarkersResult(
        name, tuple(marker_motion(vehicle, places, cloud, section.cutoff) for cloud in clouds), notes
    )


def wings_by_markers(vehicle: SimulatedVehicle, section: MarkersSection, result: MarkersResult) -> AeroResult:
    """The wings' coefficients (Grauer Eq. 13 to 19) by the motion of the markers.

    Raises:
        InputError: no record of the speeds is long enough, or the wings do not move through the air.
    """
    notes: tuple[str, ...] = ("motion: by markers",)
    if vehicle.wing.twists:
        notes += ("twist of the wings: not measured, counted as at rest",)
    motions, lost = [], []
    for motion in result.motions:
        for piece in motion.speeds:
            name = f"{motion.name}, {piece.time[0]:.2f} s to {piece.time[-1]:.2f} s"
            moved = moved_by_speeds(vehicle, piece, section.wind)
            try:
                motions.append(
                    coefficients(vehicle, WingMotion(name, piece.time, moved, section.density, notes), LOW_PASS)
                )
            except InputError as error:
                lost.append(str(error))
    if not motions:
        raise InputError("; ".join(lost) or "the markers give no speeds")
    return identify_coefficients(tuple(motions))
