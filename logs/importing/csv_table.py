"""Tables of comma-separated values with a mapping file.

The mapping is TOML: the time column, and for each topic its fields with column, unit, scale and offset.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.importing.checks import sound
from logs.importing.counterparts import checked, fields_of
from logs.importing.mapping import FieldEntry, TableMapping, TableSection, TimeSection, TopicSection, load_mapping
from logs.importing.source import Array, Dropped, ImportedTopic, Series, Source
from logs.importing.units import conversion
from logs.layout import Field
from wingbeat.errors import InputError
from wingbeat.message import Event, Text
from wingbeat.text import pluralize
from wingbeat.topic import Topic

OWN_PREFIX = "/csv/"
WHITESPACE = "whitespace"
"""delimiter: any run of blanks and tabs"""
_FORTRAN = re.compile(r"[+-]?[0-9]*\.?[0-9]*[dD][+-]?[0-9]+")
_ENTRY = ("column", "value", "unit", "scale", "offset")
KNOWN_TOPICS: Mapping[str, Topic[Any]] = {
    topic.name: topic for topic in topics.TOPICS if topic.message not in (Event, Text)
}


class Table(NamedTuple):
    """Table as read: columns by name, NaN for cells without a number."""

    columns: Mapping[str, NDArray[np.float64]]
    rows: int
    strange: int
    """nonempty cells that are not numbers"""
    twice: frozenset[str] = frozenset()
    """names of several columns"""
    short: int = 0
    """rows with fewer cells than the header"""


def read_table(data: bytes, mapping: Path | None) -> Source:
    """Read a table with its mapping.

    Raises:
        InputError: no mapping, an invalid one, or one that does not match the table.
    """
    if mapping is None:
        raise InputError("a table of columns needs --map MAP.toml (wingbeat log import --help has an example)")
    chosen = load_mapping(mapping)
    try:
        table = parse_table(data, chosen.table)
        times = _times(table, chosen.time)
        clock, dropped = sound(times, "time")
        if len(times.time_us) < table.rows:
            dropped.append(Dropped("time", "no time from 0 on", table.rows - len(times.time_us)))
        rows = clock.columns["row"]
        found = [_topic(name, section, table, clock.time_us, rows) for name, section in chosen.topics.items()]
    except InputError as reason:
        raise InputError(f"{reason} (mapping {mapping})") from None
    series = {one.name: one for one in found if isinstance(one, Series)}
    made = tuple(one for one in found if isinstance(one, ImportedTopic))
    notes = {"mapping": mapping.name, "columns_not_mapped": ", ".join(_not_mapped(table, chosen))}
    return Source("csv", series, notes=notes, damage=_damage(table), dropped=tuple(dropped), made=made)


def _not_mapped(table: Table, chosen: TableMapping) -> list[str]:
    """Return the columns that no field of the mapping uses."""
    entries = [entry for section in chosen.topics.values() for entry in section.fields.values()]
    used = {chosen.time.column, *(entry.column for entry in entries)}
    return [name for name in table.columns if name not in used]


def _damage(table: Table) -> tuple[str, ...]:
    told = {
        f"{pluralize(table.strange, 'cell')} without a number": table.strange,
        f"{pluralize(table.short, 'row')} with fewer cells than there are names of columns": table.short,
    }
    return tuple(line for line, count in told.items() if count)


def parse_table(data: bytes, layout: TableSection) -> Table:
    """Parse a table into columns of numbers.

    Raises:
        InputError: not text, or no row below the header.
    """
    lines = decoded(data, layout.encoding).splitlines()[layout.skip :]
    decimal = layout.decimal
    if len(decimal) != 1:
        raise InputError("decimal must be one character")
    rows = split_rows(lines, layout.delimiter)
    if not layout.names and rows:
        rows = [[str(number + 1) for number in range(max(map(len, rows)))], *rows]
    if len(rows) < 2:
        raise InputError("there is no row of numbers in it")
    names, body = [name.strip() for name in rows[0]], rows[1:]
    cells = {
        name: [row[place] if place < len(row) else "" for row in body] for place, name in enumerate(names) if name
    }
    columns = {name: np.array([number_of(cell, decimal) for cell in column]) for name, column in cells.items()}
    strange = sum(
        1 for name, column in cells.items() for cell, value in zip(column, columns[name].tolist(), strict=True)
        if math.isnan(value) and cell.strip() and cell.strip().lower() != "nan" and np.isfinite(columns[name]).any()
    )  # fmt: skip
    width = max((place + 1 for place, name in enumerate(names) if name), default=0)
    short = sum(len(row) < width for row in body)
    return Table(columns, len(body), strange, frozenset(name for name in columns if names.count(name) > 1), short)


def split_rows(lines: list[str], delimiter: str) -> list[list[str]]:
    """Return the cells of each nonempty line. ``delimiter`` is one character, or `WHITESPACE` for runs of blanks.

    Raises:
        InputError: the delimiter is neither, or a line cannot be split.
    """
    if delimiter == WHITESPACE:
        return [cells for cells in (line.split() for line in lines) if cells]
    if len(delimiter) != 1:
        raise InputError(f'delimiter must be one character or "{WHITESPACE}"')
    try:
        return [row for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter) if row]
    except (csv.Error, ValueError) as error:
        raise InputError(f"it cannot be read as a table: {error}") from None


def decoded(data: bytes, encoding: Any) -> str:
    """Decode the text of a table.

    Raises:
        InputError: not text in that encoding, or unknown encoding.
    """
    try:
        return data.decode("utf-8-sig" if encoding == "utf-8" else encoding)
    except UnicodeDecodeError:
        hint = "" if encoding != "utf-8" else ': set [table] encoding = "latin-1"'
        raise InputError(f"not text in {encoding.upper()}{hint}") from None
    except (LookupError, TypeError):
        raise InputError(f"[table] encoding {encoding!r} is not known") from None


def number_of(cell: str, decimal: str = ".") -> float:
    """Parse a cell's number, NaN without one; Fortran's ``1.0D+02`` is accepted."""
    plain = cell if decimal == "." else cell.replace(decimal, ".")
    try:
        return float(plain)
    except ValueError:
        pass
    try:
        return float(plain.upper().replace("D", "E")) if _FORTRAN.fullmatch(plain.strip()) else math.nan
    except ValueError:
        return math.nan


def _times(table: Table, chosen: TimeSection) -> Series:
    """us since boot, of the rows of the table that have a time at all, with their numbers."""
    if chosen.rate is not None:
        seconds = np.arange(table.rows) / chosen.rate
    else:
        known = conversion(chosen.unit)
        if known.unit != "s":
            raise InputError(f"unit {chosen.unit!r} of time is not a unit of time")
        seconds = (_column(table, chosen.column) - chosen.start) * known.factor
    rows = np.flatnonzero(np.isfinite(seconds) & (seconds >= 0.0) & (seconds < 1e12))
    if not len(rows):
        raise InputError("no row has a time from 0 on (time.column, time.start)")
    return Series("time", np.rint(seconds[rows] * 1e6).astype(np.int64), {"row": rows}, {})


def _column(table: Table, name: Any) -> NDArray[np.float64]:
    if not isinstance(name, str) or name not in table.columns:
        raise InputError(f"the table has no column {name!r}; it has: {', '.join(table.columns)}")
    if name in table.twice:
        raise InputError(f"the table has several columns {name!r}: rename one of them")
    return table.columns[name]


def _topic(
    name: str, section: TopicSection, table: Table, times: NDArray[np.int64], rows: Array
) -> ImportedTopic | Series:
    """One topic of the mapping: one of the project's, or one that the mapping makes up."""
    topic = KNOWN_TOPICS.get(name)
    if topic is None and not (name.startswith(OWN_PREFIX) and len(name) > len(OWN_PREFIX)):
        raise InputError(
            f"topic {name} is not known; known: {', '.join(KNOWN_TOPICS)}, and any of yours after {OWN_PREFIX}"
        )
    known = None if topic is None else {field.name: field for field in fields_of(topic)[1:]}
    read = {field: _field(name, field, entry, table, known) for field, entry in section.fields.items()}
    measured = [field for field, entry in section.fields.items() if entry.column is not None]
    kept = ~_all_unknown([read[field][0] for field in measured])[rows]
    if section.rate is not None:
        kept &= _thinned(times, section.rate)
    columns = {field: values[rows[kept]] for field, (values, _) in read.items()}
    units = {field: unit for field, (_, unit) in read.items()}
    series = Series(name.removeprefix(OWN_PREFIX), times[kept], columns, units)
    return series if topic is None else checked(topic, series, columns)._replace(source="table")


