"""Results of motion-capture markers as lines of a table, JSON document and chapter of a page."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from logs.identification.motion_capture.motion import BASE, MarkerMotion, findings_of
from logs.identification.results import Array, student_factor
from logs.identification.sources.table.markers import MarkersResult
from logs.pages.document import MEASURED, Band, Chapter, Plot, Series, Table
from logs.pages.labels import sentence
from wingbeat.rotation_arrays import euler_from_quaternions

UNITS = ("m",) * 3 + ("rad",) * 3
SPEEDS = ("v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z")
SPEED_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
METHOD = (
    "Position and attitude of the base and the joint angles are fitted to all markers (Grauer Eq. 1 and 8); standard"
    " errors are from the residuals. Speeds are derivatives of the low-passed coordinates (Eq. 2)."
)


class Track(NamedTuple):
    """One coordinate of one record."""

    name: str
    unit: str
    values: Array
    """as `unit`; (N,), NaN if not known"""
    errors: Array
    """as `unit`; (N,), standard errors"""

    @property
    def typical(self) -> float:
        """The median standard error."""
        return float(np.nanmedian(self.errors))

    @property
    def line(self) -> str:
        """Range and standard error as text."""
        low, high = np.nanmin(self.values), np.nanmax(self.values)
        return f"{low:.3f} to {high:.3f} {self.unit}, standard error {self.typical:.2g} {self.unit}"


def coordinates(motion: MarkerMotion) -> tuple[Track, ...]:
    """Position, attitude and joint angles; errors of position and attitude are along and about the base's axes."""
    found, errors = motion.coordinates, motion.errors
    values = np.column_stack(
        [found.position_ned, np.column_stack(euler_from_quaternions(*found.quaternion.T)), found.angles]
    )
    names = ("north", "east", "down", "roll", "pitch", "yaw", *found.names)
    units = (*UNITS, *("rad",) * len(found.names))
    rows = zip(names, units, values.T, errors.T, strict=True)
    return tuple(Track(*row) for row in rows)


def speed_lines(motion: MarkerMotion) -> tuple[tuple[str, str, float, float], ...]:
    """Return name, unit, minimum and maximum of every generalized speed."""
    if not motion.speeds:
        return ()
    table = np.concatenate([one.speeds for one in motion.speeds])
    names = (*SPEEDS, *(f"{name}_rate" for name in motion.coordinates.names))
    units = (*SPEED_UNITS, *("rad/s",) * len(motion.coordinates.names))
    return tuple(
        (name, unit, float(column.min()), float(column.max()))
        for name, unit, column in zip(names, units, table.T, strict=True)
    )


def marker_lines(motion: MarkerMotion) -> tuple[tuple[str, str], ...]:
    """Return name and text of the lines below the table."""
    rates = {name: (unit, low, high) for name, unit, low, high in speed_lines(motion)}
    lines = [(track.name, track.line) for track in coordinates(motion)]
    lines += [(name, f"{low:.2f} to {high:.2f} {unit}") for name, (unit, low, high) in rates.items()]
    return (*lines, *(("told", one.text) for one in findings_of(motion)))


def marker_document(result: MarkersResult) -> dict[str, Any]:
    """Return the JSON document; unknown numbers are null."""
    return {
        "vehicle": result.vehicle,
        "records": [_record(one) for one in result.motions],
        "notes": list(result.notes),
    }


def _record(motion: MarkerMotion) -> dict[str, Any]:
    tracks = coordinates(motion)
    return {
        "name": motion.name,
        "noise": motion.noise._asdict(),
        "frames": len(motion.time),
        "told": int(motion.known.sum()),
        "left_out": motion.coordinates.unused,
        "never_seen": list(motion.unobserved),
        "low_pass": motion.cutoff,
        "time": _list(motion.time),
        "quaternion": [_list(row) for row in motion.coordinates.quaternion],
        "coordinates": [
            {"name": one.name, "unit": one.unit, "values": _list(one.values), "standard_errors": _list(one.errors)}
            for one in tracks
        ],
        "speeds": [_speeds(motion, place) for place in range(len(motion.speeds))],
    }


def _speeds(motion: MarkerMotion, place: int) -> dict[str, Any]:
    piece = motion.speeds[place]
    return {
        "names": [name for name, *_ in speed_lines(motion)],
        "time": _list(piece.time),
        "values": [_list(row) for row in piece.speeds],
        "rates": [_list(row) for row in piece.rates],
    }


def _list(values: Array) -> list[float | None]:
    return [float(value) if math.isfinite(value) else None for value in values]


def markers_chapter(result: MarkersResult) -> Chapter:
    """Return coordinates with their 95 % bands and speeds of each record."""
    parts = tuple(_part(motion) for motion in result.motions)
    return Chapter("Motion by markers", (METHOD, *map(sentence, result.notes)), parts=parts)


def _part(motion: MarkerMotion) -> Chapter:
    tracks, factor = coordinates(motion), student_factor(math.inf)
    rows = tuple(
        (one.name, one.unit, float(np.nanmin(one.values)), float(np.nanmax(one.values)), one.typical)
        for one in tracks
    )
    noise = motion.noise
    tables = [
        Table(
            ("coordinate", "unit", "minimum", "maximum", "standard error"),
            rows,
            "Standard errors are medians over the frames; of position and attitude along and about the base's axes"
            f" ({', '.join(BASE[3:])} as roll, pitch, yaw).",
        )
    ]
    if motion.speeds:
        tables.append(Table(("speed", "unit", "minimum", "maximum"), speed_lines(motion)))
    plots = tuple(_plot(one, motion.time, factor) for one in tracks)
    told = f"marker noise {1e3 * noise.value:.3f} mm ({1e3 * noise.low:.3f} to {1e3 * noise.high:.3f})"
    return Chapter(
        motion.name, tuple(map(sentence, (told, *(one.text for one in findings_of(motion))))), tuple(tables), plots
    )


def _plot(one: Track, time: Array, factor: float) -> Plot:
    half = factor * one.errors
    band = Band("95 % interval", time, one.values - half, one.values + half)
    return Plot("", "time", "s", one.name, one.unit, (Series("", time, one.values, MEASURED),), (band,))
