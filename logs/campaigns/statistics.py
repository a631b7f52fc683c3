"""Summary statistics, rank correlations and worst flights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.campaigns.metrics import METRICS
from logs.campaigns.table import Table
from wingbeat.errors import InputError

Array = NDArray[np.float64]

CHANCE = 3.0
"""-; a rank correlation below this over the square root of the number of flights may be chance"""
FEWEST = 12
"""-; flights, below which nothing is said of what an input has to do with a metric"""
TAILS = 20
"""-; flights, below which what 5 % lie below is but the least of them"""
DIGITS = 4
"""-; of the largest number of a metric"""
BY = ("hold_altitude_rms", "touchdown_sink", "estimate_altitude_rms", "bank")
"""metrics by which flights that did not fail are ordered, the first that has numbers"""


class Spread(NamedTuple):
    """How one metric is spread over the flights that have it."""

    name: str
    unit: str
    flights: int
    mean: float
    sigma: float
    """standard deviation; NaN of a single flight"""
    least: float
    low: float
    """5 % lie below; NaN of fewer than `TAILS` flights"""
    median: float
    high: float
    """95 % lie below; NaN of fewer than `TAILS` flights"""
    greatest: float


class Sensitivity(NamedTuple):
    """What a swept input has to do with a metric."""

    input: str
    metric: str
    rank_correlation: float
    """-; Spearman's, from -1 to 1"""
    flights: int
    """-; flights that have both"""

    @property
    def beyond_chance(self) -> bool:
        """Whether it is more than chance makes of so many flights, once in 370 times aside."""
        return abs(self.rank_correlation) > CHANCE / math.sqrt(self.flights)


class Worst(NamedTuple):
    """A flight that somebody should look at."""

    flight: int
    why: str
    value: float | None
    """of the metric by which it was chosen; None for one that failed"""
    command: str
    """that flies it again"""
    values: Mapping[str, Any]
    """of the swept inputs and the seed: what it was flown with"""


def numbers(table: Table, name: str) -> Array:
    """(flights,) of a column; NaN where it has none, and for what is no number."""
    return np.array([_number(value) for value in table.columns[name]], dtype=np.float64)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def metrics_of(table: Table) -> list[str]:
    """Metrics that any flight has."""
    return [name for name in METRICS if name in table.columns and np.isfinite(numbers(table, name)).any()]


def inputs_of(table: Table) -> list[str]:
    """Swept inputs that are numbers and differ between flights; the seed, whose size means nothing, is left out."""
    return [name for name in table.about.swept if name != "seed" and len(np.unique(finite(numbers(table, name)))) > 1]


def finite(values: Array) -> Array:
    """Those that are numbers."""
    return values[np.isfinite(values)]


def spreads(table: Table) -> list[Spread]:
    """Of every metric that any flight has."""
    return [_spread(name, table.units[name], finite(numbers(table, name))) for name in metrics_of(table)]


def _spread(name: str, unit: str, values: Array) -> Spread:
    low, median, high = (float(one) for one in np.percentile(values, (5.0, 50.0, 95.0)))
    low, high = (low, high) if len(values) >= TAILS else (math.nan, math.nan)
    sigma = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
    mean, least, greatest = float(values.mean()), float(values.min()), float(values.max())
    return Spread(name, unit, len(values), mean, sigma, least, low, median, high, greatest)


def format_column(values: Sequence[float]) -> list[str]:
    """Numbers of one metric with decimals in common, `DIGITS` digits of the largest; empty for NaN."""
    largest = max((abs(one) for one in values if math.isfinite(one)), default=0.0)
    places = max(DIGITS - 1 - math.floor(math.log10(largest)), 0) if largest else 0
    return [f"{one:.{places}f}" if math.isfinite(one) else "" for one in values]


def sensitivities(table: Table) -> list[Sensitivity]:
    """Of every pair of input and metric, the strongest first; ``failed`` is a metric here."""
    columns = {name: numbers(table, name) for name in metrics_of(table)}
    columns["failed"] = np.array(table.columns["failed"], dtype=np.float64)
    found = [
        one
        for name in inputs_of(table)
        for metric, values in columns.items()
        if (one := _sensitivity(name, metric, numbers(table, name), values)) is not None
    ]
    return sorted(found, key=lambda one: -abs(one.rank_correlation))


def _sensitivity(name: str, metric: str, inputs: Array, values: Array) -> Sensitivity | None:
    both = np.isfinite(inputs) & np.isfinite(values)
    if both.sum() < FEWEST:
        return None
    x, y = ranks(inputs[both]), ranks(values[both])
    spread = float(np.std(x) * np.std(y))
    if spread == 0.0:
        return None
    share = float(np.mean((x - x.mean()) * (y - y.mean()))) / spread
    return Sensitivity(name, metric, min(max(share, -1.0), 1.0), int(both.sum()))


def ranks(values: Array) -> Array:
    """(n,) from 0; equal values share the middle of their ranks."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    middle: Array = (last - 0.5 * (counts + 1))[place]
    return middle


def chosen_metric(table: Table, requested: str | None) -> str | None:
    """The metric by which flights are ordered; None where no flight has any.

    Raises:
        InputError: there is no metric of that name in the table.
    """
    present = metrics_of(table)
    if requested is None:
        return next((name for name in (*BY, *present) if name in present), None)
    if requested not in present:
        raise InputError(f"no flight has a metric {requested}; metrics: {', '.join(present) or 'none'}")
    return requested


def worst(table: Table, by: str | None, most: int) -> list[Worst]:
    """The worst flights: those that failed, then those that are worst by a metric, ``most`` of each."""
    failed = [i for i, one in enumerate(table.columns["failed"]) if one]
    found = [_worst(table, i, f"{table.columns['outcome'][i]}: {table.columns['reason'][i]}") for i in failed[:most]]
    return found if by is None else found + _worst_by(table, by, most)


def _worst_by(table: Table, by: str, most: int) -> list[Worst]:
    values = numbers(table, by)
    values[np.array(table.columns["failed"], dtype=bool)] = math.nan
    order: Sequence[int] = np.argsort(-values if METRICS[by].bad >= 0 else values, kind="stable").tolist()
    chosen = [i for i in order if math.isfinite(values[i])][:most]
    return [_worst(table, i, by, float(values[i])) for i in chosen]


def _worst(table: Table, row: int, why: str, value: float | None = None) -> Worst:
    flight = table.columns["flight"][row]
    command = f"wingbeat campaign {table.about.file} --flight {flight} --log flight-{flight}.mcap"
    values = {name: table.columns[name][row] for name in table.about.swept}
    return Worst(flight, why, value, command, values)
