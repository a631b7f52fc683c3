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
"""-; significance limit of a rank correlation, times the square root of the number of flights"""
FEWEST = 12
"""-; minimum number of flights for a sensitivity"""
TAILS = 20
"""-; minimum number of flights for percentiles"""
DIGITS = 4
"""-; significant digits of the largest number of a metric"""
BY = ("hold_altitude_rms", "touchdown_sink", "estimate_altitude_rms", "bank")
"""metrics that order the flights without failure; the first one with numbers is used"""


class Spread(NamedTuple):
    """Distribution of one metric over the flights that have it."""

    name: str
    unit: str
    flights: int
    mean: float
    sigma: float
    """standard deviation; NaN for a single flight"""
    least: float
    low: float
    """5th percentile; NaN for fewer than `TAILS` flights"""
    median: float
    high: float
    """95th percentile; NaN for fewer than `TAILS` flights"""
    greatest: float


class Sensitivity(NamedTuple):
    """Sensitivity of a metric to a swept input."""

    input: str
    metric: str
    rank_correlation: float
    """-; Spearman's rank correlation, -1 to 1"""
    flights: int
    """-; flights with both values"""

    @property
    def beyond_chance(self) -> bool:
        """Whether the correlation exceeds three standard deviations of chance (one false result in 370)."""
        return abs(self.rank_correlation) > CHANCE / math.sqrt(self.flights)


class Worst(NamedTuple):
    """Flight to be examined: it failed or has one of the worst metrics."""

    flight: int
    why: str
    value: float | None
    """of the metric of its selection; None for a failed flight"""
    command: str
    """command that repeats the flight"""
    values: Mapping[str, Any]
    """of the swept inputs and the seed"""


def numbers(table: Table, name: str) -> Array:
    """Return (flights,) values of a column; NaN for missing values and text."""
    return np.array([_number(value) for value in table.columns[name]], dtype=np.float64)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def metrics_of(table: Table) -> list[str]:
    """Return the metrics that any flight has."""
    return [name for name in METRICS if name in table.columns and np.isfinite(numbers(table, name)).any()]


def inputs_of(table: Table) -> list[str]:
    """Return the numeric swept inputs that vary; the seed is excluded because its magnitude has no meaning."""
    return [name for name in table.about.swept if name != "seed" and len(np.unique(finite(numbers(table, name)))) > 1]


def finite(values: Array) -> Array:
    """Return the values that are not NaN."""
    return values[np.isfinite(values)]


def spreads(table: Table) -> list[Spread]:
    """Compute the distribution of every metric that any flight has."""
    return [_spread(name, table.units[name], finite(numbers(table, name))) for name in metrics_of(table)]


def _spread(name: str, unit: str, values: Array) -> Spread:
    low, median, high = (float(one) for one in np.percentile(values, (5.0, 50.0, 95.0)))
    low, high = (low, high) if len(values) >= TAILS else (math.nan, math.nan)
    sigma = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
    mean, least, greatest = float(values.mean()), float(values.min()), float(values.max())
    return Spread(name, unit, len(values), mean, sigma, least, low, median, high, greatest)


def format_column(values: Sequence[float]) -> list[str]:
    """Format numbers of one metric with common decimals, `DIGITS` digits of the largest; empty for NaN."""
    largest = max((abs(one) for one in values if math.isfinite(one)), default=0.0)
    places = max(DIGITS - 1 - math.floor(math.log10(largest)), 0) if largest else 0
    return [f"{one:.{places}f}" if math.isfinite(one) else "" for one in values]


def sensitivities(table: Table) -> list[Sensitivity]:
    """Compute the sensitivity of every metric, ``failed`` included, to every input, strongest first."""
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
    """Return (n,) ranks from 0; equal values share their mean rank."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    middle: Array = (last - 0.5 * (counts + 1))[place]
    return middle


def chosen_metric(table: Table, requested: str | None) -> str | None:
    """Return the metric that orders the flights; None if no flight has any.

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
    """Return the failed flights, then the flights worst by the metric ``by``, ``most`` of each."""
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
