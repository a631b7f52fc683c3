"""A flight does not wait for its disk; one recording in several files; what the last flight left unfinished."""

from __future__ import annotations

import os
import signal
import struct
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from recorded import EPOCH_NS, flight, record

from avionics import topics
from logs import backlog as backlog_module
from logs import container
from logs import recorder as recorder_module
from logs.backlog import Backlog
from logs.reader import Log, open_log
from logs.recorder import IN_FLIGHT, McapRecorder, Writing
from logs.recover import recover_left
from wingbeat.errors import InputError
from wingbeat.topic import Topic

IMU_ALONE = (topics.IMU,)


class SlowDisk:
    """An unbuffered file that takes nothing until ``release`` is set."""

    def __init__(self, file: Any, release: threading.Event) -> None:
        self.file, self.release = file, release

    def write(self, data: Any) -> int:
        self.release.wait(30.0)
        return int(self.file.write(data))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


@pytest.fixture
def release(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """The switch of a disk that every recorder gets."""
    switch, create = threading.Event(), recorder_module._create
    switch.set()
    monkeypatch.setattr(recorder_module, "_create", lambda path: SlowDisk(create(path), switch))
    return switch


def recorder_at(path: Path, writing: Writing) -> McapRecorder:
    return McapRecorder(path, start_epoch_ns=EPOCH_NS, clock=lambda: 0.0, writing=writing)


def imu_times(*logs: Log) -> list[int]:
    return [time for log in logs for time in log.columns(topics.IMU)["time_us"].tolist()]


def test_behind_the_flights_back_the_same_bytes_are_written(tmp_path: Path) -> None:
    messages = flight(3.0)
    at_once = record(tmp_path / "a.mcap", messages)
    behind = record(tmp_path / "b.mcap", messages, writing=Writing(10**8, account=topics.RECORDER))
    assert behind.read_bytes() == at_once.read_bytes()


@pytest.mark.parametrize("queue", [0, 10**6])
def test_ctrl_c_while_a_recording_is_closed_waits_until_the_file_is_whole(
    tmp_path: Path, release: threading.Event, queue: int
) -> None:
    recorder = recorder_at(tmp_path / "a.mcap", Writing(queue))
    for topic, message in flight(0.2, IMU_ALONE):
        recorder.record(topic, message)
    release.clear()

    def interrupt() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
        release.set()

    pressing = threading.Timer(0.1, interrupt)
    pressing.start()
    with pytest.raises(KeyboardInterrupt):
        recorder.close()
    pressing.join()
    with open_log(recorder.path) as log:
        assert log.complete and len(imu_times(log)) == 40
    recorder.close()


def test_a_message_that_no_other_follows_is_written_all_the_same(tmp_path: Path) -> None:
    """GIVEN a recorder with a queue WHEN one message comes and nothing after it THEN the file soon has it."""
    clock = [0.0]
    recorder = McapRecorder(
        tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: clock[0], writing=Writing(10**6)
    )
    topic, message = flight(0.1, IMU_ALONE)[0]
    recorder.record(topic, message)
    clock[0] = 0.26
    assert written(recorder.path, 30.0) == [message.time_us]
    recorder.close()


def test_a_message_recorded_during_a_flush_is_written_too(tmp_path: Path) -> None:
    """GIVEN an open time window WHEN another thread flushes just before the message enters the queue THEN the file
    has the message after 0.25 s."""
    clock = [0.0]
    recorder = McapRecorder(
        tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: clock[0], writing=Writing(10**6)
    )

    class Flushed(deque[Any]):
        def append(self, item: Any) -> None:
            recorder.flush()
            super().append(item)

    (topic, first), (_, second) = flight(0.1, IMU_ALONE)[:2]
    recorder.record(topic, first)
    recorder._pending = Flushed(recorder._pending)
    recorder.record(topic, second)
    clock[0] = 0.26
    assert written(recorder.path, 10.0, 2) == [first.time_us, second.time_us]
    recorder.close()


def written(path: Path, timeout: float, count: int = 1) -> list[int]:
    """Times in us of the messages in a file that grows, as soon as there are ``count``, within ``timeout`` s."""
    end = time.monotonic() + timeout
    # The declarations are there a moment before the messages.
    while len(found := stated(path)) < count and time.monotonic() < end:
        time.sleep(0.01)
    return found


def stated(path: Path) -> list[int]:
    log = open_log(path)
    return imu_times(log) if topics.IMU.name in log.topics else []


def test_a_disk_that_stands_still_costs_what_does_not_fit_the_queue_and_that_is_logged(
    tmp_path: Path, release: threading.Event
) -> None:
    """GIVEN a queue of 200 kB and a disk that stops WHEN 20 s are recorded THEN nothing waits."""
    messages = flight(20.0, IMU_ALONE)
    recorder = recorder_at(tmp_path / "a.mcap", Writing(200_000, account=topics.RECORDER))
    release.clear()
    for topic, message in messages:
        recorder.record(topic, message)
    dropped = recorder.dropped
    assert 0 < dropped < len(messages)
    release.set()
    for topic, message in flight(1.0, IMU_ALONE):
        recorder.record(topic, message._replace(time_us=message.time_us + 20_000_000))
    recorder.close()
    assert not recorder.failure and recorder.dropped >= dropped
    log = open_log(recorder.path)
    assert log.complete and log.verify() == []
    assert len(imu_times(log)) == len(messages) + 200 - recorder.dropped
    stated = log.columns(topics.RECORDER)
    assert int(stated["dropped"][-1]) <= recorder.dropped
    assert int(stated["dropped"].max()) > 0 and int(stated["waiting"].max()) <= 200_000


def test_the_end_does_not_wait_for_ever_for_a_dead_disk(
    tmp_path: Path, release: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(backlog_module, "PATIENCE", 0.2)
    recorder = recorder_at(tmp_path / "a.mcap", Writing(200_000))
    release.clear()
    recorder.record(*flight(1.0, IMU_ALONE)[0])
    recorder.close()
    assert "the disk did not respond" in recorder.failure and "\n" not in recorder.failure
    release.set()


def test_a_full_disk_behind_the_flights_back_ends_the_recording_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from test_logs_recorder import FullDisk

    create = recorder_module._create
    monkeypatch.setattr(recorder_module, "_create", lambda path: FullDisk(create(path), 100_000))
    recorder = recorder_at(tmp_path / "a.mcap", Writing(10**8, account=topics.RECORDER))
    for topic, message in flight(20.0, IMU_ALONE):
        recorder.record(topic, message)
    recorder.close()
    assert "No space left" in recorder.failure
    assert open_log(recorder.path).damage == ("the file was cut off before its end",)
    assert len(imu_times(open_log(recorder.path))) > 100


@pytest.mark.parametrize("error", [MemoryError(), struct.error("too large"), zstandard.ZstdError("cannot compress")])
@pytest.mark.parametrize("queue", [0, 10**8])
def test_whatever_ends_the_writing_is_told_and_the_file_does_not_end_as_a_whole_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, queue: int
) -> None:
    """GIVEN chunks of which the third cannot be packed WHEN a flight ends THEN its recorder and its file say so."""
    packed: list[Any] = []
    pack = container.pack_chunk

    def third_fails(*arguments: Any) -> Any:
        packed.append(arguments)
        if len(packed) == 3:
            raise error
        return pack(*arguments)

    monkeypatch.setattr(recorder_module, "pack_chunk", third_fails)
    recorder = recorder_at(tmp_path / "a.mcap", Writing(queue))
    for topic, message in flight(20.0, IMU_ALONE):
        recorder.record(topic, message)
    recorder.close()
    assert (str(error) or "MemoryError") in recorder.failure and "\n" not in recorder.failure
    log = open_log(recorder.path)
    assert not log.complete and log.damage == ("the file was cut off before its end",)
    assert 0 < len(imu_times(log)) < 4000 and len(packed) == 3


def test_what_ends_the_thread_while_it_waits_is_told_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a chunk that its time alone closes WHEN there is no memory to THEN the recording is over and says so."""
    clock = [0.0]
    recorder = McapRecorder(
        tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: clock[0], writing=Writing(10**6)
    )
    ended = threading.Event()

    def no_memory(*_: object) -> None:
        ended.set()
        raise MemoryError

    monkeypatch.setattr(recorder, "_write_chunk", no_memory)
    recorder.record(*flight(0.1, IMU_ALONE)[0])
    clock[0] = 0.26
    assert ended.wait(30.0)
    recorder.close()
    assert "MemoryError" in recorder.failure
    assert not open_log(recorder.path).complete


def test_a_thread_that_ends_tells_why_and_takes_nothing_more() -> None:
    stated: list[BaseException] = []
    done: list[int] = []
    backlog = Backlog(100, lambda: None, 10.0, stated.append)

    def exits() -> None:
        raise SystemExit("enough")

    assert backlog.offer(exits, 60)
    assert not backlog.offer(lambda: done.append(1), 60, timeout=30.0)
    assert backlog.close()
    assert [str(error) for error in stated] == ["enough"] and not done and backlog.waiting == 0


def test_one_recording_in_several_files(tmp_path: Path) -> None:
    """Each of them opens by itself and has the notes and documents, those too that came late."""
    messages = flight(6.0)
    recorder = recorder_at(tmp_path / "a.mcap", Writing(volume=300_000))
    recorder.note("flight", {"vehicle": "raven"})
    for i, (topic, message) in enumerate(messages):
        recorder.record(topic, message)
        if i == len(messages) // 2:
            recorder.attach("late.txt", "text/plain", b"late")
    recorder.close()
    assert not recorder.failure and not recorder.refused
    assert [path.name for path in recorder.paths] == [
        "a.mcap",
        *(f"a-{n}.mcap" for n in range(2, len(recorder.paths) + 1)),
    ]
    assert len(recorder.paths) > 2
    logs = [open_log(path) for path in recorder.paths]
    assert all(log.complete and log.verify() == [] for log in logs)
    assert all(log.metadata["flight"] == {"vehicle": "raven"} and log.boot_ns == EPOCH_NS for log in logs)
    assert logs[-1].attachment("late.txt") == b"late"
    assert sum(info.messages for log in logs for info in log.topics.values()) == len(messages)
    assert imu_times(*logs) == [message.time_us for topic, message in messages if topic is topics.IMU]
    sizes = [path.stat().st_size for path in recorder.paths[:-1]]
    assert min(sizes) > 300_000 and max(sizes) < 600_000


def torn_and_flipped(path: Path, text: bytes) -> Path:
    """A copy without its end, one bit of the first ``text`` in it changed."""
    data = path.read_bytes()
    place = data.index(text)
    torn = path.with_name("torn.mcap")
    torn.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 : -3000])
    return torn


def test_every_file_has_its_declarations_under_a_checksum(tmp_path: Path) -> None:
    """GIVEN a later file that was cut off WHEN a topic's name is damaged THEN it is read all the same."""
    path = record(tmp_path / "a.mcap", flight(6.0), writing=Writing(volume=300_000)).with_name("a-2.mcap")
    whole = open_log(path)
    assert whole.complete and whole.verify() == []
    for name in (topics.IMU.name, topics.HEALTH.name):
        with open_log(torn_and_flipped(path, name.encode())) as log:
            assert not log.complete
            assert set(log.topics) == set(whole.topics)
            assert 0 < log.topics[name].messages <= whole.topics[name].messages


def test_what_is_declared_in_a_chunk_that_is_left_out_is_declared_again(
    tmp_path: Path, release: threading.Event
) -> None:
    """GIVEN a disk that stands still when a topic begins WHEN it goes on THEN its declaration is in a chunk."""
    messages = flight(3.0, IMU_ALONE)
    recorder = recorder_at(tmp_path / "a.mcap", Writing(60_000))
    release.clear()
    for topic, message in flight(3.0, (topics.WING,)):
        recorder.record(topic, message)
    for topic, message in messages:
        recorder.record(topic, message._replace(time_us=message.time_us + 3_000_000))
    dropped = recorder.dropped
    release.set()
    for topic, message in flight(20.0, IMU_ALONE):
        recorder.record(topic, message._replace(time_us=message.time_us + 10_000_000))
    recorder.close()
    assert dropped > len(messages) // 2
    whole = imu_times(open_log(recorder.path))
    torn = open_log(torn_and_flipped(recorder.path, topics.IMU.name.encode()))
    assert topics.IMU.name in torn.topics and imu_times(torn) == whole[: len(imu_times(torn))]


def test_another_file_of_the_recording_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "a-2.mcap").write_bytes(b"precious")
    path = record(tmp_path / "a.mcap", flight(6.0), writing=Writing(volume=300_000))
    assert (tmp_path / "a-2.mcap").read_bytes() == b"precious"
    assert open_log(path.with_name("a-3.mcap")).complete


