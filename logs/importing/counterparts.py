"""Wingbeat topics from the series of another log."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics as t
from logs.importing.checks import Mask, within
from logs.importing.source import Array, Dropped, ImportedTopic, Series
from logs.importing.units import CONVERSIONS, LIMITS
from logs.layout import Field, layout_of
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import euler_from_quaternions, quaternions_from_euler
from wingbeat.topic import Topic

Columns = dict[str, Array]
CORE: Mapping[Topic[Any], tuple[str, ...]] = {
    t.IMU: ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z"),
    t.ATTITUDE: ("roll", "pitch", "yaw"),
    t.AIR_DATA: ("airspeed",),
    t.ALTITUDE: ("altitude",),
    t.POSITION: (),
    t.POWER: ("voltage",),
    t.GPS: ("latitude", "longitude"),
}
"""Required fields: a row without them is dropped. For other topics, all fields of the source."""
KNOWN: Mapping[str, float] = {"bias_x": 0.0, "bias_y": 0.0, "bias_z": 0.0, "valid": 1}
"""Default values of fields that a source lacks; otherwise NaN, and 0 for counts and flags."""
_TURN = 1.001 * math.pi
FIELD_LIMITS: Mapping[str, tuple[float, float]] = {
    "roll": (-2.0 * _TURN, 2.0 * _TURN),
    "pitch": (-0.501 * math.pi, 0.501 * math.pi),
    "latitude": (-0.5 * math.pi, 0.5 * math.pi),
    "longitude": (-_TURN, _TURN),
    "battery_remaining": (-0.01, 1.01),
    "static_pressure": (1e3, 1.2e5),
    "satellites": (0, 255),
}


class View:
    """Source series of a counterpart, with other series at its times; values in SI by their units."""

    def __init__(self, series: Mapping[str, Series], name: str) -> None:
        self._series = series
        self.here = series[name]

    def __getitem__(self, column: str) -> Array:
        """Return a column of the series, (N,) or (N, k); raise `KeyError` if it has no such numbers."""
        return _in_si(self.here, column)

    def raw(self, column: str) -> Array:
        """Return a column in the unit of the source; raise `KeyError` if it has no such numbers."""
        return _numbers(self.here, column)

    def get(self, column: str) -> Array:
        """Return a column of the series, NaN if it is missing."""
        return self[column] if column in self.here.columns else self.unknown()

    def has(self, name: str) -> bool:
        """Return whether the log has another series of that name."""
        return name in self._series

    def unknown(self) -> Array:
        """Return NaN for every row."""
        return np.full(len(self.here.time_us), np.nan)

    def latest_value(self, name: str, column: str, part: int | None = None) -> Array:
        """Return a column of another series, held since its last row; NaN before that, or if it is missing.

        ``part`` is the index in an array.
        """
        other = self._series.get(name)
        if other is None or not len(other.time_us):
            return self.unknown()
        try:
            values = _in_si(other, column)
        except KeyError:
            return self.unknown()
        values = values if part is None else values[:, part]
        last = np.searchsorted(other.time_us, self.here.time_us, side="right") - 1
        return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def _numbers(series: Series, column: str) -> Array:
    values = series.columns[column]
    if values.dtype == object:
        raise KeyError(column)
    return values


def _in_si(series: Series, column: str) -> Array:
    values = _numbers(series, column)
    # A unit that is unknown here, such as "satellites", is kept.
    known = CONVERSIONS.get(series.units.get(column, ""), CONVERSIONS[""])
    if known.factor == 1.0 and known.offset == 0.0:
        return values
    return np.asarray(values * known.factor + known.offset, float)


class Counterpart(NamedTuple):
    """Rule that makes a Wingbeat topic from a series."""

    topic: Topic[Any]
    source: str
    """name of the series that determines the times"""
    build: Callable[[View], Columns]
    """fields from columns; raises `KeyError` if the source lacks one"""
    needs: str = ""
    """column without which the source is not one of this topic; empty for none"""


def make_all(table: Sequence[Counterpart], series: Mapping[str, Series]) -> tuple[list[ImportedTopic], list[Dropped]]:
    """Make the first available counterpart of each topic from the series.

    Returns:
        the topics, and those that could not be made although the log has a source for them, with the reason.
    """
    made: dict[Topic[Any], ImportedTopic] = {}
    failed: dict[Topic[Any], Dropped] = {}
    for counterpart in table:
        topic, source = counterpart.topic, series.get(counterpart.source)
        if topic in made or source is None or (counterpart.needs and counterpart.needs not in source.columns):
            continue
        try:
            columns = counterpart.build(View(series, counterpart.source))
            _check_shapes(topic, columns)
        except (KeyError, IndexError, ValueError) as error:
            # Another version of the source: no such column, another unit, an array for a number.
            reason = f"not made of {counterpart.source}: {_reason(error)}"
            failed.setdefault(topic, Dropped(topic.name, reason, len(source.time_us)))
            continue
        imported = checked(topic, source, columns)
        if len(imported.series.time_us):
            made[topic] = imported
        elif imported.dropped:
            failed.setdefault(topic, imported.dropped[0])
    return list(made.values()), [lost for topic, lost in failed.items() if topic not in made]


def _reason(error: Exception) -> str:
    if isinstance(error, KeyError):
        return f"no numbers in column {error.args[0]}"
    return str(error) if isinstance(error, InputError) else f"column {error} has another shape"


def _check_shapes(topic: Topic[Any], columns: Columns) -> None:
    """Whether numbers are given for numbers, and arrays for arrays; raises `ValueError` where they are not."""
    fields = {field.name: field for field in fields_of(topic)}
    for name, values in columns.items():
        if np.shape(values)[1:] != ((fields[name].length,) if fields[name].length else ()):
            raise ValueError(name)


def checked(topic: Topic[Any], source: Series, columns: Columns) -> ImportedTopic:
    """Make a topic of ``columns`` at the times of ``source``, without invalid rows."""
    columns = {name: np.asarray(values) for name, values in columns.items()}
    kept = np.ones(len(source.time_us), bool)
    dropped: list[Dropped] = []
    for reason, mask in _verdicts(topic, columns):
        lost = int((kept & ~mask).sum())
        kept &= mask
        if lost:
            dropped.append(Dropped(topic.name, reason, lost))
    whole = Series(topic.name, source.time_us, _completed(topic, columns, len(kept)), {})
    return ImportedTopic(topic, source.name, whole.taken(kept), kept, tuple(dropped))


def _verdicts(topic: Topic[Any], columns: Columns) -> list[tuple[str, Mask]]:
    """Reasons, each with a mask of the rows that pass."""
    core = CORE.get(topic, tuple(columns))
    verdicts = [(f"{name} not finite", _finite(columns[name])) for name in core if name in columns]
    fields = {field.name: field for field in fields_of(topic)}
    limits = {name: FIELD_LIMITS.get(name, LIMITS.get(fields[name].unit)) for name in columns}
    return verdicts + [(f"{name} out of range", mask) for name, mask in within(columns, limits)]


def fields_of(topic: Topic[Any]) -> tuple[Field, ...]:
    """Return the fields of a topic's message, the time first."""
    message: Any = topic.message
    return layout_of(message).fields


