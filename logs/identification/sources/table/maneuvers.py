"""Section [manoeuvres] of a map: records of tables are cut into experiments, some of them held out for validation."""

from __future__ import annotations

from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import down_sampled
from logs.identification.data.split import split
from logs.identification.findings import Finding
from logs.identification.results import Array, Estimate, Information, note_finding
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
"""-; by which a rate may miss a whole share of the measured one and still be its means"""


class _Span(NamedTuple):
    start: float
    end: float
    file: str | None = None
    validate: bool = False


class Window(NamedTuple):
    """One manoeuvre: ``[start, end]`` in s as the time reads, or ``{ file, start, end, validate }``."""

    span: _Span
    key: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Window:
        """Of a map's entry.

        Raises:
            InputError: it is neither, or ends before it begins.
        """
        if isinstance(entry, list) and len(entry) == 2:
            entry = {"start": entry[0], "end": entry[1]}
        if not isinstance(entry, dict):
            raise InputError(f"{key} must be [start, end] in s or {{ file = ..., start = ..., end = ... }}")
        span = read_record(_Span, entry, key)
        if not span.end > span.start:
            raise InputError(f"{key} ends at {span.end:g}, before it begins at {span.start:g}")
        return cls(span, key)


class Manoeuvres(NamedTuple):
    """As written; without any of ``windows``, ``rows`` and ``column`` each record is one manoeuvre."""

    windows: tuple[Window, ...] = ()
    rows: tuple[Window, ...] = ()
    """as ``windows``, by the first and last row of numbers, from 1"""
    column: Place | None = None
    """a column of numbers, another in each manoeuvre, 0 or nothing between them"""
    validate: tuple[int, ...] = ()
    """-; numbers from 1 of the manoeuvres that are held out"""
    validate_files: tuple[str, ...] = ()
    """-; files all of whose manoeuvres are held out"""
    validate_share: float | None = None
    """-; share of the files, or of the only file's manoeuvres, that are drawn to be held out"""


class Cut(NamedTuple):
    """The experiments of all files."""

    fitted: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...]
    findings: tuple[Finding, ...]
    """on what was read, left out or changed"""
    delays: tuple[Estimate, ...] = ()
    """s; measured delays of signals, by name"""
    averaged: bool = False
    """-; over the stroke: the noise of neighboring samples is correlated"""


def file_of(one: Experiment) -> str:
    """The file that an experiment of `cut` was cut from, which may be called "log of day.csv"."""
    return one.name.partition(" of ")[2]


def cut(
    tables: list[Columns],
    entries: dict[str, SignalEntry],
    base: TimeSection,
    section: Manoeuvres,
    prepare: PrepareSection | None = None,
) -> Cut:
    """Experiments, named by number and file, on even time bases.

    Raises:
        InputError: a column or window that is not in the tables, or nothing left to fit.
    """
    if sum(bool(told) for told in (section.windows, section.rows, section.column)) > 1:
        raise InputError("[manoeuvres] takes one of windows, rows and column")
    records, findings = [], []
    for columns in tables:
        found, more = records_of(columns, entries, base, section.column)
        records += found
        findings += more
    units = {name: SIGNALS.get(name, entry.unit) for name, entry in entries.items()}
    delays: tuple[Estimate, ...] = ()
    if prepare is not None:
        if prepare.resample is not None and base.resample is not None:
            raise InputError("time.resample and prepare.resample say the same: give one")
        records, units, more, delays = prepared(records, units, prepare)
        findings += more
    pieces = _pieces(records, section)
    experiments = [
        (_experiment(str(number + 1), record, span, units, base.resample), held)
        for number, (record, span, held) in enumerate(pieces)
    ]
    return _split(experiments, section, findings)._replace(delays=delays)


def _split(experiments: list[tuple[Experiment, bool]], section: Manoeuvres, findings: list[Finding]) -> Cut:
    """What is fitted, and what is held out by number, window, file or lot.

    Raises:
        InputError: a manoeuvre or file that is not there, a share beside another choice, or nothing left to fit.
    """
    numbers = _held_out(len(experiments), section.validate)
    files = [file_of(one) for one, _ in experiments]
    for name in section.validate_files:
        if name not in files:
            told = f"manoeuvres.validate_files {name}{did_you_mean(name, files)}: no such file is among those given"
            raise InputError(f"{told}; there are: {', '.join(dict.fromkeys(files))}")
    held = [
        told or number in numbers or file in section.validate_files
        for number, ((_, told), file) in enumerate(zip(experiments, files, strict=True), 1)
    ]
    if section.validate_share is not None:
        if any(held):
            raise InputError("manoeuvres.validate_share draws what is held out: name none beside it")
        flights = {file: [one for (one, _), own in zip(experiments, files, strict=True) if own == file]
                   for file in files}  # fmt: skip
        drawn = split(flights, section.validate_share)
        return Cut(drawn.training, drawn.validation, (*findings, note_finding(Information(drawn.note))))
    pairs = list(zip((one for one, _ in experiments), held, strict=True))
    fitted = tuple(one for one, out in pairs if not out)
    if not fitted:
        raise InputError("every manoeuvre is held out for validation: none is left to fit (manoeuvres.validate)")
    return Cut(fitted, tuple(one for one, out in pairs if out), tuple(findings))


