"""CRCs of message indexes and metadata, which MCAP does not protect.

They stand in a private record of the summary, which the summary's own CRC vouches for and other readers pass over.
Behind each metadata record stands another with that one's: a file that was cut off has no summary.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import NamedTuple

from logs.records import HEAD, Buffer, Damage, Span

OPCODE = 0x80
"""Opcode of the record. Other programs may use it too, so the record begins with a name."""
_NAME = b"wingbeat.checksums"
_INDEXES = struct.Struct("<I")
_METADATA = struct.Struct("<QI")


class Checksums(NamedTuple):
    """CRC32 of a file's parts."""

    indexes: int
    """CRC of all message index records, concatenated over the chunks"""
    metadata: Mapping[int, int]
    """CRC of each metadata record, by its offset in the file"""


def encode_checksums(checksums: Checksums) -> bytes:
    """Encode the whole record."""
    pairs = b"".join(_METADATA.pack(offset, crc) for offset, crc in checksums.metadata.items())
    body = _NAME + _INDEXES.pack(checksums.indexes) + pairs
    return HEAD.pack(OPCODE, len(body)) + body


def decode_checksums(data: Buffer, span: Span) -> Checksums | None:
    """Decode the record at ``span``; return None if another program wrote it.

    Raises:
        Damage: its length cannot be that of such a record.
    """
    body = bytes(data[span.body : span.end])
    if not body.startswith(_NAME):
        return None
    try:
        (indexes,) = _INDEXES.unpack_from(body, len(_NAME))
        pairs = _METADATA.iter_unpack(body[len(_NAME) + _INDEXES.size :])
        return Checksums(indexes, dict(pairs))
    except struct.error:
        raise Damage(f"checksums at byte {span.offset} have lengths that contradict each other") from None
