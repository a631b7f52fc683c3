"""Section [maneuvers] of a map: records of tables are cut into experiments, some of them held out for validation."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.maneuvers import split
from logs.identification.data.resampling import cut, down_sampled
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, Estimate
from logs.identification.sources.table.columns import Columns
from logs.identification.sources.table.prepare import PrepareSection, prepared
from logs.identification.sources.table.quantities import SIGNALS
from logs.identification.sources.table.signals import (
    LEAST_SAMPLES,
    Place,
    Record,
    SignalEntry,
    TimeSection,
    records_of,
)
from wingbeat.errors import InputError
from wingbeat.schema import read_record
from wingbeat.text import did_you_mean, pluralize

UNEVEN = 0.01
"""-; relative deviation of a rate from an integer fraction of the measured one, up to which rows are averaged"""
STEADY = ("alpha", "beta", "theta", "phi", "p", "q", "r")
"""states, which are continuous in time; an acceleration may follow an input at once"""
NEIGHBORS, LEAST_PIECE = 4, 16
"""-; samples on either side through which lines are laid; least samples of a maneuver"""
ABOVE_NOISE, ABOVE_MOTION, OF_RANGE, QUANTA = 8.0, 3.0, 0.05, 2.5
"""-; least jump over the usual gap between the lines, the largest step near it, the range, and the resolution"""
FULL_TURN = 0.9 * 2.0 * np.pi
"""rad; a larger jump is an angle that wraps"""

register({
    "discontinuity": Entry(
        "{where}: {subject} jump at {times} s; cut there",
        "States are continuous: maneuvers were written one after the other under one running time.",
        "set the limits in [maneuvers]",
    ),
    "validation_sample": Entry(
        "held out: {value:.0f} of {limit:.0f} {kind} ({names})", "Sample by validation_fraction."
    ),
})  # fmt: skip


class _Span(NamedTuple):
    start: float
    end: float
    file: str | None = None
    validate: bool = False


class Window(NamedTuple):
    """One maneuver: ``[start, end]`` in s of the table's time, or ``{ file, start, end, validate }``."""

    span: _Span
    key: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Window:
        """Read a map's entry.

        Raises:
            InputError: neither form, or an end before the start.
        """
        if isinstance(entry, list) and len(entry) == 2:
            entry = {"start": entry[0], "end": entry[1]}
        if not isinstance(entry, dict):
            raise InputError(f"{key} must be [start, end] in s or {{ file = ..., start = ..., end = ... }}")
        span = read_record(_Span, entry, key)
        if not span.end > span.start:
            raise InputError(f"{key} ends at {span.end:g}, before it begins at {span.start:g}")
        return cls(span, key)


class Maneuvers(NamedTuple):
    """Section [maneuvers]; without ``windows``, ``rows`` and ``column`` each record is one maneuver."""

    windows: tuple[Window, ...] = ()
    rows: tuple[Window, ...] = ()
    """as ``windows``, by the first and last row of numbers, from 1"""
    column: Place | None = None
    """a column of numbers, another in each maneuver, 0 or nothing between them"""
    validate: tuple[int, ...] = ()
    """-; numbers from 1 of the maneuvers that are held out"""
    validate_files: tuple[str, ...] = ()
    """-; files all of whose maneuvers are held out"""
    validation_fraction: float | None = None
    """-; fraction of the files, or of the only file's maneuvers, that is drawn to be held out"""


