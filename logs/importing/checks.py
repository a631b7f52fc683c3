"""Plausibility of rows: increasing time, values within physical limits.

A damaged file gives rows of garbage without an error, so every row is looked at before it is kept.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from logs.importing.source import Array, Dropped, Series
from logs.importing.units import limits_in

Mask = NDArray[np.bool_]
LATEST_US = 4_102_444_800_000_000
"""us since 1970; the year 2100: a later clock value is damage"""
LONGEST_PAUSE_US = 3_600_000_000
"""us; between two rows of a topic; rows after a longer pause have damaged time stamps"""
ABSURD = 1e15
"""-; magnitude limit of a column without a unit; damaged bytes read as a float usually exceed it"""
NEVER = "time before the clock's zero"
BACKWARDS = "time runs backwards"
ELSEWHERE = "time far from the rest of the log"
BEHIND = "time behind the end of the log"
MANY = 20
"""rows; threshold of the topics that determine the length of a log"""
LATE_US = 10_000_000
"""us; allowed delay of a row after the last one of those topics"""
REORDERED_US = 2_000_000
"""us; how far a row may be out of order in the file: queues of loggers and radios"""
REBOOT_US = 10_000_000
"""us; least drop of the clock at a reboot"""
REBOOT_ROWS = 5
"""rows before and after a drop that confirm a reboot: a false time stamp stands alone"""


def sound(series: Series, topic: str, trusted: bool = False) -> tuple[Series, list[Dropped]]:
    """Return the valid rows of a series in order of time, and the dropped ones as ``topic``.

    The values of a ``trusted`` series are not checked, its times are.
    """
    dropped: list[Dropped] = []
    for reason, mask in _verdicts(series, trusted):
        series = series.taken(mask)
        if not mask.all():
            dropped.append(Dropped(topic, reason, int((~mask).sum())))
    if np.any(np.diff(series.time_us) < 0):
        series = series.taken(np.argsort(series.time_us, kind="stable"))
    return series, dropped


def _verdicts(series: Series, trusted: bool) -> Iterator[tuple[str, Mask]]:
    """Reasons, each with a mask of the rows that are left by the ones before it."""
    kept = np.asarray(series.time_us >= 0, bool)
    yield NEVER, kept.copy()
    for name, values in () if trusted else series.columns.items():
        mask = possible(values[kept], series.units.get(name, ""))
        if not mask.all():
            yield f"{name} out of range", mask
            kept[kept] = mask
    order = nearly_ordered(series.time_us[kept])
    yield BACKWARDS, order
    kept[kept] = order
    yield ELSEWHERE, together(series.time_us[kept])


def possible(values: Array, unit: str) -> Mask:
    """Select the rows whose values are within the limits of their unit; NaN is accepted.

    Foreign logs use NaN for unknown values.
    """
    if values.dtype.kind not in "iuf":
        return np.ones(len(values), bool)
    limits = limits_in(unit)
    if limits is None:
        if values.dtype.kind != "f":
            return np.ones(len(values), bool)
        # Some logs use infinity for a setting without limit.
        mask = ~(np.abs(values) > ABSURD) | np.isinf(values)
    else:
        low, high = limits
        mask = ~((values < low) | (values > high))
    return np.asarray(mask if mask.ndim == 1 else mask.all(axis=1), bool)


def within(
    columns: Mapping[str, Array], limits: Mapping[str, tuple[float, float] | None]
) -> Iterator[tuple[str, Mask]]:
    """Select, for each column, the rows within its limits or unknown."""
    for name, values in columns.items():
        bounds = limits.get(name)
        if bounds is not None:
            mask = ~((values < bounds[0]) | (values > bounds[1]))
            yield name, np.asarray(mask if mask.ndim == 1 else mask.all(axis=1), bool)


def monotonic_rows(times: NDArray[np.int64]) -> Mask:
    """Select the largest set of rows with nondecreasing times: one false time stamp costs one row."""
    if not len(times) or np.all(np.diff(times) >= 0):
        return np.ones(len(times), bool)
    ends: list[int] = []
    rows: list[int] = []
    before = np.full(len(times), -1)
    for row, time in enumerate(times.tolist()):
        place = bisect_right(ends, time)
        before[row] = rows[place - 1] if place else -1
        ends[place : place + 1] = [time]
        rows[place : place + 1] = [row]
    mask = np.zeros(len(times), bool)
    last = rows[-1]
    while last >= 0:
        mask[last] = True
        last = int(before[last])
    return mask


def nearly_ordered(times: NDArray[np.int64]) -> Mask:
    """Select the rows whose times fit to those beside them in the file, in order or out of it.

    The largest set of rows with nondecreasing times is the reference. Another row belongs to the log if its time is
    at most `REORDERED_US` before the last and after the next row of that set.
    """
    ordered = monotonic_rows(times)
    if ordered.all():
        return ordered
    row, count = np.arange(len(times)), len(times)
    last = np.maximum.accumulate(np.where(ordered, row, -1))
    following = np.minimum.accumulate(np.where(ordered, row, count)[::-1])[::-1]
    low = times[np.where(last >= 0, last, following)] - REORDERED_US
    high = times[np.where(following < count, following, last)] + REORDERED_US
    return np.asarray(ordered | ((times >= low) & (times <= high)), bool)


def boots(times: NDArray[np.int64]) -> list[int]:
    """Return the rows at which a clock starts anew, the first row included.

    Args:
        times: (n,) us since boot, in the order of the file.
    """
    first = [0]
    for row in (np.flatnonzero(np.diff(times) < -REBOOT_US) + 1).tolist():
        before, after = times[max(first[-1], row - REBOOT_ROWS) : row], times[row : row + REBOOT_ROWS]
        fresh = np.median(before) - after.max() > 0 and np.median(before) - np.median(after) > REBOOT_US
        if fresh and len(before) >= REBOOT_ROWS <= len(after):
            first.append(row)
    return first


def together(times: NDArray[np.int64]) -> Mask:
    """Select the most rows without a pause of more than an hour between their times."""
    order = np.argsort(times, kind="stable")
    edges = np.flatnonzero(np.diff(times[order]) > LONGEST_PAUSE_US) + 1
    bounds = [0, *edges.tolist(), len(times)]
    first = int(np.argmax(np.diff(bounds)))
    mask = np.zeros(len(times), bool)
    mask[order[bounds[first] : bounds[first + 1]]] = True
    return mask


def not_behind(times: NDArray[np.int64], end_us: int) -> Mask:
    """Select the rows that are not far after the ``end_us`` of the log; unset time stamps have any value."""
    return np.asarray(times <= end_us + LATE_US, bool)


def end_of(series: Sequence[Series]) -> int:
    """Return the last time (us) of the topics with many rows; without such topics, of all consistent rows."""
    many = [int(one.time_us[-1]) for one in series if len(one.time_us) >= MANY]
    if many:
        return max(many)
    every = np.sort(np.concatenate([one.time_us for one in series]))
    return int(every[together(every)][-1])