def test_where_no_further_file_can_be_begun_the_last_one_grows_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create = recorder_module._create

    def once(path: Path) -> Any:
        if path.name != "a.mcap":
            raise InputError("no more files")
        return create(path)

    monkeypatch.setattr(recorder_module, "_create", once)
    messages = flight(6.0)
    path = record(tmp_path / "a.mcap", messages, writing=Writing(volume=300_000))
    log = open_log(path)
    assert log.complete and log.verify() == []
    assert sum(info.messages for info in log.topics.values()) == len(messages)


def test_what_a_flight_left_unfinished_is_repaired_before_the_next(tmp_path: Path) -> None:
    whole = record(tmp_path / "whole.mcap", flight(1.0, IMU_ALONE))
    torn = record(tmp_path / "torn.mcap", flight(3.0, IMU_ALONE))
    torn.write_bytes(torn.read_bytes()[:-2000])
    (tmp_path / "other.mcap").write_text("no log")
    before = whole.read_bytes()
    with McapRecorder(tmp_path / "now.mcap") as now:
        now.record(*flight(1.0, IMU_ALONE)[0])
        now.flush()
        left = recover_left(tmp_path)
    assert [path for path, _ in left] == [torn]
    assert open_log(torn).complete and open_log(torn).verify() == []
    assert left[0][1].messages == len(imu_times(open_log(torn))) > 400
    assert whole.read_bytes() == before and (tmp_path / "other.mcap").read_text() == "no log"
    assert open_log(tmp_path / "now.mcap").complete
    assert recover_left(tmp_path) == []
    assert recover_left(tmp_path / "missing") == []


