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
"""Header of every record: opcode and length of the body."""
Record = TypeVar("Record")


class Damage(Exception):
    """Error: the bytes do not match their declared content; the text names the location in one line."""


class Span(NamedTuple):
    """Location of a record, including its nine bytes of opcode and length."""

    opcode: int
    offset: int
    length: int

    @property
    def body(self) -> int:
        """Offset of the first byte after opcode and length."""
        return self.offset + HEAD.size

    @property
    def end(self) -> int:
        """Offset of the first byte after the record."""
        return self.offset + self.length


def record_at(data: Buffer, offset: int, stop: int) -> Span | None:
    """Return the record at ``offset`` if it is complete before ``stop``, else None."""
    if offset + HEAD.size > stop:
        return None
    opcode, length = HEAD.unpack_from(data, offset)
    span = Span(opcode, offset, HEAD.size + length)
    return span if opcode and span.end <= stop else None


def records(data: Buffer, start: int, stop: int) -> Iterator[Span]:
    """Yield complete records from ``start``, up to the first torn one."""
    span = record_at(data, start, stop)
    while span is not None:
        yield span
        span = record_at(data, span.end, stop)


def expected(data: Buffer, opcode: int, offset: int, stop: int) -> Span:
    """Return the record at ``offset``, which must have the ``opcode``.

    Raises:
        Damage: it is not.
    """
    span = record_at(data, offset, stop)
    if span is None or span.opcode != opcode:
        raise Damage(f"no record of kind {int(opcode)} at byte {offset}")
    return span


def parse(kind: type[Record], data: Buffer, span: Span) -> Record:
    """Decode the record at ``span`` as the `mcap` class ``kind``.

    Raises:
        Damage: the bytes do not hold such a record.
    """
    reader: Any = kind
    try:
        record: Record = reader.read(ReadDataStream(BytesIO(data[span.body : span.end])))
    # The package raises unrelated exceptions for torn records: a short read ends in struct.error.
    except (struct.error, McapError, UnicodeDecodeError, OverflowError, MemoryError) as error:
        reason = str(error) or type(error).__name__
        raise Damage(f"{kind.__name__} at byte {span.offset} cannot be read ({reason})") from None
    return record


def attachment_at(data: Buffer, span: Span) -> Attachment:
    """Return the attachment at ``span`` after a check of its CRC.

    Raises:
        Damage: it is torn or altered.
    """
    attachment = parse(Attachment, data, span)
    body = data[span.body : span.end]
    stored = int.from_bytes(body[-4:], "little")
    if stored and stored != crc32(body[:-4]):
        raise Damage(f"attachment at byte {span.offset} does not match its checksum")
    return attachment
