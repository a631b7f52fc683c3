"""A campaign's table as one page of HTML: what came of the flights, their spread, what matters, the worst ones."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from avionics.quantities import counted
from logs.campaigns.metrics import METRICS
from logs.campaigns.statistics import (
    Array,
    Sensitivity,
    Spread,
    Worst,
    finite,
    inputs_of,
    metrics_of,
    numbers,
    sensitivities,
    spreads,
)
from logs.campaigns.table import Table
from logs.identification.chapter import MEASURED, MODEL, OTHER, POINTS, STEPS, Cell, Chapter, Plot, Series
from logs.identification.chapter import Table as Rows
from logs.identification.report.report import write_page

MOST_PLOTS = 12
"""-; of what an input has to do with a metric, the strongest first"""
MOST_BINS = 40
"""-; of a histogram"""
SHARES = 8
"""-; groups of flights, as large as each other, of which the share that failed is drawn"""
REASONS = 12
"""-; told of failed flights, the most frequent first"""


class Shown(NamedTuple):
    """A column as it is drawn: angles in degrees."""

    values: Array
    unit: str


def write(path: Path, table: Table, worst: Sequence[Worst]) -> int:
    """Write the page to ``path``, which must not exist; its size in bytes.

    Raises:
        BadInput: the file exists or cannot be written.
    """
    facts = (counted(table.size, "flight"), f"from {table.about.file}", table.about.title)
    chapters = (_outcomes(table), _worst(worst), _distributions(table), _sensitivity(table))
    return write_page(path, f"Campaign {table.about.name}", tuple(fact for fact in facts if fact), chapters)


def shown(table: Table, name: str) -> Shown:
    """A column of numbers, angles in degrees; what failed or did not is 1 or 0."""
    values, unit = numbers(table, name), table.units.get(name, "-")
    return Shown(np.degrees(values), "°") if unit == "rad" else Shown(values, unit.replace("deg", "°"))


def _outcomes(table: Table) -> Chapter:
    outcomes = Counter(table.columns["outcome"]).most_common()
    rows = tuple((outcome, float(count), 100.0 * count / table.size) for outcome, count in outcomes)
    told: list[Rows] = [Rows(("outcome", "flights", "%"), rows)]
    pairs = zip(table.columns["failed"], table.columns["reason"], strict=True)
    reasons = Counter(reason for failed, reason in pairs if failed).most_common(REASONS)
    if reasons:
        told.append(Rows(("why flights failed", "flights"), tuple((text, float(count)) for text, count in reasons)))
    failed = sum(table.columns["failed"])
    notes = (f"{counted(failed, 'flight')} of {table.size} failed." if failed else "No flight failed.",)
    return Chapter("Flights", notes, tuple(told))


def _worst(worst: Sequence[Worst]) -> Chapter:
    rows: list[tuple[Cell, ...]] = []
    for one in worst:
        unit = METRICS[one.why].unit if one.value is not None else "-"
        value = one.value if one.value is None or unit != "rad" else math.degrees(one.value)
        named = one.why if one.value is None else f"{one.why} ({'°' if unit == 'rad' else unit})"
        rows.append((str(one.flight), named, value, one.command))
    note = "Each command flies its flight again, bit for bit, and records it."
    table = Rows(("flight", "why", "", "flown again by"), tuple(rows))
    return Chapter("Worst flights", (note,), (table,))


def _distributions(table: Table) -> Chapter:
    heads = ("metric", "unit", "flights", "mean", "sigma", "least", "5 %", "median", "95 %", "greatest", "")
    rows = tuple(_spread_row(one) for one in spreads(table))
    plots = tuple(_histogram(table, name) for name in metrics_of(table))
    return Chapter("Distributions", (), (Rows(heads, rows),), plots)


def _spread_row(one: Spread) -> tuple[Cell, ...]:
    in_degrees = one.unit == "rad"
    told = [math.degrees(value) if in_degrees else value for value in one[3:]]
    cells = (None if math.isnan(value) else f"{value:.4g}" for value in told)
    return (one.name, "°" if in_degrees else one.unit, f"{one.flights}", *cells, METRICS[one.name].text)


def _histogram(table: Table, name: str) -> Plot:
    column = shown(table, name)
    failed = np.array(table.columns["failed"], dtype=bool) & np.isfinite(column.values)
    edges = _edges(finite(column.values))
    groups = ((OTHER, "not failed", ~failed), (MODEL, "failed", failed))
    series = tuple(
        _bars(edges, finite(column.values[chosen]), label if failed.any() else "", role)
        for role, label, chosen in groups
        if np.isfinite(column.values[chosen]).any()
    )
    return Plot(name, METRICS[name].text, column.unit, "flights", "-", series)


def _edges(values: Array) -> Array:
    """Of the bins: about the square root of the number of values, over all of them."""
    low, high = float(values.min()), float(values.max())
    margin = 0.0 if high > low else 0.5 * abs(high) or 0.5
    bins = min(max(round(math.sqrt(len(values))), 5), MOST_BINS)
    return np.linspace(low - margin, high + margin, bins + 1)


def _bars(edges: Array, values: Array, label: str, role: str) -> Series:
    counts, _ = np.histogram(values, edges)
    return Series(label, edges, np.append(counts, 0).astype(np.float64), role, STEPS)


def _sensitivity(table: Table) -> Chapter:
    found = sensitivities(table)
    if not found:
        note = "Too few flights, or no number was swept: no rank correlations."
        return Chapter("What matters", (note,), tuple(_groups(table)))
    strong = [one for one in found if one.beyond_chance and one.metric != "failed"]
    notes = (
        "Spearman's rank correlation of each swept number with each metric: 1 where more of one always goes with more"
        " of the other, 0 where they have nothing to do with each other. In brackets what chance may make of so many"
        " flights.",
    )
    plots = [_scatter(table, one) for one in strong[:MOST_PLOTS]]
    if any(table.columns["failed"]):
        plots = [*(_failures(table, name) for name in inputs_of(table)), *plots]
    return Chapter("What matters", notes, (_correlations(inputs_of(table), found), *_groups(table)), tuple(plots))


def _correlations(inputs: Sequence[str], found: Sequence[Sensitivity]) -> Rows:
    metrics = [name for name in ("failed", *METRICS) if any(one.metric == name for one in found)]
    known = {(one.input, one.metric): one for one in found}
    rows = tuple((metric, *(_correlation(known.get((name, metric))) for name in inputs)) for metric in metrics)
    return Rows(("metric", *inputs), rows)


def _correlation(one: Sensitivity | None) -> Cell:
    if one is None:
        return None
    text = f"{one.rank_correlation:+.2f}".replace("-", "−")
    return text if one.beyond_chance else f"({text})"


def _groups(table: Table) -> list[Rows]:
    """A table of medians for each swept input that is words, or a grid of few numbers."""
    found = []
    for name in table.about.swept:
        values = table.columns[name]
        choices = list(dict.fromkeys(str(value) for value in values))
        if name != "seed" and 1 < len(choices) <= REASONS and len(choices) < table.size:
            found.append(_medians(table, name, choices))
    return found


def _medians(table: Table, name: str, choices: Sequence[str]) -> Rows:
    of = np.array([choices.index(str(value)) for value in table.columns[name]])
    failed = np.array(table.columns["failed"], dtype=np.float64)
    rows: list[tuple[Cell, ...]] = [
        ("failed (%)", *(f"{100.0 * failed[of == i].mean():.1f}" for i in range(len(choices))))
    ]
    for metric in metrics_of(table):
        column = shown(table, metric)
        medians = (finite(column.values[of == i]) for i in range(len(choices)))
        cells = (f"{np.median(values):.4g}" if len(values) else None for values in medians)
        rows.append((f"{metric} ({column.unit})" if column.unit != "-" else metric, *cells))
    return Rows((f"median by {name}", *(choice or "none" for choice in choices)), tuple(rows))


def _scatter(table: Table, one: Sensitivity) -> Plot:
    x, y = shown(table, one.input), shown(table, one.metric)
    failed = np.array(table.columns["failed"], dtype=bool)
    failed &= np.isfinite(y.values)
    series = [Series("not failed" if failed.any() else "", x.values[~failed], y.values[~failed], OTHER, POINTS)]
    if failed.any():
        series.append(Series("failed", x.values[failed], y.values[failed], MODEL, POINTS))
    title = f"{one.metric} by {one.input}, {_correlation(one)}"
    return Plot(title, one.input, x.unit, one.metric, y.unit, tuple(series))


def _failures(table: Table, name: str) -> Plot:
    """The share of flights that failed, in groups of equal size along an input."""
    column, failed = shown(table, name), np.array(table.columns["failed"], dtype=np.float64)
    there = np.flatnonzero(np.isfinite(column.values))
    order = there[np.argsort(column.values[there], kind="stable")]
    choices = np.unique(column.values[there])
    if len(choices) <= SHARES:
        parts = [there[column.values[there] == choice] for choice in choices]
    else:
        parts = [part for part in np.array_split(order, SHARES) if len(part)]
    x = np.array([column.values[part].mean() for part in parts])
    share = np.array([100.0 * failed[part].mean() for part in parts])
    return Plot(f"failed by {name}", name, column.unit, "failed", "%", (Series("", x, share, MEASURED),))
