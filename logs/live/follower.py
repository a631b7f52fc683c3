"""Reader of a growing recording.

The writer is not involved and never waits. What has been read is whole records: the rest of one
that is still being written is read the next time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC

from logs.chunks import ENTRY_TYPE, ChunkSpan, chunk_at, unpack
from logs.file_lock import lock
from logs.records import Damage, Span, parse, records
from wingbeat.errors import InputError

AT_ONCE = 4 * 1024 * 1024
"""bytes; limit of compressed chunks read at once: of more, the newest are read and the messages of the others
counted
"""
_MESSAGE = struct.Struct("<HIQQ")
_INDEX = struct.Struct("<HI")


def is_recorded(path: Path) -> bool:
    """Return whether a recorder holds its lock on the file.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            lock(file, shared=True)
    except BlockingIOError:
        return True
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    return False


class Message(NamedTuple):
    """One message as stored in the file."""

    log_ns: int
    """ns since 1970"""
    channel: int
    data: bytes
    """encoded"""


class Follower:
    """Reader of a file that another process writes; the file may not exist yet."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        """channels declared so far, by number"""
        self.end_ns = 0
        """ns since 1970; log time of the newest flushed message, 0 before the first"""
        self.skipped = 0
        """messages omitted because too many arrived at once, or because their chunk could not be read"""
        self.finished = False
        """whether the writer has closed the file"""
        self._file: IO[bytes] | None = None
        self._rest = b""
        self._has_magic = self._skipping = False

    def read(self, is_requested: Callable[[int], bool] = lambda channel: True) -> list[Message]:
        """Return the new messages of the requested channels in file order; without one nothing is decompressed.

        Raises:
            Damage: the file is not an MCAP file.
        """
        data = self._rest + self._news()
        start = 0 if self._has_magic else self._begin(data)
        spans = list(records(data, start, len(data))) if self._has_magic else []
        self._rest = data[spans[-1].end :] if spans else data[start:]
        room = _first_of_newest(spans)
        return [message for span in spans for message in self._take(data, span, room, is_requested)]

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _news(self) -> bytes:
        if self._file is None:
            try:
                self._file = self.path.open("rb")
            except FileNotFoundError:
                return b""
        return self._file.read()

    def _begin(self, data: bytes) -> int:
        """Return the length of MCAP's magic at the start of the file; 0 while it is incomplete."""
        if not MCAP0_MAGIC.startswith(data[: len(MCAP0_MAGIC)]):
            raise Damage(f"{self.path} is not an MCAP log")
        self._has_magic = len(data) >= len(MCAP0_MAGIC)
        return len(MCAP0_MAGIC) if self._has_magic else 0

    def _take(self, data: bytes, span: Span, first: int, is_requested: Callable[[int], bool]) -> Iterator[Message]:
        """Enter one record; chunks before the byte ``first`` are omitted."""
        if span.opcode == Opcode.CHUNK:
            chunk = chunk_at(data, span)
            self.end_ns = max(self.end_ns, chunk.end_ns)
            asked = any(map(is_requested, self.channels))
            self._skipping = asked and span.offset < first
            if asked and not self._skipping:
                yield from self._unpacked(data, chunk, is_requested)
        elif span.opcode == Opcode.MESSAGE_INDEX and self._skipping:
            self.skipped += _INDEX.unpack_from(data, span.body)[1] // ENTRY_TYPE.itemsize
        else:
            self._define(data, span)

    def _define(self, data: bytes, span: Span) -> None:
        """Enter a schema or channel; the Wingbeat recorder declares every channel outside of the chunks."""
        if span.opcode == Opcode.SCHEMA:
            schema = parse(Schema, data, span)
            self.schemas[schema.id] = schema
        elif span.opcode == Opcode.CHANNEL:
            channel = parse(Channel, data, span)
            self.channels[channel.id] = channel
        elif span.opcode == Opcode.FOOTER:
            self.finished = True

    def _unpacked(self, data: bytes, chunk: ChunkSpan, is_requested: Callable[[int], bool]) -> Iterator[Message]:
        try:
            content = unpack(data, chunk)
        except Damage:
            self._skipping = True
            return
        for span in records(content, 0, len(content)):
            if span.opcode == Opcode.MESSAGE:
                channel, _, log_ns, _ = _MESSAGE.unpack_from(content, span.body)
                if is_requested(channel):
                    yield Message(log_ns, channel, content[span.body + _MESSAGE.size : span.end])


def _first_of_newest(spans: Sequence[Span]) -> int:
    """Return the index of the first of the newest chunks that can be read at once, at least one."""
    chunks = [span for span in spans if span.opcode == Opcode.CHUNK]
    size, first = 0, len(chunks)
    while first and (size < AT_ONCE or first == len(chunks)):
        first -= 1
        size += chunks[first].length
    return chunks[first].offset if chunks else 0
