"""Message records of many topics, encoded together, and their division into chunks.

The values of a message are packed by one `struct` call with zeros in place of header and tags. NumPy adds these
constant bytes for all messages of a topic, and sequence numbers, times and message indexes for all topics at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.chunks import BEYOND_NS, ENTRY_TYPE
from logs.codecs import STAMP_OFFSET, Codec, codec_for
from logs.container import encode
from wingbeat.topic import Topic

CHUNK_BYTES = 64 * 1024
FLUSH_NS = 250_000_000
STAMP_TYPE = np.dtype([("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])
"""Part of a message record's header that differs from message to message."""

Bytes = NDArray[np.uint8]


class Block(NamedTuple):
    """Message records in the order of the file."""

    content: Bytes
    """the records, each first message of a topic after the declaration of the topic"""
    stream: NDArray[np.intp]
    """(n,); number of the topic of each message"""
    time_ns: NDArray[np.uint64]
    """(n,); log time"""
    start: NDArray[np.int64]
    """(n + 1,); first byte of each message with its declaration, and the end"""
    offset: NDArray[np.int64]
    """(n,); first byte of each message record"""

    def part(self, first: int, end: int, shift: int) -> Block:
        """Return messages ``first`` to ``end`` with offsets for a content that begins ``shift`` bytes earlier."""
        low, high = int(self.start[first]), int(self.start[end])
        return Block(
            self.content[low:high],
            self.stream[first:end],
            self.time_ns[first:end],
            self.start[first : end + 1] - (low - shift),
            self.offset[first:end] - (low - shift),
        )


def concatenate(parts: Sequence[Block]) -> Block:
    """Join consecutive parts whose offsets are those of the whole."""
    if len(parts) == 1:
        return parts[0]
    start = np.concatenate([*(part.start[:-1] for part in parts), parts[-1].start[-1:]])
    content, stream, time_ns = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return Block(content, stream, time_ns, start, np.concatenate([part.offset for part in parts]))


def chunk_end(block: Block, first: int, begin_ns: int, filled: int) -> tuple[int, bool]:
    """Return the index after the last message of the open chunk, and whether the chunk is full.

    A chunk is full with the message by which it has `CHUNK_BYTES`, or that is `FLUSH_NS` from its first one.

    Args:
        block: messages.
        first: index of the first one that is not yet in a chunk.
        begin_ns: log time of the chunk's first message.
        filled: bytes in the chunk.
    """
    count, begin = len(block.time_ns), np.uint64(begin_ns)
    # At least one message: after an interruption a full chunk may still be open.
    stop = max(first + 1, int(np.searchsorted(block.start, block.start[first] + CHUNK_BYTES - filled)))
    times = block.time_ns[first:stop]
    distant = np.where(times > begin, times - begin, begin - times) >= FLUSH_NS
    if distant.any():
        return first + int(np.argmax(distant)) + 1, True
    return min(stop, count), stop <= count


def index_entries(block: Block, shift: int = 0) -> dict[int, bytes]:
    """Return the packed message index of each stream; ``shift`` bytes come before the content in the chunk."""
    order = np.argsort(block.stream, kind="stable")
    entries = np.empty(len(order), ENTRY_TYPE)
    entries["time"], entries["offset"] = block.time_ns[order], block.offset[order] + shift
    packed, size = entries.tobytes(), ENTRY_TYPE.itemsize
    counts = np.bincount(block.stream)
    ends = (np.cumsum(counts) * size).tolist()
    present: list[int] = np.flatnonzero(counts).tolist()
    return {number: packed[ends[number] - int(counts[number]) * size : ends[number]] for number in present}


class Stream(NamedTuple):
    """One topic of a recording."""

    topic: Topic[Any]
    codec: Codec
    number: int
    """in the order of first use"""

    @property
    def declaration(self) -> bytes:
        """Schema and channel records."""
        return encode(self.codec.schema) + encode(self.codec.channel)


class ColumnSeries(NamedTuple):
    """Messages of one topic, in order: columns for a constant layout, else the messages."""

    topic: Topic[Any]
    time_us: NDArray[np.int64]
    """(n,); since boot, not negative"""
    columns: Sequence[NDArray[Any]] = ()
    """(n,) or (n, k) for each field of the layout"""
    messages: Sequence[Any] = ()


