"""Sections [signals] and [time] of a map: columns of a table become named signals in SI on even time bases."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array
from logs.identification.sources.table.columns import Columns
from logs.identification.sources.table.quantities import ANGLES, SIGNALS, WIDEST_ANGLE, converted, in_unit
from wingbeat.errors import InputError
from wingbeat.schema import read_record
from wingbeat.text import pluralize

LEAST_RATE, HIGHEST_RATE = 1e-3, 1e5
LEAST_SAMPLES = 5
"""-; of a record worth keeping"""
MOST_SAMPLES = 5_000_000
WIDEST_GAP = 1.5
"""-; steps between two rows; over it nothing is interpolated between them"""
SENTINELS = (
    999.0, 9999.0, 99999.0, 999999.0, 9999999.0, 999.9, 9999.9, 999.99, 9999.99, 32767.0, 32768.0, 65535.0, 1e10,
    1e20, 1e30, 1e34, 1e35, 1e36, 2147483647.0, 2147483648.0, 4294967295.0,
)  # fmt: skip
"""-; sizes of numbers that loggers write for what was not measured"""
FAR = 2.0
"""-; spans of all others, by which such a number is away from them"""
COARSE = 0.05
"""-; share of the rows that have another's time and other values, from which the stamps are too coarse for them"""
MOSTLY = 0.5
"""-; the same, from which rows that are not even have no time that could be told"""
LONGEST_FILL = 5
"""-; samples missing on end that do not cut a record, and over which an input is interpolated"""
FOLLOWING = 0.1
"""-; share of a stamp's surprise that the clock takes over"""


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


def _time_finding(code: str, file: str, count: int, limit: float | None = None) -> Finding:
    """What was done to make the time of a file even."""
    return Finding(code, "info", "", float(count), limit, {"file": file})


