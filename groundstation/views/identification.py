"""What was identified, as a table: each number with its 95 % interval, and the truth where the log knows it."""

from __future__ import annotations

from rich.console import RenderableType
from rich.text import Text

from groundstation.views import tables, wording
from logs.identification.report import Identification, Row, rows


def identification_table(found: Identification) -> RenderableType:
    """One row a number; a number that the data does not give says why."""
    table = tables.plain_table(
        ("identified", ""), ("", ""), ("value", "right"), ("95 % interval", "right"), ("true", "right"), ("unit", "")
    )
    subject = ""
    for row in rows(found):
        table.add_row(row.subject if row.subject != subject else "", *_cells(row))
        subject = row.subject
    return table


def _cells(row: Row) -> tuple[str | Text, ...]:
    name = wording.words(row.name) if row.name.islower() else row.name
    if row.estimate is None:
        return name, Text(row.note, style="dim"), "", "", ""
    half = 0.5 * (row.estimate.high - row.estimate.low)
    value, _ = wording.significant(row.estimate.value, half)
    low, _ = wording.significant(row.estimate.low, half)
    high, _ = wording.significant(row.estimate.high, half)
    return name, Text(value, style="bold"), f"{low} to {high}", _truth(row, half), row.unit


def _truth(row: Row, half: float) -> Text:
    if row.truth is None or row.estimate is None:
        return Text("")
    text, _ = wording.significant(row.truth, half)
    return Text(text, style="green" if row.estimate.contains(row.truth) else "yellow")
