"""Small plots in the terminal: each character cell holds two by four braille dots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
_BLANK = 0x2800
Point = tuple[float, float]


class Window(NamedTuple):
    """The part of the plane that is drawn."""

    left: float
    right: float
    bottom: float
    top: float


def draw(lines: Iterable[Sequence[Point]], window: Window, columns: int, rows: int) -> list[str]:
    """Draw polylines of (x, y) into ``rows`` strings of ``columns`` characters; what leaves the window is cut."""
    cells = [[0] * columns for _ in range(rows)]
    for line in lines:
        dots = [_dot(point, window, columns, rows) for point in line]
        for start, end in zip(dots, dots[1:] or dots, strict=False):
            _segment(cells, start, end)
    return ["".join(chr(_BLANK + cell) for cell in row) for row in cells]


def _dot(point: Point, window: Window, columns: int, rows: int) -> tuple[int, int]:
    across = (point[0] - window.left) / ((window.right - window.left) or 1.0)
    up = (point[1] - window.bottom) / ((window.top - window.bottom) or 1.0)
    return round(across * (2 * columns - 1)), round((1.0 - up) * (4 * rows - 1))


def _segment(cells: list[list[int]], start: tuple[int, int], end: tuple[int, int]) -> None:
    steps = max(abs(end[0] - start[0]), abs(end[1] - start[1]), 1)
    for step in range(steps + 1):
        x = start[0] + (end[0] - start[0]) * step // steps
        y = start[1] + (end[1] - start[1]) * step // steps
        if 0 <= y < 4 * len(cells) and 0 <= x < 2 * len(cells[0]):
            cells[y // 4][x // 2] |= _DOTS[x % 2][y % 4]


def round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten: a calm upper end for an axis."""
    if value <= 0:
        return 1.0
    size = 1.0
    while size < value:
        size *= 10.0
    while size / 10.0 >= value:
        size /= 10.0
    return next(size * share for share in (0.1, 0.2, 0.5, 1.0) if size * share >= value * (1 - 1e-9))
