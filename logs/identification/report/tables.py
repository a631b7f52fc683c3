"""The report of what was identified from tables: its chapters are those of a log's, and the steps of regressions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.models.modes import KINDS
from logs.identification.report.document import MEASURED, Bar, Chapter, Intervals, Plot, Series, Table
from logs.identification.report.fits import (
    correlation_chapter,
    fits_chapter,
    parameters_chapter,
    residuals_chapter,
    validation_chapter,
)
from logs.identification.report.labels import meaning, number, sentence, unit
from logs.identification.report.numbers import determined
from logs.identification.report.report import model_chapter, modes_chapter, write_page
from logs.identification.report.result_formatting import finding_line, heading
from logs.identification.report.steps import step_table
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.table.quantities import UNITS
from logs.identification.sources.table.run import TableIdentification
from wingbeat.text import pluralize

FITS = "Measured and modelled outputs of every manoeuvre, in the table's time."
RESIDUALS = (
    "Measured minus model, all manoeuvres one after another. Were they white, 95 % of the autocorrelation would lie"
    " in the band; the intervals of the parameters take the colour into account."
)
HELD = (
    "Held-out manoeuvres are predicted by the model of the others; initial state and biases, where the model has"
    " them, are their own."
)
NONE_HELD = "No manoeuvre was held out: manoeuvres.validate of the map names those that are only predicted."


class Source(NamedTuple):
    """One file that was read."""

    name: str
    sha256: str
    """-; of its bytes, in hexadecimal digits"""


def write_tables_report(path: Path, sources: tuple[Source, ...], results: TableIdentification) -> int:
    """Write the page of what was identified from ``sources``, the map among them; its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    names = tuple(one.name for one in sources)
    more = len(results.files) - 1
    title = f"{names[0]}{f' and {more} more' if more > 0 else ''}: identification"
    return write_page(path, title, names, table_chapters(sources, results))


def table_chapters(sources: tuple[Source, ...], results: TableIdentification) -> tuple[Chapter, ...]:
    """The report: findings first, then what they rest on."""
    fits = results.fits
    numbered = tuple(one for one in fits if one.estimates)
    held = (HELD,) * len(numbered) if results.held_out else ()
    told = (
        _findings(results),
        _data(sources, results),
        modes_chapter(results.modes, {}) if results.modes is not None else None,
        _model(results, fits),
        _parameters(results),
        *(chapter for fit in results.fits for chapter in fit.chapters),
        _steps(results),
        correlation_chapter(numbered),
        _noted(fits_chapter(fits), FITS),
        _noted(residuals_chapter(fits), RESIDUALS),
        validation_chapter(numbered, held) or Chapter("Validation on held-out manoeuvres", (NONE_HELD,)),
    )
    return tuple(chapter for chapter in told if chapter is not None)


def _model(results: TableIdentification, fits: tuple[EstimationResult, ...]) -> Chapter | None:
    """Equations, what the map holds in them, and the constants."""
    if not fits:
        return None
    whole = model_chapter(fits, None)
    parts = tuple(
        part._replace(notes=(*part.notes, *_fixed_values(results.fits, part.notes))) for part in whole.parts
    )
    return whole._replace(tables=_constants(results), parts=parts)


def _fixed_values(fits: tuple[EstimationResult, ...], equations: tuple[str, ...]) -> tuple[str, ...]:
    """What is not estimated, so that who reads the equations knows which of their terms are there.

    One line for all fits of these equations where they hold the same, else one for each, by its place in the map.
    """
    told = [_not_estimated(fit) for fit in fits if fit.equations == equations]
    if len(set(told)) == 1:
        return (f"Fixed, not estimated: {told[0]}.",) if told[0] else ()
    return tuple(f"Fixed, not estimated, in fit {i} of these: {one or 'nothing'}." for i, one in enumerate(told, 1))


def _not_estimated(fit: EstimationResult) -> str:
    return ", ".join(f"{name} = {number(value)}" for name, value in (dict(fit.unnamed) | dict(fit.fixed)).items())


def _noted(chapter: Chapter | None, note: str) -> Chapter | None:
    return None if chapter is None else chapter._replace(notes=(note,))


def _findings(results: TableIdentification) -> Chapter:
    """What a reader wants to know first: the modes by the first method that has them, and every fit's numbers."""
    notes = [sentence(f"{heading(fit)}: {fit.failure.text if fit.failure else _extent(fit)}") for fit in results.fits]
    bars: tuple[Bar, ...] = ()
    if results.modes is not None:
        pairs = [(mode.method, pair) for mode in results.modes.modes for k in KINDS if (pair := mode.of_kind(k))]
        first = pairs[0][0] if pairs else ""
        estimates = [e for method, pair in pairs if method == first for e in determined(pair.estimates)[0]]
        bars = tuple(Bar(e.name, e) for e in estimates)
        notes.append(f"Modes by {first}; {results.modes.statement}." if pairs else sentence(results.modes.statement))
    parts = tuple(_numbers(fit.title, fit.estimates, results.inputs) for fit in results.fits if fit.estimates)
    notes += [f"Not identified: {one.subject}: {one.text}." for one in results.missing]
    return Chapter("Findings", tuple(notes), plots=(Intervals("", bars),) if bars else (), parts=parts)