def test_a_recording_that_ended_early_leaves_no_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from test_logs_recorder import FullDisk

    create = recorder_module._create
    monkeypatch.setattr(recorder_module, "_create", lambda path: FullDisk(create(path), 100_000))
    before = set(threading.enumerate())
    recorder = recorder_at(tmp_path / "a.mcap", Writing(10**8))
    for topic, message in flight(20.0, IMU_ALONE):
        recorder.record(topic, message)
    recorder.close()
    recorder.close()
    assert recorder.failure and set(threading.enumerate()) == before


def test_threads_share_a_recorder_and_nothing_is_lost_or_out_of_turn(tmp_path: Path) -> None:
    path, each = tmp_path / "a.mcap", 20_000
    shared = (topics.ATTITUDE, topics.ALTITUDE, topics.WING)
    kinds = {topic: flight(0.1, (topic,))[0][1] for topic in shared}
    with McapRecorder(path, start_epoch_ns=EPOCH_NS, writing=Writing(IN_FLIGHT)) as recorder:

        def speak(topic: Topic) -> None:
            for number in range(each):
                recorder.record(topic, kinds[topic]._replace(time_us=500 * number))

        speakers = [threading.Thread(target=speak, args=(topic,)) for topic in shared]
        for speaker in speakers:
            speaker.start()
        for speaker in speakers:
            speaker.join()
    assert not (recorder.failure or recorder.refusal or recorder.dropped)
    with open_log(path) as log:
        for topic in shared:
            assert np.array_equal(log.columns(topic.name)["time_us"], 500 * np.arange(each))
