"""Recorder of a flight to an MCAP file."""

from __future__ import annotations

import math
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, NamedTuple

import numpy as np
import zstandard
from mcap.records import Attachment, AttachmentIndex, McapRecord, Metadata
from numpy.typing import NDArray

from logs.backlog import PATIENCE, Backlog
from logs.blocks import FLUSH_NS, Block, BlockEncoder, ColumnSeries, Stream, chunk_end, concatenate, index_entries
from logs.container import Container, encode, pack_chunk
from logs.file_lock import lock
from logs.interruption import DelayedInterruption
from logs.volumes import Volumes, Work
from wingbeat.errors import InputError
from wingbeat.message import RecorderStatus
from wingbeat.topic import Topic

FLUSH_S = FLUSH_NS * 1e-9
ZSTD_LEVEL = -1
"""Level of zstd: files are 3 to 5 % larger than at level 1, but decompress in 50 to 75 % of the time."""
TopicMessage = tuple[Topic[Any], Any]
"""a message with its topic"""
_Packer = tuple[Topic[Any], int, Callable[..., bytes] | None, Callable[[Any], bytes]]
"""topic, number of its stream, encoder of the fields of a message if it has one, encoder of a message"""
RECORDING = "wingbeat.recording"
"""Name of the metadata record with the epoch time of the zero of the vehicle clock."""


class Writing(NamedTuple):
    """Options of writing a recording to the disk."""

    queue: int = 0
    """bytes; limit of the queue to the disk. 0: each message is written before the call returns"""
    volume: int = 0
    """bytes; size at which a file is finished and the next one begun (``-2``, ``-3``); 0 for no limit"""
    account: Topic[Any] | None = None
    """topic of the recorder's own status: dropped messages and queue length; None for no status"""


