"""What was identified, as a table: each number with its 95 % interval, and the truth where the log knows it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from groundstation.views import tables, wording
from logs.identification.report import Identification, Row, rows
from logs.identification.report.numbers import FOLLOWS
from logs.identification.results import Estimate


def identification_summary(estimates: Identification, log: Path) -> RenderableType:
    """`identification_table` without what follows from other numbers and without reasons, and how to see them."""
    listed = rows(estimates)
    refused = sum(row.note.startswith("not identified") for row in listed)
    silent = ("not identified", "not determined")
    notes = [row for row in listed if row.estimate is None and not row.note.startswith(silent)]
    stated = [row for row in listed if row.estimate is not None and not FOLLOWS.search(row.name)]
    left = f"{refused} more could not be identified; why" if refused else "periods and times to half"
    return Group(_table([*stated, *notes]), Text(f"{left}: wingbeat identify {log}", style="dim"))


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
    return wording.words(row.name.removeprefix("short_period_")) if row.name.islower() else row.name


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
