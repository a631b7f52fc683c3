"""Tables of numbers: delimiter, decimal sign, names and line of units are detected, or given by the map."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, NamedTuple

import numpy as np

from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array
from logs.importing.csv_table import WHITESPACE, Table, decoded, number_of, parse_table, split_rows
from logs.importing.mapping import TableSection
from wingbeat.errors import InputError

LOOKED_AT = 200
"""lines from which the delimiter is found out"""
COMMENT = "#%!"
BLANK = ("", "nan", "na", "n/a", "null", "none", "-", "inf", "-inf")
"""cells without a measurement, besides the numbers that a map gives"""


register({
    "strange_cells": Entry("{file}: {value:.0f} cells with something that is no number", "They count as missing."),
    "short_rows": Entry("{file}: {value:.0f} rows with fewer cells than the others", "The cells count as missing."),
})  # fmt: skip


class Layout(NamedTuple):
    """Section [table] of a map; None is found out."""

    delimiter: str | None = None
    """one character, or "whitespace" """
    decimal: Annotated[str, ".", ","] | None = None
    names: bool | None = None
    """whether a line of names stands above the numbers; columns are numbered from 1 in any case"""
    skip: int | None = None
    """-; lines before the one with the names, or before the first row where there are none"""
    encoding: str | None = None
    """UTF-8 or, by its mark, UTF-16, else Windows' cp1252 if not given"""
    missing: tuple[float, ...] = ()
    """as the columns; numbers that stand for "not measured" in any column, such as -9999"""


class Columns(NamedTuple):
    """A table's numbers, every column (N,), NaN where a cell has none."""

    file: str
    """-; name of the file"""
    by_name: dict[str, Array]
    """as the file has them; (N,) each"""
    order: tuple[str, ...]
    """-; names in the order of the columns; those of columns without a name are their numbers"""
    twice: frozenset[str]
    rows: int
    """-; N"""
    findings: tuple[Finding, ...]
    """on cells that are no numbers"""
    clocks: frozenset[str] = frozenset()
    """-; names of columns of clocks or dates, which are in s"""
    texts: Mapping[str, str] = MappingProxyType({})
    """-; first cell of every column without a number, by its name"""
    unused_names: int = 0
    """-; names in the line above the numbers if they are fewer than the columns"""

    def column(self, name: str | int, key: str) -> Array:
        """A column by its name, or by its number from 1.

        Raises:
            InputError: there is none, or several.
        """
        if isinstance(name, int):
            if not 1 <= name <= len(self.order):
                raise InputError(f"{key}: {self.file} has no column {name}; it has {len(self.order)}")
            name = self.order[name - 1]
        if name not in self.by_name and self.unused_names:
            raise InputError(
                f"{key}: {self.file} has {self.unused_names} names over {len(self.order)} columns: name every column,"
                " or give its number"
            )
        if name not in self.by_name:
            raise InputError(f"{key}: {self.file} has no column {name!r}; it has: {_listed(self.order)}")
        if name in self.twice:
            raise InputError(f"{key}: {self.file} has several columns {name!r}: give its number")
        return self.by_name[name]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(name if name.isprintable() else repr(name) for name in names[:40])
    return shown + (", ..." if len(names) > 40 else "")


def read_columns(path: Path, layout: Layout) -> Columns:
    """Read a table from a file.

    Raises:
        InputError: it cannot be read, is no table, or has no numbers.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    try:
        return _columns(path.name, data, layout)
    except InputError as reason:
        raise InputError(f"{path}: {reason}") from None


def _columns(file: str, data: bytes, layout: Layout) -> Columns:
    lines = [_uncommented(line) for line in _text(data, layout.encoding).splitlines()]
    if layout.skip is not None:
        if layout.skip < 0:
            raise InputError("table.skip must be 0 or more")
        lines = lines[layout.skip :]
    form = _form(lines, layout)
    first = _first_row(lines, form)
    names = _names(lines[:first], lines[first], form) if layout.names is not False else None
    if layout.names and names is None:
        raise InputError("there is no line of names above its numbers (table.names, table.skip)")
    body = "\n".join(lines[first:])
    table = parse_table(body.encode(), TableSection(delimiter=form.delimiter, decimal=form.decimal, names=False))
    columns = _named(file, table, names, layout)
    if names is None and layout.names is not False:
        above = next((_cells(line, form) for line in reversed(lines[:first]) if line), [])
        columns = columns._replace(unused_names=len(above) if len(above) > 1 else 0)
    return _with_clocks(columns, lines[first:], form)


def _with_clocks(columns: Columns, lines: list[str], form: _Form) -> Columns:
    """With the seconds of columns of clocks, and the first cell of others without a number."""
    silent = [place for place, name in enumerate(columns.order) if not np.isfinite(columns.by_name[name]).any()]
    if not silent:
        return columns
    rows = split_rows(lines, form.delimiter)
    by_name, clocks, texts = dict(columns.by_name), set(), {}
    for place in silent:
        cells = [row[place] if place < len(row) else "" for row in rows]
        text = next((cell.strip() for cell in cells if cell.strip()), None)
        seconds = None if text is None else clock_column(cells, form.decimal)
        if seconds is not None:
            by_name[columns.order[place]] = seconds
            clocks.add(columns.order[place])
        elif text is not None:
            texts[columns.order[place]] = text
    return columns._replace(by_name=by_name, clocks=frozenset(clocks), texts=texts)


def _text(data: bytes, encoding: str | None) -> str:
    if encoding is not None:
        return decoded(data, encoding)
    for guess in ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8", "cp1252"):
        try:
            return decoded(data, guess)
        except InputError:
            continue
    raise InputError('it is no text in UTF-8 or cp1252: set [table] encoding, such as "latin-1"')


def _uncommented(line: str) -> str:
    """Without a comment's sign: the names may stand behind one."""
    bare = line.strip(" \r\n")
    return bare.lstrip(COMMENT).strip(" ") if bare[:1] and bare[0] in COMMENT else bare


