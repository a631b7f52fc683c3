"""Vehicle position, attitude and wings on even time grids for the page.

As in `logs.scene`: the truth if it is recorded, else the estimate of the flight computer. Axes have z up (ENU, FLU).
Parts without a recording are at rest, with a note.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.view.tables import QUATERNION, Table, Tables, true_state
from sim_bridge import topics as truth_topics
from wingbeat.rotation_arrays import quaternions_from_euler

Array = NDArray[np.float64]
BODY_RATE, BODY_ROWS = 50.0, 200_000
"""Hz and rows; limits of position and attitude"""
WING_RATE, WING_ROWS = 200.0, 800_000
"""Hz and rows; limits of the wings"""
TRACK_ROWS = 20_000
"""limit of the rows of the estimated track beside the true one"""
PER_STROKE = 8.0
"""Samples per stroke below which the wings are drawn from phase and amplitude instead of the angles."""
REDRAWN_PER_STROKE = 24.0
EARTH = 6_371_000.0
"""m; mean radius"""


class Body(NamedTuple):
    """Position and attitude over time."""

    time: Array
    """s; since boot"""
    place: Array
    """m; east, north, up in three rows"""
    quaternion: Array
    """-; (w, x, y, z) of r_enu_from_flu in four rows"""
    tail: Array
    """rad; elevator and rudder in two rows"""


class Wings(NamedTuple):
    """Angles of the wings over time."""

    time: Array
    """s; since boot"""
    flap: Array
    """rad; left and right in two rows, wing up is positive"""
    twist: Array
    """rad; of the tips, left and right in two rows, leading edge up is positive"""


class Motion(NamedTuple):
    """Motion to be drawn in 3D."""

    body: Body | None
    """None without an attitude"""
    wings: Wings | None
    """None without wing angles"""
    estimated: tuple[Array, Array] | None
    """time (s) and position (m; east, north, up) of the estimated track beside a true one"""
    missing: list[str]
    """missing data, as text"""


def motion_of(tables: Tables) -> Motion:
    """Build the motion of all parts."""
    true = true_state(tables)
    body, missing = (_true_body(true, tables), []) if true is not None else _estimated_body(tables)
    wings = _wings(tables)
    if body is not None and wings is None:
        missing.append("wing angles (the wings are drawn at rest)")
    return Motion(body, wings, None if true is None else _estimated_track(true, tables), missing)


# --- body ---------------------------------------------------------------------------------------------------


def _true_body(state: Table, tables: Tables) -> Body:
    time = _grid(state.time, BODY_RATE, BODY_ROWS)
    place = np.array([_at(time, state, name) for name in ("east", "north", "down")])
    place[2] *= -1.0
    return Body(time, place, _attitude(time, state), _tail(time, tables))


def _estimated_body(tables: Tables) -> tuple[Body | None, list[str]]:
    attitude = tables.get(topics.ATTITUDE.name)
    if attitude is None or not {"roll", "pitch", "yaw"} <= set(attitude.fields):
        return None, ["attitude (the vehicle is not drawn)"]
    time = _grid(attitude.time, BODY_RATE, BODY_ROWS)
    (level, height), missing = _level(time, tables), []
    if level is None:
        missing.append("position (the vehicle does not move)")
    if height is None:
        missing.append("altitude")
    parts = [*(level if level is not None else np.zeros((2, len(time)))), _or_zero(height, time)]
    return Body(time, np.array(parts), _attitude(time, attitude), _tail(time, tables)), missing


def _level(time: Array, tables: Tables) -> tuple[Array | None, Array | None]:
    """Return east and north (m) in two rows, and height (m), each None if unknown."""
    position, altitude = tables.get(topics.POSITION.name), tables.get(topics.ALTITUDE.name)
    fixes = _fixes(tables.get(topics.GPS.name))
    level = height = None
    if position is not None and {"north", "east"} <= set(position.fields):
        known = position.fields.get("valid", np.ones(len(position.time))) > 0
        if known.any():
            level = np.array(
                [np.interp(time, position.time[known], position.fields[n][known]) for n in ("east", "north")]
            )
    if altitude is not None and "altitude" in altitude.fields:
        height = _at(time, altitude, "altitude")
    if fixes is not None and level is None:
        level = np.array([np.interp(time, fixes[0], values) for values in fixes[1][:2]])
    if fixes is not None and height is None:
        height = np.interp(time, fixes[0], fixes[1][2])
    return level, height


def _fixes(gps: Table | None) -> tuple[Array, Array] | None:
    """Times (s), and east, north and height (m) from the first fix in three rows; None without a fix."""
    if gps is None or not {"latitude", "longitude", "altitude", "fix_type"} <= set(gps.fields):
        return None
    known = gps.fields["fix_type"] >= 2
    if not known.any():
        return None
    latitude, longitude, altitude = (gps.fields[name][known] for name in ("latitude", "longitude", "altitude"))
    east = EARTH * math.cos(latitude[0]) * (longitude - longitude[0])
    return gps.time[known], np.array([east, EARTH * (latitude - latitude[0]), altitude - altitude[0]])


def _attitude(time: Array, table: Table) -> Array:
    """Return quaternions of r_enu_from_flu with continuous sign for interpolation."""
    if set(QUATERNION) <= set(table.fields):
        source = np.array([table.fields[name] for name in QUATERNION])
    else:
        source = np.array(quaternions_from_euler(*(table.fields[name] for name in ("roll", "pitch", "yaw"))))
    known = np.isfinite(source).all(axis=0)
    if not known.any():
        return np.tile([[1.0], [0.0], [0.0], [0.0]], len(time))
    source = source[:, known]
    turned = np.sum(source[:, 1:] * source[:, :-1], axis=0) < 0.0
    source[:, 1:] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)
    w, x, y, z = (np.interp(time, table.time[known], row) for row in source)
    out = np.array([w + z, x + y, x - y, w - z])
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=0), 1e-9))


def _tail(time: Array, tables: Tables) -> Array:
    table = tables.get(truth_topics.WING.name) or tables.get(topics.ACTUATORS.name)
    return np.array([_or_zero(_at(time, table, name), time) for name in ("elevator", "rudder")])


def _estimated_track(state: Table, tables: Tables) -> tuple[Array, Array] | None:
    """Return the estimated track, shifted to the start altitude of the true one: its altitude is relative to boot."""
    position = tables.get(topics.POSITION.name)
    if position is None:
        return None
    time = _grid(position.time, 5.0, TRACK_ROWS)
    level, height = _level(time, tables)
    if level is None or height is None:
        return None
    return time, np.array([*level, height - state.fields["down"][0]])


# --- wings --------------------------------------------------------------------------------------------------


def _wings(tables: Tables) -> Wings | None:
    true, seen = tables.get(truth_topics.WING.name), tables.get(topics.WING.name)
    table = true if _has_angles(true) else seen
    if table is None or not _has_angles(table):
        return None
    redrawn = _redrawn(table)
    if redrawn is not None:
        return redrawn
    time = _grid(table.time, WING_RATE, WING_ROWS)
    flap = np.array([_at(time, table, name) for name in ("angle_left", "angle_right")])
    return Wings(
        time, flap, np.array([_or_zero(_at(time, table, name), time) for name in ("twist_left", "twist_right")])
    )


def _has_angles(table: Table | None) -> bool:
    return table is not None and {"angle_left", "angle_right"} <= set(table.fields)


def _redrawn(table: Table) -> Wings | None:
    """Reconstruct strokes from their phase if angles are sampled too rarely, as over a radio; else return None."""
    needed = {"phase", "frequency", "amplitude_left", "amplitude_right", "mean_angle"}
    if not needed <= set(table.fields) or len(table.time) < 2:
        return None
    frequency = table.fields["frequency"]
    usual = float(np.median(frequency[frequency > 0.0])) if (frequency > 0.0).any() else 0.0
    if usual == 0.0 or 1.0 / _period(table.time) >= PER_STROKE * usual:
        return None
    # Not decimated to the rows of the log: a stroke needs more.
    rows = min(WING_ROWS, 2 + int((table.time[-1] - table.time[0]) * REDRAWN_PER_STROKE * usual))
    time = np.linspace(table.time[0], table.time[-1], rows)
    swing = np.sin(np.interp(time, table.time, _cycles(table)) * 2.0 * np.pi)
    mean = _or_zero(_at(time, table, "mean_angle"), time)
    sides = [mean + _or_zero(_at(time, table, f"amplitude_{side}"), time) * swing for side in ("left", "right")]
    still = np.interp(time, table.time, (frequency > 0.0).astype(float)) < 0.5
    held = [_or_zero(_at(time, table, f"angle_{side}"), time) for side in ("left", "right")]
    return Wings(time, np.where(still, held, sides), np.zeros((2, len(time))))


def _cycles(table: Table) -> Array:
    """Return the stroke count: its integer part from the frequency, the fraction from the phase."""
    phase = np.nan_to_num(table.fields["phase"]) / (2.0 * np.pi)
    frequency = np.nan_to_num(table.fields["frequency"])
    passed = 0.5 * (frequency[1:] + frequency[:-1]) * np.diff(table.time)
    turned = np.diff(phase)
    return np.asarray(phase[0] + np.concatenate(([0.0], np.cumsum(turned + np.rint(passed - turned)))))


# --- grids --------------------------------------------------------------------------------------------------


def _period(time: Array) -> float:
    """Return the typical sampling period in s."""
    periods = np.diff(time)
    periods = periods[periods > 0.0]
    return float(np.median(periods)) if len(periods) else 1.0


def _grid(time: Array, rate: float, rows: int) -> Array:
    """Return equal time steps from the first to the last time, not finer than ``time``, ``rate`` (Hz) or ``rows``."""
    span = float(time[-1] - time[0])
    return np.linspace(time[0], time[-1], 1 + min(rows - 1, math.ceil(span / max(_period(time), 1.0 / rate) - 1e-6)))


def _at(time: Array, table: Table | None, name: str) -> Array | None:
    """Interpolate a field at other times across unknown values; None if the log lacks it."""
    if table is None or name not in table.fields:
        return None
    values = table.fields[name]
    known = np.isfinite(values)
    return np.interp(time, table.time[known], values[known])


def _or_zero(values: Array | None, time: Array) -> Array:
    return np.zeros(len(time)) if values is None else values
