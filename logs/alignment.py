"""Several topics on one time base."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.columns import LATEST_NS, Array, Columns, moment
from logs.log_file import LogFile
from wingbeat.errors import InputError
from wingbeat.topic import Topic

ALIGNED = "aligned"
"""Topic name of the aligned table."""
GAP_PERIODS = 5.0
"""Default gap threshold: pause between two messages in median periods of the topic."""
MOST_ROWS = 50_000_000
SLOWEST = 1e-6
"""Hz; lowest rate, a row in 12 days"""
RANGES: Mapping[str, float] = {"-pi to pi": -math.pi, "0 to 2 pi": 0.0}
"""rad; range texts of angles that wrap, with the lower limit of the range"""
TIME = "time_us"
_AXES = "wxyz"

Times = NDArray[np.int64]
Known = NDArray[np.bool_]


class _Places(NamedTuple):
    """Positions of the rows of a time base among the messages of one topic."""

    before: NDArray[np.intp]
    """index of the last message at or before the row"""
    after: NDArray[np.intp]
    """index of the next message"""
    share: NDArray[np.float64]
    """-; interpolation fraction from ``before`` to ``after``, 0 to 1"""
    between: Known
    """the row lies on a message or between two, and in no gap"""
    previous: Known
    """the previous message is valid for flags, states and counts"""


def aligned(
    log: LogFile,
    topics: Iterable[str | Topic[Any]],
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
    gap: float | None = None,
) -> Columns:
    """Build one table of several topics with columns ``topic.field``; see `logs.reader.Log.aligned`."""
    for value, what in ((rate, "rate"), (gap, "longest gap")):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"the {what} of a table must be above 0, not {value:g}")
    if rate is not None and rate < SLOWEST:
        raise InputError(f"the rate of a table must be at least {SLOWEST:g} Hz, not {rate:g}")
    requested = _selected_fields(log, [topic if isinstance(topic, str) else topic.name for topic in topics])
    tables = {name: _ordered(columns) for name, columns in log.tables(requested).items()}
    boot = log.boot_ns
    base = _time_base([times for _, times in tables.values()], rate, start, end)
    out = Columns(ALIGNED, {}, {}, base + boot, boot)
    for name, fields in requested.items():
        columns, times = tables[name]
        chosen = _fields(log, name, columns, fields)
        # A topic without a rate has a message for each change: its value is valid until the next message.
        places = _places(times, base, gap, lasting=log.topics[name].rate == 0.0)
        for field, values in _sampled(columns, chosen, places).items():
            _add(out, f"{name}.{field}", columns, field, values)
    return out


def wraps_from(columns: Columns, field: str) -> float | None:
    """Return the lower limit (rad) of the range of an angle that wraps, from its unit and description; else None."""
    if columns.units.get(field) != "rad":
        return None
    text = columns.descriptions.get(field, "")
    return next((low for words, low in RANGES.items() if words in text), None)


def quaternions(columns: Columns) -> list[tuple[str, str, str, str]]:
    """Return the fields that are w, x, y and z of one quaternion: their names differ only in the last letter."""
    groups = [tuple(name[:-1] + axis for axis in _AXES) for name in columns if name.endswith("w")]
    return [
        (w, x, y, z)
        for w, x, y, z in groups
        if all(
            name in columns and columns[name].dtype.kind == "f" and columns[name].ndim == 1 for name in (w, x, y, z)
        )
    ]


# --- selection ------------------------------------------------------------------------------------------


def _selected_fields(log: LogFile, names: list[str]) -> dict[str, list[str] | None]:
    """Return the fields by topic in the requested order, None for all of them."""
    requested: dict[str, list[str] | None] = {}
    for name in names:
        topic, field = _split(log, name)
        fields = requested.setdefault(topic, [])
        if field is None:
            requested[topic] = None
        elif fields is not None and field not in fields:
            fields.append(field)
    if not requested:
        raise InputError("no topic to align was named")
    return requested


def _split(log: LogFile, name: str) -> tuple[str, str | None]:
    """Split ``topic`` or ``topic.field``; both may contain dots."""
    if name in log.topics:
        return name, None
    found = [topic for topic in log.topics if name.startswith(f"{topic}.")]
    if not found:
        raise InputError(f"{log.path} has no topic {name}; it has: {', '.join(log.topics) or 'none'}")
    topic = max(found, key=len)
    return topic, name[len(topic) + 1 :]


def _fields(log: LogFile, topic: str, columns: Columns, fields: list[str] | None) -> list[str]:
    chosen = [name for name in columns if name != TIME] if fields is None else fields
    unknown = next((name for name in chosen if name not in columns), None)
    if unknown is not None:
        raise InputError(f"{log.path}: {topic} has no field {unknown}; it has: {', '.join(columns) or 'none'}")
    return chosen


# --- time -----------------------------------------------------------------------------------------------


def _ordered(columns: Columns) -> tuple[Columns, Times]:
    """Return the columns in order of time (ns since boot), and the last of those with equal time."""
    times = np.rint(columns.time * 1e9).astype(np.int64)
    order = np.argsort(times, kind="stable")
    last = np.append(np.diff(times[order]) > 0, True)[: len(order)]
    rows = order[last]
    if len(rows) == len(times) and np.array_equal(rows, np.arange(len(rows))):
        return columns, times
    fields = {name: values[rows] for name, values in columns.items()}
    kept = Columns(
        columns.topic, fields, columns.units, columns.log_time_ns[rows], columns.boot_ns, columns.labels,
        columns.descriptions,
    )  # fmt: skip
    return kept, times[rows]


def _time_base(times: list[Times], rate: float | None, start: float | None, end: float | None) -> Times:
    """Return the row times (ns since boot): those of the first topic, or multiples of ``1 / rate``."""
    spoken = [each for each in times if len(each)]
    first = min((int(each[0]) for each in spoken), default=0)
    last = max((int(each[-1]) for each in spoken), default=-1)
    low = first if start is None else moment(start, LATEST_NS // 2)
    high = last + 1 if end is None else moment(end, LATEST_NS // 2)
    if rate is None:
        return times[0][(times[0] >= low) & (times[0] < high)]
    return _multiples(rate, low, high)


def _multiples(rate: float, low: int, high: int) -> Times:
    rows = (high - low) * 1e-9 * rate
    if rows > MOST_ROWS:
        raise InputError(f"{rate:g} Hz over {(high - low) * 1e-9:.6g} s are {rows:.3g} rows: maximum {MOST_ROWS:.0e}")
    # One more row on either side; the rounded times decide which of them are in the window.
    numbers = np.arange(math.floor(low * 1e-9 * rate) - 1, math.ceil(high * 1e-9 * rate) + 2)
    times: Times = np.rint(numbers * (1e9 / rate)).astype(np.int64)
    return times[(times >= low) & (times < high)]


def _places(times: Times, base: Times, gap: float | None, lasting: bool) -> _Places:
    if not len(times):
        none, nowhere = np.zeros(len(base), np.intp), np.zeros(len(base), bool)
        return _Places(none, none, np.zeros(len(base)), nowhere, nowhere)
    last = np.searchsorted(times, base, side="right") - 1
    before = np.maximum(last, 0)
    after = np.minimum(last + 1, len(times) - 1)
    since, step = base - times[before], times[after] - times[before]
    share = np.divide(since, step, out=np.zeros(len(base)), where=step > 0)
    between = (last >= 0) & ((since == 0) | ((base <= times[-1]) & (step <= _longest(times, gap))))
    return _Places(before, after, share, between, last >= 0 if lasting and gap is None else between)


def _longest(times: Times, gap: float | None) -> float:
    """Return the gap threshold in ns."""
    if gap is not None:
        return gap * 1e9
    return GAP_PERIODS * float(np.median(np.diff(times))) if len(times) > 1 else math.inf


# --- values ---------------------------------------------------------------------------------------------


def _sampled(columns: Columns, fields: list[str], places: _Places) -> dict[str, Array]:
    """Sample the fields at the rows."""
    sampled: dict[str, Array] = {}
    for names in quaternions(columns):
        if not set(names).isdisjoint(fields):
            rows = _quaternion(np.column_stack([columns[name] for name in names]), places)
            sampled |= dict(zip(names, rows.T, strict=True))
    for name in fields:
        if name not in sampled:
            sampled[name] = _sample(columns, name, places)
    return {name: sampled[name] for name in fields}


def _sample(columns: Columns, name: str, places: _Places) -> Array:
    values = columns[name]
    if not len(values):
        return np.full((len(places.before), *values.shape[1:]), np.nan)
    if values.dtype.kind != "f" or name in columns.labels:
        return _previous_values(values, places)
    if values.shape[1:] == (4,) and (name == "q" or name.endswith("quaternion")):
        return _quaternion(values, places)
    low = wraps_from(columns, name)
    return _linear(values, places) if low is None else _angle(values, low, places)


def _known(values: Array, known: Known) -> Array:
    values[~known] = np.nan
    return values


def _linear(values: Array, places: _Places) -> Array:
    share = places.share.reshape(-1, *[1] * (values.ndim - 1))
    first = values[places.before]
    return _known(first + (values[places.after] - first) * share, places.between)


def _angle(values: Array, low: float, places: _Places) -> Array:
    """Interpolate angles by the shorter way, in the range of 2 pi that begins at ``low``."""
    first = values[places.before]
    turned = values[places.after] - first
    turned -= math.tau * np.rint(turned / math.tau)
    found = first + turned * places.share
    inside = found - math.tau * np.floor((found - low) / math.tau)
    # A recorded value is unchanged, also at the end of its range.
    return _known(np.where(places.share == 0.0, first, inside), places.between)


def _quaternion(values: Array, places: _Places) -> Array:
    """Interpolate rotations (n, 4) with length 1 and continuous sign."""
    if not len(values):
        return np.full((len(places.before), 4), np.nan)
    first, second = values[places.before], values[places.after]
    second = np.where(np.sum(first * second, axis=1, keepdims=True) < 0.0, -second, second)
    rows = first + (second - first) * places.share[:, None]
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    rows = np.divide(rows, length, out=np.full_like(rows, np.nan), where=length > 0.0)
    return _continuous(_known(rows, places.between))


def _continuous(rows: Array) -> Array:
    known = np.flatnonzero(np.isfinite(rows).all(axis=1))
    against = np.sum(rows[known[1:]] * rows[known[:-1]], axis=1) < 0.0
    rows[known[1:]] *= np.cumprod(np.where(against, -1.0, 1.0))[:, None]
    return rows


def _previous_values(values: Array, places: _Places) -> Array:
    """Return the values of the previous message; integers become floats if one is missing."""
    found = values[places.before]
    if places.previous.all():
        return found
    if found.dtype == object:
        found[~places.previous] = None
        return found
    return _known(found.astype(np.float64), places.previous)


def _add(out: Columns, name: str, columns: Columns, field: str, values: Any) -> None:
    out.fields[name] = values
    out.units[name] = columns.units[field]
    out.descriptions[name] = columns.descriptions.get(field, "")
    if field in columns.labels:
        out.labels[name] = columns.labels[field]
