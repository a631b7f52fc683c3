"""Recorder of a flight to an MCAP file."""

from __future__ import annotations

import fcntl
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
from logs.volumes import Volumes, Work
from wingbeat.errors import InputError
from wingbeat.message import RecorderStatus
from wingbeat.topic import Topic

CHUNK_BYTES = 64 * 1024
FLUSH_S = 0.25
_FLUSH_NS = round(FLUSH_S * 1e9)
ZSTD_LEVEL = -1
"""Files are 3 to 5 % larger than with level 1, and unpacked in half to three quarters of the time."""
Said = tuple[Topic[Any], Any]
"""a message with its topic"""
RECORDING = "wingbeat.recording"
"""Name of the metadata record that says when the vehicle's clock was zero."""


class _Stream:
    """One topic while it is recorded."""

    __slots__ = ("codec", "encode", "index", "sequence", "topic")

    def __init__(self, topic: Topic[Any], codec: Codec) -> None:
        self.topic = topic
        self.codec = codec
        self.encode = codec.encode
        self.sequence = 0
        self.index: list[int] = []
        """log time and offset of every message in the open chunk, in turn"""


class Writing(NamedTuple):
    """How a recording gets to the disk."""

    queue: int = 0
    """bytes; that may wait for the disk behind the flight's back; 0: every message waits until it is written"""
    volume: int = 0
    """bytes; after which a file is finished and the next one begun (``-2``, ``-3``); 0 for one file of any size"""
    account: Topic[Any] | None = None
    """where the recorder itself says what it had to leave out, and how much waits; None for nowhere"""


BATCH, BATCH_US = 256, 100_000.0
"""-, us; messages, and time on the vehicle's clock from the first to the last, that are encoded together"""
_SHUT = -math.inf
"""us; end of the time of messages that may wait, while none waits"""
LOCK_ATTEMPTS, LOCK_PAUSE = 50, 0.02
"""-, s; to lock a new file that another program looks into"""
IN_FLIGHT = 16 * 1024 * 1024
"""bytes; a queue that outlasts a disk which stands still for 10 s at the rate of a whole flight"""
AT_ONCE = Writing()