class Place(NamedTuple):
    """A column."""

    column: str | int
    """-; its name, or its number from 1"""

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Place:
        """Of a map's entry.

        Raises:
            InputError: it is neither text nor a whole number.
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
    """as ``unit``; of all rows, where there is no column"""
    scale: float = 1.0
    """as ``unit`` per unit of the column"""
    offset: float = 0.0
    """as ``unit``"""
    missing: tuple[float, ...] = ()
    """as the column; numbers that stand for what was not measured"""


class SignalEntry(NamedTuple):
    """One signal: SI value = conversion of (column * scale + offset)."""

    entry: _Entry
    key: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> SignalEntry:
        """Of a map's entry, its unit checked against what the name means.

        Raises:
            InputError: neither column nor value, or a unit that cannot be that of the signal.
        """
        told = read_record(_Entry, entry, key)
        if (told.column is None) == (told.value is None):
            raise InputError(f'{key} must be {{ column = "...", unit = "..." }} or {{ value = ..., unit = "..." }}')
        converted(told.unit, SIGNALS.get(key.rpartition(".")[2]), key)
        return cls(told, key)

    @property
    def unit(self) -> str:
        """In SI."""
        return converted(self.entry.unit, None, self.key).unit

    def read(self, columns: Columns) -> Array:
        """Values in SI (N,), NaN where not measured.

        Raises:
            InputError: the column is not there, or has angles that no aircraft has.
        """
        unit, entry = converted(self.entry.unit, None, self.key), self.entry
        if entry.column is None:
            raw = np.full(columns.rows, entry.value, dtype=np.float64)
        else:
            raw = columns.column(entry.column.column, self.key)
            self._check_number(columns)
        raw = np.where(np.isin(raw, (*entry.missing, *self.sentinels(columns))), np.nan, raw)
        with np.errstate(over="ignore", invalid="ignore"):
            values: Array = (raw * entry.scale + entry.offset) * unit.factor + unit.offset
        values[~(np.abs(values) < 1e15)] = np.nan
        _check_angle(self.key, unit.unit, values)
        return values

    def _check_number(self, columns: Columns) -> None:
        wanted = None if self.entry.column is None else self.entry.column.column
        if (columns.order[wanted - 1] if isinstance(wanted, int) else wanted) in columns.clocks:
            raise InputError(f"{self.key}: column {wanted!r} of {columns.file} holds clocks or dates, no numbers")

    def sentinels(self, columns: Columns) -> tuple[float, ...]:
        """Numbers of its column, not told by the map, that loggers write for nothing and that are far from others."""
        if self.entry.column is None:
            return ()
        raw = columns.column(self.entry.column.column, self.key)
        suspect = np.isin(np.abs(raw), SENTINELS) & ~np.isin(raw, self.entry.missing)
        others = raw[np.isfinite(raw) & ~suspect & ~np.isin(raw, self.entry.missing)]
        if 2 * suspect.sum() > len(raw) or not suspect.any() or not len(others) or not np.ptp(others):
            return ()  # the one of two levels is no gap in the other
        span, low, high = float(np.ptp(others)), float(others.min()), float(others.max())
        found: list[float] = np.unique(raw[suspect]).tolist()
        return tuple(one for one in found if max(low - one, one - high) > FAR * max(span, abs(low), abs(high)))


def _check_angle(key: str, unit: str, values: Array) -> None:
    name = key.rpartition(".")[2]
    limit = math.pi if name in ANGLES else WIDEST_ANGLE if unit == "rad" and name not in SIGNALS else math.inf
    largest = float(np.nanmax(np.abs(values))) if np.any(np.isfinite(values)) else 0.0
    if largest > limit:
        raise InputError(
            f"{key} reaches {largest:.3g} rad: is its unit right, and what stands for missing values told?"
        )


class TimeSection(NamedTuple):
    """Where the time of a row comes from: a column, or the rate of the rows."""

    column: Place | None = None
    unit: str = "s"
    rate: float | None = None
    """Hz; of rows without a time"""
    resample: float | None = None
    """Hz; to which the rows are averaged and thinned"""
    fill: float | None = None
    """s; longest run of missing samples over which an input is interpolated; 5 samples where not told"""

    def check(self) -> None:
        """Refuse what cannot be.

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
    """-; (N,), number of the table's row from 1 that each sample is of, or lies after"""
    signals: dict[str, Array]
    """SI, by name; (N,) each"""
    marks: Array | None
    """-; (N,), numbers of the column that tells the manoeuvres"""


def records_of(
    columns: Columns, entries: dict[str, SignalEntry], base: TimeSection, marks: Place | None
) -> tuple[list[Record], list[Finding]]:
    """Every record of a table, cut where its time goes back, and what was done to make its time even.

    Raises:
        InputError: a column that is not there, no time in it, or none of the rows can be used.
    """
    signals = {name: entry.read(columns) for name, entry in entries.items()}
    sentinels = [
        Finding("sentinel", "warning", name, number, None, {"file": columns.file})
        for name, entry in entries.items()
        for number in entry.sentinels(columns)
    ]
    marked = None if marks is None else columns.column(marks.column, "manoeuvres.column")
    times = _times(columns, base)
    rows = np.flatnonzero(np.isfinite(times))
    if not len(rows):
        raise InputError(f"{columns.file}: no row has a time (time.column){_time_text(columns, base)}")
    findings = [*columns.findings, *sentinels]
    bounds = [0, *_cuts(columns.file, times[rows], base, findings), len(rows)]
    if len(rows) < len(times):
        findings.append(_time_finding("rows_without_time", columns.file, len(times) - len(rows)))
    found = []
    for first, last in pairwise(bounds):
        piece = rows[first:last]
        if len(np.unique(times[piece])) < LEAST_SAMPLES:
            findings.append(_time_finding("short_piece", columns.file, len(piece), LEAST_SAMPLES))
            continue
        found.append(_even(columns.file, times[piece], piece, signals, marked, findings))
    if not found:
        back = int(np.count_nonzero(np.diff(times[rows]) < 0))
        if 2 * back > len(rows):
            raise InputError(
                f"{columns.file}: its time goes back in {back} of {len(rows)} rows: it must be sorted by time"
            )
        raise InputError(f"{columns.file}: it has fewer than {LEAST_SAMPLES} rows with a time of their own")
    return found, findings


