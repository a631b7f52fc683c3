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
from logs.identification.report.result_formatting import heading
from logs.identification.report.steps import step_table
from logs.identification.results import Estimate, Fitted
from logs.identification.sources.table.constants import UNITS
from logs.identification.tables.results import TableFit, TableIdentification
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


def write_tables_report(path: Path, sources: tuple[Source, ...], found: TableIdentification) -> int:
    """Write the page of what was identified from ``sources``, the map among them; its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    names = tuple(one.name for one in sources)
    more = len(found.files) - 1
    title = f"{names[0]}{f' and {more} more' if more > 0 else ''}: identification"
    return write_page(path, title, names, table_chapters(sources, found))


def table_chapters(sources: tuple[Source, ...], found: TableIdentification) -> tuple[Chapter, ...]:
    """The report: findings first, then what they rest on."""
    fits = tuple(one.fitted._replace(validation=HELD if found.held_out else "") for one in found.fits)
    numbered = tuple(one for one in fits if one.estimates)
    told = (
        _findings(found),
        _data(sources, found),
        modes_chapter(found.modes, {}) if found.modes is not None else None,
        _model(found, fits),
        _parameters(found),
        *(chapter for fit in found.fits for chapter in fit.chapters),
        _steps(found),
        correlation_chapter(numbered),
        _noted(fits_chapter(fits), FITS),
        _noted(residuals_chapter(fits), RESIDUALS),
        validation_chapter(numbered) or Chapter("Validation on held-out manoeuvres", (NONE_HELD,)),
    )
    return tuple(chapter for chapter in told if chapter is not None)


def _model(found: TableIdentification, fits: tuple[Fitted, ...]) -> Chapter | None:
    """Equations, what the map holds in them, and the constants."""
    if not fits:
        return None
    whole = model_chapter(fits, None)
    parts = tuple(part._replace(notes=(*part.notes, *_held(found.fits, part.notes))) for part in whole.parts)
    return whole._replace(tables=_constants(found), parts=parts)


def _held(fits: tuple[TableFit, ...], equations: tuple[str, ...]) -> tuple[str, ...]:
    """What is not estimated, so that who reads the equations knows which of their terms are there.

    One line for all fits of these equations where they hold the same, else one for each, by its place in the map.
    """
    told = [_not_estimated(fit) for fit in fits if fit.fitted.equations == equations]
    if len(set(told)) == 1:
        return (f"Held, not estimated: {told[0]}.",) if told[0] else ()
    return tuple(f"Held, not estimated, in fit {i} of these: {one or 'nothing'}." for i, one in enumerate(told, 1))


def _not_estimated(fit: TableFit) -> str:
    return ", ".join(f"{name} = {number(value)}" for name, value in (dict(fit.unnamed) | dict(fit.fixed)).items())


def _noted(chapter: Chapter | None, note: str) -> Chapter | None:
    return None if chapter is None else chapter._replace(notes=(note,))


def _findings(found: TableIdentification) -> Chapter:
    """What a reader wants to know first: the modes by the first method that has them, and every fit's numbers."""
    notes = [sentence(f"{heading(fit)}: {fit.failure or _extent(fit)}") for fit in found.fits]
    bars: tuple[Bar, ...] = ()
    if found.modes is not None:
        pairs = [(mode.method, pair) for mode in found.modes.modes for k in KINDS if (pair := mode.of_kind(k))]
        first = pairs[0][0] if pairs else ""
        estimates = [e for method, pair in pairs if method == first for e in determined(pair.estimates)[0]]
        bars = tuple(Bar(e.name, e) for e in estimates)
        notes.append(f"Modes by {first}; {found.modes.statement}." if pairs else sentence(found.modes.statement))
    parts = tuple(
        _numbers(fit.fitted.method, fit.fitted.estimates, found.inputs) for fit in found.fits if fit.fitted.estimates
    )
    notes += [f"Not identified: {one.name}: {one.reason}." for one in found.missing]
    return Chapter("Findings", tuple(notes), plots=(Intervals("", bars),) if bars else (), parts=parts)


def _numbers(title: str, found: tuple[Estimate, ...], controls: tuple[str, ...]) -> Chapter:
    bars = tuple(Bar(e.name, e, meaning=meaning(e.name, controls)) for e in found)
    return Chapter(title, plots=(Intervals("", bars),))


