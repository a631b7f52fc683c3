"""Recorder of a flight to an MCAP file."""

from __future__ import annotations

import math
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple

import zstandard
from mcap.records import Attachment, AttachmentIndex, McapRecord, Metadata

from logs.backlog import PATIENCE, Backlog
from logs.codecs import Codec, codec_for
from logs.container import Container, encode, pack_chunk
from logs.file_lock import lock
from logs.volumes import Volumes, Work
from wingbeat.errors import InputError
from wingbeat.message import RecorderStatus
from wingbeat.topic import Topic

CHUNK_BYTES = 64 * 1024
FLUSH_S = 0.25
_FLUSH_NS = round(FLUSH_S * 1e9)
ZSTD_LEVEL = -1
"""Level of zstd: files are 3 to 5 % larger than at level 1, but decompress in 50 to 75 % of the time."""
Said = tuple[Topic[Any], Any]
"""a message with its topic"""
RECORDING = "wingbeat.recording"
"""Name of the metadata record with the epoch time of the zero of the vehicle clock."""


class _Stream:
    """One topic of a recording."""

    __slots__ = ("codec", "encode", "index", "sequence", "topic")

    def __init__(self, topic: Topic[Any], codec: Codec) -> None:
        self.topic = topic
        self.codec = codec
        self.encode = codec.encode
        self.sequence = 0
        self.index: list[int] = []
        """log time and offset of every message in the open chunk, in sequence"""


class Writing(NamedTuple):
    """Options of writing a recording to the disk."""

    queue: int = 0
    """bytes; limit of the queue to the disk. 0: each message is written before the call returns"""
    volume: int = 0
    """bytes; size at which a file is finished and the next one begun (``-2``, ``-3``); 0 for no limit"""
    account: Topic[Any] | None = None
    """topic of the recorder's own status: dropped messages and queue length; None for no status"""


BATCH, BATCH_US = 256, 100_000.0
"""-, us; number of messages, and span of their vehicle time, that are encoded together"""
_SHUT = -math.inf
"""us; end of the time window of pending messages if none is pending"""
LOCK_ATTEMPTS, LOCK_PAUSE = 50, 0.02
"""-, s; attempts and pause to lock a new file that another program is reading"""
IN_FLIGHT = 16 * 1024 * 1024
"""bytes; queue for a disk that stalls for 10 s at the data rate of a whole flight"""
AT_ONCE = Writing()