def _finite(values: Array) -> Mask:
    mask = np.isfinite(values)
    return np.asarray(mask if mask.ndim == 1 else mask.all(axis=1), bool)


def _completed(topic: Topic[Any], columns: Columns, rows: int) -> Columns:
    """Every field of the message: as given, as it follows from the others, or not known."""
    if topic is t.ATTITUDE:
        columns = _whole_attitude(columns)
    fields = fields_of(topic)[1:]
    return {field.name: _fitting(field, columns.get(field.name), rows) for field in fields}


def _fitting(field: Field, values: Array | None, rows: int) -> Array:
    """A column in the type of its field."""
    whole = field.scalar not in ("double", "float")
    shape = (rows, field.length) if field.length else (rows,)
    if values is None:
        values = np.full(shape, KNOWN.get(field.name, 0 if whole else math.nan))
    if not whole:
        return np.asarray(values, float)
    low, high = (-(2**31), 2**31 - 1) if field.scalar == "sfixed32" else (0, 2**32 - 1)
    rounded: Array = np.nan_to_num(np.rint(np.asarray(values, float)))
    return rounded.clip(low, high).astype(np.int64)


def _whole_attitude(columns: Columns) -> Columns:
    """Angles and quaternion, whichever of them the source has; roll and yaw from -pi to pi."""
    names = tuple(f"quaternion_{axis}" for axis in "wxyz")
    angles = ("roll", "pitch", "yaw")
    if all(name in columns for name in names) and not any(name in columns for name in angles):
        columns = columns | dict(zip(angles, euler_from_quaternions(*(columns[name] for name in names)), strict=True))
    columns = columns | {name: wrapped(columns[name]) for name in ("roll", "yaw") if name in columns}
    if all(name in columns for name in angles) and not any(name in columns for name in names):
        columns |= dict(zip(names, quaternions_from_euler(*(columns[name] for name in angles)), strict=True))
    return columns


def wrapped(angle: Array) -> Array:
    """Wrap an angle in rad to -pi to pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)), float)


def true_airspeed(equivalent: Array, density: Array) -> Array:
    """Compute the true airspeed in m/s; without a density (kg/m^3) return the equivalent airspeed."""
    ratio = np.where(np.isfinite(density) & (density > 0.1), SEA_LEVEL_DENSITY / np.maximum(density, 0.1), 1.0)
    return np.asarray(equivalent * np.sqrt(ratio), float)


def ground_velocity(speed: Array, course: Array) -> tuple[Array, Array]:
    """Return north and east components (m/s) of a speed along a course (rad)."""
    return speed * np.cos(course), speed * np.sin(course)


def pulse_array(view: View, columns: Sequence[str], count: int) -> NDArray[np.int64]:
    """Return radio-control pulse widths in integer us, (N, count): 0 for channels that were not recorded."""
    zeros = np.zeros(len(view.here.time_us))
    table = [np.nan_to_num(view.raw(name)) if name in view.here.columns else zeros for name in columns[:count]]
    return np.stack(table + [zeros] * (count - len(table)), axis=1).astype(np.int64)
