"""Positions of records in an MCAP file and checked reading of them."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import Any, NamedTuple, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Attachment
from zlib_ng.zlib_ng import crc32

Buffer = bytes | mmap.mmap
HEAD = struct.Struct("<BQ")
"""Opcode and length of the body, before every record."""
Record = TypeVar("Record")


class Damage(Exception):
    """Bytes do not hold what they promise; the text says where, in one line."""


class Span(NamedTuple):
    """Place of a record, its nine bytes of opcode and length included."""

    opcode: int
    offset: int
    length: int

    @property
    def body(self) -> int:
        """Offset of the first byte behind opcode and length."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """Offset of the first byte behind the record."""
        return self.offset + self.length


def record_at(data: Buffer, offset: int, stop: int) -> Span | None:
    """The record at ``offset`` when it is whole before ``stop``, else None."""
    if offset + HEAD.size > stop:
        return None
    opcode, length = HEAD.unpack_from(data, offset)
    span = Span(opcode, offset, HEAD.size + length)
    return span if opcode and span.end <= stop else None


def records(data: Buffer, start: int, stop: int) -> Iterator[Span]:
    """Whole records from ``start`` on, up to the first one that is torn."""
    span = record_at(data, start, stop)
    while span is not None:
        yield span
        span = record_at(data, span.end, stop)


def expected(data: Buffer, opcode: int, offset: int, stop: int) -> Span:
    """The record at ``offset``, which must be of the kind ``opcode``.

    Raises:
        Damage: it is not.
    """
    span = record_at(data, offset, stop)
    if span is None or span.opcode != opcode:
        raise Damage(f"no record of kind {int(opcode)} at byte {offset}")
    return span


def parse(kind: type[Record], data: Buffer, span: Span) -> Record:
    """The `mcap` record of type ``kind`` at ``span``.

    Raises:
        Damage: the bytes do not hold such a record.
    """
    reader: Any = kind
    try:
        record: Record = reader.read(ReadDataStream(BytesIO(data[span.body : span.end])))
    # What the package raises on torn records is not one family: a short read ends in struct.error.
    except (struct.error, McapError, UnicodeDecodeError, OverflowError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        raise Damage(f"{kind.__name__} at byte {span.offset} cannot be read ({reason})") from None
    return record


def attachment_at(data: Buffer, span: Span) -> Attachment:
    """The attachment at ``span``, its CRC checked.

    Raises:
        Damage: it is torn or altered.
    """
    attachment = parse(Attachment, data, span)
    body = data[span.body : span.end]
    stored = int.from_bytes(body[-4:], "little")
    if stored and stored != crc32(body[:-4]):
        raise Damage(f"attachment at byte {span.offset} does not match its checksum")
    return attachment