class McapRecorder:
    """An `avionics.recorder.Recorder` that writes MCAP: 64 KiB chunks, zstd, CRCs, message indexes.

    A chunk is closed when it is full and 0.25 s after it was begun, in log time or on the wall clock, whichever is
    first: that much is lost when the machine dies. Where messages may wait for the disk (`Writing.queue`) the wall
    clock is looked at though none comes, every 0.125 s; else it is the next message that closes a chunk.

    Messages are encoded some at a time, so they may not change once they are here: one by one, between all else that
    a flight does, each would find the processor's caches full of something else and take twice as long.

    During a flight nothing is raised. When the disk refuses, or writing fails in any other way, recording ends, what
    was written stays readable without claiming to be whole, and `failure` says why; a message that does not fit its
    declared layout is left out and `refusal` says which. Where the queue has no room for more, a chunk of messages
    is left out, counted in `dropped`, and the count is logged as soon as there is room. Threads may share a recorder.
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
            path: of the new file; its folder is made when it is missing.
            start_epoch_ns: ns since 1970 at which the vehicle's clock was zero; now when not given.
            clock: s; wall clock for the flushes.
            topics: prepared now, which costs a millisecond or two each; others are when they first come.
            writing: how it gets to the disk.

        Raises:
            InputError: the file exists, cannot be created or is locked by another program.
        """
        self.path = Path(path)
        self.start_epoch_ns = time.time_ns() if start_epoch_ns is None else start_epoch_ns
        self.failure = ""
        """why recording ended early, one line"""
        self._refused, self._refusal = 0, ""
        self.dropped = 0
        """messages for which the disk was too slow"""
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
        """Of the files so far, in turn."""
        return list(self._volumes.paths)

    @property
    def refused(self) -> int:
        """Messages left out."""
        self._settle()
        return self._refused

    @property
    def refusal(self) -> str:
        """Why the first of them was left out, one line."""
        self._settle()
        return self._refusal

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Store one message; its ``time_us`` is the time stamp."""
        if not self._open_for_writing:
            return
        waiting = self._waiting
        # Without the lock: a queue takes one message after another, and where the window was shut meanwhile, it was
        # before the queue was emptied, so that the message is looked at here or there.
        waiting.append((topic, message))
        try:
            if (
                self._first_us <= message.time_us < self._past_us
                and len(waiting) <= BATCH
                # Without a thread that does it, it is a message that ends a chunk whose time is over.
                and (self._backlog is not None or self._clock() < self._flush_clock)
            ):
                return
        # What is wrong with it is told where it is encoded.
        except (AttributeError, TypeError):
            pass
        self._look(message)

    def record_all(self, messages: Iterable[Said]) -> None:
        """Store messages in turn, encoded now; in less time than one by one, where there are some hundred of them."""
        if not self._open_for_writing:
            return
        with self._lock:
            self._since = self._clock()
            self._waiting.extend(messages)
            self._settle()

    def _look(self, message: Any) -> None:
        """Begin to wait with a first message; encode what has waited long enough."""
        with self._lock:
            try:
                opened = self._past_us == _SHUT and self._open_window(message.time_us)
            except (AttributeError, TypeError):
                opened = False
            if not opened or (self._backlog is None and self._clock() >= self._flush_clock):
                self._settle()

    def _open_window(self, time_us: float) -> bool:
        """Let messages wait that are not much younger than this one."""
        self._since, past_us = self._clock(), time_us + BATCH_US
        if self._buffer:
            past_us = min(past_us, (self._youngest_ns - self.start_epoch_ns) / 1000)
        else:
            self._flush_clock = self._since + FLUSH_S
        self._first_us, self._past_us = time_us, past_us
        return True

    def _settle(self) -> None:
        """Encode what waits into the open chunk."""
        with self._lock:
            self._past_us = _SHUT
            waiting, stream_of, epoch = self._waiting, self._streams.get, self.start_epoch_ns
            # Ctrl-C may come between any two lines: what was taken is not taken again.
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
                # A message of the wrong shape must cost that message alone, whatever is wrong with it.
                except Exception as error:
                    self._refuse(f"a message of {topic.name}", error)
                    continue
                buffer = self._buffer
                if not buffer:
                    self._begin_chunk(log_ns)
                if not stream.sequence:
                    # Inside a chunk a declaration is under its CRC; beside it, where readers look first, it is not.
                    buffer += _declared(stream.codec)
                offset = len(buffer)
                stream.sequence += 1
                # An index must not name a message that is not there.
                buffer += record
                stream.index += (log_ns, offset)
                self._last_ns = log_ns
                if len(buffer) >= CHUNK_BYTES or not self._oldest_ns < log_ns < self._youngest_ns:
                    self._close()
            if self._buffer and self._clock() >= self._flush_clock:
                self._close()

    def _begin_chunk(self, log_ns: int) -> None:
        # Time that runs backwards closes the chunk too: its messages are then near each other.
        self._oldest_ns, self._youngest_ns = log_ns - _FLUSH_NS, log_ns + _FLUSH_NS
        self._flush_clock = self._since + FLUSH_S

    def flush(self) -> None:
        """Close the open chunk and hand it to the operating system, or to the queue before it."""
        with self._lock:
            self._settle()
            self._close()

    def _close(self) -> None:
        if not self._buffer:
            return
        try:
            self._close_chunk()
        # Where there is no memory for another chunk, the flight goes on without its recording.
        except Exception as error:
            self._end(error)

    def _close_chunk(self) -> None:
        filled = [stream for stream in self._streams.values() if stream.index]
        others = (stream for stream in filled if stream.topic is not self._writing.account)
        count = sum(len(stream.index) // 2 for stream in others)
        work, size = self._chunk(filled), len(self._buffer)
        # Emptied before it is handed over: whatever interrupts this, no message is written twice.
        self._buffer = bytearray()
        self._flush_clock = math.inf
        for stream in filled:
            stream.index = []
        if not self._hand_over(work, size):
            self.dropped += count
        self._report_drops()

    def _flush_overdue(self) -> None:
        """Close an open chunk whose time is over though no message comes that would do it.

        Whoever holds the lock is recording, and looks at the clock himself; to wait for him while he waits for room
        in the queue would keep both.
        """
        if self._lock.acquire(blocking=False):
            try:
                if self._clock() >= self._flush_clock:
                    self.flush()
            finally:
                self._lock.release()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Store a file beside the messages."""
        self._settle()
        log_ns = self._last_ns
        record = self._encode(f"attachment {name}", Attachment(0, log_ns, name, media_type, data))
        if record:

            def attached(container: Container) -> None:
                container.attachment(record, AttachmentIndex(0, 0, log_ns, 0, len(data), name, media_type))

            self._keep(attached, f"attachment {name}", len(record))

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store metadata."""
        record = self._encode(f"metadata {name}", Metadata(name=name, metadata=values))
        if record:
            self._keep(lambda container: container.metadata(record, name), f"metadata {name}", len(record))

    def close(self) -> None:
        """Finish the recording; further calls do nothing.

        Ctrl-C meanwhile, as when both commands of a flight are ended at once, is raised when the file is whole.
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
            # Nobody flies any more: what is left waits for the disk, and so does what is told of the drops.
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
        """Write what every file of the recording has."""
        with self._lock:
            if not self._hand_over(work, size, everywhere=True):
                self._refused += 1
                self._refusal = self._refusal or f"{what} was not recorded: the disk is too slow"

    def _hand_over(self, work: Work, size: int, everywhere: bool = False) -> bool:
        """Write now, or queue to be written; False where there is no room."""
        if not self._open_for_writing or self.failure:
            return True

        def job() -> None:
            self._attempt(lambda: self._volumes.write(work, everywhere))

        if self._backlog is not None:
            return self._backlog.offer(job, size, self._timeout)
        job()
        return True

    def _attempt(self, write: Callable[[], None]) -> None:
        """Write, unless writing has failed before; a disk that refuses ends the recording behind a whole record."""
        if self.failure:
            return
        try:
            write()
        # Whatever it was (no memory, the compressor): what was to be written is missing, and the file may not end as
        # if it were whole.
        except Exception as error:
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        """End the recording behind its last whole record; for whoever writes."""
        self._end(error)
        self._volumes.give_up()

    def _end(self, error: BaseException) -> None:
        """Record no more; the file is closed by whoever writes, or by `close`."""
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        self.failure = self.failure or f"recording to {self.path} ended: {reason}"
        self._open_for_writing = False

    def _chunk(self, filled: list[_Stream]) -> Work:
        """The open chunk, to be compressed by whoever writes it."""
        content, codecs = bytes(self._buffer), [stream.codec for stream in filled]
        entries = {stream.topic.channel: stream.index for stream in filled}
        times = [stream.index[::2] for stream in filled]
        window = min(map(min, times)), max(map(max, times))
        begun = {stream.topic.channel for stream in filled if stream.sequence == len(stream.index) // 2}

        def written(container: Container) -> None:
            new = [codec for codec in codecs if container.define(codec.schema, codec.channel)]
            # Every file has its declarations under a CRC: a later one, and one whose chunk with them was left out.
            before = b"".join(_declared(codec) for codec in new if codec.channel.id not in begun)
            packed = {channel: _packed(index, len(before)) for channel, index in entries.items()}
            container.chunk(pack_chunk(before + content, packed, window, self._compressor))

        return written

    def _report_drops(self) -> None:
        """Log what was left out, once after each time it was more."""
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
    """Times and offsets of a message index, its messages ``shift`` bytes further on."""
    if shift:
        index = [value + shift if place % 2 else value for place, value in enumerate(index)]
    return struct.pack(f"<{len(index)}Q", *index)


def _recording(start_epoch_ns: int) -> Metadata:
    return Metadata(name=RECORDING, metadata={"start_epoch_ns": str(start_epoch_ns)})


def _create(path: Path) -> Any:
    """Open a new file without a buffer, locked so that nobody repairs it while it grows."""
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
    """Lock a new file; False where another keeps the lock. A file system without locks is recorded to all the same.

    Who repairs what other flights left may look into the file just now: it is empty, and let go of at once.
    """
    for _ in range(LOCK_ATTEMPTS):
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            time.sleep(LOCK_PAUSE)
        except OSError:
            return True
    return False
