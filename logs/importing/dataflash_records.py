"""Records of ArduPilot dataflash logs.

Records have no checksum. One is taken only where another record, or the end of the file, follows it; bytes between
them are counted as damage. Formats: https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.importing.counterparts import Columns
from logs.importing.source import Array
from wingbeat.text import pluralize

MAGIC = b"\xa3\x95"
HEAD = 3
"""bytes; magic and format number"""
FORMAT = 0x80
"""format number of the format records"""
_CODES: dict[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0), "b": ("i1", 1.0), "B": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0),
    "i": ("<i4", 1.0), "I": ("<u4", 1.0), "f": ("<f4", 1.0), "d": ("<f8", 1.0), "g": ("<f2", 1.0),
    "n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "M": ("u1", 1.0), "q": ("<i8", 1.0), "Q": ("<u8", 1.0),
    "c": ("<i2", 1e2), "C": ("<u2", 1e2), "e": ("<i4", 1e2), "E": ("<u4", 1e2), "L": ("<i4", 1e7),
}  # fmt: skip
"""NumPy type of each letter, and the divisor of the stored number."""
_FMT = np.dtype([("type", "u1"), ("length", "u1"), ("name", "S4"), ("format", "S16"), ("columns", "S64")])


class Kind(NamedTuple):
    """Format as declared in the file."""

    name: str
    record: np.dtype[np.void]
    """of the complete record with header"""
    codes: Mapping[str, str]
    """letter of each column"""


class Records(NamedTuple):
    """Location of the records in the data."""

    kinds: Mapping[int, Kind]
    places: Mapping[int, NDArray[np.int64]]
    """offsets of the complete records, by format"""
    damage: tuple[str, ...]


def is_dataflash(head: bytes) -> bool:
    """Return whether a file with this start is a dataflash log."""
    return head[:HEAD] == MAGIC + bytes([FORMAT])


def find_records(data: bytes) -> Records:
    """Find the complete records."""
    kinds: dict[int, Kind] = {FORMAT: Kind("FMT", _record(_FMT), {})}
    sizes = [0] * 256
    sizes[FORMAT] = kinds[FORMAT].record.itemsize
    found: list[int] = []
    lost: list[tuple[int, int]] = []
    used, at, cut = len(data.rstrip(b"\0\xff")), 0, ""
    first, second = MAGIC
    padded = data + bytes(HEAD)
    while at < used:
        size = sizes[padded[at + 2]] if padded[at] == first and padded[at + 1] == second else 0
        end = at + (size or HEAD)
        if end > len(data) and MAGIC.startswith(data[at : at + 2]):
            cut = f"cut off in the middle of a record, {pluralize(len(data) - at, 'byte')} before the end"
            break
        if size and (end >= used or (padded[end] == first and (end + 1 == len(data) or padded[end + 1] == second))):
            found.append(at)
            if padded[at + 2] == FORMAT:
                _learn(data, at, kinds)
                sizes = [kinds[number].record.itemsize if number in kinds else 0 for number in range(256)]
            at = end
            continue
        at = _skip(data, at, lost)
    starts = np.array(found, np.int64)
    numbers = np.frombuffer(data, np.uint8)[starts + 2] if found else np.empty(0, np.uint8)
    places = {number: starts[numbers == number] for number in np.unique(numbers).tolist()}
    size = sum(last - first for first, last in lost)
    told = f"{pluralize(size, 'byte')} in {pluralize(len(lost), 'place')} outside of records" if lost else ""
    return Records(kinds, places, tuple(filter(None, (told, cut))))


def _skip(data: bytes, at: int, lost: list[tuple[int, int]]) -> int:
    """The next place where a record may begin; what lies before it is added to ``lost``."""
    after = data.find(MAGIC, at + 1)
    after = len(data) if after < 0 else after
    begin = lost.pop()[0] if lost and lost[-1][1] == at else at
    lost.append((begin, after))
    return after


def _record(body: np.dtype[np.void]) -> np.dtype[np.void]:
    return np.dtype([("/head", f"S{HEAD}"), *((name, body.fields[name][0]) for name in body.names or ())])  # type: ignore[index]


def _learn(data: bytes, at: int, kinds: dict[int, Kind]) -> None:
    """Take a format into ``kinds``; one that contradicts itself, or one from before, is not."""
    row = np.frombuffer(data, _record(_FMT), 1, at)[0]
    name, letters, listed = (text_of(row[key]) for key in ("name", "format", "columns"))
    columns = [column.strip() for column in listed.split(",") if column.strip()]
    if len(columns) != len(letters) or len(set(columns)) != len(columns):
        return
    taken = int(row["type"]) in kinds or name in (kind.name for kind in kinds.values())
    if taken or not re.fullmatch(r"\w{1,4}", name, re.ASCII) or any(letter not in _CODES for letter in letters):
        return
    types = [(column, _CODES[letter][0]) for column, letter in zip(columns, letters, strict=True)]
    record = _record(np.dtype(types)) if types else np.dtype([("/head", f"S{HEAD}")])
    if record.itemsize == int(row["length"]):
        kinds[int(row["type"])] = Kind(name, record, dict(zip(columns, letters, strict=True)))


def text_of(value: bytes) -> str:
    """Decode a stored text up to its first zero."""
    return bytes(value).partition(b"\0")[0].decode("utf-8", "replace")


def columns_of(data: bytes, kind: Kind, places: NDArray[np.int64]) -> Columns:
    """Return the columns of all records of a format, as stored but for the divisor of their letter."""
    buffer = np.frombuffer(data, np.uint8)
    rows = buffer[places[:, None] + np.arange(kind.record.itemsize)].view(kind.record)[:, 0]
    return {
        name: _decoded(rows[name], kind.codes.get(name, "")) for name in kind.record.names or () if name != "/head"
    }


def _decoded(values: Array, letter: str) -> Array:
    if values.dtype.kind == "S":
        return np.array([text_of(value) for value in values], object)
    divisor = _CODES[letter][1] if letter else 1.0
    return np.array(values) if divisor == 1.0 else values / divisor
