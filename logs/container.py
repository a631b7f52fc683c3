"""MCAP writer: records, chunks, indexes, summary (https://mcap.dev/spec).

The records themselves are the `mcap` package's. Its `Writer` is not used because it numbers channels itself, and
because joining and repairing files copies chunks without unpacking them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import IO, NamedTuple, Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from zlib_ng.zlib_ng import crc32

from logs.checksums import Checksums, encode_checksums
from wingbeat.errors import InputError

LIBRARY = "wingbeat"
ENTRY = struct.Struct("<QQ")
"""Entry of a message index: log time in ns, offset in the chunk in bytes."""
_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<BQQQQII4sQ")
_INDEX = struct.Struct("<BQHI")


class RawChunk(NamedTuple):
    """Chunk as stored in a file."""

    record: bytes
    """the complete record with the compressed messages"""
    indexes: Mapping[int, bytes]
    """complete message index records by channel"""
    start_ns: int
    """log time of the first message"""
    end_ns: int
    """log time of the last message"""
    compression: str
    compressed_size: int
    """bytes"""
    uncompressed_size: int
    """bytes"""


class _Indexed(Protocol):
    def write(self, stream: RecordBuilder) -> None: ...


def pack_chunk(
    content: bytes | memoryview,
    entries: Mapping[int, bytes],
    window: tuple[int, int],
    compressor: zstandard.ZstdCompressor,
) -> RawChunk:
    """Compress records into a chunk.

    Args:
        content: the records.
        entries: packed `ENTRY` values of its messages by channel.
        window: first and last log time in ns.
        compressor: zstd compressor.
    """
    start, end = window
    data = compressor.compress(content)
    body = _CHUNK.size - _RECORD.size + len(data)
    crc = crc32(content)
    head = _CHUNK.pack(Opcode.CHUNK, body, start, end, len(content), crc, 4, b"zstd", len(data))
    indexes = {channel: pack_index(channel, packed) for channel, packed in entries.items()}
    return RawChunk(head + data, indexes, start, end, "zstd", len(data), len(content))


def pack_index(channel: int, entries: bytes) -> bytes:
    """Encode a message index record from packed `ENTRY` values."""
    return _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries


def encode(record: McapRecord) -> bytes:
    """Encode one record."""
    builder = RecordBuilder()
    record.write(builder)
    return _taken(builder)


def _taken(builder: RecordBuilder) -> bytes:
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


class Container:
    """MCAP writer to an unbuffered stream; the written bytes are always complete records.

    Every method that writes raises `OSError` if the disk fails.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._crc = 0
        self.size = 0
        """bytes of complete records written"""
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._index_crc = 0
        self._metadata_crcs: dict[int, int] = {}
        self._write(MCAP0_MAGIC + encode(Header(profile="", library=LIBRARY)))

    def define(self, schema: Schema | None, channel: Channel) -> bool:
        """Declare a channel before its first chunk; return whether it is new. An identical declaration has no
        effect.

        Raises:
            InputError: another channel or schema has this number.
        """
        known = self._channels.get(channel.id)
        if known is channel and (schema is None or self._schemas.get(schema.id) is schema):
            return False
        if known is not None and known != channel:
            raise InputError(
                f"channel {channel.id} is both {known.topic} and {channel.topic} (or differs in its schema)"
            )
        if schema is not None and self._schemas.get(schema.id, schema) != schema:
            raise InputError(f"schema {schema.id} is both {self._schemas[schema.id].name} and {schema.name}")
        if schema is not None and schema.id not in self._schemas:
            self._write(encode(schema))
            self._schemas[schema.id] = schema
        if known is None:
            self._write(encode(channel))
            self._channels[channel.id] = channel
        return known is None

    def chunk(self, chunk: RawChunk) -> None:
        """Append a chunk and its message indexes."""
        start = self.size
        offset = start + len(chunk.record)
        offsets: dict[int, int] = {}
        for channel, record in chunk.indexes.items():
            offsets[channel] = offset
            offset += len(record)
        indexes = b"".join(chunk.indexes.values())
        self._write(chunk.record + indexes)
        self._index_crc = crc32(indexes, self._index_crc)
        for channel, record in chunk.indexes.items():
            self._counts[channel] = self._counts.get(channel, 0) + (len(record) - _INDEX.size) // ENTRY.size
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk.record),
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=chunk.compressed_size,
                message_end_time=chunk.end_ns,
                message_index_length=offset - start - len(chunk.record),
                message_index_offsets=offsets,
                message_start_time=chunk.start_ns,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def attachment(self, record: bytes, index: AttachmentIndex) -> None:
        """Append an attachment record; offset and length in ``index`` are set."""
        index.offset, index.length = self.size, len(record)
        self._write(record)
        self._attachments.append(index)

    def metadata(self, record: bytes, name: str) -> None:
        """Append a metadata record and its checksum, so that a truncated file without a summary can be checked."""
        index = MetadataIndex(offset=self.size, length=len(record), name=name)
        crc = {index.offset: crc32(record)}
        self._write(record + encode_checksums(Checksums(0, crc)))
        self._metadata.append(index)
        self._metadata_crcs |= crc

    def finish(self) -> None:
        """Write summary and footer."""
        self._write(encode(DataEnd(self._crc)))
        start = self.size
        summary = self._summary(start) + encode_checksums(Checksums(self._index_crc, self._metadata_crcs))
        offset_start = start + len(summary)
        summary += b"".join(encode(offset) for offset in self._offsets)
        head = _RECORD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", start, offset_start)
        footer = Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc32(summary + head))
        self._write(summary + encode(footer) + MCAP0_MAGIC)

    def _summary(self, start: int) -> bytes:
        groups: Iterable[tuple[Opcode, Iterable[_Indexed]]] = (
            (Opcode.SCHEMA, self._schemas.values()),
            (Opcode.CHANNEL, self._channels.values()),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        )
        builder = RecordBuilder()
        self._offsets: list[SummaryOffset] = []
        for opcode, records in groups:
            before = builder.count
            for record in records:
                record.write(builder)
            if builder.count > before:
                self._offsets.append(SummaryOffset(opcode, start + before, builder.count - before))
        return _taken(builder)

    def _statistics(self) -> Statistics:
        filled = [chunk for chunk in self._chunks if chunk.message_index_offsets]
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in filled), default=0),
            message_start_time=min((chunk.message_start_time for chunk in filled), default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, data: bytes) -> None:
        """Write all of ``data``: an unbuffered file may accept less, and raises at the next attempt."""
        rest = memoryview(data)
        while rest:
            written = self._stream.write(rest)
            if not written:
                raise OSError("the disk takes no more data")
            rest = rest[written:]
        self._crc = crc32(data, self._crc)
        self.size += len(data)
