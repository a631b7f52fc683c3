"""Small plots in the terminal: each character cell holds two by four braille dots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_BLANK = 0x2800
EMPTY = chr(_BLANK)
"""empty cell"""
Point = tuple[float, float]


class Window(NamedTuple):
    """Section of the plane to draw."""

    left: float
    right: float
    bottom: float
    top: float


def draw(lines: Iterable[Sequence[Point]], window: Window, columns: int, rows: int) -> list[str]:
    """Draw polylines of (x, y) into ``rows`` strings of ``columns`` characters, clipped to the window."""
    cells = [[0] * columns for _ in range(rows)]
    for line in lines:
        dots = [_dot(point, window, columns, rows) for point in line]
        for start, end in zip(dots, dots[1:] or dots, strict=False):
            _segment(cells, start, end)
    return ["".join(chr(_BLANK + cell) for cell in row) for row in cells]


def _dot(point: Point, window: Window, columns: int, rows: int) -> Point:
    """Return the position of a point in dots from the upper left corner, not rounded."""
    across = (point[0] - window.left) / ((window.right - window.left) or 1.0)
    up = (point[1] - window.bottom) / ((window.top - window.bottom) or 1.0)
    return across * (2 * columns - 1), (1.0 - up) * (4 * rows - 1)


def _segment(cells: list[list[int]], start: Point, end: Point) -> None:
    size = (2 * len(cells[0]) - 1, 4 * len(cells) - 1)
    inside = _clipped(start, end, size)
    if inside is None:
        return
    (x0, y0), (x1, y1) = inside
    steps = max(round(abs(x1 - x0)), round(abs(y1 - y0)), 1)
    for step in range(steps + 1):
        x = round(x0 + (x1 - x0) * step / steps)
        y = round(y0 + (y1 - y0) * step / steps)
        cells[y // 4][x // 2] |= _DOTS[x % 2][y % 4]


def _clipped(start: Point, end: Point, size: tuple[int, int]) -> tuple[Point, Point] | None:
    """Clip a segment to 0 to ``size`` (Liang and Barsky); None if it is outside."""
    if not all(math.isfinite(value) for value in (*start, *end)):
        return None
    enter, leave = 0.0, 1.0
    for begin, finish, limit in zip(start, end, size, strict=True):
        change = finish - begin
        if change == 0.0:
            if not 0.0 <= begin <= limit:
                return None
            continue
        ends = sorted((-begin / change, (limit - begin) / change))
        enter, leave = max(enter, ends[0]), min(leave, ends[1])
    if enter > leave:
        return None
    return _along(start, end, enter, size), _along(start, end, leave, size)


def _along(start: Point, end: Point, share: float, size: tuple[int, int]) -> Point:
    x, y = (a + (b - a) * share for a, b in zip(start, end, strict=True))
    return min(max(x, 0.0), float(size[0])), min(max(y, 0.0), float(size[1]))


def round_up(value: float) -> float:
    """Round up to the next of 1, 2, 5 times a power of ten, for the end of an axis."""
    if not 0.0 < value < math.inf:
        return 1.0
    size = 10.0 ** math.ceil(math.log10(value) - 1e-9)
    return next(size * share for share in (0.1, 0.2, 0.5, 1.0) if size * share >= value * (1 - 1e-9))
