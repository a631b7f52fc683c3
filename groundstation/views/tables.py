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
"""characters between two columns: where there is room, and where there is none"""
READABLE = 32
"""characters; sentences in a narrower column stand below their row instead"""
INDENT = 4
"""characters; of sentences below their row"""
FOLDED = 2
"""-; lines that a name may take"""

NAME, NUMBER, UNIT, GROUP, SENTENCES, SPARE = "", "right", "unit", "group", "text", "spare"
"""kinds of columns: names fold between words, numbers and units stay whole, a group is the name of the rows below it,
sentences fold as they come, what is spare is left out where there is no room"""


class _Column(NamedTuple):
    heading: str
    kind: str
    cells: tuple[Text, ...]

    @property
    def full(self) -> int:
        """Characters that nothing of it has to be folded for."""
        return max(map(_length, (Text(self.heading), *self.cells)), default=0)

    def least(self, lines: int) -> int:
        """Characters below which a number or unit is cut, or a name takes more than so many ``lines``."""
        words = max(map(cell_len, self.heading.split()), default=0)
        if self.kind in (NUMBER, UNIT):
            return max([words, *map(_length, self.cells)])
        if self.kind == SENTENCES:
            return min(READABLE, self.full)
        return max([words, *(_narrowest(one.plain, lines) for one in self.cells)])


class _Block(NamedTuple):
    """Columns beside each other."""

    columns: tuple[_Column, ...]
    widths: tuple[int, ...]
    gap: int


class _Around(NamedTuple):
    """Columns that do not stand beside the others, on a terminal of so many characters."""

    width: int
    groups: tuple[_Column, ...] = ()
    names: tuple[_Column, ...] = ()
    """and their units, above their numbers"""
    below: tuple[_Column, ...] = ()

    def over(self, groups: Sequence[Text], names: Sequence[Text]) -> Iterator[Text]:
        """Lines above a row."""
        inset = NARROW if self.groups else 0
        for text in groups:
            yield from (line for line in _folded(text, self.width) if line)
        joined = Text("  ").join([one for one in names if one])
        yield from (_indented(line, inset) for line in _folded(joined, self.width - inset) if line)

    def inset(self, lines: Iterable[Text]) -> Iterator[Text]:
        """Lines of the row itself."""
        yield from (_indented(line, INDENT if self.names else 0) for line in lines)

    def under(self, texts: Sequence[Text]) -> Iterator[Text]:
        """Lines below a row."""
        for text in texts:
            yield from (_indented(line, INDENT) for line in _folded(text, self.width - INDENT) if line)


class PlainTable:
    """A table without lines that fits itself to the terminal.

    Where it is too wide, in this order: what is spare is left out; a group stands above its rows; the columns move
    together; names and headings fold between words; sentences stand below their row; names stand above their numbers;
    where those are too many for a line, the columns that find no room stand in a table of their own below, with names
    and units again.
    """

    def __init__(self, columns: Sequence[tuple[str, str]], header: bool) -> None:
        self._columns = tuple(columns)
        self._header = header
        self._rows: list[tuple[Text, ...]] = []

    def add_row(self, *cells: str | Text) -> None:
        """A cell for each column; a text without markup, or with its own styles."""
        padded = (*cells, *[""] * (len(self._columns) - len(cells)))
        self._rows.append(tuple(one.copy() if isinstance(one, Text) else Text(one) for one in padded))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Lines without trailing blanks, no longer than the terminal is wide as long as every word fits on it."""
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
        """Columns that have anything in them."""
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
    """A table without lines: each column is a heading and its kind, such as `NUMBER`."""
    return PlainTable(columns, header)


def _blocks(columns: Sequence[_Column], width: int) -> Iterator[_Block]:
    """The columns in as many tables as the width asks for, names and units in each."""
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
    """Columns that say what a row is: the first, and names behind it."""
    return next((i for i, one in enumerate(columns) if i and one.kind != NAME), len(columns))


def _fits(columns: Sequence[_Column], chosen: Iterable[int], lines: int, width: int) -> bool:
    return _needed([columns[i].least(lines) for i in chosen], NARROW) <= width


def _fitted(columns: Sequence[_Column], lines: int, width: int) -> _Block:
    """Every column as wide as it would be, the widest narrowed until all fit."""
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
    """Characters on which ``text`` folds between words to no more than so many lines."""
    words = re.findall(r"\S+\s*", text)
    width = max((cell_len(word.rstrip()) for word in words), default=0)
    while _count(words, width) > lines:
        width += 1
    return width


def _count(words: Sequence[str], width: int) -> int:
    """Lines that words take."""
    lines, used = 0, width
    for word in words:
        if used + cell_len(word.rstrip()) > width:
            lines, used = lines + 1, 0
        used += cell_len(word)
    return lines


def _folded(text: Text, width: int) -> list[Text]:
    """Lines of a text, broken between words."""
    lines = text.wrap(_RULER, max(width, 1), justify="left", overflow="fold")
    for line in lines:
        line.rstrip()
    return list(lines)


_RULER = Console(width=10_000)
"""measures texts, prints none"""


def _row(cells: Sequence[Text], block: _Block) -> Iterator[Text]:
    """The lines of a row, as many as its most folded cell has."""
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
    """A parameter as a JSON object."""
    kind = PARAMETER_TYPES.get(parameter.kind, str(parameter.kind))
    return {"name": parameter.name, "value": parameter.value, "type": kind}
