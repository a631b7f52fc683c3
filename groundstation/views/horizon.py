"""Artificial horizon with pitch ladder and bank scale."""

from __future__ import annotations

import math

from rich.text import Text

from groundstation.views import braille
from groundstation.views.canvas import Canvas, Color

SKY: tuple[Color, ...] = ((44, 108, 178), (36, 94, 160), (29, 80, 142), (22, 66, 122))
"""colors upwards from the horizon"""
GROUND: tuple[Color, ...] = ((122, 84, 48), (106, 72, 40), (90, 61, 34), (76, 51, 28))
"""colors downwards from the horizon"""
SHADE = math.radians(12.0)
"""rad; elevation range of a shade"""
BLANK: Color = (28, 32, 38)
LINE: Color = (235, 238, 242)
FAINT: Color = (170, 186, 204)
AIRCRAFT: Color = (255, 204, 51)
SPAN = math.radians(50.0)
"""rad; elevation range of the view"""
RUNG = math.radians(10.0)
BANKS = (-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60)
"""deg; marks of the bank scale"""


def horizon(roll: float | None, pitch: float | None, columns: int, rows: int) -> Text:
    """Draw the horizon for ``roll`` and ``pitch`` (rad, None if unknown), ``columns`` by ``rows`` cells."""
    canvas = Canvas(columns, rows, BLANK)
    if roll is None or pitch is None or not math.isfinite(roll + pitch):
        canvas.write(columns // 2 - 5, rows // 2, "no attitude", FAINT)
        return canvas.text()
    _paint(canvas, roll, pitch)
    _ladder(canvas, roll, pitch)
    _bank_scale(canvas, roll)
    _aircraft(canvas)
    return canvas.text()


def _per_radian(canvas: Canvas) -> float:
    """Return pixels per radian of elevation."""
    return 2 * canvas.rows / SPAN


def _paint(canvas: Canvas, roll: float, pitch: float) -> None:
    """Draw sky and ground: the color of a pixel depends on its elevation, which is linear along a row."""
    scale = _per_radian(canvas)
    sine, cosine = math.sin(roll), math.cos(roll)
    middle_x, middle_y = 0.5 * (canvas.columns - 1), canvas.rows - 0.5
    for y in range(2 * canvas.rows):
        up = (middle_y - y) * cosine
        elevations = (pitch + (up - (x - middle_x) * sine) / scale for x in range(canvas.columns))
        canvas.row(y, [_shade(elevation) for elevation in elevations])


def _shade(elevation: float) -> Color:
    shades = SKY if elevation >= 0.0 else GROUND
    return shades[min(int(abs(elevation) / SHADE), len(shades) - 1)]


def _ladder(canvas: Canvas, roll: float, pitch: float) -> None:
    """Draw a pitch ladder with ten-degree spacing, below the bank scale."""
    nearest = round(pitch / RUNG)
    half = min(canvas.columns / 8.0, 8.0)
    lines = []
    for rung in range(nearest - 3, nearest + 4):
        up = (rung * RUNG - pitch) * _per_radian(canvas)
        if rung == 0 or up > canvas.rows - 6.0 or abs(rung * RUNG) > math.radians(80.0):
            continue
        lines.append([_place(canvas, roll, side, up) for side in (-half, half)])
        if abs(up) < 2.0:
            continue  # the aircraft's symbol is there
        for side in (-half - 2.5, half + 2.5):
            _number(canvas, _place(canvas, roll, side, up), f"{abs(rung) * 10}")
    _draw(canvas, lines, FAINT)


def _draw(canvas: Canvas, lines: list[list[tuple[float, float]]], color: Color) -> None:
    """Draw thin lines in braille dots over the pixels."""
    window = braille.Window(0.0, canvas.columns - 0.5, 2.0 * canvas.rows - 0.75, -0.25)
    for row, letters in enumerate(braille.draw(lines, window, canvas.columns, canvas.rows)):
        for column, letter in enumerate(letters):
            if letter != braille.EMPTY:
                canvas.write(column, row, letter, color)


def _place(canvas: Canvas, roll: float, across: float, up: float) -> tuple[float, float]:
    """Return the pixel of a point in earth axes, ``across`` and ``up`` in pixels from the center."""
    x = 0.5 * (canvas.columns - 1) + across * math.cos(roll) - up * math.sin(roll)
    y = canvas.rows - 0.5 - across * math.sin(roll) - up * math.cos(roll)
    return x, y


def _number(canvas: Canvas, place: tuple[float, float], text: str) -> None:
    row = math.floor(place[1] / 2)
    if 2 < row < canvas.rows - 1:
        canvas.write(round(place[0]) - len(text) // 2, row, text, FAINT)


def _bank_scale(canvas: Canvas, roll: float) -> None:
    radius = min(canvas.rows - 1.0, 0.5 * canvas.columns - 2.0)
    marks = []
    for bank in BANKS:
        length = 3.0 if bank % 30 == 0 else 1.5
        ends = (_polar(math.radians(bank), radius), _polar(math.radians(bank), radius - length))
        marks.append([_place(canvas, 0.0, *end) for end in ends])
    _draw(canvas, marks, LINE)
    pointer = min(max(-roll, -math.radians(70.0)), math.radians(70.0))
    x, y = _place(canvas, 0.0, *_polar(pointer, radius - 4.0))
    canvas.write(round(x), math.floor(y / 2), "▲", AIRCRAFT)


def _polar(bank: float, radius: float) -> tuple[float, float]:
    return radius * math.sin(bank), radius * math.cos(bank)


def _aircraft(canvas: Canvas) -> None:
    """Draw the fixed aircraft symbol."""
    row, middle = canvas.rows // 2, canvas.columns // 2
    wing = max(min(canvas.columns // 10, 6), 2)
    canvas.write(middle - wing - 3, row, "━" * wing + "┓", AIRCRAFT)
    canvas.write(middle + 3, row, "┏" + "━" * wing, AIRCRAFT)
    canvas.write(middle, row, "●", AIRCRAFT)
