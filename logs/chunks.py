"""Messages of a channel from chunks as rows of a NumPy record type."""

from __future__ import annotations

import struct
import threading
from array import array
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple

import numpy as np
import zstandard
from mcap.opcode import Opcode
from numpy.typing import NDArray
from zlib_ng.zlib_ng import crc32

from logs.records import HEAD, Buffer, Damage, Span, expected, record_at

MAX_CHUNK_SIZE = 256 << 20
"""Bytes, uncompressed; default limit above which a chunk is not decompressed."""
BEYOND_NS = 2**64 - 1
"""ns; greatest MCAP log time"""
ENTRY_TYPE = np.dtype([("time", "<u8"), ("offset", "<u8")])
"""Entry of a message index: log time in ns, offset in the chunk in bytes."""
PLACE_TYPE = np.dtype([("channel", "<u2"), ("offset", "<u8")])
"""Location of a message index in a summary: channel, offset in the file in bytes."""
MESSAGE_HEAD = np.dtype(
    {
        "names": ["opcode", "length", "channel", "sequence", "log_time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
        "offsets": [0, 1, 9, 11, 15, 23],
        "itemsize": 31,
    }
)
"""Header of a message record, without its data."""
_CHUNK_HEAD = struct.Struct("<QQQII")
_SIZE = struct.Struct("<Q")
_PLACE = struct.Struct("<HQ")
_MESSAGE = struct.Struct("<BQHIQ")
_INDEX_HEAD = struct.Struct("<HI")

Entries = NDArray[np.void]
_LZ4_PIECE = 4 << 20
"""bytes"""
_threads = threading.local()


class ChunkSpan(NamedTuple):
    """Location of a chunk in the file and the fields of its header."""

    span: Span
    data_offset: int
    data_size: int
    """bytes as stored"""
    size: int
    """bytes, uncompressed"""
    crc: int
    """of the unpacked bytes, 0 for none"""
    compression: str
    start_ns: int
    """log time of the first message"""
    end_ns: int
    """log time of the last message"""
    places: bytes
    """`PLACE_TYPE` values: locations of the message index records from the summary, not yet checked"""
    entries: dict[int, Entries]
    """message indexes by channel, if the chunk was scanned"""
    index_size: int = 0
    """bytes of the message index records after the chunk, from the summary"""

    @property
    def indexes(self) -> dict[int, int]:
        """Return the offsets of the message index records by channel."""
        return dict(_PLACE.iter_unpack(self.places))

    @property
    def channels(self) -> set[int]:
        """Return the numbers of the channels with messages in the chunk."""
        return set(self.indexes) | set(self.entries)


class OversizedChunk(Damage):
    """Error: a chunk declares more uncompressed bytes than allowed; its length in the file is valid."""


class IndexedChunk(NamedTuple):
    """Entry of a chunk in the summary; see `ChunkSpan`."""

    start_ns: int
    end_ns: int
    places: bytes
    index_size: int


class Contents(NamedTuple):
    """Records of an uncompressed chunk."""

    definitions: list[Span]
    """schema and channel records"""
    entries: dict[int, Entries]


def chunk_at(
    data: Buffer, span: Span, indexed: IndexedChunk | None = None, max_chunk_size: int = MAX_CHUNK_SIZE
) -> ChunkSpan:
    """Return the compressed chunk at ``span``; the summary entry ``indexed`` takes precedence over its header.

    Raises:
        Damage: its header contradicts its length, or declares more than ``max_chunk_size`` uncompressed bytes.
    """
    body = span.offset + HEAD.size
    try:
        start, end, size, crc, name_size = _CHUNK_HEAD.unpack_from(data, body)
        place = body + _CHUNK_HEAD.size + name_size
        name = bytes(data[place - name_size : place]).decode("ascii")
        (data_size,) = _SIZE.unpack_from(data, place)
    except (struct.error, UnicodeDecodeError, OverflowError):
        raise Damage(f"chunk at byte {span.offset} cannot be read") from None
    if place + 8 + data_size != span.offset + span.length:
        raise Damage(f"chunk at byte {span.offset} has lengths that contradict each other")
    if size > max_chunk_size:
        raise OversizedChunk(
            f"chunk at byte {span.offset} declares {size / 1e6:.0f} MB uncompressed, over the limit of"
            f" {max_chunk_size / 1e6:.0f} MB (--max-chunk-size)"
        )
    start, end, places, index_size = indexed or IndexedChunk(start, end, b"", 0)
    return ChunkSpan(span, place + 8, data_size, size, crc, name, start, end, places, {}, index_size)


def loose_messages(start: int, end: int) -> ChunkSpan:
    """Return a chunk of the messages outside of any chunk, from byte ``start`` to ``end``."""
    return ChunkSpan(Span(0, start, end - start), start, end - start, end - start, 0, "", 0, 0, b"", {})


def unpack(data: Buffer, chunk: ChunkSpan) -> bytes:
    """Decompress the records of a chunk and check them against its CRC.

    Raises:
        Damage: they cannot be unpacked or do not match.
    """
    packed = bytes(data[chunk.data_offset : chunk.data_offset + chunk.data_size])
    try:
        content = _decompress(packed, chunk)
    except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError) as error:
        raise Damage(f"chunk at byte {chunk.span.offset} cannot be unpacked ({error})") from None
    if len(content) != chunk.size or (chunk.crc and crc32(content) != chunk.crc):
        raise Damage(f"chunk at byte {chunk.span.offset} does not match its checksum")
    return content


