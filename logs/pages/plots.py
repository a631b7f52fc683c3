"""Plots as JSON data for uPlot."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from logs.pages.document import POINTS, Array, Band, Plot, Series
from logs.pages.labels import plain, unit

LINE_SAMPLES = 4000
"""limit of the samples of a line, beyond which minimum and maximum of each interval are kept"""
POINT_SAMPLES = 2500
"""limit of the points of a scatter plot"""
DIGITS = 5
"""decimal digits of the range of a column"""
POINT_DIGITS = 7
"""the same of the x of a scatter plot"""


def plot_data(plot: Plot, sync: str = "") -> dict[str, Any] | None:
    """Return the data that ``plots.js`` reads; None without a finite sample. ``sync`` groups plots with one cursor.

    Keys: ``x``, ``unit``, ``sync``, ``columns`` (rows of numbers, null for a gap), ``series`` (``label``, ``role``,
    ``style``, indices ``x`` and ``y`` of columns), ``bands`` (``label``, ``x``, ``low``, ``high``), ``marks``.
    """
    columns = _Columns()
    series = [_series(one, columns) for one in plot.series if np.any(np.isfinite(one.x) & np.isfinite(one.y))]
    if not series:
        return None
    return {
        "x": plain(plot.x) + (f" ({unit(plot.x_unit)})" if unit(plot.x_unit) else ""),
        "unit": unit(plot.y_unit),
        "sync": sync,
        "series": series,
        "bands": [_band(one, columns) for one in plot.bands],
        "marks": [[float(x), label] for x, label in plot.marks],
        "columns": columns.rows,
    }


class _Columns:
    """Columns of one plot; equal ones are stored once."""

    def __init__(self) -> None:
        self.rows: list[list[float | None]] = []

    def add(self, values: Array, digits: int = DIGITS) -> int:
        """Return the index of a column, rounded to ``digits`` of its range."""
        finite = values[np.isfinite(values)]
        size = float(np.ptp(finite)) or float(np.max(np.abs(finite), initial=0.0)) or 1.0
        places = digits - math.floor(math.log10(size))
        rounded = np.round(values, places).tolist()
        row = [value if math.isfinite(value) else None for value in rounded]
        if row not in self.rows:
            self.rows.append(row)
        return self.rows.index(row)


def _series(one: Series, columns: _Columns) -> dict[str, Any]:
    x, y = np.asarray(one.x, dtype=np.float64), np.asarray(one.y, dtype=np.float64)
    x, y = _points(x, y) if one.style == POINTS else decimated(x, y)
    places = columns.add(x, POINT_DIGITS if one.style == POINTS else DIGITS), columns.add(y)
    return {"label": plain(one.label), "role": one.role, "style": one.style, "x": places[0], "y": places[1]}


def _band(one: Band, columns: _Columns) -> dict[str, Any]:
    finite = np.isfinite(one.low) & np.isfinite(one.high)
    x, low, high = (columns.add(values[finite]) for values in (one.x, one.low, one.high))
    return {"label": plain(one.label), "x": x, "low": low, "high": high}


def _points(x: Array, y: Array) -> tuple[Array, Array]:
    """Points with strictly ascending x, as uPlot requires: equal x differ by less than a pixel."""
    finite = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if len(finite) > POINT_SAMPLES:
        finite = finite[np.linspace(0, len(finite) - 1, POINT_SAMPLES).astype(int)]
    order = finite[np.argsort(x[finite], kind="stable")]
    x, y = x[order], y[order]
    step = (float(np.ptp(x)) or abs(float(x[0])) or 1.0) * 10.0 ** (1 - POINT_DIGITS)
    offset = np.arange(len(x)) * step
    # Each x is at least one rounding step above the one before.
    return np.maximum.accumulate(x - offset) + offset, y


def decimated(x: Array, y: Array) -> tuple[Array, Array]:
    """Return at most about `LINE_SAMPLES` samples of a line, with minimum, maximum and gaps of every interval."""
    if len(x) <= LINE_SAMPLES:
        return x, y
    chosen = {0, len(x) - 1}
    for first, after in pairwise(np.linspace(0, len(x), LINE_SAMPLES // 2 + 1).astype(int).tolist()):
        values = y[first:after]
        if np.all(np.isfinite(values)):
            chosen |= {first + int(np.argmin(values)), first + int(np.argmax(values))}
        else:
            chosen |= {first, first + int(np.argmax(~np.isfinite(values)))}
    indices = np.array(sorted(chosen))
    return x[indices], y[indices]