class DataSplit(NamedTuple):
    """The experiments of all files, and what is known besides."""

    fitted: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...]
    findings: tuple[Finding, ...] = ()
    """on what was read, left out or changed"""
    delays: tuple[Estimate, ...] = ()
    """s; measured delays of signals, by name"""
    constants: Mapping[str, float] = {}
    """SI; of the map"""
    fill: float | None = None
    """s; longest gap of an input that is interpolated; None for the default"""
    averaged: bool = False
    """-; over the stroke: the noise of neighboring samples is correlated"""

    @property
    def all(self) -> tuple[Experiment, ...]:
        """Every experiment, fitted ones first."""
        return (*self.fitted, *self.held_out)

    def map(self, change: Any) -> DataSplit:
        """The split with ``change`` (experiment -> experiment, or -> several) applied to each experiment."""
        parts = []
        for part in (self.fitted, self.held_out):
            changed = [change(one) for one in part]
            parts.append(tuple(x for one in changed for x in ((one,) if isinstance(one, Experiment) else tuple(one))))
        return self._replace(fitted=parts[0], held_out=parts[1])


def files_of(experiments: tuple[Experiment, ...]) -> str:
    """The names of the files that the experiments are from."""
    return ", ".join(dict.fromkeys(one.file for one in experiments))


def data_split(
    tables: list[Columns],
    entries: dict[str, SignalEntry],
    base: TimeSection,
    section: Maneuvers,
    prepare: PrepareSection | None = None,
) -> DataSplit:
    """Experiments, named by number and file, on even time bases.

    Raises:
        InputError: a column or window that is not in the tables, or nothing left to fit.
    """
    if sum(bool(one) for one in (section.windows, section.rows, section.column)) > 1:
        raise InputError("[maneuvers] takes one of windows, rows and column")
    records, findings = [], []
    for columns in tables:
        found, more = records_of(columns, entries, base, section.column)
        records += found
        findings += more
    units = {name: SIGNALS.get(name, entry.unit) for name, entry in entries.items()}
    delays: tuple[Estimate, ...] = ()
    if prepare is not None:
        if prepare.resample is not None and base.resample is not None:
            raise InputError("time.resample and prepare.resample are the same: give one")
        records, units, more, delays = prepared(records, units, prepare)
        findings += more
    smooth = {} if prepare is None else prepare.smooth
    experiments = [
        (_experiment(number, record, span, units, base.resample)._replace(smoothed=smooth), held)
        for number, (record, span, held) in enumerate(_pieces(records, section), 1)
    ]
    return _split(experiments, section, findings)._replace(delays=delays, fill=base.fill)


def _split(experiments: list[tuple[Experiment, bool]], section: Maneuvers, findings: list[Finding]) -> DataSplit:
    """What is fitted, and what is held out by number, window, file or fraction.

    Raises:
        InputError: a maneuver or file that is not there, a fraction beside another choice, or nothing left to fit.
    """
    count, files = len(experiments), [one.file for one, _ in experiments]
    for number in section.validate:
        if not 1 <= number <= count:
            raise InputError(f"maneuvers.validate: there is no maneuver {number}; there are {count}")
    for name in section.validate_files:
        if name not in files:
            text = f"maneuvers.validate_files {name}{did_you_mean(name, files)}: no such file is among those given"
            raise InputError(f"{text}; there are: {', '.join(dict.fromkeys(files))}")
    held = [
        by_window or one.number in section.validate or one.file in section.validate_files
        for one, by_window in experiments
    ]
    if section.validation_fraction is not None:
        if any(held):
            raise InputError("maneuvers.validation_fraction draws what is held out: name none beside it")
        by_file = {name: [one for one, _ in experiments if one.file == name] for name in files}
        drawn = split(by_file, section.validation_fraction)
        details = {"kind": drawn.kind, "names": ", ".join(drawn.held_out)}
        finding = Finding("validation_sample", "info", "", len(drawn.held_out), drawn.groups, details)
        return DataSplit(drawn.training, drawn.validation, (*findings, finding))
    pairs = [(one, out) for (one, _), out in zip(experiments, held, strict=True)]
    fitted = tuple(one for one, out in pairs if not out)
    if not fitted:
        raise InputError("all maneuvers are held out for validation, none is left to fit (maneuvers.validate)")
    return DataSplit(fitted, tuple(one for one, out in pairs if out), tuple(findings))


_Piece = tuple[Record, slice, bool]


