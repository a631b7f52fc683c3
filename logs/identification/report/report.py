"""Report of an identification from logs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import DriveData
from logs.identification.data.maneuvers import Maneuver
from logs.identification.diagnostics.agreement import validation
from logs.identification.estimators.flight_modes import OUTPUT_ERROR, cross_validated
from logs.identification.models.modes import KINDS, ModesResult
from logs.identification.report.markers import markers_chapter
from logs.identification.report.methods import method_chapter, missing_remarks, remarks
from logs.identification.report.numbers import FOLLOWS, POWER_TRUTH, Identification, determined
from logs.identification.report.subjects import aero_chapter, drives_chapter, log_path_chapter, wings_chapter
from logs.identification.results import Array, Estimate, EstimationResult
from logs.pages.document import MEASURED, Bar, Chapter, Intervals, Plot, Remark, Series, Table
from logs.pages.labels import capitalized, sentence
from logs.pages.render import write_page
from wingbeat.text import pluralize

SUMMARY = "Summary"


class Subject(NamedTuple):
    """Source of the identification."""

    title: str
    """-; of the page"""
    file: str
    """-; name of the log or table"""
    sha256: str
    """-; of its bytes, in hexadecimal digits"""
    facts: tuple[tuple[str, str], ...]
    """further facts: name and value"""
    more: tuple[tuple[str, str], ...] = ()
    """-; name and SHA-256 of further logs of the same aircraft"""

    @property
    def sources(self) -> tuple[tuple[str, str], ...]:
        """The logs with their digests, name and value."""
        files = ((self.file, self.sha256), *self.more)
        return tuple(row for name, digest in files for row in (("file", name), ("SHA-256", digest)))


def write_report(path: Path, subject: Subject, results: Identification, drive: DriveData | None = None) -> int:
    """Write the page to ``path``, which must not exist; return its size in bytes.

    ``drive`` are the data of the servo models, for their scatter plots.

    Raises:
        InputError: the file exists or cannot be written.
    """
    files = (subject.file, *(name for name, _ in subject.more))
    facts = (*files, *(f"{name} {value}" for name, value in subject.facts[:3]))
    return write_page(path, subject.title, facts, chapters(subject, results, drive), signed=True)


def chapters(subject: Subject, results: Identification, drive: DriveData | None = None) -> tuple[Chapter, ...]:
    """Return the report: the summary, the data, and a chapter for each subject and method."""
    fits, note = method_results(results)
    every = [
        _summary(results),
        _data(subject, results),
        modes_chapter(results.modes, results.truths) if results.modes is not None else None,
        drives_chapter(results.torque, results.power, drive, results.truths),
        wings_chapter(results.load, results.frequency, results.truths),
        None if results.aero is None else aero_chapter(results.aero, results.truths),
        log_path_chapter(results.path) if results.path is not None else None,
        None if results.markers is None else markers_chapter(results.markers),
        model_chapter(fits, results.modes) if fits else None,
        *(method_chapter(fit, results.truths, note=note if fit.title == OUTPUT_ERROR else "") for fit in fits),
    ]
    return tuple(chapter for chapter in every if chapter is not None)


def method_results(results: Identification) -> tuple[tuple[EstimationResult, ...], str]:
    """Return the results of the methods with a model, output error with predicted maneuvers, and a note on these."""
    fits, note = list[EstimationResult](), ""
    for one in results.modes.results if results.modes is not None else ():
        fit = one._replace(title=one.title or one.method)
        if one.method == OUTPUT_ERROR and one.estimates and results.modes is not None:
            predicted = [] if any(piece.held_out for piece in one.series) else cross_validated(results.modes.flight)
            fit = fit._replace(series=(*one.series, *predicted))
            note = _validation_note(fit, results.modes)
        fits.append(fit)
    return (*fits, *((results.path.result,) if results.path is not None else ())), note


def _validation_note(fit: EstimationResult, modes: ModesResult) -> str:
    count = len({one.experiment for one in fit.series if one.held_out})
    if not count:
        return "No maneuver was held out: there are too few."
    total = len(modes.maneuvers) + count * bool(modes.held_out)
    return (
        f"{count} of {total} maneuvers were held out and predicted by the derivatives of the others, with initial"
        " state and sensor biases of the maneuver itself."
    )


def _summary(results: Identification) -> Chapter:
    """Return the estimates of each subject and the findings on them."""
    method, modal = modal_summary(results.modes)
    listed = [(one, "") for one in modal]
    frequency = None if results.frequency is None else results.frequency.result
    for part, prefix in ((results.torque, ""), (results.power, "power."), (results.load, ""), (frequency, "")):
        listed += [(one, prefix) for one in (part.estimates if part is not None else ())]
    listed += [(one, "") for one in (results.path.result.estimates if results.path is not None else ())]
    models = results.aero.models if results.aero is not None else ()
    listed += [(one, "") for model in models for one in model.estimates]
    bars = [Bar(e.name, e, results.truths.get(prefix + e.name)) for e, prefix in listed]
    notes = []
    if results.modes is not None:
        notes.append(f"{f'Modes by {method}' if method else 'No modes'}; {results.modes.statement}.")
    if any(bar.truth is not None for bar in bars):
        notes.append("Simulated flight: true values are red if outside the interval.")
    return Chapter(SUMMARY, tuple(notes), plots=_compared(bars), findings=_findings(results))


def _findings(results: Identification) -> tuple[Remark, ...]:
    """Return what is not identified, then the findings on modes and flight path."""
    modes = [one for one in results.modes.findings if one.code != "note"] if results.modes is not None else ()
    path = results.path.result.findings if results.path is not None else ()
    return (*missing_remarks(results.missing), *remarks((*modes, *path)))


def _compared(bars: Iterable[Bar]) -> tuple[Intervals, ...]:
    every = tuple(bars)
    return (Intervals("", every),) if every else ()


def modal_summary(modes: ModesResult | None) -> tuple[str, list[Estimate]]:
    """Return the first method with a short period or phugoid, and their frequencies and dampings; empty if none."""
    for mode in modes.modes if modes is not None else ():
        pairs = [pair for kind in KINDS if (pair := mode.of_kind(kind)) is not None]
        if pairs:
            every = (one for pair in pairs for one in determined(pair.estimates)[0])
            return mode.method, [one for one in every if not FOLLOWS.search(one.name)]
    return "", []


def _data(subject: Subject, results: Identification) -> Chapter:
    """Return the files, the maneuvers and notes on them."""
    tables = [Table(("source", ""), (*subject.sources, *subject.facts))]
    notes: tuple[str, ...] = ()
    plots: tuple[Plot, ...] = ()
    if results.modes is not None:
        notes = tuple(sentence(one.text) for one in results.modes.findings if one.code == "note")
        predicted = validation(results.modes)
        notes += () if predicted is None else (sentence(f"held out: {predicted.statement}"),)
        if results.modes.maneuvers:
            tables.append(_maneuvers(results.modes.maneuvers))
            plots = (_inputs(results.modes.maneuvers),)
    if any(name.startswith("power.") for name in results.truths):
        notes += (f"True values of the power model: {POWER_TRUTH}.",)
    return Chapter("Data", notes, tuple(tables), plots)


def _maneuvers(maneuvers: tuple[Maneuver, ...]) -> Table:
    lengths = [float(m.experiment.time[-1] - m.experiment.time[0]) + m.period for m in maneuvers]
    several = any(m.flight is not None for m in maneuvers)
    rows = tuple(
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
        *(("flight",) if several else ()), "maneuver", "start (s)", "length (s)", "wing strokes", "flapping (Hz)",
        "airspeed (m/s)", "elevator, range (°)", "pitch rate, range (°/s)",
    )  # fmt: skip
    return Table(columns, rows, f"{pluralize(len(rows), 'maneuver')}; range: maximum minus minimum.")


def _inputs(maneuvers: tuple[Maneuver, ...]) -> Plot:
    """Return the elevator of all maneuvers."""
    series = tuple(Series("", m.command_time, _degrees(m.command), MEASURED) for m in maneuvers)
    return Plot("Elevator command of all maneuvers", "time since the start", "s", "change of elevator", "°", series)


def _degrees(angle: Array) -> Array:
    return np.asarray(np.degrees(angle), dtype=np.float64)


def modes_chapter(result: ModesResult, truths: Mapping[str, float]) -> Chapter:
    """Return every modal parameter by every method, and whether the methods agree."""
    parts, withheld = [], list[Remark]()
    for kind in KINDS:
        pairs = [(mode.method, pair) for mode in result.modes if (pair := mode.of_kind(kind)) is not None]
        split = [(method, *determined(pair.estimates)) for method, pair in pairs]
        for method, _, wide in split:
            withheld += missing_remarks(one._replace(subject=f"{method}, {one.subject}") for one in wide)
        names = dict.fromkeys(e.name for _, pair in pairs for e in pair.estimates)
        bars = [
            Bar(method, e, truths.get(name))
            for name in names
            for method, estimates, _ in split
            for e in estimates
            if e.name == name
        ]
        if bars:
            parts.append(Chapter(kind.replace("_", " ").capitalize(), plots=_compared(bars)))
    bars = [Bar(mode.method, e, truths.get(e.name)) for mode in result.modes for e in mode.divergence]
    if bars:
        parts.append(Chapter("Divergence", plots=_compared(bars)))
    lost = (one._replace(subject=f"{mode.method}, {one.subject}") for mode in result.modes for one in mode.withheld)
    findings = (*missing_remarks(lost), *withheld)
    return Chapter("Modes", (sentence(result.statement),), parts=tuple(parts), findings=findings)


def model_chapter(fits: tuple[EstimationResult, ...], result: ModesResult | None) -> Chapter:
    """Return the equations and the steady flight that they are linear about."""
    titles: dict[tuple[str, ...], list[str]] = {}
    for fit in fits:
        titles.setdefault(fit.equations, []).append(fit.title)
    parts = tuple(
        Chapter(capitalized(" and ".join(dict.fromkeys(same))), equations) for equations, same in titles.items()
    )
    tables: tuple[Table, ...] = ()
    if result is not None and result.reference is not None:
        trim = result.reference
        rows: list[tuple[str, float, str]] = [
            ("u₀, airspeed along x", trim.u, "m/s"),
            ("w₀, airspeed along z", trim.w, "m/s"),
            ("airspeed", trim.airspeed, "m/s"),
            ("θ₀, pitch", math.degrees(trim.pitch), "°"),
            ("angle of attack", math.degrees(math.atan2(trim.w, trim.u)), "°"),
            ("elevator command", math.degrees(trim.elevator), "°"),
        ]
        if result.wing_period:
            rows.append(("flapping", 1.0 / result.wing_period, "Hz"))
        tables = (Table(("steady flight", "value", "unit"), tuple(rows), "Mean over the maneuvers."),)
    return Chapter("Model", (), tables, parts=parts)
