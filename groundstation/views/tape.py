"""Tape instruments for airspeed and altitude."""

from __future__ import annotations

import math
from typing import NamedTuple

from rich.text import Text

from groundstation.views import wording

INK = "#aab4c0"
WINDOW = "bold #0b0e12 on #ffcc33"
BUG = "bold #d16ad1"
FAINT = "#5b6672"


class Scale(NamedTuple):
    """Scale of a tape."""

    heading: str
    """-; name of the quantity"""
    unit: str
    """-; shown below the heading"""
    row: float
    """in the unit; step of a row"""
    mark: int
    """number of rows between two labels"""
    layout: str = ".1f"
    """-; number format of the value"""
    lowest: float = -math.inf
    """in the unit; lower end of the scale"""


AIRSPEED = Scale("airspeed", "m/s", 0.5, 2, lowest=0.0)
ALTITUDE = Scale("altitude", "m", 1.0, 5)


def tape(scale: Scale, value: float | None, target: float | None, columns: int, rows: int) -> Text:
    """Draw the tape with ``value`` in the middle and a bug at ``target`` (in the scale's unit, None if unknown)."""
    heading = Text(f"{scale.heading:^{columns}}\n", style=INK, no_wrap=True, end="")
    heading.append(f"{scale.unit:^{columns}}", style=FAINT)
    known = value is not None and math.isfinite(value)
    middle = rows // 2 - 2  # level with the middle of the horizon beside it
    base = round(value / scale.row) if value is not None and known else 0
    for row in range(rows - 2):
        heading.append("\n")
        if row == middle:
            heading.append(f" {wording.number(value, 'z' + scale.layout):^{columns - 2}} ", style=WINDOW)
        elif known:
            _row(heading, scale, base + middle - row, target, columns)
    return heading


def _row(text: Text, scale: Scale, number: int, target: float | None, columns: int) -> None:
    """Return one row of the scale: a label at every mark, a tick elsewhere, the bug at the setpoint."""
    here = number * scale.row
    if here < scale.lowest:
        return
    marked = number % scale.mark == 0
    label = f"{here:.0f}" if marked else ""
    text.append(f"{label:>{columns - 3}} ", style=INK)
    if target is not None and math.isfinite(target) and round(target / scale.row) == number:
        text.append("◀", style=BUG)
    else:
        text.append("┤" if marked else "╷", style=FAINT)