def _numbers(title: str, results: tuple[Estimate, ...], controls: tuple[str, ...]) -> Chapter:
    bars = tuple(Bar(e.name, e, meaning=meaning(e.name, controls)) for e in results)
    return Chapter(title, plots=(Intervals("", bars),))


def _extent(fit: EstimationResult) -> str:
    numbers = pluralize(len(fit.estimates), "number")
    return (
        f"{numbers} from {pluralize(fit.samples, 'sample')}{'' if fit.status == 'converged' else ', not converged'}"
    )


def _data(sources: tuple[Source, ...], results: TableIdentification) -> Chapter:
    """The files, the manoeuvres, and findings on the data."""
    files = Table(("file", "SHA-256"), tuple((one.name, one.sha256) for one in sources))
    notes = tuple(map(sentence, (*map(finding_line, results.findings), *_absent(results))))
    if not notes:
        notes = ("Every sample was measured; none was dropped or filled.",)
    return Chapter("Data used", notes, (files, _manoeuvres(results), _signals(results)), parts=_inputs(results))


def _absent(results: TableIdentification) -> list[str]:
    """Samples that a signal lacks, manoeuvre by manoeuvre."""
    return [
        f"{one.name}: {int(lost)} of {pluralize(len(values), 'sample')} of {name} not measured"
        for one in results.records
        for name, values in one.signals.items()
        if (lost := np.count_nonzero(~np.isfinite(values)))
    ]


def _manoeuvres(results: TableIdentification) -> Table:
    rows = tuple(
        (
            one.name, "held out" if one.name in results.held_out else "fitted", float(one.time[0]),
            float(one.time[-1] - one.time[0]), float(len(one.time)), 1.0 / one.step,
        )
        for one in results.records
    )  # fmt: skip
    told = f"{pluralize(len(results.experiments), 'manoeuvre')} fitted, {len(results.held_out)} held out."
    return Table(("manoeuvre", "use", "start (s)", "length (s)", "samples", "rate (Hz)"), rows, told)


def _signals(results: TableIdentification) -> Table:
    """Range of every signal over all manoeuvres, and how much of it was measured."""
    rows = []
    for name in results.records[0].signals if results.records else ():
        values = np.concatenate([one.signals[name] for one in results.records])
        there = values[np.isfinite(values)]
        least, most = (float(there.min()), float(there.max())) if len(there) else (math.nan, math.nan)
        told = results.records[0].units.get(name, "")
        rows.append((name, unit(told), least, most, 100.0 * len(there) / len(values)))
    return Table(
        ("signal", "unit", "least", "most", "measured (%)"), tuple(rows), "Signals over all manoeuvres, in SI."
    )


def _inputs(results: TableIdentification) -> tuple[Chapter, ...]:
    plots = tuple(
        Plot(
            f"{name}, all manoeuvres", "time from the start", "s", name, results.records[0].units.get(name, ""),
            tuple(Series("", one.time - one.time[0], one.signals[name], MEASURED) for one in results.records),
        )
        for name in results.inputs
        if results.records and name in results.records[0].signals
    )  # fmt: skip
    return (Chapter("Inputs", plots=plots),) if plots else ()


def _constants(results: TableIdentification) -> tuple[Table, ...]:
    rows = tuple((name, value, unit(UNITS.get(name, ""))) for name, value in results.constants.items() if name != "g")
    return (Table(("constant", "value", "unit"), rows, "What the map tells, in SI."),) if rows else ()


def _parameters(results: TableIdentification) -> Chapter | None:
    """The numbers with their intervals, and below each method where its search began and what was held."""
    if not results.fits:
        return None
    whole = parameters_chapter(results.fits, {}, results.inputs)
    parts = tuple(part._replace(tables=_search(fit)) for part, fit in zip(whole.parts, results.fits, strict=True))
    return whole._replace(parts=parts)


def _search(fit: EstimationResult) -> tuple[Table, ...]:
    values = {one.name: one.value for one in fit.estimates}
    rows = [(name, start, values[name], "estimated") for name, start in fit.initial.items() if name in values]
    rows += [(name, value, value, "fixed by the map") for name, value in fit.fixed.items()]
    told = "Where the search began: by the map, or where it names none by the data."
    return (Table(("parameter", "start", "end", "the end is"), tuple(rows), told),) if rows else ()


def _steps(results: TableIdentification) -> Chapter | None:
    """Every step of every stepwise regression."""
    parts = tuple(Chapter(fit.title, tables=(step_table(fit.steps),)) for fit in results.fits if fit.steps)
    note = "A term enters while its F test, its error by the recipe for coloured residuals, holds it for no chance."
    return Chapter("Steps of the regressions", (note,), parts=parts) if parts else None