class BlockEncoder:
    """Encoder of the messages of one recording."""

    def __init__(self, epoch_ns: int) -> None:
        """Set the log time of the zero of the vehicle clock."""
        self.epoch_ns = epoch_ns
        self.latest_us = (BEYOND_NS - epoch_ns) // 1000
        """us since boot; latest time of a message"""
        self.streams: list[Stream] = []
        self._by_channel: dict[int, Stream] = {}
        self._templates: list[bytes] = []
        self._time_offsets = np.zeros(0, np.int64)
        self._next = np.zeros(0, np.int64)
        """sequence number of the next message of each stream"""

    def open(self, topic: Topic[Any]) -> Stream:
        """Return the stream of a topic; a new topic takes one to two milliseconds.

        Raises:
            ValueError: another topic has its channel.
            TypeError: its messages have no layout.
        """
        known = self._by_channel.get(topic.channel)
        if known is None:
            known = Stream(topic, codec_for(topic), len(self.streams))
            self._templates.append(known.codec.template.record if known.codec.template else b"")
            self._time_offsets = np.append(self._time_offsets, known.codec.time_offset)
            self._next = np.append(self._next, 0)
            self.streams.append(known)
            self._by_channel[topic.channel] = known
        if known.topic != topic:
            raise ValueError(f"channel {topic.channel} belongs to {known.topic.name}")
        return known

    def block(self, messages: Sequence[tuple[int, bytes]]) -> Block:
        """Complete encoded messages (number of the stream, record), at least one; none is after `latest_us`."""
        numbers, encoded = zip(*messages, strict=True)
        stream, records, templates = np.array(numbers, np.intp), list(encoded), self._templates
        filled = [templates[number] or bytes(len(record)) for number, record in messages]
        lead = np.zeros(len(records), np.int64)
        for place, declaration in self._declarations(stream):
            lead[place] = len(declaration)
            records[place] = declaration + records[place]
            filled[place] = bytes(len(declaration)) + filled[place]
        size = np.fromiter(map(len, records), np.int64, len(records))
        content = np.frombuffer(b"".join(records), np.uint8) | np.frombuffer(b"".join(filled), np.uint8)
        offset = np.cumsum(size) - size + lead
        times = np.ndarray((len(content) - 7,), "<u8", content, strides=(1,))
        time_us = times[offset + self._time_offsets[stream]]
        return self._stamped(content, stream, time_us, size - lead, lead)

    def block_of_columns(
        self, series: Sequence[ColumnSeries], order: NDArray[np.intp], first: Sequence[int]
    ) -> Block:
        """Encode consecutive messages of several topics, which have no other messages in the recording.

        Args:
            series: one for each topic.
            order: index in ``series`` of each message, in the order of the file; not empty.
            first: row of each series that comes first.

        Raises:
            ValueError, TypeError, struct.error: a message does not match its layout.
        """
        numbers, sizes = np.zeros(len(series), np.intp), np.zeros(len(order), np.int64)
        time_us = np.empty(len(order), np.uint64)
        parts = list[tuple[NDArray[np.intp], list[bytes] | Bytes]]()
        places_of = {number: places for number, places in enumerate(rows_by_value(order, len(series))) if len(places)}
        # Streams have numbers in the order of their first messages, as if these came one by one.
        for number in sorted(places_of, key=lambda number: int(places_of[number][0])):
            one, places = series[number], places_of[number]
            rows = slice(first[number], first[number] + len(places))
            stream = self.open(one.topic)
            numbers[number], time_us[places] = stream.number, one.time_us[rows]
            template = stream.codec.template
            records = (
                [*map(stream.codec.record, one.messages[rows])]
                if template is None
                else template.rows([values[rows] for values in one.columns])
            )
            sizes[places] = [*map(len, records)] if isinstance(records, list) else records.shape[1]
            parts.append((places, records))
        streams, lead = numbers[order], np.zeros(len(order), np.int64)
        declarations = self._declarations(streams)
        for place, declaration in declarations:
            lead[place] = len(declaration)
        offset = np.cumsum(sizes + lead) - sizes
        content = np.empty(int(offset[-1] + sizes[-1]), np.uint8)
        for place, declaration in declarations:
            content[offset[place] - lead[place] : offset[place]] = np.frombuffer(declaration, np.uint8)
        for places, records in parts:
            _scatter(content, offset[places], records)
        return self._stamped(content, streams, time_us, sizes, lead)

    def _declarations(self, stream: NDArray[np.intp]) -> list[tuple[int, bytes]]:
        """Return the index of the first message of each new stream and the declaration that comes before it."""
        counts = np.bincount(stream, minlength=len(self._next))
        new: list[int] = np.flatnonzero((counts > 0) & (self._next == 0)).tolist()
        return [(int(np.argmax(stream == number)), self.streams[number].declaration) for number in new]

    def _stamped(
        self,
        content: Bytes,
        stream: NDArray[np.intp],
        time_us: NDArray[np.uint64],
        size: NDArray[np.int64],
        lead: NDArray[np.int64],
    ) -> Block:
        """Write sequence numbers and log times into records of ``size`` bytes, each with ``lead`` bytes before it."""
        count = len(stream)
        order, counts = np.argsort(stream, kind="stable"), np.bincount(stream, minlength=len(self._next))
        stamps = np.empty(count, STAMP_TYPE)
        stamps["sequence"][order] = np.arange(count) + np.repeat(self._next - (np.cumsum(counts) - counts), counts)
        time_ns = time_us * np.uint64(1000) + np.uint64(self.epoch_ns)
        stamps["log_time"] = stamps["publish_time"] = time_ns
        start = np.zeros(count + 1, np.int64)
        np.cumsum(size + lead, out=start[1:])
        offset = start[:-1] + lead
        _scatter(content, offset + STAMP_OFFSET, stamps.view(np.uint8).reshape(count, -1))
        self._next = self._next + counts
        return Block(content, stream, time_ns, start, offset)


def rows_by_value(values: NDArray[np.intp], count: int) -> list[NDArray[np.intp]]:
    """Return the rows with each value from 0 to ``count - 1``, in order."""
    return np.split(np.argsort(values, kind="stable"), np.cumsum(np.bincount(values, minlength=count))[:-1])


def _scatter(content: Bytes, offset: NDArray[np.int64], records: list[bytes] | Bytes) -> None:
    """Write each of some records, rows (n, size) or of different lengths, at its offset."""
    if isinstance(records, list):
        for place, record in zip(offset.tolist(), records, strict=True):
            content[place : place + len(record)] = np.frombuffer(record, np.uint8)
    else:
        size = records.shape[1]
        rows = np.ndarray((len(content) - size + 1,), f"V{size}", content, strides=(1,))
        rows[offset] = records.view(f"V{size}")[:, 0]