def _pieces(records: list[Record], section: Maneuvers) -> list[_Piece]:
    if section.column is not None:
        return _marked(records)
    windows = section.windows or section.rows
    if not windows:
        return [(record, slice(0, len(record.time)), False) for record in records]
    found = [(window.key, _of_window(records, window, by_time=bool(section.windows))) for window in windows]
    _check_overlap([(key, record, part) for key, pieces in found for record, part, _ in pieces])
    return [piece for _, pieces in found for piece in pieces]


def _check_overlap(parts: list[tuple[str, Record, slice]]) -> None:
    """Reject windows with common samples: they would count twice, and intervals be too narrow.

    Raises:
        InputError: two windows share more than the sample at which one ends and the other begins.
    """
    for (key, record, part), (other, another, second) in combinations(parts, 2):
        if record is another and min(part.stop, second.stop) - max(part.start, second.start) > 1:
            raise InputError(f"{key} and {other} overlap: their common samples of {record.file} would count twice")


def _of_window(records: list[Record], window: Window, by_time: bool) -> list[_Piece]:
    span, pieces = window.span, []
    named = [record for record in records if span.file in (None, record.file)]
    if not named:
        known = ", ".join(sorted({record.file for record in records}))
        raise InputError(f"{window.key}: there is no file {span.file!r}; there are: {known}")
    for record in named:
        base = record.time if by_time else record.rows
        slack = 1e-6 * (record.time[1] - record.time[0]) if by_time else 0.0
        inside = np.flatnonzero((base >= span.start - slack) & (base <= span.end + slack))
        if len(inside) >= LEAST_SAMPLES:
            pieces.append((record, slice(int(inside[0]), int(inside[-1]) + 1), span.validate))
    if not pieces:
        reach = [f"{_reach(record, by_time)} of {record.file}" for record in named[:3]]
        few = f"{window.key} has fewer than {LEAST_SAMPLES} samples of any record; there are {', '.join(reach)}"
        raise InputError(few)
    for (one, _, _), (other, _, _) in pairwise(pieces):
        if by_time and one.file == other.file and other.time[0] <= one.time[-1]:
            raise InputError(f"{window.key}: the time of {one.file} goes back, several pieces have it: give rows")
    return pieces


def _reach(record: Record, by_time: bool) -> str:
    if by_time:
        return f"{record.time[0]:.6g} to {record.time[-1]:.6g} s"
    return f"rows {record.rows[0]:g} to {record.rows[-1]:g}"


def _marked(records: list[Record]) -> list[_Piece]:
    """Runs of one number in the column with the numbers of the maneuvers."""
    pieces: list[_Piece] = []
    for record in records:
        marks = np.zeros(len(record.time)) if record.marks is None else np.nan_to_num(record.marks)
        edges = [0, *(np.flatnonzero(np.diff(marks)) + 1).tolist(), len(marks)]
        spans = [slice(a, b) for a, b in pairwise(edges) if marks[a] and b - a >= LEAST_SAMPLES]
        pieces += [(record, span, False) for span in spans]
    if not pieces:
        raise InputError(f"maneuvers.column has no run of {LEAST_SAMPLES} rows with the same number other than 0")
    return pieces


def _experiment(
    number: int, record: Record, span: slice, units: dict[str, str], resample: float | None
) -> Experiment:
    signals = {key: values[span] for key, values in record.signals.items()}
    name = f"maneuver {number} of {record.file}"
    one = Experiment(name, record.time[span], signals, units, file=record.file, number=number)
    if resample is not None:
        one = _slower(one, resample)
    if len(one.time) < LEAST_SAMPLES:
        raise InputError(f"maneuver {number} has {pluralize(len(one.time), 'sample')} left after time.resample")
    return one