def _field(
    topic: str, field: str, entry: FieldEntry, table: Table, known: Mapping[str, Field] | None
) -> tuple[Array, str]:
    """A field's values in SI, and its unit."""
    name = f"{topic}.{field}"
    if known is not None and field not in known:
        raise InputError(f"{name}: the topic has no such field; it has: {', '.join(known)}")
    if known is not None and known[field].length:
        raise InputError(f"{name} has several values, which a table of columns does not give")
    unit = conversion(entry.unit)
    if known is not None and unit.unit != _base(known[field].unit):
        raise InputError(f"{name} is in {known[field].unit}; a column in {entry.unit!r} cannot be that")
    raw = np.full(table.rows, entry.value) if entry.value is not None else _column(table, entry.column)
    return (raw * entry.scale + entry.offset) * unit.factor + unit.offset, unit.unit


def _base(unit: str) -> str:
    """Unit of a field as a column can have it."""
    return conversion(unit).unit


def _all_unknown(columns: list[Array]) -> NDArray[np.bool_]:
    """Rows in which a topic has nothing: a table of several rates leaves cells empty."""
    if not columns:
        raise InputError("a topic must have a field with a column")
    return np.asarray(np.all([np.isnan(values) for values in columns], axis=0), bool)


def _thinned(times: NDArray[np.int64], rate: float) -> NDArray[np.bool_]:
    """The first row of each period."""
    _, first = np.unique(np.floor(times * 1e-6 * rate + 1e-6), return_index=True)
    mask = np.zeros(len(times), bool)
    mask[first] = True
    return mask
