"""Report of published and computed figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views import tables, wording
from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.row import COMPARED, FITTED, OUTCOMES, SHORT, UNREPRODUCIBLE, WITHIN, Figure, Row, nearest

STYLES = {WITHIN: "green", SHORT: "yellow", FITTED: "dim", UNREPRODUCIBLE: "dim", COMPARED: "dim"}


def validation_table(results: Mapping[str, Sequence[Row]]) -> RenderableType:
    """Show one row per figure, grouped by paper, with the remarks on the figures below each paper."""
    parts: list[RenderableType] = []
    for name, rows in results.items():
        notes = list(dict.fromkeys(row.why for row in rows if row.why))
        parts += [Text(PAPERS[name].title, style="bold"), _paper_table(rows, notes), _notes(notes), Text()]
    return Group(*parts)


def summary_line(results: Mapping[str, Sequence[Row]]) -> Text:
    """Return the number of rows of each outcome."""
    every = [row for rows in results.values() for row in rows]
    counts = [f"{outcome} {sum(row.outcome == outcome for row in every)}" for outcome in OUTCOMES]
    return Text(f"{len(every)} figures: {', '.join(counts)}")


def _paper_table(rows: Sequence[Row], notes: Sequence[str]) -> tables.PlainTable:
    numbers = (("published", "right"), ("ours", "right"), ("difference", "right"))
    table = tables.plain_table(("where", ""), ("figure", ""), *numbers, ("verdict", ""))
    for row in rows:
        table.add_row(*_cells(row, notes.index(row.why) + 1 if row.why else 0))
    return table


def _notes(notes: Sequence[str]) -> Table:
    table = Table.grid(padding=(0, 1))
    table.add_column(justify="right", style="dim", min_width=4)
    table.add_column(style="dim")
    for number, words in enumerate(notes, start=1):
        table.add_row(Text(f"[{number}]"), Text(words))
    return table


def _cells(row: Row, note: int) -> tuple[str | Text, ...]:
    printed = row.figure
    outcome = Text(_judged(row), style=STYLES[row.outcome])
    if note:
        outcome.append(f" [{note}]", style="dim")
    computed = wording.UNKNOWN if row.computed is None else _with_unit(f"{row.computed:.4g}", printed)
    return printed.where, printed.quantity, _printed(printed), computed, _difference(row), outcome


def _judged(row: Row) -> str:
    if row.outcome not in (WITHIN, SHORT) or not row.limit:
        return row.outcome
    limit = _with_unit(f"{row.limit:.3g}", row.figure) if row.share is None else f"{100.0 * row.share:g} %"
    return f"{row.outcome} {'of ' if row.outcome == SHORT else ''}{limit}"


def _printed(printed: Figure) -> str:
    if math.isnan(printed.low):
        return "no number"
    if printed.low == printed.high:
        return f"{printed.low:.4g}"
    return f"{printed.low:.4g} to {printed.high:.4g}" if math.isfinite(printed.high) else f"{printed.low:.4g} or more"


def _difference(row: Row) -> str:
    """Return the relative difference, or the absolute one if the published number is zero."""
    if row.computed is None or row.difference is None:
        return ""
    if row.difference == 0.0 and row.figure.low != row.figure.high:
        return "inside"
    reference = abs(nearest(row.figure, row.computed))
    return (
        f"{100.0 * row.difference / reference:+.1f} %"
        if reference
        else _with_unit(f"{row.difference:.3g}", row.figure)
    )


def _with_unit(number: str, printed: Figure) -> str:
    return number if printed.unit == "-" else f"{number} {printed.unit}"