class _Form(NamedTuple):
    delimiter: str
    decimal: str


def _form(lines: list[str], layout: Layout) -> _Form:
    """The delimiter and decimal sign with which most cells are numbers, and of those the most columns."""
    filled = [line for line in lines if line]
    if not filled:
        raise InputError("it is empty")
    delimiters = [layout.delimiter] if layout.delimiter is not None else [",", ";", "\t", WHITESPACE]
    signs = [layout.decimal] if layout.decimal is not None else [".", ","]
    sample = filled[len(filled) // 2 :][:LOOKED_AT]
    return max((_Form(*one) for one in product(delimiters, signs)), key=lambda form: _score(sample, form))


def _score(sample: list[str], form: _Form) -> tuple[float, float, bool]:
    rows = split_rows(sample, form.delimiter)
    cells = [cell for row in rows for cell in row if cell.strip().lower() not in BLANK]
    numbers = sum(np.isfinite(number_of(cell, form.decimal)) for cell in cells)
    width = float(np.median([len(row) for row in rows])) if rows else 0.0
    return numbers / max(len(cells), 1), width, form.decimal == "."


def _all_cells(line: str, form: _Form) -> list[str]:
    rows = split_rows([line], form.delimiter)
    return [cell.strip() for cell in rows[0]] if rows else []


def _cells(line: str, form: _Form) -> list[str]:
    """Of one line, without the empty ones that a delimiter at its end makes."""
    cells = _all_cells(line, form)
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_row(cells: list[str], form: _Form) -> bool:
    """Whether at least half of the cells that are not blank are numbers."""
    filled = [cell for cell in cells if cell.lower() not in BLANK]
    return bool(filled) and 2 * sum(np.isfinite(number_of(cell, form.decimal)) for cell in filled) >= len(filled)


def _first_row(lines: list[str], form: _Form) -> int:
    """The first line of numbers that the next line of numbers is as wide as, or that only lacks some of them."""
    rows = ((place, _cells(line, form)) for place, line in enumerate(lines) if line)
    numeric = [(place, len(cells)) for place, cells in rows if _is_row(cells, form)][: 50 + LOOKED_AT]
    if not numeric:
        raise InputError("there is no row of numbers in it")
    usual = sorted(width for _, width in numeric)[len(numeric) // 2]
    first = next(place for place, width in numeric if width >= usual)
    delimiters = len(_all_cells(lines[first], form))
    while first and _has_gaps(lines[first - 1], form, delimiters):
        first -= 1
    return first


def _has_gaps(line: str, form: _Form, width: int) -> bool:
    """Whether a line is a row with as many delimiters as others and nothing but numbers between them, or nothing."""
    filled = [cell for cell in _all_cells(line, form) if cell.lower() not in BLANK]
    numbers = bool(filled) and all(np.isfinite(number_of(cell, form.decimal)) for cell in filled)
    return numbers and len(_all_cells(line, form)) == width


def _names(above: list[str], row: str, form: _Form) -> list[str] | None:
    """The names right above the numbers: of the lines as wide as a row the topmost, a line of units is below it."""
    width, widest, found = len(_cells(row, form)), len(_all_cells(row, form)), None
    for line in reversed(above):
        cells = _cells(line, form)
        as_wide = width <= len(cells) <= widest or (
            len(_all_cells(line, form)) == widest <= 2 * len(list(filter(None, cells)))
        )
        fewer = found is not None and len(list(filter(None, cells))) < len(list(filter(None, found)))
        if line and (not as_wide or fewer or _is_row(cells, form)):
            break
        found = cells if line else found
    return found


def _named(file: str, table: Table, names: list[str] | None, layout: Layout) -> Columns:
    values = [_measured(column, layout.missing) for column in table.columns.values()]
    given = names or []
    order = [given[n] if n < len(given) and given[n] else str(n + 1) for n in range(len(values))]
    codes = {"strange_cells": table.strange, "short_rows": table.short}
    return Columns(
        file, dict(zip(order, values, strict=True)), tuple(order),
        frozenset(name for name in order if order.count(name) > 1), table.rows,
        tuple(Finding(code, "warning", "", float(n), None, {"file": file}) for code, n in codes.items() if n),
    )  # fmt: skip


def _measured(column: Array, missing: tuple[float, ...]) -> Array:
    """NaN where a number stands for none, or is not finite."""
    kept: Array = np.where(np.isfinite(column) & ~np.isin(column, missing), column, np.nan)
    return kept


LOOKED_AT = 50
"""cells by which a column is known"""
_CLOCK = re.compile(r"(?:(?:(\d{1,3}):)?(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:\.\d*)?)")
_PARTS = (86400.0, 3600.0, 60.0, 1.0)
_MOST = (math.inf, 24.0, 60.0, 61.0)
"""each part stays below; a leap second has number 60"""


def seconds_of(cell: str, decimal: str = ".") -> float:
    """Seconds of a clock (``minutes:seconds``, hours before them, the day of the year before those), since midnight
    or the year's beginning, or of a date with a time since 1970 (UTC without a zone); NaN of anything else."""
    text = cell.strip().replace(decimal, ".")
    clock = _CLOCK.fullmatch(text)
    if clock:
        return _clock_seconds(clock.groups())
    try:
        date = datetime.fromisoformat(text) if ":" in text else None
    except ValueError:
        return math.nan
    if date is None:
        return math.nan
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def _clock_seconds(groups: tuple[str | None, ...]) -> float:
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
