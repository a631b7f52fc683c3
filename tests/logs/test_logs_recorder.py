"""What is recorded, read by independent libraries; what happens when recording cannot go on."""

from __future__ import annotations

import errno
import fcntl
import itertools
import linecache
import signal
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from recorded import ALL_TOPICS, EPOCH_NS, FIXED_TOPICS, flight, record

from avionics import messages as m
from avionics import topics
from logs import recorder as recorder_module
from logs.blocks import CHUNK_BYTES, ColumnSeries
from logs.layout import SCALARS, layout_of
from logs.reader import open_log
from logs.recorder import AT_ONCE, McapRecorder, Writing
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.topic import Topic


def test_an_independent_reader_finds_every_message(tmp_path: Path) -> None:
    messages = flight()
    path = record(tmp_path / "a.mcap", messages)
    waiting = {topic.name: [msg for t, msg in messages if t == topic] for topic in FIXED_TOPICS}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, raw, decoded in reader.iter_decoded_messages(topics=list(waiting)):
            message = waiting[channel.topic].pop(0)
            assert schema is not None and schema.id == channel.id == channel.schema_id
            assert raw.log_time == EPOCH_NS + message.time_us * 1000
            for name, value in message._asdict().items():
                found = getattr(decoded, name)
                assert tuple(found) == value if isinstance(value, tuple) else found == value
    assert not any(waiting.values())


def test_every_checksum_and_the_summary_satisfy_the_mcap_package(tmp_path: Path) -> None:
    messages = flight()
    path = record(tmp_path / "a.mcap", messages)
    with path.open("rb") as file:
        kinds = Counter(
            type(rec).__name__ for rec in StreamReader(file, validate_crcs=True, emit_chunks=True).records
        )
        file.seek(0)
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.channel_message_counts == Counter(topic.channel for topic, _ in messages)
        assert summary.statistics.message_count == len(messages)
        assert len(summary.chunk_indexes) == kinds["Chunk"] == summary.statistics.chunk_count
        assert {channel.topic for channel in summary.channels.values()} == {topic.name for topic in ALL_TOPICS}
        assert [attachment.name for attachment in reader.iter_attachments()] == ["vehicle.toml"]
        assert {metadata.name for metadata in reader.iter_metadata()} == {"wingbeat.recording", "flight"}
    assert kinds["Footer"] == kinds["DataEnd"] == 1