class McapRecorder:
    """MCAP implementation of `avionics.recorder.Recorder`: 64 KiB chunks, zstd, CRCs, message indexes.

    A chunk is closed when it is full or 0.25 s after it was begun, in log time or on the wall clock, whichever is
    first. At most this much data is lost if the machine fails. With a queue (`Writing.queue`) the wall clock is
    checked every 0.125 s even without messages; otherwise the next message closes an overdue chunk.

    Messages are encoded in batches, which halves the encoding time because the processor caches stay filled, so
    messages must not change after they are passed to the recorder.

    No method raises during a flight. If the disk fails or writing fails otherwise, recording ends, the written data
    stay readable but are not marked as complete, and `failure` has the reason. A message that does not match its
    declared layout is omitted and reported in `refusal`. If the queue is full, a chunk of messages is omitted and
    counted in `dropped`, and the count is logged as soon as the queue has capacity. The recorder is thread-safe.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        start_epoch_ns: int | None = None,
        clock: Callable[[], float] = time.monotonic,
        topics: Iterable[Topic[Any]] = (),
        writing: Writing = AT_ONCE,
    ) -> None:
        """Create the file.

        Args:
            path: of the new file; its folder is created if missing.
            start_epoch_ns: ns since 1970 at the zero of the vehicle clock (default: now).
            clock: s; wall clock for the flushes.
            topics: prepared at once, one to two milliseconds each; others are prepared with their first message.
            writing: queue, file size limit and status topic.

        Raises:
            InputError: the file exists, cannot be created or is locked by another program.
        """
        self.path = Path(path)
        self.start_epoch_ns = time.time_ns() if start_epoch_ns is None else start_epoch_ns
        self.failure = ""
        """reason why recording ended early, one line"""
        self._refused, self._refusal = 0, ""
        self.dropped = 0
        """messages dropped because the disk was too slow"""
        self._clock = clock
        self._lock = threading.RLock()
        self._streams: dict[int, _Stream] = {}
        self._waiting: deque[Said] = deque()
        self._since, self._first_us, self._past_us = 0.0, 0.0, _SHUT
        self._buffer = bytearray()
        self._last_ns = self.start_epoch_ns
        self._oldest_ns = self._youngest_ns = 0
        self._flush_clock, self._timeout = math.inf, 0.0
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._writing, self._reported = writing, (0, 0)
        self._open_for_writing, self._closed = True, False
        self._volumes = self._begin()
        self._backlog = (
            Backlog(writing.queue, self._flush_overdue, FLUSH_S / 2, self._fail) if writing.queue else None
        )
        for topic in topics:
            self._open(topic)

    @property
    def paths(self) -> list[Path]:
        """Paths of the files so far, in sequence."""
        return list(self._volumes.paths)

    @property
    def refused(self) -> int:
        """Number of messages rejected because they do not match their layout."""
        self._settle()
        return self._refused

    @property
    def refusal(self) -> str:
        """Reason of the first rejection, one line."""
        self._settle()
        return self._refusal

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Record one message; its ``time_us`` is the time stamp."""
        if not self._open_for_writing:
            return
        waiting = self._waiting
        # Without the lock: the queue accepts messages one after another. If the window is closed meanwhile, that
        # happens before the queue is emptied, so the message is processed either here or there.
        waiting.append((topic, message))
        try:
            if (
                self._first_us <= message.time_us < self._past_us
                and len(waiting) <= BATCH
                # Without a worker thread the next message closes an overdue chunk.
                and (self._backlog is not None or self._clock() < self._flush_clock)
            ):
                return
        # Errors are reported by the encoder.
        except (AttributeError, TypeError):
            pass
        self._look(message)

    def record_all(self, messages: Iterable[Said]) -> None:
        """Record messages in sequence and encode them at once; faster than single calls for a hundred or more."""
        if not self._open_for_writing:
            return
        with self._lock:
            self._since = self._clock()
            self._waiting.extend(messages)
            self._settle()

    def _look(self, message: Any) -> None:
        """Start the time window with a first pending message; encode overdue messages."""
        with self._lock:
            try:
                opened = self._past_us == _SHUT and self._open_window(message.time_us)
            except (AttributeError, TypeError):
                opened = False
            if not opened or (self._backlog is None and self._clock() >= self._flush_clock):
                self._settle()

    def _open_window(self, time_us: float) -> bool:
        """Open the time window for messages slightly younger than this one."""
        self._since, past_us = self._clock(), time_us + BATCH_US
        if self._buffer:
            past_us = min(past_us, (self._youngest_ns - self.start_epoch_ns) / 1000)
        else:
            self._flush_clock = self._since + FLUSH_S
        self._first_us, self._past_us = time_us, past_us
        return True

    def _settle(self) -> None:
        """Encode pending messages into the open chunk."""
        with self._lock:
            self._past_us = _SHUT
            waiting, stream_of, epoch = self._waiting, self._streams.get, self.start_epoch_ns
            # Ctrl-C may occur between any two statements: no message is encoded twice.
            while waiting:
                topic, message = waiting.popleft()
                stream = stream_of(topic.channel)
                try:
                    if stream is None or stream.topic is not topic:
                        if not topic.logged:
                            continue
                        stream = self._open(topic)
                    log_ns = epoch + message.time_us * 1000
                    record = stream.encode(message, log_ns, stream.sequence)
                # A message of the wrong layout must affect only that message.
                except Exception as error:
                    self._refuse(f"a message of {topic.name}", error)
                    continue
                buffer = self._buffer
                if not buffer:
                    self._begin_chunk(log_ns)
                if not stream.sequence:
                    # A declaration inside a chunk is protected by its CRC; one outside, which readers use first, is
                    # not.
                    buffer += _declared(stream.codec)
                offset = len(buffer)
                stream.sequence += 1
                # An index must not name a message that is missing.
                buffer += record
                stream.index += (log_ns, offset)
                self._last_ns = log_ns
                if len(buffer) >= CHUNK_BYTES or not self._oldest_ns < log_ns < self._youngest_ns:
                    self._close()
            if self._buffer and self._clock() >= self._flush_clock:
                self._close()

    def _begin_chunk(self, log_ns: int) -> None:
        # Time that runs backwards closes the chunk too, so the times in a chunk stay close together.
        self._oldest_ns, self._youngest_ns = log_ns - _FLUSH_NS, log_ns + _FLUSH_NS
        self._flush_clock = self._since + FLUSH_S

    def flush(self) -> None:
        """Close the open chunk and pass it to the operating system, or to the queue."""
        with self._lock:
            self._settle()
            self._close()

    def _close(self) -> None:
        if not self._buffer:
            return
        try:
            self._close_chunk()
        # If there is no memory for another chunk, the flight continues without recording.
        except Exception as error:
            self._end(error)

    def _close_chunk(self) -> None:
        filled = [stream for stream in self._streams.values() if stream.index]
        others = (stream for stream in filled if stream.topic is not self._writing.account)
        count = sum(len(stream.index) // 2 for stream in others)
        work, size = self._chunk(filled), len(self._buffer)
        # Cleared before the handover: an interruption must not write a message twice.
        self._buffer = bytearray()
        self._flush_clock = math.inf
        for stream in filled:
            stream.index = []
        if not self._hand_over(work, size):
            self.dropped += count
        self._report_drops()

    def _flush_overdue(self) -> None:
        """Close an overdue open chunk without a new message.

        If the lock is held, a recording thread checks the clock itself; waiting for it while it waits for the queue
        would be a deadlock.
        """
        if self._lock.acquire(blocking=False):
            try:
                if self._clock() >= self._flush_clock:
                    self.flush()
            finally:
                self._lock.release()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to the recording."""
        self._settle()
        log_ns = self._last_ns
        record = self._encode(f"attachment {name}", Attachment(0, log_ns, name, media_type, data))
        if record:

            def attached(container: Container) -> None:
                container.attachment(record, AttachmentIndex(0, 0, log_ns, 0, len(data), name, media_type))

            self._keep(attached, f"attachment {name}", len(record))

    def note(self, name: str, values: dict[str, str]) -> None:
        """Record metadata."""
        record = self._encode(f"metadata {name}", Metadata(name=name, metadata=values))
        if record:
            self._keep(lambda container: container.metadata(record, name), f"metadata {name}", len(record))

    def close(self) -> None:
        """Finish the recording; further calls have no effect.

        Ctrl-C meanwhile, as when both commands of a flight are interrupted at once, is raised after the file is
        complete.
        """
        interruption = None
        done = threading.Event()

        def finish() -> None:
            try:
                self._finish()
            finally:
                done.set()

        threading.Thread(target=finish, name="finishing").start()
        # Not by `join`: a thread whose join was interrupted counts as ended.
        while not done.is_set():
            try:
                done.wait()
            except KeyboardInterrupt as stop:
                interruption = stop
        if interruption is not None:
            raise interruption

    def _finish(self) -> None:
        with self._lock:
            if self._closed:
                return
            self._closed = True
            # The flight is over, so the rest of the messages and the drop count may block on the disk.
            self._timeout = PATIENCE
            self.flush()
            self.flush()
            self._open_for_writing = False
        if self._backlog is not None and not self._backlog.close():
            self.failure = (
                self.failure or f"recording to {self.path} ended: the disk did not respond for {PATIENCE:g} s"
            )
            return
        self._attempt(self._volumes.finish)
        if self.failure:
            self._volumes.give_up()

    def __enter__(self) -> McapRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _begin(self) -> Volumes:
        try:
            volumes = Volumes(self.path, self._writing.volume, lambda path: _create(path))
        except OSError as error:
            raise InputError(f"cannot record to {self.path}: {error.strerror or error}") from None
        record = encode(_recording(self.start_epoch_ns))
        try:
            volumes.write(lambda container: container.metadata(record, RECORDING), everywhere=True)
        except OSError as error:
            volumes.give_up()
            self.path.unlink(missing_ok=True)
            raise InputError(f"cannot record to {self.path}: {error.strerror or error}") from None
        return volumes

    def _open(self, topic: Topic[Any]) -> _Stream:
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
        self._refused += 1
        self._refusal = self._refusal or f"{what} was not recorded: {error}"

    def _keep(self, work: Work, what: str, size: int) -> None:
        """Write a record that every file of the recording needs."""
        with self._lock:
            if not self._hand_over(work, size, everywhere=True):
                self._refused += 1
                self._refusal = self._refusal or f"{what} was not recorded: the disk is too slow"

    def _hand_over(self, work: Work, size: int, everywhere: bool = False) -> bool:
        """Write at once or queue; return False if the queue is full."""
        if not self._open_for_writing or self.failure:
            return True

        def job() -> None:
            self._attempt(lambda: self._volumes.write(work, everywhere))

        if self._backlog is not None:
            return self._backlog.offer(job, size, self._timeout)
        job()
        return True

    def _attempt(self, write: Callable[[], None]) -> None:
        """Write unless writing has failed before; a disk error ends the recording after a complete record."""
        if self.failure:
            return
        try:
            write()
        # Whatever the error (no memory, the compressor), data are missing, so the file must not be marked
        # as complete.
        except Exception as error:
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        """End the recording after its last complete record; called by the writing thread."""
        self._end(error)
        self._volumes.give_up()

    def _end(self, error: BaseException) -> None:
        """Stop recording; the file is closed by the writing thread or by `close`."""
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        self.failure = self.failure or f"recording to {self.path} ended: {reason}"
        self._open_for_writing = False

    def _chunk(self, filled: list[_Stream]) -> Work:
        """Return the open chunk; the writing thread compresses it."""
        content, codecs = bytes(self._buffer), [stream.codec for stream in filled]
        entries = {stream.topic.channel: stream.index for stream in filled}
        times = [stream.index[::2] for stream in filled]
        window = min(map(min, times)), max(map(max, times))
        begun = {stream.topic.channel for stream in filled if stream.sequence == len(stream.index) // 2}

        def written(container: Container) -> None:
            new = [codec for codec in codecs if container.define(codec.schema, codec.channel)]
            # Every file has its declarations under a CRC, also a later file and one whose first chunk was dropped.
            before = b"".join(_declared(codec) for codec in new if codec.channel.id not in begun)
            packed = {channel: _packed(index, len(before)) for channel, index in entries.items()}
            container.chunk(pack_chunk(before + content, packed, window, self._compressor))

        return written

    def _report_drops(self) -> None:
        """Log the drop count once after each increase."""
        account, now = self._writing.account, (self.dropped, self._refused)
        if account is None or now == self._reported:
            return
        self._reported = now
        waiting = self._backlog.waiting if self._backlog else 0
        time_us = (self._last_ns - self.start_epoch_ns) // 1000
        self.record(account, RecorderStatus(time_us, self.dropped, self._refused, waiting, self._volumes.written))


def _declared(codec: Codec) -> bytes:
    return encode(codec.schema) + encode(codec.channel)


def _packed(index: list[int], shift: int) -> bytes:
    """Return times and offsets of a message index whose messages are moved by ``shift`` bytes."""
    if shift:
        index = [value + shift if place % 2 else value for place, value in enumerate(index)]
    return struct.pack(f"<{len(index)}Q", *index)


def _recording(start_epoch_ns: int) -> Metadata:
    return Metadata(name=RECORDING, metadata={"start_epoch_ns": str(start_epoch_ns)})


def _create(path: Path) -> Any:
    """Open a new file without a buffer, locked so that no other program repairs it while it grows."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("xb", buffering=0)
    except OSError as error:
        if path.exists():
            raise InputError(f"{path} exists: a recording never overwrites a file") from None
        raise InputError(f"cannot record to {path}: {error.strerror or error}") from None
    if not _locked(file):
        file.close()
        path.unlink(missing_ok=True)
        raise InputError(f"cannot record to {path}: another program holds its lock")
    return file


def _locked(file: IO[bytes]) -> bool:
    """Lock a new file; return False if another program keeps the lock.

    A file system without locks is accepted. A repair program may inspect the file at this moment; it releases an
    empty file at once.
    """
    for _ in range(LOCK_ATTEMPTS):
        try:
            lock(file)
            return True
        except BlockingIOError:
            time.sleep(LOCK_PAUSE)
        except OSError:
            return True
    return False
