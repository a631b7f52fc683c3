"""Paired comparison of metrics by the values of a grid."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from logs.campaigns.metrics import METRICS
from logs.campaigns.statistics import CHANCE, Array, finite, format_column, metrics_of, numbers
from logs.campaigns.table import Table

MOST_VALUES = 12
"""-; limit of the values of an input that is treated as a grid"""


class Quartiles(NamedTuple):
    """Quartiles of a metric over the flights with one value of an input; NaN without data."""

    flights: int
    low: float
    """in the unit of the metric; first quartile"""
    median: float
    """in the unit of the metric"""
    high: float
    """in the unit of the metric; third quartile"""


class Pairs(NamedTuple):
    """Paired flights with ``value`` and ``first``, equal in all other inputs and the seed."""

    value: str
    first: str
    pairs: int
    """-; pairs in which both flights have the metric"""
    better: int
    """-; pairs in which the flight with `value` is better"""
    worse: int

    @property
    def beyond_chance(self) -> bool:
        """Whether the difference exceeds three standard deviations of chance (one false result in 370)."""
        return abs(self.better - self.worse) > CHANCE * math.sqrt(self.better + self.worse)


class Compared(NamedTuple):
    """One metric by the values of an input."""

    metric: str
    unit: str
    groups: tuple[Quartiles, ...]
    """for each value"""
    pairs: tuple[Pairs, ...]
    """for each value but the first, in order; empty without paired flights or if the metric has no better side"""


class Comparison(NamedTuple):
    """All metrics by the values of an input."""

    input: str
    values: tuple[str, ...]
    """as text, angles in degrees"""
    flights: tuple[int, ...]
    """-; number for each value"""
    failed: tuple[int, ...]
    """-; number of failed flights for each value"""
    metrics: tuple[Compared, ...]


def comparisons(table: Table) -> list[Comparison]:
    """Compare the metrics by each swept input that is text or has few values shared by several flights, not by the
    seed.
    """
    found = []
    for name in table.about.swept:
        choices = list(dict.fromkeys(map(_key, table.columns[name])))
        if name != "seed" and 1 < len(choices) <= MOST_VALUES and not _is_drawn(table, name, choices):
            found.append(_comparison(table, name, sorted(choices) if _are_numbers(choices) else choices))
    return found


def written(table: Table, name: str, value: Any) -> str:
    """Format a value of an input with its unit, angles in degrees."""
    unit = table.units.get(name, "-")
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value) if value not in ("", None) else "none"
    if unit == "rad":
        return f"{math.degrees(value):.4g}°"
    if unit == "deg":
        return f"{value:.4g}°"
    return f"{value:.4g}" if unit == "-" else f"{value:.4g} {unit}"


def conditions_text(table: Table, values: Mapping[str, Any]) -> str:
    """Format the inputs of a flight on one line."""
    return ", ".join(f"{name} {written(table, name, value)}" for name, value in values.items())


def quartile_texts(one: Compared) -> list[str]:
    """Format median and quartiles of each value, angles in degrees; empty if no flight has the metric."""
    factor = math.degrees(1.0) if one.unit == "rad" else 1.0
    told = format_column([factor * number for each in one.groups for number in (each.median, each.low, each.high)])
    triples = zip(told[0::3], told[1::3], told[2::3], strict=True)
    return [f"{median} ({low} to {high})" if median else "" for median, low, high in triples]


def pairs_text(one: Pairs) -> str:
    """Format the pairs in which the value is better, with a star if significant; empty without pairs."""
    if not one.pairs:
        return ""
    return f"in {one.better} of {one.pairs}{' *' if one.beyond_chance else ''}"


def _comparison(table: Table, name: str, choices: Sequence[Any]) -> Comparison:
    of = np.array([choices.index(_key(value)) for value in table.columns[name]])
    failed = np.array(table.columns["failed"], dtype=bool)
    texts = tuple(written(table, name, choice) for choice in choices)
    partners = _partners(table, name, of)
    places = range(len(choices))
    metrics = tuple(_compared(table, metric, of, texts, partners) for metric in metrics_of(table))
    flights = tuple(int(np.sum(of == i)) for i in places)
    return Comparison(name, texts, flights, tuple(int(np.sum(failed[of == i])) for i in places), metrics)


def _compared(
    table: Table, metric: str, of: Array, texts: Sequence[str], partners: Sequence[Mapping[int, int]]
) -> Compared:
    values = numbers(table, metric)
    groups = tuple(_quartiles(finite(values[of == i])) for i in range(len(texts)))
    bad = METRICS[metric].bad
    pairs = []
    for i, text in enumerate(texts[1:], start=1) if bad else ():
        both = [rows for rows in partners if 0 in rows and i in rows]
        apart = finite(np.array([bad * (values[rows[i]] - values[rows[0]]) for rows in both]))
        pairs.append(Pairs(text, texts[0], len(apart), int(np.sum(apart < 0.0)), int(np.sum(apart > 0.0))))
    there = any(one.pairs for one in pairs)
    return Compared(metric, table.units[metric], groups, tuple(pairs) if there else ())


def _quartiles(values: Array) -> Quartiles:
    if not len(values):
        return Quartiles(0, math.nan, math.nan, math.nan)
    return Quartiles(len(values), *(float(one) for one in np.percentile(values, (25.0, 50.0, 75.0))))


def _partners(table: Table, name: str, of: Array) -> list[dict[int, int]]:
    """Return the rows of flights that differ only in this input, by value index; incomplete for unfinished tables."""
    others = [table.columns[other] for other in table.about.swept if other != name]
    sets: dict[tuple[Any, ...], dict[int, int]] = {}
    for row, place in enumerate(of.tolist()):
        sets.setdefault(tuple(_key(column[row]) for column in others), {})[place] = row
    return list(sets.values())


def _key(value: Any) -> Any:
    """Return a hashable form of a value: lists are converted to text."""
    return json.dumps(value) if isinstance(value, list | dict) else value


def _is_drawn(table: Table, name: str, choices: Sequence[Any]) -> bool:
    """Return whether each flight or draw has its own value, so that flights are not compared by it.

    For a table without information on draws the seeds decide, unless all flights have the same.
    """
    if len(choices) == table.size:
        return True
    if table.about.drawn is not None:
        return name in table.about.drawn
    if not _are_numbers(choices):
        return False
    seeds = table.columns.get("seed", [None] * table.size)
    pairs = set(zip(seeds, table.columns[name], strict=True))
    return len(choices) == len(pairs) == len(set(seeds))


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) for value in values)