def _extent(fit: TableFit) -> str:
    numbers = pluralize(len(fit.fitted.estimates), "number")
    return f"{numbers} from {pluralize(fit.samples, 'sample')}{'' if fit.converged else ', not converged'}"


def _data(sources: tuple[Source, ...], found: TableIdentification) -> Chapter:
    """The files, the manoeuvres, and what was dropped, filled or found strange in reading; fits tell of the rest."""
    files = Table(("file", "SHA-256"), tuple((one.name, one.sha256) for one in sources))
    notes = tuple(map(sentence, (*found.notes, *_absent(found))))
    if not notes:
        notes = ("Every sample was measured; none was dropped or filled.",)
    return Chapter("Data used", notes, (files, _manoeuvres(found), _signals(found)), parts=_inputs(found))


def _absent(found: TableIdentification) -> list[str]:
    """Samples that a signal lacks, manoeuvre by manoeuvre."""
    return [
        f"{one.name}: {int(lost)} of {pluralize(len(values), 'sample')} of {name} not measured"
        for one in found.records
        for name, values in one.signals.items()
        if (lost := np.count_nonzero(~np.isfinite(values)))
    ]


def _manoeuvres(found: TableIdentification) -> Table:
    rows = tuple(
        (
            one.name, "held out" if one.name in found.held_out else "fitted", float(one.time[0]),
            float(one.time[-1] - one.time[0]), float(len(one.time)), 1.0 / one.step,
        )
        for one in found.records
    )  # fmt: skip
    told = f"{pluralize(len(found.experiments), 'manoeuvre')} fitted, {len(found.held_out)} held out."
    return Table(("manoeuvre", "use", "start (s)", "length (s)", "samples", "rate (Hz)"), rows, told)


def _signals(found: TableIdentification) -> Table:
    """Range of every signal over all manoeuvres, and how much of it was measured."""
    rows = []
    for name in found.records[0].signals if found.records else ():
        values = np.concatenate([one.signals[name] for one in found.records])
        there = values[np.isfinite(values)]
        least, most = (float(there.min()), float(there.max())) if len(there) else (math.nan, math.nan)
        told = found.records[0].units.get(name, "")
        rows.append((name, unit(told), least, most, 100.0 * len(there) / len(values)))
    return Table(
        ("signal", "unit", "least", "most", "measured (%)"), tuple(rows), "Signals over all manoeuvres, in SI."
    )


def _inputs(found: TableIdentification) -> tuple[Chapter, ...]:
    plots = tuple(
        Plot(
            f"{name}, all manoeuvres", "time from the start", "s", name, found.records[0].units.get(name, ""),
            tuple(Series("", one.time - one.time[0], one.signals[name], MEASURED) for one in found.records),
        )
        for name in found.inputs
        if found.records and name in found.records[0].signals
    )  # fmt: skip
    return (Chapter("Inputs", plots=plots),) if plots else ()


def _constants(found: TableIdentification) -> tuple[Table, ...]:
    rows = tuple((name, value, unit(UNITS.get(name, ""))) for name, value in found.constants.items() if name != "g")
    return (Table(("constant", "value", "unit"), rows, "What the map tells, in SI."),) if rows else ()


def _parameters(found: TableIdentification) -> Chapter | None:
    """The numbers with their intervals, and below each method where its search began and what was held."""
    if not found.fits:
        return None
    whole = parameters_chapter(tuple(one.fitted for one in found.fits), {}, found.inputs)
    parts = tuple(part._replace(tables=_search(fit)) for part, fit in zip(whole.parts, found.fits, strict=True))
    return whole._replace(parts=parts)


def _search(fit: TableFit) -> tuple[Table, ...]:
    values = {one.name: one.value for one in fit.fitted.estimates}
    rows = [(name, start, values[name], "estimated") for name, start in fit.starts.items() if name in values]
    rows += [(name, value, value, "held by the map") for name, value in fit.fixed.items()]
    told = "Where the search began: by the map, or where it names none by the data."
    return (Table(("parameter", "start", "end", "the end is"), tuple(rows), told),) if rows else ()


def _steps(found: TableIdentification) -> Chapter | None:
    """Every step of every stepwise regression."""
    parts = tuple(Chapter(fit.fitted.method, tables=(step_table(fit.steps),)) for fit in found.fits if fit.steps)
    note = "A term enters while its F test, its error by the recipe for coloured residuals, holds it for no chance."
    return Chapter("Steps of the regressions", (note,), parts=parts) if parts else None
