"""Number formats: units, degrees, a dash for missing values."""

from __future__ import annotations

import math
from collections.abc import Callable

UNKNOWN = "–"
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def number(value: float | None, layout: str, unit: str = "") -> str:
    """Format ``value`` with ``layout`` (a format specification) and unit; a dash for None."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    return f"{value:{layout}} {unit}".rstrip()


def angle(value: float | None, layout: str = "+z.0f") -> str:
    """Format an angle (rad) in degrees."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{math.degrees(value):{layout}}°"


def bearing(value: float | None) -> str:
    """Format a direction (rad) as a compass bearing, 000° to 359°."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    return f"{round(math.degrees(value)) % 360:03d}°"


def compass_point(value: float | None) -> str:
    """Format a direction (rad) as one of eight compass points; empty for None."""
    if value is None or not math.isfinite(value):
        return ""
    return COMPASS[round(math.degrees(value) / 45.0) % 8]


def percent(value: float | None) -> str:
    """Format a fraction (0 to 1) in percent."""
    return UNKNOWN if value is None or not math.isfinite(value) else f"{100.0 * value:.0f} %"


def clock(seconds: float | None) -> str:
    """Format flight time as minutes, seconds and tenths."""
    if seconds is None or not math.isfinite(seconds):
        return UNKNOWN
    tenths = round(seconds * 10)
    return f"{tenths // 600:02d}:{tenths // 10 % 60:02d}.{tenths % 10}"


def duration(seconds: float) -> str:
    """Format a duration: 0.8 s, 12 s, 3 min 05 s."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def size(count: float) -> str:
    """Format a number of bytes in kB or MB."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.0f} kB"


def one_line(text: str) -> str:
    """Replace line feeds by symbols, so that text from a file or link cannot imitate program output."""
    return text.replace("\n", "\N{SYMBOL FOR LINE FEED}")


def words(identifier: str) -> str:
    """Convert ``CLIMB_OUT`` to ``climb out``."""
    return identifier.lower().replace("_", " ")


def significant(value: float, error: float) -> tuple[str, str]:
    """Format a value and its uncertainty, both rounded to two digits of the uncertainty."""
    if not (math.isfinite(value) and math.isfinite(error)) or error <= 0:
        return f"{value:.4g}", UNKNOWN
    decimals = max(0, 1 - math.floor(math.log10(error)))
    layout: Callable[[float], str] = lambda x: f"{x:.{min(decimals, 9)}f}" if decimals < 8 else f"{x:.3g}"  # noqa: E731
    return layout(value), layout(error)