BATCH, BATCH_US = 1024, FLUSH_S * 1e6
"""-, us; number of messages, and span of their vehicle time, that are encoded together"""
COLUMN_BATCH = 32_768
"""-; number of messages that are encoded together from columns"""
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

    Each message is packed at once, which is cheaper than to keep it. Headers, indexes and chunks are made for up to
    0.25 s of messages together.

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
        self.dropped = 0
        """messages dropped because the disk was too slow"""
        self._clock = clock
        self._lock = threading.RLock()
        self._refused, self._refusal = 0, ""
        self._packers: dict[int, _Packer] = {}
        self._pending: deque[tuple[int, bytes]] = deque()
        """number of the stream and record of each message that is not yet in a block"""
        self._taken: list[tuple[int, bytes]] = []
        """pending messages of which a block is made"""
        self._block: Block | None = None
        self._first = 0
        """index of the first message of the block that is not yet in a chunk"""
        self._since, self._first_us, self._past_us, self._timeout = 0.0, 0.0, _SHUT, 0.0
        self._flush_clock = math.inf
        """s; wall clock by which the open chunk and the pending messages must be written"""
        self._encoder = BlockEncoder(self.start_epoch_ns)
        self._parts: list[Block] = []
        """of the open chunk"""
        self._filled = self._begin_ns = 0
        self._last_ns = self.start_epoch_ns
        self._compressor = zstandard.ZstdCompressor(level=ZSTD_LEVEL)
        self._writing, self._reported = writing, (0, 0)
        self._open_for_writing, self._closed = True, False
        self._volumes = self._begin()
        self._backlog = (
            Backlog(writing.queue, self._flush_overdue, FLUSH_S / 2, self._fail) if writing.queue else None
        )
        for topic in topics:
            self._encoder.open(topic)

    @property
    def paths(self) -> list[Path]:
        """Paths of the files so far, in sequence."""
        return list(self._volumes.paths)

    @property
    def refused(self) -> int:
        """Number of messages rejected because they do not match their layout."""
        return self._refused

    @property
    def refusal(self) -> str:
        """Reason of the first rejection, one line."""
        return self._refusal

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Record one message; its ``time_us`` is the time stamp."""
        if not self._open_for_writing:
            return
        packer = self._packers.get(topic.channel)
        try:
            if packer is None or packer[0] is not topic:
                if not topic.logged:
                    return
                packer = self._prepare(topic)
            _, number, pack, encode_record = packer
            record = pack(*message) if pack is not None else encode_record(message)
            time_us = message.time_us
        # A message of the wrong layout must affect only that message.
        except Exception as error:
            self._refuse(f"a message of {topic.name}", error)
            return
        # Without the lock: the queue accepts messages one after another. The window is closed before the queue is
        # emptied. It is therefore checked again after the message is in the queue: if it is still open, the thread
        # that closes it finds the message.
        if self._first_us <= time_us < self._past_us:
            self._pending.append((number, record))
            if (
                time_us < self._past_us
                and len(self._pending) <= BATCH
                # Without a worker thread the next message closes an overdue chunk.
                and (self._backlog is not None or self._clock() < self._flush_clock)
            ):
                return
            self._settle()
        else:
            self._record_outside(topic, time_us, (number, record))

    def _prepare(self, topic: Topic[Any]) -> _Packer:
        with self._lock:
            stream = self._encoder.open(topic)
            packer = self._packers[topic.channel] = topic, stream.number, stream.codec.pack, stream.codec.record
            return packer

    def _record_outside(self, topic: Topic[Any], time_us: int, encoded: tuple[int, bytes]) -> None:
        """Record a message outside of the time window: the first one opens a window, another one closes it."""
        with self._lock:
            if time_us > self._encoder.latest_us:
                self._refuse(f"a message of {topic.name}", f"its time is {time_us} us")
                return
            opened = self._past_us == _SHUT and self._open_window(time_us)
            self._pending.append(encoded)
            if not opened or (self._backlog is None and self._clock() >= self._flush_clock):
                self._settle()

    def _open_window(self, time_us: float) -> bool:
        """Open the time window for messages slightly younger than this one."""
        self._since, past_us = self._clock(), time_us + BATCH_US
        if self._parts:
            past_us = min(past_us, (self._begin_ns + FLUSH_NS - self.start_epoch_ns) / 1000)
        else:
            self._flush_clock = self._since + FLUSH_S
        self._first_us, self._past_us = time_us, past_us
        return True

    def record_columns(
        self, series: Sequence[ColumnSeries], order: NDArray[np.intp], progress: Callable[[int], None]
    ) -> None:
        """Record all messages of topics that have no others, without a call for each message.

        Args:
            series: one for each topic.
            order: index in ``series`` of each message, in the order of the file.
            progress: called with the number of recorded messages, until recording ends.
        """
        if not self._open_for_writing:
            return
        first = np.zeros(len(series), np.int64)
        for one in series:
            low, high = one.time_us.min(initial=0), one.time_us.max(initial=0)
            if low < 0 or high > self._encoder.latest_us:
                self._refuse(f"series {one.topic.name}", f"its times are {low} to {high} us")
                return
        with self._lock:
            self._settle()
            self._since = self._clock()
            for begin in range(0, len(order), COLUMN_BATCH):
                batch = order[begin : begin + COLUMN_BATCH]
                try:
                    block = self._encoder.block_of_columns(series, batch, first.tolist())
                except (ValueError, TypeError, struct.error) as error:
                    self._refuse("a block of series", error)
                    return
                self._block, self._first = block, 0
                self._settle()
                if not self._open_for_writing:
                    return
                first += np.bincount(batch, minlength=len(series))
                progress(begin + len(batch))

    def _settle(self) -> None:
        """Append pending messages to the open chunk.

        Ctrl-C may interrupt between any two statements. The next call continues with the messages that are left:
        at most one is lost and none is written twice.
        """
        with self._lock:
            self._past_us = _SHUT
            for _ in range(len(self._pending)):
                self._taken.append(self._pending.popleft())
            # If there is no memory for another chunk, the flight continues without recording.
            try:
                self._divide()
                if self._taken:
                    # One statement, so that an interruption leaves the messages either in the list or in the block.
                    self._block, self._first, self._taken = self._encoder.block(self._taken), 0, []
                    self._divide()
                if self._clock() >= self._flush_clock:
                    self._close_chunk()
            except Exception as error:
                self._end(error)

    def _divide(self) -> None:
        """Append the rest of the block to the open chunk, and close each full one."""
        while (block := self._block) is not None:
            if not self._parts:
                self._begin_ns, self._filled = int(block.time_ns[self._first]), 0
                self._flush_clock = self._since + FLUSH_S
            end, is_full = chunk_end(block, self._first, self._begin_ns, self._filled)
            part = block.part(self._first, end, self._filled)
            self._last_ns = int(part.time_ns[-1])
            parts, filled = [*self._parts, part], self._filled + len(part.content)
            rest = block if end < len(block.stream) else None
            # One statement, so that an interruption leaves the messages either in the block or in the chunk.
            self._parts, self._filled, self._block, self._first = parts, filled, rest, end
            if is_full:
                self._close_chunk()

    def flush(self) -> None:
        """Close the open chunk and pass it to the operating system, or to the queue."""
        with self._lock:
            self._settle()
            try:
                self._close_chunk()
            except Exception as error:
                self._end(error)

    def _close_chunk(self) -> None:
        self._flush_clock = math.inf
        if not self._parts:
            return
        # An interruption would lose the chunk, write it twice, or leave a part of it in the file.
        with DelayedInterruption():
            parts, self._parts = self._parts, []
            block, streams = concatenate(parts), list(self._encoder.streams)
            size = len(block.content)
            if not self._hand_over(lambda container: self._write_chunk(container, block, streams), size):
                account = [stream.number for stream in streams if stream.topic is self._writing.account]
                self.dropped += int(np.count_nonzero(~np.isin(block.stream, account)))
        self._report_drops()

    def _write_chunk(self, container: Container, block: Block, streams: Sequence[Stream]) -> None:
        """Compress and write a chunk; called by the writing thread."""
        begun = set(block.stream[block.offset > block.start[:-1]].tolist())
        entries, before = index_entries(block), b""
        for number in entries:
            stream = streams[number]
            # Every file has its declarations under a CRC, also a later file and one whose first chunk was dropped.
            if container.define(stream.codec.schema, stream.codec.channel) and number not in begun:
                before += stream.declaration
        if before:
            entries = index_entries(block, len(before))
        packed = {streams[number].topic.channel: each for number, each in entries.items()}
        window = int(block.time_ns.min()), int(block.time_ns.max())
        content = before + block.content.tobytes() if before else block.content.data
        container.chunk(pack_chunk(content, packed, window, self._compressor))

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

    def _encode(self, what: str, record: McapRecord) -> bytes:
        try:
            return encode(record)
        except (struct.error, TypeError, ValueError, AttributeError) as error:
            self._refuse(what, error)
            return b""

    def _refuse(self, what: str, error: object) -> None:
        """Count an omitted message, document or note."""
        with self._lock:
            self._refused += 1
            self._refusal = self._refusal or f"{what} was not recorded: {error}"

    def _keep(self, work: Work, what: str, size: int) -> None:
        """Write a record that every file of the recording needs."""
        with self._lock, DelayedInterruption():
            if not self._hand_over(work, size, everywhere=True):
                self._refuse(what, "the disk is too slow")

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

    def _report_drops(self) -> None:
        """Log the drop count once after each increase."""
        account, now = self._writing.account, (self.dropped, self._refused)
        if account is None or now == self._reported:
            return
        self._reported = now
        waiting = self._backlog.waiting if self._backlog else 0
        time_us = (self._last_ns - self.start_epoch_ns) // 1000
        self.record(account, RecorderStatus(time_us, *now, waiting, self._volumes.written))


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
