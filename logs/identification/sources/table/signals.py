"""Sections [signals] and [time] of a map: columns of a table become named signals in SI on even time bases."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.resampling import interpolated
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array
from logs.identification.sources.table.columns import Columns
from logs.identification.sources.table.quantities import ANGLES, SIGNALS, WIDEST_ANGLE, converted, in_unit
from wingbeat.errors import InputError
from wingbeat.schema import read_record
from wingbeat.text import pluralize

LEAST_RATE, HIGHEST_RATE = 1e-3, 1e5
LEAST_SAMPLES, MOST_SAMPLES = 5, 5_000_000
WIDEST_GAP = 1.5
"""-; steps between two rows, above which nothing is interpolated between them"""
SENTINELS = (
    999.0, 9999.0, 99999.0, 999999.0, 9999999.0, 999.9, 9999.9, 999.99, 9999.99, 32767.0, 32768.0, 65535.0, 1e10,
    1e20, 1e30, 1e34, 1e35, 1e36, 2147483647.0, 2147483648.0, 4294967295.0,
)  # fmt: skip
"""-; sizes of numbers that loggers write for missing samples"""
FAR = 2.0
"""-; least distance of such a number from all others, over their range"""
COARSE, MOSTLY = 0.05, 0.5
"""-; fraction of rows with another row's time, above which stamps are coarse, and above which there is no time"""
LONGEST_FILL = 5
"""-; missing samples in a row that do not cut a record, and over which an input is interpolated"""
FOLLOWING = 0.1
"""-; gain of the phase-locked loop that counts samples"""


register({
    "sentinel": Entry(
        "{file}: {value:g} in {subject} taken as not measured (far from others)",
        "Loggers write numbers such as -9999 for missing samples.",
        "name it in missing = [...]",
    ),
    "rows_without_time": Entry("{file}: {value:.0f} rows without a time left out", "The time column has no number."),
    "short_piece": Entry(
        "{file}: a piece of {value:.0f} rows is too short and left out", "A record needs five rows with a time."
    ),
    "time_reversal": Entry("{file}: the time goes back {value:.0f} times; each piece is a record", "A restart."),
    "time_gap": Entry("{file}: the time has {value:.0f} gaps; each piece is a record", "Rows are missing."),
    "missing_rows": Entry("{file}: {value:.0f} samples missing in the time, taken as not measured", "Dropped rows."),
    "uneven_time": Entry(
        "{file}: uneven time (by up to {value:.2g} s) interpolated to {rate:.4g} Hz", "The sampling has jitter."
    ),
    "duplicate_rows": Entry(
        "{file}: {value:.0f} rows with the time of the row before left out", "They share a time stamp."
    ),
    "joined_rows": Entry(
        "{file}: {value:.0f} rows joined with the row of the same time", "Each has other signals."
    ),
    "coarse_time": Entry(
        "{file}: rows share time stamps of {value:.3g} s; taken as {rate:.4g} Hz",
        "The time stamps are coarser than the sampling interval.",
    ),
})  # fmt: skip


class Place(NamedTuple):
    """A column."""

    column: str | int
    """-; its name, or its number from 1"""

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Place:
        """Read a map's entry.

        Raises:
            InputError: neither text nor a whole number.
        """
        if isinstance(entry, bool) or not isinstance(entry, str | int):
            raise InputError(f"{key} must be the name of a column in quotes, or its number from 1")
        return cls(entry)


class _Entry(NamedTuple):
    """As written."""

    unit: str
    """-; of value, and of a column after scale and offset"""
    column: Place | None = None
    value: float | None = None
    """as ``unit``; of all rows, without a column"""
    scale: float = 1.0
    """as ``unit`` per unit of the column"""
    offset: float = 0.0
    """as ``unit``"""
    missing: tuple[float, ...] = ()
    """as the column; numbers that mark missing samples"""


