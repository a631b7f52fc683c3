"""Fields of a log that the page needs, read in parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.columns import Columns
from logs.reader import Log
from sim_bridge import topics as truth_topics
from wingbeat.topic import Topic

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]
"""called with the completed fraction, 0 to 1, and the current step"""
SLICE = 600.0
"""s; interval read at a time"""

QUATERNION = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")
WANTED: Mapping[Topic[Any], tuple[str, ...]] = {
    topics.ATTITUDE: ("roll", "pitch", "yaw", *QUATERNION),
    topics.WING: (
        "angle_left", "angle_right", "phase", "frequency", "amplitude_left", "amplitude_right", "mean_angle",
    ),
    topics.AIR_DATA: ("airspeed",),
    topics.ALTITUDE: ("altitude",),
    topics.POSITION: ("north", "east", "valid"),
    topics.GPS: ("latitude", "longitude", "altitude", "fix_type"),
    topics.POWER: ("voltage", "power", "battery_remaining"),
    topics.NAVIGATION: ("mode", "stage", "altitude_setpoint", "heading_setpoint"),
    topics.PITCH_LOOP: ("pitch_setpoint",),
    topics.ROLL_LOOP: ("roll_setpoint",),
    topics.FLAP: ("frequency",),
    topics.ACTUATORS: ("elevator", "rudder"),
    truth_topics.STATE: ("north", "east", "down", *QUATERNION, "airspeed"),
    truth_topics.WING: (
        "angle_left", "angle_right", "twist_left", "twist_right", "electrical_power", "elevator", "rudder",
    ),
}  # fmt: skip
"""Topics and fields of the page."""
INSTEAD: Mapping[Topic[Any], str] = {topics.GPS: truth_topics.STATE.name, topics.ACTUATORS: truth_topics.WING.name}
"""Topics that are not read if a better one with the same data exists."""


class Table(NamedTuple):
    """Displayed fields of one topic, in order of time."""

    time: Array
    """s; since boot, nondecreasing"""
    fields: Mapping[str, Array]
    """in the log's units, without fields that are missing or have no numbers"""
    labels: Mapping[str, Mapping[int, str]]
    """value names of enumerations, by field"""


Tables = Mapping[str, Table]
"""Tables by topic."""


def true_state(tables: Tables) -> Table | None:
    """Return the truth, None if it was not recorded or has no position or attitude."""
    table = tables.get(truth_topics.STATE.name)
    return table if table is not None and {"north", "east", "down", *QUATERNION} <= set(table.fields) else None


def read_tables(log: Log, progress: Progress = lambda done, note: None) -> Tables:
    """Read every topic of `WANTED` that has messages in the log.

    Raises:
        InputError: a part of the file is damaged.
    """
    there = {name for name, info in log.topics.items() if info.messages}
    wanted = {t.name: fields for t, fields in WANTED.items() if t.name in there and INSTEAD.get(t) not in there}
    pieces: dict[str, list[Table]] = {name: [] for name in wanted}
    slices = _slices(log)
    for number, (start, end) in enumerate(slices):
        progress(number / len(slices), "reading")
        for name, columns in log.tables(wanted, start, end).items():
            if len(columns.time):
                pieces[name].append(_table(columns, wanted[name]))
    return {name: table for name, parts in pieces.items() if parts and len((table := _joined(parts)).time)}


def _slices(log: Log) -> list[tuple[float | None, float | None]]:
    """Windows in s since boot; the first and the last are open."""
    begin = (log.start_ns - log.boot_ns) * 1e-9
    edges: list[float] = [begin + SLICE * n for n in range(1, math.ceil(log.duration / SLICE))]
    return list(zip([None, *edges], [*edges, None], strict=True))


def _table(columns: Columns, names: tuple[str, ...]) -> Table:
    """The named columns of numbers."""
    found = {name: columns[name] for name in names if name in columns.fields}
    numbers = {n: v.astype(np.float64) for n, v in found.items() if v.ndim == 1 and v.dtype.kind in "fiub"}
    return Table(columns.time, numbers, {name: columns.labels[name] for name in numbers if name in columns.labels})


def _joined(parts: list[Table]) -> Table:
    """Pieces one behind the other, in the order of time, without rows whose time is no number."""
    time = np.concatenate([part.time for part in parts])
    names = [name for name in parts[0].fields if all(name in part.fields for part in parts)]
    fields = {name: np.concatenate([part.fields[name] for part in parts]) for name in names}
    known = np.isfinite(time)
    order = np.flatnonzero(known)[np.argsort(time[known], kind="stable")]
    if not np.array_equal(order, np.arange(len(time))):
        time, fields = time[order], {name: values[order] for name, values in fields.items()}
    shown = {name: values for name, values in fields.items() if np.isfinite(values).any()}
    return Table(time, shown, parts[0].labels)
