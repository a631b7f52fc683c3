"""Message inspector: rates and last values of messages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from groundstation.link.frames import label
from groundstation.link.traffic import MessageRow
from groundstation.views import wording

COLUMNS = ("message", "from", "rate", "count", "size", "age")


class FieldRow(NamedTuple):
    """One field of a message."""

    path: str
    """-; the field's name, with an index such as [3] for an array element"""
    value: str
    """-; value on the wire, with its enumeration label"""
    unit: str
    """-; unit on the wire"""


def message_cells(row: MessageRow) -> tuple[str, ...]:
    """Return the cells of one row of the inspector, in the order of `COLUMNS`."""
    rate = f"{row.rate:.1f} Hz" if row.rate else wording.UNKNOWN
    age = f"{row.age:.1f} s" if row.age < 60.0 else f"{row.age / 60.0:.0f} min"
    return row.name, f"{row.sender[0]}/{row.sender[1]}", rate, str(row.total), f"{row.size} B", age


def field_rows(message: Any) -> list[FieldRow]:
    """Return every field of a message; none for a message that no dialect defines."""
    if message is None:
        return []
    units = message.fieldunits_by_name
    names = message.fieldnames
    return [
        FieldRow(path, _value(message, name, value), units.get(name, ""))
        for name in names
        for path, value in _elements(name, getattr(message, name))
    ]


def _elements(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, list | tuple):
        yield from ((f"{name}[{index}]", one) for index, one in enumerate(value))
    else:
        yield name, value


def _value(message: Any, name: str, value: Any) -> str:
    if isinstance(value, bytes | str):
        text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        return "".join(letter if letter.isprintable() else " " for letter in text.partition("\0")[0])
    if isinstance(value, float):
        return "NaN" if math.isnan(value) else f"{value:.6g}"
    return f"{value}{_label(message, name, value)}"


def _label(message: Any, name: str, value: int) -> str:
    """Return the name of an enumeration value; empty for bit masks."""
    enum = message.fieldenums_by_name.get(name)
    if enum is None or message.fielddisplays_by_name.get(name) == "bitmask":
        return ""
    name_of_value = label(message, enum, value)
    return f"  {name_of_value}" if name_of_value else ""
