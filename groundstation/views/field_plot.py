"""Any field of any message over time, in braille."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from rich.text import Text

from groundstation.views import braille

LABEL = "#8794a2"
FAINT = "#5b6672"
COLORS = ("#5fc8d8", "#ffcc33", "#d16ad1", "#6cc26c")
AXIS = 10
"""characters; width of the axis labels"""


class Trace(NamedTuple):
    """Data of a field to plot."""

    name: str
    """-; MESSAGE.field"""
    unit: str
    """-; of the values, empty for none"""
    points: Sequence[tuple[float, float]]
    """(s of any clock, value in ``unit``), oldest first"""


def field_plot(trace: Trace, now: float, columns: int, rows: int, color: str = COLORS[0]) -> Text:
    """Plot the trace up to ``now`` (s, the clock of its points), with name, last value, range and time axis."""
    points = [point for point in trace.points if math.isfinite(point[1])]
    text = _title(trace, points, columns, color)
    if not points:
        return text.append("\n  nothing received yet", style=FAINT)
    low, high = _bounds([value for _, value in points])
    start = min(points[0][0], now - 10.0)
    lines = braille.draw([points], braille.Window(start, now, low, high), columns - AXIS - 1, rows - 2)
    for row, line in enumerate(lines):
        label = _number(high) if row == 0 else _number(low) if row == len(lines) - 1 else ""
        text.append(f"\n{label:>{AXIS - 1}} ", style=LABEL).append("│", style=FAINT).append(line, style=color)
    left, right = f"−{now - start:.0f} s", "now"
    rule = "─" * max(columns - AXIS - 1 - len(left) - len(right), 1)
    return text.append(f"\n{'':{AXIS}}└{left}{rule}{right}", style=FAINT)


def _title(trace: Trace, points: Sequence[tuple[float, float]], columns: int, color: str) -> Text:
    text = Text(f" {trace.name}", style=f"bold {color}", no_wrap=True, end="", overflow="ellipsis")
    if points:
        values = [value for _, value in points]
        text.append(f"  {_number(values[-1])} {trace.unit}".rstrip(), style="bold #e6ebf0")
        text.append(f"   {_number(min(values))} to {_number(max(values))}", style=FAINT)
    text.truncate(columns, overflow="ellipsis")
    return text


def _bounds(values: Sequence[float]) -> tuple[float, float]:
    """Return the axis limits: multiples of 1, 2 or 5 times a power of ten."""
    low, high = min(values), max(values)
    spread = high - low or abs(high) or 1.0
    step = braille.round_up(0.2 * spread)
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return (low, high) if high > low else (low - step, high + step)


def _number(value: float) -> str:
    return f"{value + 0.0:.5g}"