class SignalEntry(NamedTuple):
    """One signal: SI value = conversion of (column * scale + offset)."""

    entry: _Entry
    key: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> SignalEntry:
        """Read a map's entry and check its unit against the meaning of the name.

        Raises:
            InputError: neither column nor value, or a unit of another dimension.
        """
        one = read_record(_Entry, entry, key)
        if (one.column is None) == (one.value is None):
            raise InputError(f'{key} must be {{ column = "...", unit = "..." }} or {{ value = ..., unit = "..." }}')
        converted(one.unit, SIGNALS.get(key.rpartition(".")[2]), key)
        return cls(one, key)

    @property
    def unit(self) -> str:
        """SI unit."""
        return converted(self.entry.unit, None, self.key).unit

    def read(self, columns: Columns) -> Array:
        """Values in SI (N,), NaN if not measured.

        Raises:
            InputError: the column is missing, or its angles are out of range.
        """
        unit, entry = converted(self.entry.unit, None, self.key), self.entry
        if entry.column is None:
            raw = np.full(columns.rows, entry.value, dtype=np.float64)
        else:
            raw = columns.column(entry.column.column, self.key)
            name = entry.column.column
            if (columns.order[name - 1] if isinstance(name, int) else name) in columns.clocks:
                raise InputError(f"{self.key}: column {name!r} of {columns.file} holds clocks or dates, no numbers")
        raw = np.where(np.isin(raw, (*entry.missing, *self.sentinels(columns))), np.nan, raw)
        with np.errstate(over="ignore", invalid="ignore"):
            values: Array = (raw * entry.scale + entry.offset) * unit.factor + unit.offset
        values[~(np.abs(values) < 1e15)] = np.nan
        name = self.key.rpartition(".")[2]
        limit = (
            math.pi if name in ANGLES else WIDEST_ANGLE if unit.unit == "rad" and name not in SIGNALS else math.inf
        )
        largest = float(np.nanmax(np.abs(values))) if np.any(np.isfinite(values)) else 0.0
        if largest > limit:
            raise InputError(f"{self.key} reaches {largest:.3g} rad: check its unit and the marks of missing values")
        return values

    def sentinels(self, columns: Columns) -> tuple[float, ...]:
        """`SENTINELS` in its column that are far from all other numbers and not in ``missing``."""
        if self.entry.column is None:
            return ()
        raw = columns.column(self.entry.column.column, self.key)
        marked = np.isin(np.abs(raw), SENTINELS) & ~np.isin(raw, self.entry.missing)
        others = raw[np.isfinite(raw) & ~marked & ~np.isin(raw, self.entry.missing)]
        if 2 * marked.sum() > len(raw) or not marked.any() or not len(others) or not np.ptp(others):
            return ()  # one of two levels is no mark
        span, low, high = float(np.ptp(others)), float(others.min()), float(others.max())
        found: list[float] = np.unique(raw[marked]).tolist()
        return tuple(one for one in found if max(low - one, one - high) > FAR * max(span, abs(low), abs(high)))


class TimeSection(NamedTuple):
    """Section [time]: a column, or the rate of the rows."""

    column: Place | None = None
    unit: str = "s"
    rate: float | None = None
    """Hz; of rows without a time"""
    resample: float | None = None
    """Hz; to which the rows are averaged"""
    fill: float | None = None
    """s; longest gap over which an input is interpolated; 5 samples if not given"""

    def check(self) -> None:
        """Check the values.

        Raises:
            InputError: neither column nor rate, or a number out of range.
        """
        if (self.column is None) == (self.rate is None):
            raise InputError("[time] must have either a column or a rate")
        in_unit(0.0, self.unit, "s", "time.unit")
        for name, rate in (("rate", self.rate), ("resample", self.resample)):
            if rate is not None and not LEAST_RATE <= rate <= HIGHEST_RATE:
                raise InputError(f"time.{name} = {rate:g} Hz is outside {LEAST_RATE:g} to {HIGHEST_RATE:g} Hz")
        if self.fill is not None and self.fill < 0:
            raise InputError("time.fill must be 0 or more")


class Record(NamedTuple):
    """Rows of one file that follow each other in time, on an even base."""

    file: str
    time: Array
    """s; (N,), equally spaced"""
    rows: Array
    """-; (N,), number of the table's row from 1 that each sample is of, or that precedes it"""
    signals: dict[str, Array]
    """SI, by name; (N,) each"""
    marks: Array | None
    """-; (N,), numbers of the maneuvers"""


