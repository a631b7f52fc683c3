"""What was identified, as a table: each number with its 95 % interval, and the truth where the log knows it."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views import tables, wording
from logs.identification.report import Identification, Row, rows
from logs.identification.results import Estimate
from logs.pages.labels import text_symbol
from wingbeat.text import pluralize

HEADLINES = {
    "K_tau": "torque constant K_tau",
    "wing_torque_constant": "wing torque constant",
    "short_period_frequency": "short-period frequency",
    "short_period_damping": "short-period damping",
}
"""label by name of the numbers that a flight ends with"""


def identification_summary(estimates: Identification) -> RenderableType:
    """Return one line for each of `HEADLINES` that was identified, and how many more numbers there are."""
    listed = [row for row in rows(estimates) if row.estimate is not None]
    found = {name: next((row for row in listed if row.name == name), None) for name in HEADLINES}
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", min_width=10)
    for _ in range(4):
        table.add_column()
    table.add_row("identified", *(Text(word, style="dim") for word in ("", "value", "95 % interval", "true")))
    for name, row in found.items():
        if row is None or row.estimate is None:
            continue
        _, value, interval, truth, unit = _cells(row, row.estimate)
        table.add_row("", HEADLINES[name], Text.assemble(value, f" {unit}".rstrip()), interval, truth)
    shown = table.row_count - 1
    if not shown:
        return Text(f"identified  {pluralize(len(listed), 'number')}")
    return Group(table, Text(f"{'':12}{len(listed) - shown} more numbers in the report", style="dim"))


def identification_table(estimates: Identification) -> RenderableType:
    """One row a number; below it, what the data does not give and why, each reason once."""
    return _table(rows(estimates))


def _table(listed: Sequence[Row]) -> RenderableType:
    known = any(row.truth is not None for row in listed)
    table = tables.plain_table(
        ("identified", tables.GROUP), ("", ""), ("value", "right"), ("95 % interval", "right"),
        ("true" if known else "", "right"), ("", tables.UNIT),
    )  # fmt: skip
    subject = ""
    for row in listed:
        if row.estimate is not None:
            table.add_row(row.subject if row.subject != subject else "", *_cells(row, row.estimate))
            subject = row.subject
    rest = [row for row in listed if row.estimate is None]
    texts = dict.fromkeys(row.note for row in rest)
    notes = [_note([row for row in rest if row.note == text]) for text in texts]
    if len(rest) == len(listed):
        return Group(*notes)
    return Group(table, *([Text(), *notes] if notes else []))


def _cells(row: Row, estimate: Estimate) -> tuple[str | Text, ...]:
    half = 0.5 * (estimate.high - estimate.low)
    value, low, high = (wording.significant(x, half)[0] for x in (estimate.value, estimate.low, estimate.high))
    unit = "" if row.unit == "-" else row.unit
    return _name(row), Text(value, style="bold"), f"{low} to {high}", _truth(row.truth, estimate, half), unit


def _name(row: Row) -> str:
    kind, _, sensor = row.name.partition("_")
    if kind in ("bias", "scale"):
        return f"{kind} of {sensor}"
    return wording.words(row.name.removeprefix("short_period_")) if row.name.islower() else text_symbol(row.name)


def _truth(truth: float | None, estimate: Estimate, half: float) -> Text:
    if truth is None:
        return Text()
    return Text(wording.significant(truth, half)[0], style="green" if estimate.contains(truth) else "yellow")


def _note(stated: Sequence[Row]) -> Text:
    """Return the findings common to all these rows; subjects with equal findings share them."""
    names: dict[str, list[str]] = {}
    for row in stated:
        names.setdefault(row.subject, []).append("" if row.subject == row.name else _name(row))
    subjects: dict[str, list[str]] = {}
    for subject, own in names.items():
        subjects.setdefault(", ".join(own), []).append(subject)
    labels = [f"{'; '.join(who)} {own}".rstrip() for own, who in subjects.items()]
    return Text(f"{'; '.join(labels)}: {stated[0].note}", style="dim")
