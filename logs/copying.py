"""Copy of the readable parts of one MCAP file into another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Metadata

from logs.chunks import ChunkSpan, unpack, walk
from logs.container import Container, RawChunk, pack_chunk, pack_index
from logs.index import Index
from logs.records import Buffer, Span, attachment_at, expected, parse


@dataclass(frozen=True)
class Part:
    """Source file of a copy."""

    data: Buffer
    index: Index


def copy(parts: Iterable[Part], container: Container) -> None:
    """Write channels, metadata, attachments and chunks of all parts; chunks are ordered by their first message.

    Raises:
        InputError: two parts declare a channel differently.
        Damage: a chunk, attachment or metadata record cannot be read.
        OSError: the disk refuses.
    """
    parts = list(parts)
    for part in parts:
        for channel in part.index.channels.values():
            container.define(part.index.schemas.get(channel.schema_id), channel)
        for span in part.index.metadata:
            metadata = parse(Metadata, part.data, span)
            container.metadata(_bytes(part.data, span), metadata.name)
        for span in part.index.attachments:
            container.attachment(_bytes(part.data, span), _attachment_index(attachment_at(part.data, span)))
    for _, part, chunk in sorted(_dated(parts), key=lambda each: each[0]):
        container.chunk(_raw(part.data, chunk))


def _dated(parts: Iterable[Part]) -> Iterator[tuple[int, Part, ChunkSpan]]:
    """Return all chunks with their sort time in ns: within a part the order is kept even if its time runs back."""
    for part in parts:
        latest = 0
        for chunk in part.index.chunks:
            latest = max(latest, chunk.start_ns)
            yield latest, part, chunk


def _raw(data: Buffer, chunk: ChunkSpan) -> RawChunk:
    """Return the chunk as stored; its message indexes are rebuilt if the chunk was scanned."""
    content = unpack(data, chunk)
    if not chunk.compression:
        return _packed(chunk, content)
    indexes = {number: pack_index(number, entries.tobytes()) for number, entries in chunk.entries.items()}
    for number, place in chunk.indexes.items():
        indexes.setdefault(number, _bytes(data, expected(data, Opcode.MESSAGE_INDEX, place, len(data))))
    return RawChunk(
        _bytes(data, chunk.span),
        indexes,
        chunk.start_ns,
        chunk.end_ns,
        chunk.compression,
        chunk.data_size,
        chunk.size,
    )


def _packed(chunk: ChunkSpan, content: bytes) -> RawChunk:
    """Compress messages that are stored without compression, also outside of chunks."""
    entries = {number: found.tobytes() for number, found in walk(content).entries.items()}
    return pack_chunk(content, entries, (chunk.start_ns, chunk.end_ns), zstandard.ZstdCompressor())


def _attachment_index(attachment: Attachment) -> AttachmentIndex:
    return AttachmentIndex(
        offset=0,
        length=0,
        log_time=attachment.log_time,
        create_time=attachment.create_time,
        data_size=len(attachment.data),
        name=attachment.name,
        media_type=attachment.media_type,
    )


def _bytes(data: Buffer, span: Span) -> bytes:
    return bytes(data[span.offset : span.end])
