"""HTML report of a campaign table."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.campaigns.comparison import Comparison, comparisons, pairs_text, quartile_texts, written
from logs.campaigns.keys import label_of
from logs.campaigns.metrics import METRICS
from logs.campaigns.statistics import (
    TAILS,
    Array,
    Sensitivity,
    Spread,
    Worst,
    finite,
    format_column,
    inputs_of,
    metrics_of,
    numbers,
    sensitivities,
    spreads,
)
from logs.campaigns.table import Table
from logs.pages.document import MEASURED, MODEL, OTHER, POINTS, STEPS, Cell, Chapter, Plot, Series
from logs.pages.document import Table as Rows
from logs.pages.render import write_page
from wingbeat.text import pluralize

MOST_PLOTS = 12
"""-; limit of the plots of inputs against metrics, strongest correlation first"""
MOST_BINS = 40
"""-; limit of the bins of a histogram"""
SHARES = 8
"""-; number of equal groups of flights in the plot of failure rates"""
REASONS = 12
"""-; limit of the listed failure reasons, the most frequent first"""


class Shown(NamedTuple):
    """Column as plotted: angles in degrees."""

    values: Array
    unit: str


def write(path: Path, table: Table, worst: Sequence[Worst]) -> int:
    """Write the page to ``path``, which must not exist; return its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    whole = "" if table.planned is None else f"unfinished: {pluralize(table.planned, 'flight')} are planned"
    facts = (pluralize(table.size, "flight"), whole, f"from {table.about.file}", table.about.title)
    chapters = (_outcomes(table), _compared(table), _worst(table, worst), _distributions(table), _sensitivity(table))
    every = tuple(chapter for chapter in chapters if chapter is not None)
    return write_page(path, f"Campaign {table.about.name}", tuple(fact for fact in facts if fact), every)


def label(name: str) -> str:
    """Return the label of a metric or an input."""
    if name == "failed":
        return "failed"
    return METRICS[name].text if name in METRICS else label_of(name)


def labeled(name: str, unit: str) -> str:
    """Return the label of a metric or an input with its unit."""
    shown_unit = {"rad": "°", "deg": "°", "-": ""}.get(unit, unit)
    return label(name) + (f" ({shown_unit})" if shown_unit else "")


def shown(table: Table, name: str) -> Shown:
    """Return a column of numbers, angles in degrees; ``failed`` is 1 or 0."""
    values, unit = numbers(table, name), table.units.get(name, "-")
    return Shown(np.degrees(values), "°") if unit == "rad" else Shown(values, unit.replace("deg", "°"))


def _outcomes(table: Table) -> Chapter:
    outcomes = Counter(table.columns["outcome"]).most_common()
    rows = tuple((outcome, float(count), 100.0 * count / table.size) for outcome, count in outcomes)
    tables = [Rows(("outcome", "flights", "%"), rows)]
    pairs = zip(table.columns["failed"], table.columns["reason"], strict=True)
    reasons = Counter(reason for failed, reason in pairs if failed).most_common(REASONS)
    if reasons:
        tables.append(Rows(("reason of failure", "flights"), tuple((text, float(count)) for text, count in reasons)))
    failed = sum(table.columns["failed"])
    notes = (f"{pluralize(failed, 'flight')} of {table.size} failed." if failed else "No flight failed.",)
    return Chapter("Flights", notes, tuple(tables))


def _worst(table: Table, worst: Sequence[Worst]) -> Chapter:
    rows: list[tuple[Cell, ...]] = []
    for one in worst:
        unit = METRICS[one.why].unit if one.value is not None else "-"
        value = one.value if one.value is None or unit != "rad" else math.degrees(one.value)
        named = one.why if one.value is None else labeled(one.why, unit)
        conditions = ", ".join(f"{label(name)} {written(table, name, each)}" for name, each in one.values.items())
        rows.append((str(one.flight), named, value, conditions, one.command))
    note = "Each command repeats its flight bit for bit and records it."
    heads = ("flight", "reason", "", "inputs", "command")
    return Chapter("Worst flights", (note,), (Rows(heads, tuple(rows)),))


def _distributions(table: Table) -> Chapter:
    ranges = spreads(table)
    tails = any(math.isfinite(one.low) for one in ranges)
    heads = ["metric", "unit", "flights", "mean", "sigma", "minimum", "5 %", "median", "95 %", "maximum"]
    rows = [_spread_row(one) for one in ranges]
    if not tails:
        heads, rows = [head for head in heads if "%" not in head], [(*row[:6], row[7], row[9]) for row in rows]
    notes = () if tails else (f"The 5 % and 95 % quantiles need {TAILS} flights.",)
    plots = tuple(_histogram(table, name) for name in metrics_of(table))
    return Chapter("Distributions", notes, (Rows(tuple(heads), tuple(rows)),), plots)