def _slower(one: Experiment, rate: float) -> Experiment:
    """The experiment at ``rate`` Hz: means of an integer number of samples, else low-passed and resampled."""
    measured = 1.0 / one.step
    factor = round(measured / rate)
    if factor < 1:
        raise InputError(f"time.resample = {rate:g} Hz is above the {measured:.4g} Hz of {one.file}")
    if abs(measured / rate - factor) > UNEVEN * factor:
        return down_sampled(one, 1 / rate)

    def means(values: Array) -> Array:
        count = len(values) // factor
        return np.asarray(np.asarray(values)[: count * factor].reshape(count, factor).mean(axis=1))

    return one._replace(time=means(one.time), signals={key: means(values) for key, values in one.signals.items()})


def split_at_discontinuities(data: DataSplit) -> DataSplit:
    """The maneuvers, cut where a state jumps, each with a finding.

    Fitted as one maneuver, two would share an initial state and biases; a cut costs only another initial state.
    """
    findings: list[Finding] = []

    def pieces(one: Experiment) -> tuple[Experiment, ...]:
        places, names = discontinuities(one)
        if not places:
            return (one,)
        details = {"where": one.name, "times": ", ".join(f"{one.time[place]:.6g}" for place in places)}
        findings.append(Finding("discontinuity", "warning", ", ".join(names), details=details))
        return tuple(
            cut(one, slice(start, stop))._replace(name=f"maneuver {one.number}, part {part} of {one.file}")
            for part, (start, stop) in enumerate(pairwise((0, *places, len(one.time))), 1)
        )

    changed = data.map(pieces)
    return changed._replace(findings=(*data.findings, *findings))


def discontinuities(one: Experiment) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """First samples after a jump of a state, and the names of those that jump."""
    known = [name for name in STEADY if name in one.signals]
    if not known or len(one.time) < 2 * LEAST_PIECE:
        return (), ()
    jumping = np.array([_jumps(np.asarray(one.signals[name], dtype=np.float64)) for name in known])
    jumping[:, : LEAST_PIECE - 1] = False
    jumping[:, len(one.time) - LEAST_PIECE :] = False
    places: list[int] = []
    for before in np.flatnonzero(jumping.any(axis=0)).tolist():
        if not places or before + 1 - places[-1] >= LEAST_PIECE:
            places.append(before + 1)
    rows = [place - 1 for place in places]
    return tuple(places), tuple(n for n, row in zip(known, jumping[:, rows], strict=True) if row.any())


def _jumps(values: Array) -> Array:
    """(N - 1,) of bool; whether lines through the samples before and after each interval leave a gap that is
    significantly above the noise, the motion near it and the resolution."""
    steps, finite = np.abs(np.diff(values)), np.isfinite(values)
    moved = steps[steps > 0]
    if not len(moved) or not np.nanmedian(steps) > 0:  # sampled more slowly than the rows, or at rest
        return np.zeros(len(steps), dtype=bool)
    span = float(np.ptp(np.percentile(values[finite], (1.0, 99.0))))
    place = np.arange(NEIGHBORS) - (NEIGHBORS - 1) / 2.0
    line = 1.0 / NEIGHBORS + place * (NEIGHBORS / 2.0) / float(place @ place)
    windows = np.lib.stride_tricks.sliding_window_view(values, 2 * NEIGHBORS)
    gaps, near = np.full((2, len(steps)), np.nan)
    inner = slice(NEIGHBORS - 1, len(steps) - NEIGHBORS + 1)
    gaps[inner] = np.abs(windows[:, NEIGHBORS:] @ line[::-1] - windows[:, :NEIGHBORS] @ line)
    others = np.lib.stride_tricks.sliding_window_view(steps, 2 * NEIGHBORS - 1)
    near[inner] = np.delete(others, NEIGHBORS - 1, axis=1).max(axis=1)
    noise = ABOVE_NOISE * 1.4826 * float(np.nanmedian(gaps)) if np.isfinite(gaps).any() else np.inf
    least = np.maximum(max(noise, OF_RANGE * span, QUANTA * float(moved.min())), ABOVE_MOTION * near)
    return np.asarray((gaps > least) & (steps > least) & (steps < FULL_TURN))