def _time_text(columns: Columns, base: TimeSection) -> str:
    """What stands in the time's column where it has no number."""
    wanted = None if base.column is None else base.column.column
    name = columns.order[wanted - 1] if isinstance(wanted, int) else wanted
    told = columns.texts.get(name or "")
    return "" if told is None else f": {told!r} is neither a number nor a clock (16:04:05.25) or a date in ISO 8601"


def _cuts(file: str, times: Array, base: TimeSection, findings: list[Finding]) -> list[int]:
    """First rows after the time went back, or after more than what is filled is missing."""
    steps = np.diff(times)
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if len(forward) else 0.0
    back = steps < 0
    gap = steps > max(base.fill or 0.0, LONGEST_FILL * usual) + WIDEST_GAP * usual
    for code, where in (("time_reversal", back), ("time_gap", gap)):
        if where.any():
            findings.append(_time_finding(code, file, int(where.sum())))
    return (np.flatnonzero(back | gap) + 1).tolist()


def _times(columns: Columns, base: TimeSection) -> Array:
    if base.rate is not None:
        return np.arange(columns.rows) / base.rate
    if base.column is None:
        raise InputError("[time] must have either a column or a rate")
    told, wanted = converted(base.unit, "s", "time.unit"), base.column.column
    values = columns.column(wanted, "time.column")
    name = columns.order[wanted - 1] if isinstance(wanted, int) else wanted
    if name in columns.clocks and told.factor != 1.0:
        raise InputError(f"time.unit is {base.unit!r}, but {columns.file} has clocks in {name!r}: their unit is s")
    return values * told.factor


def _even(
    file: str,
    time: Array,
    rows: NDArray[np.int64],
    signals: dict[str, Array],
    marks: Array | None,
    findings: list[Finding],
) -> Record:
    """A record on the even base that its time stamps are nearest to."""
    time, rows, read = _distinct_times(
        file, time, rows, {name: values[rows] for name, values in signals.items()}, findings
    )
    step = _usual_step(time)
    if time[-1] - time[0] > step * min(MOST_SAMPLES, 1000 * len(time)):
        raise InputError(
            f"{file}: rows are {step:.3g} s apart but span {time[-1] - time[0]:.3g} s: too many are missing"
        )
    places = _places(time, step)
    count = int(places[-1]) + 1
    step, start = (float(one) for one in np.polyfit(places, time, 1))
    start = round(start, 9)

    off = float(np.max(np.abs(time - start - places * step)))
    if off <= max(_resolution(time), 1e-3 * step):
        if count > len(time):
            findings.append(_time_finding("missing_rows", file, count - len(time)))
        even: Array = np.asarray(start + step * np.arange(count), dtype=np.float64)
        taken = {name: _spread(values, places, count) for name, values in read.items()}
        before = np.searchsorted(places, np.arange(count), side="right") - 1
    else:
        even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
        findings.append(Finding("uneven_time", "info", "", off, None, {"file": file, "rate": 1 / step}))
        taken = {name: _interpolated(even, time, values, step) for name, values in read.items()}
        before = np.searchsorted(time, even, side="right") - 1
    before = np.clip(before, 0, None)
    numbers = np.asarray(rows[before] + 1.0, dtype=np.float64)
    return Record(file, even, numbers, taken, None if marks is None else marks[rows][before])


