"""The whole report of an identification, chapter by chapter, and its page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import DriveData
from logs.identification.data.maneuvers import Maneuver
from logs.identification.diagnostics.validation import validation
from logs.identification.estimators.flight_modes import fitted
from logs.identification.models.modes import KINDS, Mode, ModesResult
from logs.identification.report.coefficients import aero_chapter
from logs.identification.report.document import MEASURED, Bar, Chapter, Intervals, Plot, Series, Table
from logs.identification.report.drives import drives_chapter, wings_chapter
from logs.identification.report.fits import (
    correlation_chapter,
    fits_chapter,
    parameters_chapter,
    residuals_chapter,
    validation_chapter,
)
from logs.identification.report.flight_path import log_chapter
from logs.identification.report.html import page
from logs.identification.report.labels import sentence
from logs.identification.report.markers import markers_chapter
from logs.identification.report.numbers import POWER_TRUTH, Identification, determined
from logs.identification.report.numbers import rows as all_rows
from logs.identification.results import Array, EstimationResult, from_fitted
from logs.new_files import claim, draft, settle
from wingbeat.errors import InputError
from wingbeat.text import pluralize


class Subject(NamedTuple):
    """What was identified from."""

    title: str
    """-; of the page"""
    file: str
    """-; name of the log or table"""
    sha256: str
    """-; of its bytes, in hexadecimal digits"""
    facts: tuple[tuple[str, str], ...]
    """what else is known of it: word and value"""
    more: tuple[tuple[str, str], ...] = ()
    """-; name and SHA-256 of further logs of the same aircraft"""

    @property
    def sources(self) -> tuple[tuple[str, str], ...]:
        """The logs with their sums, word and value."""
        files = ((self.file, self.sha256), *self.more)
        return tuple(row for name, digest in files for row in (("file", name), ("SHA-256", digest)))


def refuse_existing(path: Path) -> None:
    """Refuse a file that is there, before the long work.

    Raises:
        InputError: it exists, or its folder does not.
    """
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}")


def write_report(
    path: Path,
    subject: Subject,
    results: Identification,
    drive: DriveData | None = None,
    more: tuple[Chapter, ...] = (),
) -> int:
    """Write the page to ``path``, which must not exist; its size in bytes.

    ``drive`` is what the servo models are from, for their scatter plots; ``more`` are chapters of other rooms.

    Raises:
        InputError: the file exists or cannot be written.
    """
    facts = (
        subject.file,
        *(name for name, _ in subject.more),
        *(f"{word} {value}" for word, value in subject.facts[:3]),
    )
    return write_page(path, subject.title, facts, chapters(subject, results, drive, more))


def write_page(path: Path, title: str, facts: tuple[str, ...], told: tuple[Chapter, ...]) -> int:
    """Write the chapters ``told`` below a ``title`` and a line of ``facts`` to ``path``; the page's size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    refuse_existing(path)
    text = page(title, facts, told).encode()
    with draft(path) as (file, name):
        file.write(text)
        settle(file)
        claim(name, path)
    return len(text)


def chapters(
    subject: Subject, results: Identification, drive: DriveData | None = None, more: tuple[Chapter, ...] = ()
) -> tuple[Chapter, ...]:
    """The report: findings first, then what they rest on."""
    older = fitted(results.modes) if results.modes else ()
    paths = (results.path.result,) if results.path else ()
    fits = (*(from_fitted(one, one.method) for one in older), *paths)
    validations = (*(one.validation for one in older), *("" for _ in paths))
    told = [
        _findings(results),
        _data(subject, results),
        modes_chapter(results.modes, results.truths) if results.modes is not None else None,
        drives_chapter(results.torque, results.power, drive, results.truths),
        wings_chapter(results.load, results.frequency, results.truths),
        None if results.aero is None else aero_chapter(results.aero, results.truths),
        log_chapter(results.path) if results.path is not None else None,
        None if results.markers is None else markers_chapter(results.markers),
        *_of_fits(fits, results, validations),
        *more,
    ]
    return tuple(chapter for chapter in told if chapter is not None)


def _of_fits(
    fits: tuple[EstimationResult, ...], results: Identification, validations: tuple[str, ...]
) -> tuple[Chapter | None, ...]:
    if not fits:
        return ()
    return (
        model_chapter(fits, results.modes),
        parameters_chapter(fits, results.truths),
        correlation_chapter(fits),
        fits_chapter(fits),
        residuals_chapter(fits),
        validation_chapter(fits, validations),
    )


def _findings(results: Identification) -> Chapter:
    """What a reader wants to know first."""
    bars = []
    shown = _shown(results.modes)
    for kind in KINDS if shown else ():
        pair = shown.of_kind(kind) if shown else None
        bars += [Bar(e.name, e, results.truths.get(e.name)) for e in determined(pair.estimates if pair else ())[0]]
    for drive, prefix in (
        (results.torque, ""),
        (results.power, "power."),
        (results.load, ""),
        (results.frequency, ""),
    ):
        bars += [Bar(e.name, e, results.truths.get(prefix + e.name)) for e in (drive.estimates if drive else ())]
    bars += [
        Bar(e.name, e, results.truths.get(e.name)) for e in (results.path.result.estimates if results.path else ())
    ]
    for model in results.aero.models if results.aero else ():
        bars += [Bar(e.name, e, results.truths.get(e.name)) for e in model.estimates]
    notes = (
        []
        if results.modes is None
        else [f"{f'Modes by {shown.method}' if shown else 'No modes'}; {results.modes.statement}."]
    )
    notes += [f"Not identified: {one.name}: {one.reason}." for one in results.missing]
    if any(row.truth is not None for row in all_rows(results)):
        notes.append(
            "The flight was simulated: true values stand beside the estimates, red where outside the interval."
        )
    return Chapter("Findings", tuple(notes), plots=(Intervals("", tuple(bars)),) if bars else ())


