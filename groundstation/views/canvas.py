"""A raster image in character cells, two pixels per cell."""

from __future__ import annotations

from rich.color import Color as RichColor
from rich.style import Style
from rich.text import Text

Color = tuple[int, int, int]
"""red, green, blue, 0 to 255"""
UPPER = "▀"


class Canvas:
    """Canvas of ``columns`` by ``rows`` cells, which are ``columns`` by twice ``rows`` pixels, with text overlay."""

    def __init__(self, columns: int, rows: int, ground: Color) -> None:
        self.columns, self.rows = columns, rows
        self._pixels = [[ground] * columns for _ in range(2 * rows)]
        self._letters: dict[tuple[int, int], tuple[str, Color]] = {}

    def set(self, x: int, y: int, color: Color) -> None:
        """Set the pixel in column ``x`` and row ``y`` from the top; pixels outside are ignored."""
        if 0 <= x < self.columns and 0 <= y < 2 * self.rows:
            self._pixels[y][x] = color

    def row(self, y: int, colors: list[Color]) -> None:
        """Set a row of pixels."""
        self._pixels[y] = colors

    def write(self, column: int, row: int, text: str, color: Color) -> None:
        """Write text over the cells from ``column``."""
        for place, letter in enumerate(text, column):
            if 0 <= place < self.columns and 0 <= row < self.rows:
                self._letters[row, place] = (letter, color)

    def text(self) -> Text:
        """Return the text; adjacent cells of one style form a span."""
        text = Text(no_wrap=True, end="")
        for row in range(self.rows):
            if row:
                text.append("\n")
            self._append_row(text, row)
        return text

    def _append_row(self, text: Text, row: int) -> None:
        upper, lower = self._pixels[2 * row], self._pixels[2 * row + 1]
        run, style = "", None
        for column in range(self.columns):
            letter, here = self._cell(row, column, upper[column], lower[column])
            if here != style and run:
                text.append(run, _style(style))
                run = ""
            run, style = run + letter, here
        text.append(run, _style(style))

    def _cell(self, row: int, column: int, upper: Color, lower: Color) -> tuple[str, tuple[Color, Color]]:
        written = self._letters.get((row, column))
        if written is not None:
            return written[0], (written[1], lower)
        return (UPPER, (upper, lower)) if upper != lower else (" ", (lower, lower))


_STYLES: dict[tuple[Color, Color], Style] = {}


def _style(colors: tuple[Color, Color] | None) -> Style:
    if colors is None:
        return Style.null()
    known = _STYLES.get(colors)
    if known is None:
        ink, paper = (RichColor.from_rgb(*color) for color in colors)
        known = _STYLES[colors] = Style(color=ink, bgcolor=paper)
    return known