class _Rows(NamedTuple):
    """Rows of one record as read."""

    file: str
    time: Array
    """s; (M,), not decreasing"""
    rows: NDArray[np.int64]
    """-; (M,), places in the table"""
    signals: dict[str, Array]
    """SI; (M,) each"""


def records_of(
    columns: Columns, entries: dict[str, SignalEntry], base: TimeSection, marks: Place | None
) -> tuple[list[Record], list[Finding]]:
    """Every record of a table, cut if its time goes back, and how its time was made even.

    Raises:
        InputError: a column is missing, has no time, or no row can be used.
    """
    signals = {name: entry.read(columns) for name, entry in entries.items()}
    findings = list(columns.findings)
    findings += [
        Finding("sentinel", "warning", name, number, None, {"file": columns.file})
        for name, entry in entries.items()
        for number in entry.sentinels(columns)
    ]
    marked = None if marks is None else columns.column(marks.column, "maneuvers.column")
    times = _times(columns, base)
    rows = np.flatnonzero(np.isfinite(times))

    def count(code: str, number: int, limit: float | None = None) -> None:
        if number:
            findings.append(Finding(code, "info", "", float(number), limit, {"file": columns.file}))

    steps = np.diff(times[rows])
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if len(forward) else 0.0
    back, gap = steps < 0, steps > max(base.fill or 0.0, LONGEST_FILL * usual) + WIDEST_GAP * usual
    count("time_reversal", int(back.sum()))
    count("time_gap", int(gap.sum()))
    count("rows_without_time", len(times) - len(rows))
    found = []
    for first, last in pairwise([0, *(np.flatnonzero(back | gap) + 1).tolist(), len(rows)]):
        piece = rows[first:last]
        if len(np.unique(times[piece])) < LEAST_SAMPLES:
            count("short_piece", len(piece), LEAST_SAMPLES)
            continue
        read = _Rows(columns.file, times[piece], piece, {name: values[piece] for name, values in signals.items()})
        record = _even(read, findings)
        places = (record.rows - 1.0).astype(np.int64)
        found.append(record if marked is None else record._replace(marks=marked[places]))
    if not found:
        if 2 * int(back.sum()) > len(rows):
            raise InputError(
                f"{columns.file}: its time goes back in {int(back.sum())} of {len(rows)} rows: sort it by time"
            )
        raise InputError(f"{columns.file}: it has fewer than {LEAST_SAMPLES} rows with distinct times")
    return found, findings


def _times(columns: Columns, base: TimeSection) -> Array:
    """Times (N,) of the rows in s; NaN if a row has none.

    Raises:
        InputError: no column, or no row has a time.
    """
    if base.rate is not None or base.column is None:
        return np.arange(columns.rows) / (base.rate or 1.0)
    unit, wanted = converted(base.unit, "s", "time.unit"), base.column.column
    values = columns.column(wanted, "time.column")
    name = columns.order[wanted - 1] if isinstance(wanted, int) else wanted
    if name in columns.clocks and unit.factor != 1.0:
        raise InputError(f"time.unit is {base.unit!r}, but {columns.file} has clocks in {name!r}: their unit is s")
    if not np.any(np.isfinite(values)):
        text = columns.texts.get(name)
        format_ = "" if text is None else f": {text!r} is neither a number nor a clock (16:04:05.25) or ISO 8601 date"
        raise InputError(f"{columns.file}: no row has a time (time.column){format_}")
    return values * unit.factor


