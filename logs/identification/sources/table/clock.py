"""Times of day and dates as loggers write them, in seconds: ``16:04:05.25``, ``123:16:04:05.25``, ISO 8601."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from logs.identification.results import Array

LOOKED_AT = 50
"""cells by which a column is known"""
_CLOCK = re.compile(r"(?:(?:(\d{1,3}):)?(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:\.\d*)?)")
_PARTS = (86400.0, 3600.0, 60.0, 1.0)
_MOST = (math.inf, 24.0, 60.0, 61.0)
"""each part stays below; a leap second has number 60"""


def seconds_of(cell: str, decimal: str = ".") -> float:
    """Seconds of a clock (``minutes:seconds``, hours before them, the day of the year before those), since midnight
    or the year's beginning, or of a date with a time since 1970 (UTC where no zone is told); NaN of anything else."""
    text = cell.strip().replace(decimal, ".")
    clock = _CLOCK.fullmatch(text)
    if clock:
        return _told(clock.groups())
    try:
        date = datetime.fromisoformat(text) if ":" in text else None
    except ValueError:
        return math.nan
    if date is None:
        return math.nan
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _told(groups: tuple[str | None, ...]) -> float:
    """Of day, hours, minutes and seconds; what has a larger part before it goes no further than that part begins."""
    total, above = 0.0, False
    for part, unit, most in zip(groups, _PARTS, _MOST, strict=True):
        if part and float(part) >= most and (above or unit == 1.0):
            return math.nan
        total, above = total + float(part or 0.0) * unit, above or bool(part)
    return total


def clock_column(cells: Sequence[str], decimal: str) -> Array | None:
    """Seconds (N,) of a column of clocks or dates, NaN where a cell is none; None where most of them are none."""
    first = [cell for cell in cells if cell.strip()][:LOOKED_AT]
    if 2 * sum(math.isfinite(seconds_of(cell, decimal)) for cell in first) <= len(first):
        return None
    return np.array([seconds_of(cell, decimal) for cell in cells])