def _spread_row(one: Spread) -> tuple[Cell, ...]:
    in_degrees = one.unit == "rad"
    values = [math.degrees(value) if in_degrees else value for value in one[3:]]
    cells = (text or None for text in format_column(values))
    return (label(one.name), "°" if in_degrees else one.unit, f"{one.flights}", *cells)


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
    return Plot("", label(name), column.unit, "flights", "-", series)


def _edges(values: Array) -> Array:
    """Return the bin edges: about the square root of the number of values, over their range."""
    low, high = float(values.min()), float(values.max())
    margin = 0.0 if high > low else 0.5 * abs(high) or 0.5
    bins = min(max(round(math.sqrt(len(values))), 5), MOST_BINS)
    return np.linspace(low - margin, high + margin, bins + 1)


def _bars(edges: Array, values: Array, label: str, role: str) -> Series:
    counts, _ = np.histogram(values, edges)
    return Series(label, edges, np.append(counts, 0).astype(np.float64), role, STEPS)


def _sensitivity(table: Table) -> Chapter:
    correlations = sensitivities(table)
    if not correlations:
        note = "Too few flights, or no number was swept: no rank correlations."
        return Chapter("Sensitivity", (note,))
    strong = [one for one in correlations if one.beyond_chance and one.metric != "failed"]
    notes = ("Spearman's rank correlation of each swept number with each metric; not significant in brackets.",)
    plots = [_scatter(table, one) for one in strong[:MOST_PLOTS]]
    if any(table.columns["failed"]):
        plots = [*(_failures(table, name) for name in inputs_of(table)), *plots]
    return Chapter("Sensitivity", notes, (_correlations(inputs_of(table), correlations),), tuple(plots))


def _correlations(inputs: Sequence[str], sensitivities: Sequence[Sensitivity]) -> Rows:
    metrics = [name for name in ("failed", *METRICS) if any(one.metric == name for one in sensitivities)]
    known = {(one.input, one.metric): one for one in sensitivities}
    rows = tuple((label(metric), *(_correlation(known.get((name, metric))) for name in inputs)) for metric in metrics)
    return Rows(("metric", *map(label, inputs)), rows)


def _correlation(one: Sensitivity | None) -> Cell:
    if one is None:
        return None
    text = f"{one.rank_correlation:+.2f}".replace("-", "−")
    return text if one.beyond_chance else f"({text})"


def _compared(table: Table) -> Chapter | None:
    """Return medians and quartiles by the values of each grid, and the paired comparisons."""
    compared = comparisons(table)
    if not compared:
        return None
    notes = ["Medians, quartiles in brackets."]
    if any(one.pairs for each in compared for one in each.metrics):
        notes.append("Pairs are flights with equal other inputs, gusts and draws; * marks a significant difference.")
    return Chapter("Comparison", tuple(notes), tuple(_by_value(one) for one in compared))


def _by_value(one: Comparison) -> Rows:
    paired = max((len(each.pairs) for each in one.metrics), default=0)
    shares = (100.0 * failed / flights for failed, flights in zip(one.failed, one.flights, strict=True))
    rows: list[tuple[Cell, ...]] = [
        ("flights", *map(str, one.flights), *[None] * paired),
        ("failed (%)", *(f"{share:.1f}" for share in shares), *[None] * paired),
    ]
    for each in one.metrics:
        pairs = [pairs_text(pair) for pair in each.pairs]
        rows.append((labeled(each.metric, each.unit), *quartile_texts(each), *pairs, *[None] * (paired - len(pairs))))
    heads = (f"{value} better" for value in one.values[1 : 1 + paired])
    return Rows((f"median by {label(one.input)}", *one.values, *heads), tuple(rows))


def _scatter(table: Table, one: Sensitivity) -> Plot:
    x, y = shown(table, one.input), shown(table, one.metric)
    failed = np.array(table.columns["failed"], dtype=bool)
    failed &= np.isfinite(y.values)
    series = [Series("not failed" if failed.any() else "", x.values[~failed], y.values[~failed], OTHER, POINTS)]
    if failed.any():
        series.append(Series("failed", x.values[failed], y.values[failed], MODEL, POINTS))
    title = f"rank correlation {_correlation(one)}"
    return Plot(title, label(one.input), x.unit, label(one.metric), y.unit, tuple(series))


def _failures(table: Table, name: str) -> Plot:
    """Return the failure rate in groups of equal size along an input."""
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
    return Plot("", label(name), column.unit, "failed flights", "%", (Series("", x, share, MEASURED),))
