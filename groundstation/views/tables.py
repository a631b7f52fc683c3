"""Tables that never cut names, units or numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from groundstation.link.parameters import Parameter

PARAMETER_TYPES = {1: "uint8", 2: "int8", 3: "uint16", 4: "int16", 5: "uint32", 6: "int32", 9: "float"}

GAP, NARROW = 3, 2
"""characters between two columns: normal, and on a narrow terminal"""
READABLE = 32
"""characters; minimum width of a text column, below which its text is put below the row"""
INDENT = 4
"""characters; indentation of text below its row"""
FOLDED = 2
"""-; maximum number of lines of a name"""

NAME, NUMBER, UNIT, GROUP, SENTENCES, SPARE = "", "right", "unit", "group", "text", "spare"
"""kinds of columns: names wrap between words, numbers and units do not, a group is the name of the rows below it,
sentences wrap anywhere between words, spare columns are omitted on a narrow terminal
"""


class _Column(NamedTuple):
    heading: str
    kind: str
    cells: tuple[Text, ...]

    @property
    def full(self) -> int:
        """Return the width without wrapping, in characters."""
        return max(map(_length, (Text(self.heading), *self.cells)), default=0)

    def least(self, lines: int) -> int:
        """Return the least width, at which no number or unit is cut and names take at most ``lines``."""
        words = max(map(cell_len, self.heading.split()), default=0)
        if self.kind in (NUMBER, UNIT):
            return max([words, *map(_length, self.cells)])
        if self.kind == SENTENCES:
            return min(READABLE, self.full)
        return max([words, *(_narrowest(one.plain, lines) for one in self.cells)])


class _Block(NamedTuple):
    """Columns that are side by side."""

    columns: tuple[_Column, ...]
    widths: tuple[int, ...]
    gap: int


class _Around(NamedTuple):
    """Columns that are not beside the others, and the terminal width in characters."""

    width: int
    groups: tuple[_Column, ...] = ()
    names: tuple[_Column, ...] = ()
    """names and units, above their numbers"""
    below: tuple[_Column, ...] = ()

    def over(self, groups: Sequence[Text], names: Sequence[Text]) -> Iterator[Text]:
        """Return the lines above a row."""
        inset = NARROW if self.groups else 0
        for text in groups:
            yield from (line for line in _folded(text, self.width) if line)
        joined = Text("  ").join([one for one in names if one])
        yield from (_indented(line, inset) for line in _folded(joined, self.width - inset) if line)

    def inset(self, lines: Iterable[Text]) -> Iterator[Text]:
        """Return the lines of a row."""
        yield from (_indented(line, INDENT if self.names else 0) for line in lines)

    def under(self, texts: Sequence[Text]) -> Iterator[Text]:
        """Return the lines below a row."""
        for text in texts:
            yield from (_indented(line, INDENT) for line in _folded(text, self.width - INDENT) if line)


class PlainTable:
    """Table without rules that fits itself to the terminal.

    If it is too wide, these measures are taken in order: spare columns are omitted; a group is put above its rows;
    the column gap is reduced; names and headings wrap between words; sentences are put below their row; names are put
    above their numbers; the columns that do not fit form another table below, with names and units again.
    """

    def __init__(self, columns: Sequence[tuple[str, str]], header: bool) -> None:
        self._columns = tuple(columns)
        self._header = header
        self._rows: list[tuple[Text, ...]] = []

    def add_row(self, *cells: str | Text) -> None:
        """Add a row with a cell for each column; a text without markup, or with its own styles."""
        padded = (*cells, *[""] * (len(self._columns) - len(cells)))
        self._rows.append(tuple(one.copy() if isinstance(one, Text) else Text(one) for one in padded))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield lines without trailing blanks, within the terminal width if every word fits."""
        for line in self._lines(options.max_width):
            line.rstrip()
            line.overflow = "fold"
            yield line

    def _lines(self, width: int) -> Iterator[Text]:
        columns = self._filled()
        if _needed([one.full for one in columns], GAP) <= width:
            yield from self._block(_fitted(columns, FOLDED, width), _Around(width))
            return
        around = _Around(width, tuple(one for one in columns if one.kind == GROUP))
        beside = tuple(one for one in columns if one.kind not in (GROUP, SPARE))
        if _needed([one.least(FOLDED) if one.kind == SENTENCES else one.full for one in beside], NARROW) > width:
            around = around._replace(below=tuple(one for one in beside if one.kind == SENTENCES))
            beside = tuple(one for one in beside if one.kind != SENTENCES)
        first = next((i for i, one in enumerate(beside) if one.kind == NUMBER), len(beside))
        alone = _needed([one.least(FOLDED) for one in beside[first:]], NARROW) <= width - INDENT
        if 0 < first < len(beside) and alone and _needed([one.least(FOLDED) for one in beside], NARROW) > width:
            block = _fitted(beside[first:], FOLDED, width - INDENT)
            yield from self._block(block, around._replace(names=beside[:first]))
            return
        for place, block in enumerate(_blocks(beside, width)):
            if place:
                yield Text()
            yield from self._block(block, around._replace(below=() if place else around.below))

    def _filled(self) -> tuple[_Column, ...]:
        """Return the columns with content."""
        cells = zip(*self._rows, strict=True) if self._rows else ((),) * len(self._columns)
        columns = (_Column(*one, tuple(those)) for one, those in zip(self._columns, cells, strict=True))
        return tuple(one for one in columns if any(one.cells) or not self._rows)

    def _block(self, block: _Block, around: _Around) -> Iterator[Text]:
        if self._header:
            groups, names, row, below = (
                [Text(one.heading, "dim") for one in those]
                for those in (around.groups, around.names, block.columns, around.below)
            )
            lines = (*around.over(groups, names), *around.inset(_row(row, block)), *around.under(below))
            yield from (line for line in lines if line.plain.strip())
        for i in range(len(self._rows)):
            yield from around.over([one.cells[i] for one in around.groups], [one.cells[i] for one in around.names])
            yield from around.inset(_row([one.cells[i] for one in block.columns], block))
            yield from around.under([one.cells[i] for one in around.below])