def test_events_are_log_lines_for_viewers(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", [(topics.EVENTS, Event(1_500_000, Severity.NOTICE, "main", "armed"))])
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        schema, _, _, log = next(iter(reader.iter_decoded_messages()))
    assert schema is not None and schema.name == "foxglove.Log"
    assert (log.message, log.name, log.level, log.timestamp.ToMilliseconds()) == ("armed", "main", 2, 1500)


def test_enum_labels_travel_in_the_channel(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", flight(0.2, (topics.NAVIGATION,)))
    assert open_log(path).columns(topics.NAVIGATION).labels["mode"][4] == "AUTO"


def test_same_input_same_bytes(tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", flight()).read_bytes()
    two = record(tmp_path / "b.mcap", flight()).read_bytes()
    assert one == two


def test_messages_do_not_depend_on_when_it_was(tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", flight(), start_epoch_ns=EPOCH_NS)
    two = record(tmp_path / "b.mcap", flight(), start_epoch_ns=EPOCH_NS + 10**15, clock=iter(range(10**9)).__next__)

    def encoded(path: Path) -> list[tuple[str, bytes]]:
        with path.open("rb") as file:
            return [(channel.topic, raw.data) for _, channel, raw in make_reader(file).iter_messages()]

    assert encoded(one) == encoded(two)


def chunk_spans(path: Path) -> list[tuple[float, int]]:
    """Duration in s and unpacked size of every chunk."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [((c.message_end_time - c.message_start_time) * 1e-9, c.uncompressed_size) for c in summary.chunk_indexes]


def test_chunks_are_closed_by_size_and_by_log_time(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", flight(3.0))
    spans = chunk_spans(path)
    assert max(duration for duration, _ in spans) <= 0.25
    assert max(size for _, size in spans) < CHUNK_BYTES + 1000
    slow = record(tmp_path / "b.mcap", flight(10.0, (topics.HEALTH,)))
    assert len(chunk_spans(slow)) == 5  # a message per second: the one that finds the chunk old enough closes it


def test_chunks_are_closed_by_the_wall_clock(tmp_path: Path) -> None:
    now = [0.0]
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=0, clock=lambda: now[0]) as recorder:
        recorder.record(topics.HEALTH, m.Health(0, 0, 0, 0))
        before = recorder.path.stat().st_size
        now[0] = 0.3
        recorder.record(topics.HEALTH, m.Health(1, 0, 0, 1))
        assert recorder.path.stat().st_size > before
        assert len(open_log(recorder.path).columns(topics.HEALTH).time) == 2


def test_an_existing_file_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(InputError, match="exists"):
        McapRecorder(path)
    assert path.read_bytes() == b"precious"


def test_a_place_that_cannot_be_written_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(InputError, match="cannot record"):
        McapRecorder(tmp_path / "file" / "a.mcap")


class FullDisk:
    """An unbuffered file on a disk that takes ``capacity`` more bytes, the last of them as a short write."""

    def __init__(self, file: Any, capacity: int) -> None:
        self.file, self.capacity = file, capacity

    def write(self, data: Any) -> int:
        if not self.capacity:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self.file.write(data[: self.capacity])
        self.capacity -= written
        return int(written)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


@pytest.mark.parametrize("capacity", [120_000, 200_001, 333_333])
def test_a_full_disk_ends_the_recording_not_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capacity: int
) -> None:
    create = recorder_module._create
    monkeypatch.setattr(recorder_module, "_create", lambda path: FullDisk(create(path), capacity))
    messages = flight(3.0)
    recorder = McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0)
    for topic, message in messages:
        recorder.record(topic, message)
    recorder.attach("late", "text/plain", b"x")
    recorder.close()
    assert "No space left" in recorder.failure and "\n" not in recorder.failure
    log = open_log(recorder.path)
    assert not log.complete
    assert log.damage == ("the file was cut off before its end",)
    times = log.columns(topics.IMU)["time_us"]
    assert len(times) > 10
    assert times.tolist() == [msg.time_us for topic, msg in messages if topic is topics.IMU][: len(times)]


def test_a_disk_without_room_at_all_is_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    create = recorder_module._create
    monkeypatch.setattr(recorder_module, "_create", lambda path: FullDisk(create(path), 10))
    with pytest.raises(InputError, match="No space left"):
        McapRecorder(tmp_path / "a.mcap")
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (topics.HEALTH, m.Health(1, -1, 0, 0)),
        (topics.HEALTH, m.Health(1, 0, 2**32, 0)),
        (topics.HEALTH, m.DriveTorque(1, 0.0, 0.0)),
        (topics.HEALTH, None),
        (topics.HEALTH, m.Health(-(2**70), 0, 0, 0)),
        (topics.ADC, m.AdcBurst(1, (1,), (1,))),
        (topics.EVENTS, Event(1, 99, "", "")),  # type: ignore[arg-type]
        (topics.EVENTS, Event(1, Severity.INFO, "", "\ud800")),
        (Topic("/bad", m.Command, 999, 0.0), m.Command(1, m.CommandKind.ARM)),
        (Topic("/clash", m.Health, topics.IMU.channel, 0.0), m.Health(1, 0, 0, 0)),
    ],
)
def test_a_message_that_does_not_fit_is_left_out_alone(tmp_path: Path, topic: Topic, message: Any) -> None:
    good = flight(0.5, (topics.IMU,))
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS) as recorder:
        for index, pair in enumerate(good):
            recorder.record(*pair)
            if index == 10:
                recorder.record(topic, message)
    assert recorder.refused == 1 and topic.name in recorder.refusal and not recorder.failure
    log = open_log(recorder.path)
    assert log.verify() == []
    assert len(log.columns(topics.IMU).time) == len(good)


def test_attachments_and_notes_that_cannot_be_written_are_left_out(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap") as recorder:
        recorder.note("flight", {"seed": 7})  # type: ignore[dict-item]
        recorder.attach("\ud800", "text/plain", b"")
    assert recorder.refused == 2
    assert open_log(recorder.path).complete


def test_after_closing_nothing_happens(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "a.mcap")
    recorder.close()
    before = recorder.path.read_bytes()
    recorder.record(topics.HEALTH, m.Health(1, 0, 0, 0))
    recorder.attach("a", "b", b"c")
    recorder.note("a", {})
    recorder.flush()
    recorder.close()
    assert recorder.path.read_bytes() == before and not recorder.failure


def test_topics_can_be_prepared_before_the_flight(tmp_path: Path) -> None:
    messages = flight(1.0)
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, topics=ALL_TOPICS) as recorder:
        for topic, message in messages:
            recorder.record(topic, message)
    with McapRecorder(tmp_path / "b.mcap", topics=ALL_TOPICS):
        pass
    log = open_log(tmp_path / "a.mcap")
    assert sum(info.messages for info in log.topics.values()) == len(messages)
    assert open_log(tmp_path / "b.mcap").topics == {}


def test_a_topic_that_is_not_logged_is_not_recorded(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", [(topics.HEALTH._replace(logged=False), m.Health(1, 0, 0, 0))])
    assert open_log(path).topics == {}


def test_a_file_is_locked_while_it_is_recorded(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap") as recorder, recorder.path.open("rb") as file:
        with pytest.raises(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        recorder.close()
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


class Repairing:
    """Another program that locks every new file before its recorder does, and lets go after some attempts."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, attempts: int) -> None:
        self.pauses, self._attempts = 0, attempts
        self._locked: Any = None
        monkeypatch.setattr(Path, "open", self._opened(Path.open))
        monkeypatch.setattr("logs.recorder.time.sleep", self._sleep)

    def _opened(self, before: Any) -> Any:
        def opened(path: Path, mode: str = "r", *rest: Any, **options: Any) -> Any:
            file = before(path, mode, *rest, **options)
            if mode == "xb":
                self._locked = before(path, "rb")
                fcntl.flock(self._locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return file

        return opened

    def _sleep(self, seconds: float) -> None:
        self.pauses += 1
        if self.pauses == self._attempts and self._locked is not None:
            self._locked.close()


def test_a_lock_that_is_held_for_a_moment_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        other = Repairing(patch, attempts=3)
        recorder = McapRecorder(tmp_path / "a.mcap")
    assert other.pauses == 3
    with recorder, recorder.path.open("rb") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_a_file_that_another_keeps_locked_is_not_recorded_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        Repairing(patch, attempts=10**6)
        with pytest.raises(InputError, match="another program holds its lock"):
            McapRecorder(tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_where_there_are_no_locks_it_is_recorded_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_locks)
    messages = flight(1.0)
    path = record(tmp_path / "a.mcap", messages)
    assert sum(info.messages for info in open_log(path).topics.values()) == len(messages)


def chunk_content(path: Path) -> bytes:
    """Uncompressed records of the first chunk."""
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        chunk = next(each for each in records if isinstance(each, Chunk))
    return zstandard.ZstdDecompressor().decompress(chunk.data)


def test_message_record_has_the_documented_bytes(tmp_path: Path) -> None:
    """Opcode 5, length, channel, sequence, log and publish time, then the protobuf bytes (mcap.dev/spec)."""
    messages = [m.DriveTorque(5, 1.0, -2.0), m.DriveTorque(6, 3.0, -0.0)]
    path = record(tmp_path / "a.mcap", [(topics.DRIVE_TORQUE, message) for message in messages])
    bodies = [layout_of(m.DriveTorque).encode(message) for message in messages]
    times = [EPOCH_NS + 5000, EPOCH_NS + 6000]
    heads = [struct.pack("<BQHIQQ", 5, 22 + len(bodies[n]), 23, n, times[n], times[n]) for n in range(2)]
    assert chunk_content(path).endswith(heads[0] + bodies[0] + heads[1] + bodies[1])


@pytest.mark.parametrize("writing", [Writing(), Writing(10**8)], ids=["at once", "queue"])
def test_columns_are_recorded_as_their_messages_are(tmp_path: Path, writing: Writing) -> None:
    """GIVEN messages of all topics WHEN recorded as columns THEN the file has the same bytes."""
    messages = flight(3.0)
    one_by_one = record(tmp_path / "a.mcap", messages)
    series, order = [], [ALL_TOPICS.index(topic) for topic, _ in messages]
    for topic in ALL_TOPICS:
        rows = [message for each, message in messages if each is topic]
        times_us = np.array([row.time_us for row in rows], np.int64)
        if topic in FIXED_TOPICS:
            fields = layout_of(topic.message).fields
            columns = [
                np.array([row[n] for row in rows], SCALARS[field.scalar].code) for n, field in enumerate(fields)
            ]
            series.append(ColumnSeries(topic, times_us, columns))
        else:
            series.append(ColumnSeries(topic, times_us, messages=rows))
    done: list[int] = []
    with McapRecorder(tmp_path / "b.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0, writing=writing) as recorder:
        recorder.note("flight", {"vehicle": "robo_raven_ii_d", "seed": "7"})
        recorder.attach("vehicle.toml", "application/toml", b"name = 'raven'\n")
        recorder.record_columns(series, np.array(order), done.append)
    assert done[-1] == len(messages) and not recorder.refusal and not recorder.failure
    assert recorder.path.read_bytes() == one_by_one.read_bytes()


def health(count: int) -> tuple[list[ColumnSeries], np.ndarray]:
    """Series of ``count`` messages of one topic, and their order."""
    zeros = np.zeros(count, np.int64)
    times = np.arange(count) * 10_000
    return [ColumnSeries(topics.HEALTH, times, [times, zeros, zeros, zeros])], np.zeros(count, np.intp)


def test_columns_after_the_end_are_not_recorded(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "a.mcap")
    recorder.close()
    before = recorder.path.read_bytes()
    done: list[int] = []
    recorder.record_columns(*health(10), done.append)
    assert recorder.path.read_bytes() == before and done == [] and not recorder.failure


@pytest.mark.parametrize("writing", [Writing(), Writing(10**8)], ids=["at once", "queue"])
def test_columns_on_a_full_disk_end_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writing: Writing
) -> None:
    """GIVEN a disk with capacity for a part of some columns THEN recording stops there and reports the failure."""
    create = recorder_module._create
    monkeypatch.setattr(recorder_module, "_create", lambda path: FullDisk(create(path), 50_000))
    recorder = McapRecorder(tmp_path / "a.mcap", clock=lambda: 0.0, writing=writing)
    count, done = 20 * recorder_module.COLUMN_BATCH, list[int]()

    def progress(recorded: int) -> None:
        done.append(recorded)
        # The thread of the queue needs time to fail.
        end = time.monotonic() + 10.0
        while not recorder.failure and time.monotonic() < end:
            time.sleep(0.01)

    recorder.record_columns(*health(count), progress)
    recorder.close()
    assert "No space left" in recorder.failure and len(done) <= 1
    assert 0 < len(open_log(recorder.path).columns(topics.HEALTH).time) < recorder_module.COLUMN_BATCH


def can_be_interrupted(frame: FrameType) -> bool:
    """Return whether Ctrl-C can come before this line: not while a lock is released, and not before a ``try``."""
    line = linecache.getline(frame.f_code.co_filename, frame.f_lineno).strip()
    return line != "try:" and not line.startswith("with ")


def interrupted_by(visit: Callable[[FrameType], None], names: set[str], call: Callable[[], None]) -> bool:
    """Return whether a KeyboardInterrupt ended ``call``, of which ``visit`` is given each line of named functions."""

    def trace(frame: FrameType, event: str, _: object) -> Any:
        if event == "line" and frame.f_code.co_name in names:
            visit(frame)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def interrupted_at(number: int, names: set[str], call: Callable[[], None]) -> bool:
    """Return whether ``call`` reached a line of the named functions with this number, and interrupt it there."""
    lines = itertools.count()

    def visit(frame: FrameType) -> None:
        if can_be_interrupted(frame) and next(lines) == number:
            raise KeyboardInterrupt

    return interrupted_by(visit, names, call)


def test_interruption_loses_at_most_one_message(tmp_path: Path) -> None:
    """GIVEN pending messages for several chunks WHEN Ctrl-C interrupts before any line that puts them into a chunk
    THEN at most one is lost and none is written twice."""
    messages = [m.Health(10_000 * n, 0, 0, 0) for n in range(20)]
    times = [message.time_us for message in messages] + [600_000, 610_000]
    names = {"_settle", "_divide", "block", "_declarations", "_stamped", "part", "chunk_end"}
    for number in itertools.count():
        with McapRecorder(tmp_path / f"{number}.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
            for message in messages:
                recorder.record(topics.HEALTH, message)
            late = m.Health(600_000, 0, 0, 0)
            interrupted = interrupted_at(number, names, lambda late=late: recorder.record(topics.HEALTH, late))
            recorder.record(topics.HEALTH, m.Health(610_000, 0, 0, 0))
        found = open_log(recorder.path).columns(topics.HEALTH)["time_us"].tolist()
        assert found == [time_us for time_us in times if time_us in found] and len(found) >= len(times) - 1, number
        if not interrupted:
            break
    assert number > 20 and found == times


def stopped_at(number: int, names: set[str], call: Callable[[], None]) -> bool:
    """Return whether ``call`` reached a line of the named functions with this number, and send Ctrl-C there."""
    lines = itertools.count()
    stopped = False

    def visit(_: FrameType) -> None:
        nonlocal stopped
        if not stopped and next(lines) == number:
            stopped = True
            signal.raise_signal(signal.SIGINT)

    assert interrupted_by(visit, names, call) == stopped, "Ctrl-C had no effect"
    return stopped


@pytest.mark.parametrize("writing", [AT_ONCE, pytest.param(Writing(10**7), marks=pytest.mark.validate)])
def test_ctrl_c_in_a_chunk_leaves_it_whole(tmp_path: Path, writing: Writing) -> None:
    """GIVEN an open chunk, an attachment and a note WHEN Ctrl-C comes before any line that closes or writes one of
    them THEN it is raised, the file is intact and every message is in it once."""
    times = [10_000 * n for n in range(20)]
    names = {
        "_close_chunk", "_write_chunk", "concatenate", "index_entries", "define", "pack_chunk", "chunk", "_write",
        "_hand_over", "job", "offer", "attachment", "metadata", "_attempt", "write",
        "__enter__", "__exit__", "_restore",
    }  # fmt: skip

    def fill(recorder: McapRecorder) -> None:
        recorder.flush()
        recorder.attach("a.txt", "text/plain", b"text")
        recorder.note("note", {"key": "value"})

    for number in itertools.count():
        path = tmp_path / f"{number}.mcap"
        with McapRecorder(path, start_epoch_ns=EPOCH_NS, clock=lambda: 0.0, writing=writing) as recorder:
            for time_us in times:
                recorder.record(topics.HEALTH, m.Health(time_us, 0, 0, 0))
            stopped = stopped_at(number, names, lambda recorder=recorder: fill(recorder))
            recorder.record(topics.HEALTH, m.Health(210_000, 0, 0, 0))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        with open_log(path) as log:
            assert log.complete and log.verify() == [], number
            assert log.columns(topics.HEALTH)["time_us"].tolist() == [*times, 210_000], number
        path.unlink()
        if not stopped:
            break
    assert number > 20


def test_columns_that_do_not_match_their_layout_are_refused(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap") as recorder:
        series = ColumnSeries(topics.HEALTH, np.array([1]), [np.array([1]), np.array([1])])
        recorder.record_columns([series], np.zeros(1, np.intp), lambda count: None)
    assert recorder.refused == 1 and open_log(recorder.path).topics == {}


def test_message_time_beyond_the_format_is_refused(tmp_path: Path) -> None:
    """The log time, in ns since 1970, has 64 bits."""
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS) as recorder:
        recorder.record(topics.HEALTH, m.Health(2**63, 0, 0, 0))
        recorder.record(topics.HEALTH, m.Health(1, 0, 0, 0))
    assert recorder.refused == 1
    assert open_log(recorder.path).columns(topics.HEALTH)["time_us"].tolist() == [1]


def test_a_message_may_be_changed_after_it_is_recorded(tmp_path: Path) -> None:
    """A list is mutable: its values when it is recorded count."""
    values = [1, 0, 0, 0]

    class Row(list):  # type: ignore[type-arg]
        time_us = 1

    row = Row(values)
    with McapRecorder(tmp_path / "a.mcap") as recorder:
        recorder.record(topics.HEALTH, row)
        row[3] = 7
    assert open_log(recorder.path).columns(topics.HEALTH)[m.Health._fields[3]].tolist() == [0]