def _held_out(count: int, validate: tuple[int, ...]) -> set[int]:
    for number in validate:
        if not 1 <= number <= count:
            raise InputError(f"manoeuvres.validate: there is no manoeuvre {number}; there are {count}")
    return set(validate)


_Piece = tuple[Record, slice, bool]


def _pieces(records: list[Record], section: Manoeuvres) -> list[_Piece]:
    if section.column is not None:
        return _marked(records)
    windows = section.windows or section.rows
    if not windows:
        return [(record, slice(0, len(record.time)), False) for record in records]
    found = [(window.key, _of_window(records, window, by_time=bool(section.windows))) for window in windows]
    _check_overlap([(key, record, part) for key, pieces in found for record, part, _ in pieces])
    return [piece for _, pieces in found for piece in pieces]


def _check_overlap(parts: list[tuple[str, Record, slice]]) -> None:
    """Refuse windows that hold the same samples: they would count twice, and intervals be too narrow.

    Raises:
        InputError: two do; they may share the sample at which one ends and the other begins.
    """
    for (key, record, part), (other, another, beside) in combinations(parts, 2):
        if record is another and min(part.stop, beside.stop) - max(part.start, beside.start) > 1:
            raise InputError(f"{key} and {other} overlap: what both hold of {record.file} would count twice")


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
        told = [f"{_reach(record, by_time)} of {record.file}" for record in named[:3]]
        few = f"{window.key} holds fewer than {LEAST_SAMPLES} samples of any record; there are {', '.join(told)}"
        raise InputError(few)
    for (one, _, _), (other, _, _) in pairwise(pieces):
        if by_time and one.file == other.file and other.time[0] <= one.time[-1]:
            raise InputError(f"{window.key}: the time of {one.file} goes back, it tells several pieces: give rows")
    return pieces


def _reach(record: Record, by_time: bool) -> str:
    if by_time:
        return f"{record.time[0]:.6g} to {record.time[-1]:.6g} s"
    return f"rows {record.rows[0]:g} to {record.rows[-1]:g}"


def _marked(records: list[Record]) -> list[_Piece]:
    """Runs of one number in the column that tells the manoeuvres."""
    pieces: list[_Piece] = []
    for record in records:
        marks = np.zeros(len(record.time)) if record.marks is None else np.nan_to_num(record.marks)
        edges = [0, *(np.flatnonzero(np.diff(marks)) + 1).tolist(), len(marks)]
        runs = [slice(a, b) for a, b in pairwise(edges) if marks[a] and b - a >= LEAST_SAMPLES]
        pieces += [(record, run, False) for run in runs]
    if not pieces:
        raise InputError(f"manoeuvres.column has no run of {LEAST_SAMPLES} rows with the same number other than 0")
    return pieces


def _experiment(name: str, record: Record, span: slice, units: dict[str, str], resample: float | None) -> Experiment:
    signals = {key: values[span] for key, values in record.signals.items()}
    whole = Experiment(f"manoeuvre {name} of {record.file}", record.time[span], signals, units)
    if resample is not None:
        whole = _slower(whole, resample, record.file)
    if len(whole.time) < LEAST_SAMPLES:
        raise InputError(f"manoeuvre {name} has {pluralize(len(whole.time), 'sample')} left after time.resample")
    return whole


def _slower(experiment: Experiment, rate: float, file: str) -> Experiment:
    """The experiment at ``rate`` Hz: means of so many samples, low-passed where no whole number of them fits."""
    time = experiment.time
    measured = (len(time) - 1) / float(time[-1] - time[0])
    factor = round(measured / rate)
    if factor < 1:
        raise InputError(f"time.resample = {rate:g} Hz is above the {measured:.4g} Hz of {file}")
    if abs(measured / rate - factor) > UNEVEN * factor:
        return down_sampled(experiment, 1 / rate)
    signals = {key: _averaged(values, factor) for key, values in experiment.signals.items()}
    return experiment._replace(time=_averaged(time, factor), signals=signals)


def _averaged(values: Array, factor: int) -> Array:
    """Means over every ``factor`` samples, which holds back what the slower rate cannot show."""
    whole = len(values) // factor
    means: Array = values[: whole * factor].reshape(whole, factor).mean(axis=1)
    return means