def _shown(modes: ModesResult | None) -> Mode | None:
    """The first method that gave a short period or phugoid."""
    given = (mode for mode in modes.modes if any(mode.of_kind(kind) for kind in KINDS)) if modes else ()
    return next(iter(given), None)


def _data(subject: Subject, results: Identification) -> Chapter:
    """The file, the manoeuvres, and what was left out or taken from elsewhere."""
    rows = (*subject.sources, *subject.facts)
    tables = [Table(("", ""), rows)]
    notes: tuple[str, ...] = ()
    parts: tuple[Chapter, ...] = ()
    if results.modes is not None:
        notes = tuple(map(sentence, results.modes.notes))
        tried = validation(results.modes)
        notes += () if tried is None else (sentence(f"held out: {tried.statement}"),)
        if results.modes.maneuvers:
            tables.append(_maneuvers(results.modes.maneuvers))
            parts = (_inputs(results.modes.maneuvers),)
    if any(name.startswith("power.") for name in results.truths):
        notes += (f"True values of the power model: {POWER_TRUTH}.",)
    return Chapter("Data used", notes, tuple(tables), parts=parts)


def _maneuvers(maneuvers: tuple[Maneuver, ...]) -> Table:
    lengths = [float(m.experiment.time[-1] - m.experiment.time[0]) + m.period for m in maneuvers]
    several = any(m.flight is not None for m in maneuvers)
    lines = tuple(
        (
            *(
                (m.flight.name, f"{m.flight.local_number(m.number)}", m.flight.local_time(m.begin))
                if m.flight is not None
                else (f"{m.number}", m.begin)
            ),
            length,
            length / m.period,
            1.0 / m.period,
            m.airspeed,
            math.degrees(float(np.ptp(m.command))),
            math.degrees(float(np.ptp(m.experiment.signals["q"]))),
        )
        for m, length in zip(maneuvers, lengths, strict=True)
    )
    columns = (
        *(("flight",) if several else ()), "manoeuvre", "start (s)", "length (s)", "wing strokes", "flapping (Hz)",
        "airspeed (m/s)", "elevator, range (°)", "pitch rate, range (°/s)",
    )  # fmt: skip
    return Table(columns, lines, f"Used: {pluralize(len(lines), 'manoeuvre')}; ranges are from least to greatest.")


def _inputs(maneuvers: tuple[Maneuver, ...]) -> Chapter:
    """The elevator of every maneuver over each other."""
    series = tuple(Series("", m.command_time, _degrees(m.command), MEASURED) for m in maneuvers)
    plot = Plot("Elevator command, all manoeuvres", "time from the start", "s", "change of elevator", "°", series)
    return Chapter("Inputs", plots=(plot,))


def _degrees(angle: Array) -> Array:
    return np.asarray(np.degrees(angle), dtype=np.float64)


def modes_chapter(result: ModesResult, truths: Mapping[str, float]) -> Chapter:
    """Every number by every method below each other, and whether the methods agree."""
    parts, open_ones = [], list[tuple[str, str, str]]()
    for kind in KINDS:
        pairs = [(mode.method, pair) for mode in result.modes if (pair := mode.of_kind(kind)) is not None]
        told = [(method, *determined(pair.estimates)) for method, pair in pairs]
        open_ones += [(method, one.name.replace("_", " "), one.reason) for method, _, wide in told for one in wide]
        names = dict.fromkeys(e.name for _, pair in pairs for e in pair.estimates)
        bars = tuple(
            Bar(method, e, truths.get(name))
            for name in names
            for method, estimates, _ in told
            for e in estimates
            if e.name == name
        )
        if bars:
            parts.append(Chapter(kind.replace("_", " ").capitalize(), plots=(Intervals("", bars),)))
    bars = tuple(Bar(mode.method, e, truths.get(e.name)) for mode in result.modes for e in mode.divergence)
    if bars:
        parts.append(Chapter("Divergence", plots=(Intervals("", bars),)))
    refused = [(mode.method, one) for mode in result.modes for one in mode.unidentified]
    rows = (*((method, one.name.replace("_", " "), one.reason) for method, one in refused), *open_ones)
    tables = (Table(("method", "not identified", "why"), rows),) if rows else ()
    return Chapter("Modes", (sentence(result.statement),), tables, parts=tuple(parts))


def model_chapter(fits: tuple[EstimationResult, ...], result: ModesResult | None) -> Chapter:
    """Equations and the flight that they are about."""
    methods = {fit.equations: [other.title for other in fits if other.equations == fit.equations] for fit in fits}
    parts = tuple(Chapter(" and ".join(dict.fromkeys(names)), equations) for equations, names in methods.items())
    tables: tuple[Table, ...] = ()
    if result is not None and result.reference is not None:
        about = result.reference
        rows: list[tuple[str, float, str]] = [
            ("u₀, airspeed along x", about.u, "m/s"),
            ("w₀, airspeed along z", about.w, "m/s"),
            ("airspeed", about.airspeed, "m/s"),
            ("θ₀, pitch", math.degrees(about.pitch), "°"),
            ("angle of attack", math.degrees(math.atan2(about.w, about.u)), "°"),
            ("elevator command", math.degrees(about.elevator), "°"),
        ]
        if result.wing_period:
            rows.append(("flapping", 1.0 / result.wing_period, "Hz"))
        tables = (Table(("steady flight", "value", "unit"), tuple(rows), "Mean over the manoeuvres."),)
    return Chapter("Model", (), tables, parts=parts)