def _decompress(packed: bytes, chunk: ChunkSpan) -> bytes:
    if not chunk.compression:
        return packed
    if chunk.compression == "zstd":
        declared = zstandard.get_frame_parameters(packed).content_size
        if declared not in (chunk.size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError("its length differs from the header's")
        return _decompressor().decompress(packed, max_output_size=chunk.size)
    if chunk.compression == "lz4":
        return _decompress_lz4(packed, chunk.size)
    raise ValueError(f"compression {chunk.compression!r} is not supported")


def _decompress_lz4(packed: bytes, size: int) -> bytes:
    """Decompress an lz4 frame to little more than ``size`` at most, by which an excess is noticed."""
    import lz4.frame  # other programs' files only

    decompressor = lz4.frame.LZ4FrameDecompressor()
    content = BytesIO()  # grows in place: one copy of a large chunk, where the package's own buffer would be a second
    rest = packed
    while not decompressor.eof and content.tell() <= size:
        piece = decompressor.decompress(rest, max_length=_LZ4_PIECE)
        if not piece and decompressor.needs_input:
            break
        content.write(piece)
        rest = b""
    return content.getvalue()


def _decompressor() -> zstandard.ZstdDecompressor:
    """One per thread: making one costs as much as unpacking a chunk."""
    if not hasattr(_threads, "decompressor"):
        _threads.decompressor = zstandard.ZstdDecompressor()
    decompressor: zstandard.ZstdDecompressor = _threads.decompressor
    return decompressor


def walk(content: bytes, max_records: int | None = None) -> Contents:
    """Find the records in an uncompressed chunk; the first of repeated definitions of a number is valid.

    Raises:
        Damage: they do not fill it, or are more than ``max_records``.
    """
    found: dict[int, array[int]] = {}
    definitions: dict[tuple[int, bytes], Span] = {}
    position, stop, count = 0, len(content), 0
    while position < stop:
        span = record_at(content, position, stop)
        if span is None:
            raise Damage(f"a chunk's records end at byte {position} of {stop}")
        if span.opcode == Opcode.MESSAGE and span.length >= MESSAGE_HEAD.itemsize:
            _, _, channel, _, time = _MESSAGE.unpack_from(content, position)
            entries = found.setdefault(channel, array("Q"))
            entries.append(time)
            entries.append(position)
        elif span.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            definitions.setdefault((span.opcode, content[span.body : span.body + 2]), span)
        position = span.end
        count += 1
        if max_records is not None and count > max_records:
            raise Damage(f"a chunk holds more than {max_records} records")
    return Contents(
        list(definitions.values()), {channel: np.frombuffer(each, ENTRY_TYPE) for channel, each in found.items()}
    )


def listed_entries(data: Buffer, chunk: ChunkSpan, channel: int) -> Entries | None:
    """Read the message index of one channel as stored, unchecked.

    None if it cannot be read or if its offsets do not increase, because it would then name a message twice.
    """
    if channel in chunk.entries:
        return chunk.entries[channel]
    try:
        entries = stored_entries(data, chunk.indexes[channel])
    except Damage:
        return None
    offsets = entries["offset"]
    return entries if np.all(offsets[1:] > offsets[:-1]) else None


def entries_of(
    data: Buffer, chunk: ChunkSpan, content: bytes, channel: int, max_records: int | None = None
) -> Entries:
    """Return the message index of one channel with each entry checked.

    Opcode, channel, time and length of each entry are compared with the chunk. If the check fails, the index is
    replaced by a scan of the chunk, which its CRC protects.

    Raises:
        Damage: the chunk's records do not fill it, or are more than ``max_records``.
    """
    entries = listed_entries(data, chunk, channel)
    if entries is None or not _agree(content, entries, channel):
        return walk(content, max_records).entries.get(channel, np.empty(0, ENTRY_TYPE))
    return entries


def stored_entries(data: Buffer, offset: int) -> Entries:
    """Read the entries of the message index record at ``offset``.

    Raises:
        Damage: there is none, or its lengths contradict each other.
    """
    span = expected(data, Opcode.MESSAGE_INDEX, offset, len(data))
    if span.length < HEAD.size + _INDEX_HEAD.size:
        raise Damage(f"message index at byte {span.offset} is too short")
    _, size = _INDEX_HEAD.unpack_from(data, span.body)
    if size % ENTRY_TYPE.itemsize or span.body + _INDEX_HEAD.size + size != span.end:
        raise Damage(f"message index at byte {span.offset} has lengths that contradict each other")
    return np.frombuffer(bytes(data[span.end - size : span.end]), ENTRY_TYPE)


def _agree(content: bytes, entries: Entries, channel: int) -> bool:
    offsets = entries["offset"]
    last = len(content) - MESSAGE_HEAD.itemsize
    if len(offsets) and (last < 0 or int(offsets.max()) > last):
        return False
    heads = rows_at(content, offsets, MESSAGE_HEAD)
    return bool(
        np.all(heads["opcode"] == int(Opcode.MESSAGE))
        and np.all(heads["channel"] == channel)
        and np.all(heads["log_time"] == entries["time"])
        and np.all(heads["length"] >= MESSAGE_HEAD.itemsize - HEAD.size)
        and np.all(heads["length"] + HEAD.size <= len(content) - offsets)
    )


def rows_at(content: bytes, offsets: NDArray[np.uint64], kind: np.dtype[np.void]) -> Entries:
    """Copy rows of type ``kind`` from ``offsets`` in ``content``; all must lie inside it."""
    if not len(offsets):
        return np.empty(0, kind)
    count = len(content) - kind.itemsize + 1
    windows: Entries = np.ndarray((count,), np.dtype((np.void, kind.itemsize)), content, strides=(1,))
    return windows[offsets.astype(np.int64)].view(kind)


def bodies(content: bytes, entries: Entries) -> Iterator[bytes]:
    """Yield the encoded messages at ``entries``, copied one at a time."""
    spans = (record_at(content, int(offset), len(content)) for offset in entries["offset"])
    return (content[span.offset + MESSAGE_HEAD.itemsize : span.end] for span in spans if span is not None)