def _even(read: _Rows, findings: list[Finding]) -> Record:
    """The record on the even base that is nearest to its time stamps."""
    read = _distinct(read, findings)
    file, time = read.file, read.time
    step = _usual_step(time)
    if time[-1] - time[0] > step * min(MOST_SAMPLES, 1000 * len(time)):
        raise InputError(
            f"{file}: rows are {step:.3g} s apart but span {time[-1] - time[0]:.3g} s: too many are missing"
        )
    places = _sample_numbers(time, step)
    count = int(places[-1]) + 1
    step, start = (float(one) for one in np.polyfit(places, time, 1))
    start = round(start, 9)
    off = float(np.max(np.abs(time - start - places * step)))
    distinct = np.diff(np.unique(np.round(np.diff(time), 7)))
    resolution = float(distinct.min()) if len(distinct) else 0.0
    if off <= max(1.001 * resolution, 1e-3 * step):
        if count > len(time):
            findings.append(Finding("missing_rows", "info", "", float(count - len(time)), None, {"file": file}))
        even: Array = np.asarray(start + step * np.arange(count), dtype=np.float64)
        signals = {name: np.full(count, np.nan) for name in read.signals}
        for name, values in read.signals.items():
            signals[name][places] = values
        before = np.searchsorted(places, np.arange(count), side="right") - 1
    else:
        even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
        findings.append(Finding("uneven_time", "info", "", off, None, {"file": file, "rate": 1 / step}))
        signals = {name: interpolated(time, values, even, WIDEST_GAP * step) for name, values in read.signals.items()}
        before = np.searchsorted(time, even, side="right") - 1
    numbers = np.asarray(read.rows[np.clip(before, 0, None)] + 1.0, dtype=np.float64)
    return Record(file, even, numbers, signals, None)


def _distinct(read: _Rows, findings: list[Finding]) -> _Rows:
    """Rows with distinct times.

    Rows of one time with different signals, or equal ones, are joined. If many rows have other values at the time of
    the row before, the stamps are coarser than the sampling interval, and the rows are taken as even between them; a
    few such rows are left out.

    Raises:
        InputError: most rows share a stamp and are not even.
    """
    file, time = read.file, read.time
    first = np.flatnonzero(np.concatenate(([True], np.diff(time) > 0)))
    extra = len(time) - len(first)
    if not extra:
        return read
    lowest = {name: np.fmin.reduceat(values, first) for name, values in read.signals.items()}
    differs = np.zeros(len(first), dtype=bool)
    for name, values in read.signals.items():
        differs |= np.fmax.reduceat(values, first) > lowest[name]
    others = int(np.sum((np.diff(np.append(first, len(time))) - 1)[differs]))
    if others > COARSE * len(time):
        coarse = float(np.median(np.diff(time[first]))) if len(first) > 1 else 0.0
        numbers = np.arange(len(time))
        step, start = (float(one) for one in np.polyfit(numbers, time, 1))
        even: Array = np.asarray(start + step * numbers, dtype=np.float64)
        if coarse and float(np.max(np.abs(even - time))) <= 0.75 * coarse:
            findings.append(Finding("coarse_time", "info", "", coarse, None, {"file": file, "rate": 1 / step}))
            return read._replace(time=even)
        if extra > MOSTLY * len(time):
            raise InputError(
                f"{file}: {pluralize(extra, 'row')} of {len(time)} have the time of the row before and other values: "
                "the time is too coarse; give [time] rate instead, or a finer column"
            )
    for code, number in (("duplicate_rows", others), ("joined_rows", extra - others)):
        if number > 0:
            findings.append(Finding(code, "info", "", float(number), None, {"file": file}))
    signals = {
        name: np.asarray(np.where(differs, values[first], lowest[name])) for name, values in read.signals.items()
    }
    return read._replace(time=time[first], rows=read.rows[first], signals=signals)


def _usual_step(time: Array) -> float:
    """The mean of the steps near the median, which itself is only as fine as the stamps."""
    steps = np.diff(time)
    median = float(np.median(steps))
    usual = steps[np.abs(steps - median) <= 0.5 * median]
    if not len(usual):
        raise InputError(
            f"[time]: its steps are from {steps.min():.3g} to {steps.max():.3g} s, none usual: is it a time?"
        )
    return float(np.mean(usual))


def _sample_numbers(time: Array, step: float) -> NDArray[np.int64]:
    """Number of the sample on an even base that each row is, by a phase-locked loop.

    The expected stamp follows the stamps slowly, so that jitter and a small error of the step do not add up.
    """
    numbers, expected, number = [0], float(time[0]), 0
    for stamp in time[1:].tolist():
        ahead = max(1, round((stamp - expected) / step))
        number += ahead
        expected += ahead * step
        expected += FOLLOWING * (stamp - expected)
        numbers.append(number)
    return np.array(numbers)
