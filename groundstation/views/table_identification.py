"""What was identified from a table: each fit's numbers with intervals and starts, and how its outputs follow."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from groundstation.views import tables, wording
from groundstation.views.identification import identification_table
from logs.identification.findings import not_estimated
from logs.identification.models.modes import Mode, ModesResult
from logs.identification.report import Identification
from logs.identification.report.tables import heading, notes_of, number_rows
from logs.identification.results import EstimationResult
from logs.identification.sources.table.run import TableIdentification
from logs.identification.statistics.fit_quality import output_fits

ABOVE = "as said above"
"""in place of a reason that stands at a fit already"""


def table_identification(estimates: TableIdentification) -> RenderableType:
    """Every fit below the other, then the modes by every method, then what was found strange in the table."""
    parts: list[RenderableType] = [Text(_data(estimates)), Text()]
    for fit in estimates.fits:
        parts += [*_fit(fit), Text()]
    if estimates.modes is not None:
        parts += [identification_table(Identification(modes=_withheld(estimates.modes, estimates.fits))), Text()]
    last = [f"{one.subject}: {one.text.removeprefix(f'{one.subject}: ')}" for one in estimates.missing]
    last += (one.line for one in estimates.findings)
    return Group(*(parts if last else parts[:-1]), *(Text(note, style="dim") for note in last))


def _withheld(modes: ModesResult, fits: Sequence[EstimationResult]) -> ModesResult:
    """The modes, with a word for each reason that stands at a fit above already."""
    listed = {one.text for fit in fits for one in fit.findings if one.severity == "withheld"}
    return modes._replace(modes=tuple(_referring(mode, listed) for mode in modes.modes))


def _referring(mode: Mode, listed: Collection[str]) -> Mode:
    lost = (not_estimated(one.subject, ABOVE) if one.text in listed else one for one in mode.withheld)
    return mode._replace(withheld=tuple(lost))


def _data(estimates: TableIdentification) -> str:
    held = f"; held out: {', '.join(estimates.held_out)}" if estimates.held_out else ""
    return f"fitted: {', '.join(estimates.experiments)}{held}"


def _fit(fit: EstimationResult) -> list[RenderableType]:
    parts: list[RenderableType] = [Text(heading(fit), style="bold")]
    if fit.estimates:
        parts.append(_numbers(fit))
    if fit.series:
        parts.append(_outputs(fit))
    return [*parts, *(Text(note, style="dim") for note in notes_of(fit))]


def _numbers(fit: EstimationResult) -> RenderableType:
    table = tables.plain_table(
        ("parameter", ""), ("value", "right"), ("95 % interval", "right"), ("start", "right"), ("", tables.UNIT)
    )
    for row in number_rows(fit):
        one = row.estimate
        half = 0.5 * (one.high - one.low)
        value, low, high = (wording.significant(x, half)[0] for x in (one.value, one.low, one.high))
        start = "" if row.start is None else f"{row.start:.4g}"
        table.add_row(
            row.name, Text(value, style="bold"), f"{low} to {high}", start, "" if one.unit == "-" else one.unit
        )
    return table


def _outputs(fit: EstimationResult) -> RenderableType:
    table = tables.plain_table(
        ("maneuver", tables.GROUP), ("output", ""), ("R²", "right"), ("RMS", "right"), ("Theil", "right"),
        ("residuals", ""),
    )  # fmt: skip
    listed = ""
    for one in output_fits(fit.series):
        color = {True: "white", False: "colored", None: ""}[one.white]
        where = f"{one.experiment}{', held out' if one.held_out else ''}"
        rms = f"{one.rms:.3g}{'' if one.unit == '-' else ' ' + one.unit}"
        numbers = (_plain(one.r_squared), rms, _plain(one.theil))
        table.add_row(where if where != listed else "", one.output, *numbers, color)
        listed = where
    return table


def _plain(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else ""