def plain_table(*columns: tuple[str, str], header: bool = True) -> PlainTable:
    """Create a table without rules: each column has a heading and a kind, such as `NUMBER`."""
    return PlainTable(columns, header)


def _blocks(columns: Sequence[_Column], width: int) -> Iterator[_Block]:
    """Split the columns into tables of the given width, with names and units in each."""
    keys = {*range(_names(columns)), *(i for i, one in enumerate(columns) if one.kind == UNIT)}
    lines = FOLDED if all(_fits(columns, {*keys, i}, FOLDED, width) for i in range(len(columns))) else width
    left = [i for i in range(len(columns)) if i not in keys]
    while True:
        chosen = set(keys)
        while left and (chosen == keys or _fits(columns, {*chosen, left[0]}, lines, width)):
            chosen.add(left.pop(0))
        yield _fitted([columns[i] for i in sorted(chosen)], lines, width)
        if not left:
            return


def _names(columns: Sequence[_Column]) -> int:
    """Return the columns that identify a row: the first, and names after it."""
    return next((i for i, one in enumerate(columns) if i and one.kind != NAME), len(columns))


def _fits(columns: Sequence[_Column], chosen: Iterable[int], lines: int, width: int) -> bool:
    return _needed([columns[i].least(lines) for i in chosen], NARROW) <= width


def _fitted(columns: Sequence[_Column], lines: int, width: int) -> _Block:
    """Return the columns in full width, the widest reduced until all fit."""
    widths = [one.full for one in columns]
    if _needed(widths, GAP) <= width:
        return _Block(tuple(columns), tuple(widths), GAP)
    least = [one.least(lines) for one in columns]
    while _needed(widths, NARROW) > width:
        wide = [i for i in range(len(widths)) if widths[i] > least[i]]
        if not wide:
            break
        widths[max(wide, key=lambda i: (columns[i].kind == SENTENCES, widths[i]))] -= 1
    return _Block(tuple(columns), tuple(widths), NARROW)


def _needed(widths: Sequence[int], gap: int) -> int:
    return sum(widths) + gap * max(len(widths) - 1, 0)


def _length(text: Text) -> int:
    return max((cell_len(line) for line in text.plain.splitlines()), default=0)


def _narrowest(text: str, lines: int) -> int:
    """Return the width at which ``text`` wraps between words to at most ``lines`` lines."""
    words = re.findall(r"\S+\s*", text)
    width = max((cell_len(word.rstrip()) for word in words), default=0)
    while _count(words, width) > lines:
        width += 1
    return width


def _count(words: Sequence[str], width: int) -> int:
    """Return the number of lines of the words."""
    lines, used = 0, width
    for word in words:
        if used + cell_len(word.rstrip()) > width:
            lines, used = lines + 1, 0
        used += cell_len(word)
    return lines


def _folded(text: Text, width: int) -> list[Text]:
    """Wrap a text between words."""
    lines = text.wrap(_RULER, max(width, 1), justify="left", overflow="fold")
    for line in lines:
        line.rstrip()
    return list(lines)


_RULER = Console(width=10_000)
"""measures texts, without output"""


def _row(cells: Sequence[Text], block: _Block) -> Iterator[Text]:
    """Return the lines of a row, as many as its tallest cell has."""
    folded = [_folded(cell, width) for cell, width in zip(cells, block.widths, strict=True)]
    for i in range(max(map(len, folded), default=0)):
        line = Text()
        for lines, column, width in zip(folded, block.columns, block.widths, strict=True):
            cell = lines[i] if i < len(lines) else Text()
            blank = " " * (width - cell.cell_len)
            gap = " " * (block.gap if column is not block.columns[-1] else 0)
            line.append_text(Text.assemble(*((blank, cell) if column.kind == NUMBER else (cell, blank)), gap))
        yield line


def _indented(line: Text, inset: int) -> Text:
    return Text.assemble(" " * inset, line)


def parameter_record(parameter: Parameter) -> dict[str, Any]:
    """Return a parameter as a JSON object."""
    kind = PARAMETER_TYPES.get(parameter.kind, str(parameter.kind))
    return {"name": parameter.name, "value": parameter.value, "type": kind}