def _distinct_times(
    file: str, time: Array, rows: NDArray[np.int64], read: dict[str, Array], findings: list[Finding]
) -> tuple[Array, NDArray[np.int64], dict[str, Array]]:
    """Times, rows and signals of which none has another's time.

    Rows of one time that tell different signals, or the same, are one row. Where many rows tell other values at the
    time of the row before, the stamps are coarser than the rows, and these are even between them; rows that are not
    even are left out where a few of them share a stamp.

    Raises:
        InputError: most rows share a stamp and are not even, and so have no time.
    """
    first = np.flatnonzero(np.concatenate(([True], np.diff(time) > 0)))
    extra = len(time) - len(first)
    if not extra:
        return time, rows, read
    lowest = {name: np.fmin.reduceat(values, first) for name, values in read.items()}
    doubtful = np.zeros(len(first), dtype=bool)
    for name, values in read.items():
        doubtful |= np.fmax.reduceat(values, first) > lowest[name]
    others = int(np.sum((np.diff(np.append(first, len(time))) - 1)[doubtful]))
    if others > COARSE * len(time):
        even = _between_stamps(file, time, first, findings)
        if even is not None:
            return even, rows, read
    if others:
        findings.append(_time_finding("duplicate_rows", file, others))
    if extra > others:
        findings.append(_time_finding("joined_rows", file, extra - others))
    joined = {name: np.asarray(np.where(doubtful, values[first], lowest[name])) for name, values in read.items()}
    return time[first], rows[first], joined


def _between_stamps(file: str, time: Array, first: NDArray[np.int64], findings: list[Finding]) -> Array | None:
    """Even times of rows whose stamps ``time`` are rounded so coarsely that neighbours share them; None where no even
    rate has these stamps, which jitter and drop-outs make of rows that share few.

    Raises:
        InputError: likewise, of rows that mostly share theirs.
    """
    count, coarse = np.arange(len(time)), float(np.median(np.diff(time[first]))) if len(first) > 1 else 0.0
    step, start = (float(one) for one in np.polyfit(count, time, 1))
    even: Array = np.asarray(start + step * count, dtype=np.float64)
    shared = len(time) - len(first)
    if not coarse or float(np.max(np.abs(even - time))) > 0.75 * coarse:
        if shared <= MOSTLY * len(time):
            return None
        raise InputError(
            f"{file}: {pluralize(shared, 'row')} of {len(time)} have the time of the row before and other values: "
            "the time is too coarse; give [time] rate in its place, or a column that tells it finer"
        )
    findings.append(Finding("coarse_time", "info", "", coarse, None, {"file": file, "rate": 1 / step}))
    return even


def _usual_step(time: Array) -> float:
    """The step that most rows are apart: the mean of those near the median, which is only as fine as the stamps."""
    steps = np.diff(time)
    median = float(np.median(steps))
    usual = steps[np.abs(steps - median) <= 0.5 * median]
    if not len(usual):
        raise InputError(
            f"[time]: its steps are from {steps.min():.3g} to {steps.max():.3g} s, none usual: is it a time?"
        )
    return float(np.mean(usual))


def _places(time: Array, step: float) -> NDArray[np.int64]:
    """Which sample of an even base each row is: the next one, unless rows are missing before it.

    What is expected of a stamp follows the stamps slowly, as a phase-locked loop does, so that neither their jitter
    nor a small error of the step takes a row for another.
    """
    places, expected, place = [0], float(time[0]), 0
    for stamp in time[1:].tolist():
        ahead = max(1, round((stamp - expected) / step))
        place += ahead
        expected += ahead * step
        expected += FOLLOWING * (stamp - expected)
        places.append(place)
    return np.array(places)


def _resolution(time: Array) -> float:
    """What the stamps are rounded to: the largest power of ten that all are multiples of."""
    for digits in range(7):
        scaled = time * 10.0**digits
        if np.max(np.abs(scaled - np.rint(scaled))) < 1e-6 * max(1.0, float(np.max(np.abs(scaled))) * 1e-6):
            return float(10.0**-digits)
    return 0.0


def _spread(values: Array, at: NDArray[np.int64], count: int) -> Array:
    whole = np.full(count, np.nan)
    whole[at] = values
    return whole


def _interpolated(even: Array, time: Array, values: Array, step: float) -> Array:
    """Linear between neighbouring rows that both have a value and are near each other, NaN elsewhere."""
    result: Array = np.interp(even, time, values)
    after = np.clip(np.searchsorted(time, even, side="left"), 1, len(time) - 1)
    result[np.diff(time)[after - 1] > WIDEST_GAP * step] = np.nan
    return result
