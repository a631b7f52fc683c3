"""Report of a campaign table as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from groundstation.views.tables import NUMBER, UNIT, plain_table
from logs.campaigns.comparison import Comparison, comparisons, conditions_text, pairs_text, quartile_texts
from logs.campaigns.metrics import METRICS
from logs.campaigns.statistics import Sensitivity, Worst, format_column, sensitivities, spreads
from logs.campaigns.table import Table
from wingbeat.text import pluralize

STRONGEST = 10
"""-; number of listed pairs of input and metric"""


def report(table: Table, by: str | None, worst: Sequence[Worst], changed: str, page: Path) -> RenderableType:
    """Report outcomes, distributions, sensitivities, the worst flights, and the path of the page."""
    parts: list[RenderableType] = [_heading(table), Text(), _spreads(table)]
    for compared in comparisons(table):
        parts += [Text(), *_compared(compared)]
    strong = [one for one in sensitivities(table) if one.beyond_chance]
    if strong:
        parts += [Text(), _matters(strong)]
    if worst:
        parts += [Text(), Text(_worst_title(table, by), "bold"), *(_worst(table, one) for one in worst)]
    if changed:
        parts.append(Text(changed, "yellow"))
    return Group(*parts, Text(), Text.assemble(("page".ljust(12), "dim"), str(page)))


def _heading(table: Table) -> Text:
    told = ", ".join(f"{count} {outcome}" for outcome, count in Counter(table.columns["outcome"]).most_common())
    name = f"{table.about.name}: {table.about.title}" if table.about.title else table.about.name
    flights = pluralize(table.size, "flight")
    if table.planned is not None:
        going_on = f"\nunfinished: {flights} of {table.planned}; resume with wingbeat campaign {table.about.file}"
        return Text.assemble((name, "bold"), (going_on, "yellow"), f"\n{flights}: {told}")
    return Text.assemble((name, "bold"), f"\n{flights}: {told}")


def _spreads(table: Table) -> RenderableType:
    rows = plain_table(
        ("metric", ""), ("", UNIT), ("flights", "right"), ("mean", "right"), ("sigma", "right"), ("least", "right"),
        ("5 %", "right"), ("median", "right"), ("95 %", "right"), ("greatest", "right"),
    )  # fmt: skip
    for one in spreads(table):
        told = format_column([math.degrees(value) if one.unit == "rad" else value for value in one[3:]])
        rows.add_row(one.name, _unit(one.unit), str(one.flights), *told)
    return rows


def _compared(results: Comparison) -> list[RenderableType]:
    """Show metrics with a worse side by the values of a grid, and the paired comparisons."""
    shown = [one for one in results.metrics if METRICS[one.metric].bad]
    paired = max((len(one.pairs) for one in shown), default=0)
    heads = (f"{value} better" for value in results.values[1 : 1 + paired])
    rows = plain_table(
        ("median (quartiles)", ""), ("", UNIT), *((value, NUMBER) for value in results.values),
        *((head, NUMBER) for head in heads),
    )  # fmt: skip
    rows.add_row("failed", "", *(f"{a} of {b}" for a, b in zip(results.failed, results.flights, strict=True)))
    for one in shown:
        rows.add_row(one.metric, _unit(one.unit), *quartile_texts(one), *map(pairs_text, one.pairs))
    stars = any(pair.beyond_chance for one in shown for pair in one.pairs)
    against = f"better than {results.values[0]} in pairs of flights that are equal in all else"
    note = against + ("; * more often than chance makes of so many" if stars else ", no more often than chance makes")
    told: list[RenderableType] = [Text(f"by {results.input}", "bold"), rows]
    return [*told, Text(note, "dim")] if paired else told


def _matters(strong: Sequence[Sensitivity]) -> RenderableType:
    rows = plain_table(("what matters most", ""), ("for", ""), ("rank correlation", "right"))
    for one in strong[:STRONGEST]:
        rows.add_row(one.input, one.metric, f"{one.rank_correlation:+.2f}")
    return rows


def _worst_title(table: Table, by: str | None) -> str:
    failed = "failed flights" if any(table.columns["failed"]) else ""
    ordered = f"worst by {by}" if by else ""
    return ", then ".join(word for word in (failed, ordered) if word)


def _worst(table: Table, one: Worst) -> RenderableType:
    """Return a line with reason and inputs of a flight, and the command below it."""
    if one.value is None:
        why = one.why
    else:
        unit = METRICS[one.why].unit
        why = f"{one.why} {_number(one.value, unit)} {_unit(unit)}".rstrip()
    lines = Text.assemble(conditions_text(table, one.values), (f"\n{one.command}", "cyan"))
    return Group(Text.assemble((f"{one.flight:6d}  ", "dim"), why), Padding(lines, (0, 0, 0, 8)))


def _number(value: float, unit: str) -> str:
    shown = math.degrees(value) if unit == "rad" else value
    return "" if math.isnan(shown) else f"{shown:.4g}"


def _unit(unit: str) -> str:
    return {"rad": "°", "-": ""}.get(unit, unit)
