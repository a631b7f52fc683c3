"""Records a flight to an MCAP file."""

from __future__ import annotations

import contextlib
import fcntl
import struct
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import zstandard
from mcap.records import Attachment, AttachmentIndex, McapRecord, Metadata

from avionics.quantities import BadInput
from avionics.topics import Topic
from logs.codecs import Codec, codec_for
from logs.container import Container, encode, pack_chunk

CHUNK_BYTES = 64 * 1024
FLUSH_S = 0.25
_FLUSH_NS = round(FLUSH_S * 1e9)
ZSTD_LEVEL = 1
RECORDING = "wingbeat.recording"
"""Name of the metadata record that says when the vehicle's clock was zero."""


class _Stream:
    """One topic while it is recorded."""

    __slots__ = ("codec", "encode", "index", "sequence", "topic")

    def __init__(self, topic: Topic, codec: Codec) -> None:
        self.topic = topic
        self.codec = codec
        self.encode = codec.encode
        self.sequence = 0
        self.index: list[int] = []
        """log time and offset of every message in the open chunk, in turn"""


class McapRecorder:
    """An `avionics.recorder.Recorder` that writes MCAP: 64 KiB chunks, zstd, CRCs, message indexes.

    A chunk is closed when it is full and 0.25 s after it was begun, in log time or on the wall clock, whichever is
    first: that much is lost when the machine dies. During a flight nothing is raised. When the disk refuses,
    recording ends, what was written stays readable and `failure` says why; a message that does not fit its
    declared layout is left out and `refusal` says which. Threads may share a recorder.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        start_epoch_ns: int | None = None,
        clock: Callable[[], float] = time.monotonic,
        topics: Iterable[Topic] = (),
    ) -> None:
        """Create the file.

        Args:
            path: of the new file; its folder is made when it is missing.
            start_epoch_ns: ns since 1970 at which the vehicle's clock was zero; now when not given.
            clock: s; wall clock for the flushes.
            topics: prepared now, which costs a millisecond or two each; others are when they first come.

        Raises:
            BadInput: the file exists or cannot be created.
        """
        self.path = Path(path)
        self.start_epoch_ns = time.time_ns() if start_epoch_ns is None else start_epoch_ns
        self.failure = ""
        """why recording ended early, one line"""
        self.refused = 0
        """messages left out"""
        self.refusal = ""
        """why the first of them was left out, one line"""
        self._clock = clock
        self._lock = threading.RLock()
        self._streams: dict[int, _Stream] = {}
        self._buffer = bytearray()
        self._last_ns = self.start_epoch_ns
        self._first_ns = 0
        self._flush_clock = 0.0
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._file = _create(self.path)
        self._container: Container | None = None
        self._begin()
        for topic in topics:
            self._open(topic)

    def record(self, topic: Topic, message: Any) -> None:
        """Store one message; its ``time_us`` is the time stamp."""
        if not topic.logged or self._container is None:
            return
        with self._lock:
            stream = self._streams.get(topic.channel)
            try:
                if stream is None or stream.topic is not topic:
                    stream = self._open(topic)
                log_ns = self.start_epoch_ns + message.time_us * 1000
                record = stream.encode(message, log_ns, stream.sequence)
            # A message of the wrong shape must cost that message alone, whatever is wrong with it.
            except (struct.error, TypeError, ValueError, AttributeError, OverflowError) as error:
                self._refuse(f"a message of {topic.name}", error)
                return
            buffer = self._buffer
            if not buffer:
                self._first_ns = log_ns
                self._flush_clock = self._clock() + FLUSH_S
            if not stream.sequence:
                # Inside a chunk a declaration is under its CRC; beside it, where readers look first, it is not.
                buffer += encode(stream.codec.schema) + encode(stream.codec.channel)
            offset = len(buffer)
            stream.sequence += 1
            stream.index += (log_ns, offset)
            buffer += record
            self._last_ns = log_ns
            # Time that runs backwards closes the chunk too: its messages are then near each other.
            young = -_FLUSH_NS < log_ns - self._first_ns < _FLUSH_NS
            if offset + len(record) >= CHUNK_BYTES or not young or self._clock() >= self._flush_clock:
                self.flush()

    def flush(self) -> None:
        """Close the open chunk and hand it to the operating system."""
        self._write(self._write_chunk)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Store a file beside the messages."""
        log_ns = self._last_ns
        record = self._encode(f"attachment {name}", Attachment(0, log_ns, name, media_type, data))
        if record:
            index = AttachmentIndex(0, 0, log_ns, 0, len(data), name, media_type)
            self._write(lambda container: container.attachment(record, index))

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store metadata."""
        record = self._encode(f"metadata {name}", Metadata(name=name, metadata=values))
        if record:
            self._write(lambda container: container.metadata(record, name))

    def close(self) -> None:
        """Finish the recording; further calls do nothing."""
        with self._lock:
            self.flush()
            self._write(Container.finish)
            self._container = None
            self._file.close()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _begin(self) -> None:
        try:
            self._container = Container(self._file)
            self._container.metadata(encode(_recording(self.start_epoch_ns)), RECORDING)
        except OSError as error:
            self._container = None
            self._file.close()
            self.path.unlink(missing_ok=True)
            raise BadInput(f"cannot record to {self.path}: {error.strerror or error}") from None

    def _open(self, topic: Topic) -> _Stream:
        known = self._streams.get(topic.channel)
        if known is None:
            known = self._streams[topic.channel] = _Stream(topic, codec_for(topic))
        if known.topic != topic:
            raise ValueError(f"channel {topic.channel} belongs to {known.topic.name}")
        return known

    def _encode(self, what: str, record: McapRecord) -> bytes:
        try:
            return encode(record)
        except (struct.error, TypeError, ValueError, AttributeError) as error:
            self._refuse(what, error)
            return b""

    def _refuse(self, what: str, error: Exception) -> None:
        self.refused += 1
        self.refusal = self.refusal or f"{what} was not recorded: {error}"

    def _write(self, write: Callable[[Container], None]) -> None:
        with self._lock:
            if self._container is None:
                return
            try:
                write(self._container)
            except (OSError, ValueError) as error:
                self._fail(error)

    def _write_chunk(self, container: Container) -> None:
        if not self._buffer:
            return
        filled = [stream for stream in self._streams.values() if stream.index]
        for stream in filled:
            container.define(stream.codec.schema, stream.codec.channel)
        entries = {stream.topic.channel: struct.pack(f"<{len(stream.index)}Q", *stream.index) for stream in filled}
        times = [stream.index[::2] for stream in filled]
        window = min(map(min, times)), max(map(max, times))
        container.chunk(pack_chunk(bytes(self._buffer), entries, window, self._compressor))
        for stream in filled:
            stream.index = []
        self._buffer.clear()

    def _fail(self, error: Exception) -> None:
        """End the recording behind the last whole record."""
        assert self._container is not None
        self.failure = f"recording to {self.path} ended: {getattr(error, 'strerror', None) or error}"
        with contextlib.suppress(OSError, ValueError):
            self._file.truncate(self._container.size)
        self._container = None
        self._file.close()


def _recording(start_epoch_ns: int) -> Metadata:
    return Metadata(name=RECORDING, metadata={"start_epoch_ns": str(start_epoch_ns)})


def _create(path: Path) -> Any:
    """Open a new file without a buffer, locked so that nobody repairs it while it grows."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("xb", buffering=0)
    except OSError as error:
        if path.exists():
            raise BadInput(f"{path} exists: a recording never overwrites a file") from None
        raise BadInput(f"cannot record to {path}: {error.strerror or error}") from None
    with contextlib.suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file
