"""Logs that were cut off or altered: what is whole is read, what is not is said, nothing is lost by repairing."""

from __future__ import annotations

import fcntl
import random
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer
from recorded import ALL_TOPICS, EPOCH_NS, flight, record

from avionics import messages as m
from avionics import topics
from logs.checksums import OPCODE, Checksums, decode_checksums, encode_checksums
from logs.index import ALTERED
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.records import HEAD, Damage, Span, records
from logs.recover import recover
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError

CHOSEN = (topics.IMU, topics.WING, topics.NAVIGATION, topics.EVENTS, topics.INPUTS, truth_topics.STATE)


class Recording(bytes):
    """A whole file, named shortly when a test fails."""

    def __repr__(self) -> str:
        return f"<recording of {len(self)} bytes>"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return Recording(record(tmp_path_factory.mktemp("whole") / "a.mcap", flight(1.5, CHOSEN)).read_bytes())


EXPECTED = {topic.name: [message for t, message in flight(1.5, CHOSEN) if t is topic] for topic in CHOSEN}


def spans_of(data: bytes, opcode: int) -> list[Span]:
    return [span for span in records(data, 8, len(data)) if span.opcode == opcode]


def times_read(path: Path) -> dict[str, list[int]]:
    """Times of the messages of every topic that can be read, all of them among those recorded."""
    with open_log(path) as log:
        found = {name: table["time_us"].tolist() for name, table in log.tables(_fixed(log)).items()}
    return found


def _fixed(log: Any) -> list[str]:
    return [name for name, info in log.topics.items() if info.layout is not None]


def recorded_times(name: str) -> list[int]:
    return [message.time_us for message in EXPECTED[name]]


@given(share=st.floats(0.0, 1.0))
def test_a_file_cut_anywhere_gives_its_whole_chunks(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, share: float
) -> None:
    cut = int(share * (len(whole) - 1))
    path = tmp_path_factory.mktemp("cut") / "a.mcap"
    path.write_bytes(whole[:cut])
    if cut < 8:
        with pytest.raises(InputError):
            open_log(path)
        return
    whole_chunks = [span for span in spans_of(whole, Opcode.CHUNK) if span.end <= cut]
    with open_log(path) as log:
        assert not log.complete and log.damage[-1] == "the file was cut off before its end"
        assert log.verify() == list(log.damage)
        count = sum(info.messages for info in log.topics.values())
        for name, columns in log.tables(_fixed(log)).items():
            times = columns["time_us"].tolist()
            assert times == recorded_times(name)[: len(times)]
    assert count == sum(messages_in(whole, span) for span in whole_chunks)


def messages_in(data: bytes, chunk: Span) -> int:
    """Messages that the message indexes behind a chunk list."""
    count = 0
    for span in records(data, chunk.end, len(data)):
        if span.opcode != Opcode.MESSAGE_INDEX:
            break
        count += int.from_bytes(data[span.body + 2 : span.body + 6], "little") // 16
    return count


@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_never_gives_a_wrong_number(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, place: float, bit: int
) -> None:
    """GIVEN one flipped bit WHEN the log is read THEN messages are as recorded, or missing and it is said."""
    position = int(place * len(whole))
    damaged = bytearray(whole)
    damaged[position] ^= 1 << bit
    path = tmp_path_factory.mktemp("flip") / "a.mcap"
    path.write_bytes(damaged)
    try:
        with open_log(path) as log:
            said = bool(log.damage)
            tables = log.tables(_fixed(log))
    except InputError as error:
        assert "\n" not in str(error)
        return
    for name, columns in tables.items():
        if name not in EXPECTED:
            assert said
            continue
        known = {message.time_us: message for message in EXPECTED[name]}
        for row, time in enumerate(columns["time_us"].tolist()):
            assert tuple(columns[field][row] for field in columns) == tuple(known[time])
        assert said or len(columns.time) == len(known)


def test_a_chunk_altered_in_a_whole_file_is_noticed(tmp_path: Path, whole: bytes) -> None:
    chunk = spans_of(whole, Opcode.CHUNK)[1]
    damaged = bytearray(whole)
    damaged[chunk.end - 100] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    log = open_log(path)
    with pytest.raises(InputError, match=rf"chunk at byte {chunk.offset} .*recover") as raised:
        log.columns(topics.IMU)
    assert "\n" not in str(raised.value)
    assert [line for line in log.verify() if f"byte {chunk.offset}" in line]


def test_an_altered_attachment_is_noticed(tmp_path: Path, whole: bytes) -> None:
    span = spans_of(whole, Opcode.ATTACHMENT)[0]
    damaged = bytearray(whole)
    damaged[span.end - 6] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    with pytest.raises(InputError, match="attachment"):
        open_log(path).attachment("vehicle.toml")


@pytest.mark.parametrize("field", ["offset", "time", "channel", "size"])
def test_a_wrong_message_index_is_not_believed(tmp_path: Path, whole: bytes, field: str) -> None:
    """The chunk, which its CRC vouches for, is walked through instead."""
    damaged = bytearray(whole)
    for span in spans_of(whole, Opcode.MESSAGE_INDEX):
        first = span.body + 6
        if field == "offset":
            struct.pack_into("<Q", damaged, first + 8, 2**40)
        elif field == "time":
            struct.pack_into("<Q", damaged, first, 12345)
        elif field == "channel":
            swapped = damaged[first + 8 : first + 16]
            damaged[first + 8 : first + 16] = (int.from_bytes(swapped, "little") + 9).to_bytes(8, "little")
        else:
            struct.pack_into("<I", damaged, span.body + 2, 3)
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    assert times_read(path) == {name: recorded_times(name) for name in (topic.name for topic in CHOSEN if topic.rate)}
    log = open_log(path)
    assert log.columns(topics.IMU)["accel_x"].tolist() == [message.accel_x for message in EXPECTED["/sensors/imu"]]
    assert log.events() == EXPECTED["/system/events"]


def altered(path: Path, whole: bytes, place: int, bit: int = 0) -> Path:
    data = bytearray(whole)
    data[place] ^= 1 << bit
    path.write_bytes(data)
    return path


def test_altered_metadata_are_left_out_and_told(tmp_path: Path, whole: bytes) -> None:
    """GIVEN a note whose text was altered THEN the rest is there, it is not, and the file says so."""
    span = next(span for span in spans_of(whole, Opcode.METADATA) if b"flight" in whole[span.offset : span.end])
    path = altered(tmp_path / "a.mcap", whole, span.end - 1)
    log = open_log(path)
    assert log.damage == (f"metadata at byte {span.offset} does not match its checksum",)
    assert log.verify() == list(log.damage) and log.metadata.keys() == {"wingbeat.recording"}
    assert times_read(path)["/sensors/imu"] == recorded_times("/sensors/imu")
    recovery = recover(path)
    assert recovery.damage == log.damage and recovery.messages == sum(map(len, EXPECTED.values()))
    assert recovery.torn is not None and b"robo_raven_ii_d" in recovery.torn.read_bytes()
    assert open_log(path).verify() == []


@pytest.mark.parametrize("bit", [0, 20, 27])
def test_an_altered_time_in_a_message_index_changes_no_time_and_no_order(
    tmp_path: Path, whole: bytes, bit: int
) -> None:
    span = spans_of(whole, Opcode.MESSAGE_INDEX)[3]
    path = altered(tmp_path / "a.mcap", whole, span.body + 6 + 16 + bit // 8, bit % 8)
    (tmp_path / "whole.mcap").write_bytes(whole)
    log, known = open_log(path), open_log(tmp_path / "whole.mcap")
    for topic in CHOSEN:
        assert log.times(topic).tolist() == known.times(topic).tolist()
    assert [part.tolist() for part in log.order(CHOSEN)] == [part.tolist() for part in known.order(CHOSEN)]
    assert log.verify() == [ALTERED] and not log.damage
    recovery = recover(path)
    assert recovery.damage == (ALTERED,) and recovery.torn is None and open_log(path).verify() == []


def test_a_message_index_that_names_a_message_twice_is_not_believed(tmp_path: Path) -> None:
    """GIVEN two messages of one time, and the second entry leading to the first WHEN read THEN both are there."""
    path = record(tmp_path / "a.mcap", [(topics.HEALTH, m.Health(5000, 0, 0, ticks)) for ticks in range(2)])
    data = bytearray(path.read_bytes())
    first = spans_of(bytes(data), Opcode.MESSAGE_INDEX)[0].body + 6
    data[first + 24 : first + 32] = data[first + 8 : first + 16]
    path.write_bytes(data)
    assert open_log(path).columns(topics.HEALTH)["ticks"].tolist() == [0, 1]


def test_times_of_a_file_without_our_checksums_are_looked_up_in_its_messages(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/a", "json", writer.register_schema("a", "jsonschema", b"{}"))
        for time in range(0, 1000, 10):
            writer.add_message(channel, time, b"{}", time)
        writer.finish()
    whole = path.read_bytes()
    span = spans_of(whole, Opcode.MESSAGE_INDEX)[0]
    log = open_log(altered(path, whole, span.body + 6 + 16))
    assert log.times("/a") == pytest.approx(1e-9 * np.arange(0, 1000, 10))


def test_checksums_of_another_program_are_passed_over() -> None:
    ours = encode_checksums(Checksums(7, {8: 9}))
    assert decode_checksums(ours, Span(OPCODE, 0, len(ours))) == Checksums(7, {8: 9})
    assert decode_checksums(b"\x80" + bytes(40), Span(OPCODE, 0, 41)) is None
    with pytest.raises(Damage, match="lengths that contradict"):
        decode_checksums(ours[:-1], Span(OPCODE, 0, len(ours) - 1))


def test_chunks_behind_a_wrong_length_are_found_again(tmp_path: Path, whole: bytes) -> None:
    chunks = spans_of(whole, Opcode.CHUNK)
    damaged = bytearray(whole)
    HEAD.pack_into(damaged, chunks[1].offset, Opcode.CHUNK, 2**50)
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged[:-50])
    log = open_log(path)
    assert sum(info.messages for info in log.topics.values()) == sum(
        messages_in(whole, chunk) for chunk in chunks if chunk != chunks[1]
    )
    assert log.damage[0].startswith(f"bytes {chunks[1].offset} to ")


def test_a_chunk_that_claims_to_be_enormous_is_not_allocated(tmp_path: Path, whole: bytes) -> None:
    chunk = spans_of(whole, Opcode.CHUNK)[0]
    damaged = bytearray(whole)
    struct.pack_into("<Q", damaged, chunk.body + 16, 2**62)
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    log = open_log(path)
    assert len(log.columns(topics.IMU).time) < len(recorded_times("/sensors/imu")) and log.damage


@given(tail=st.binary(max_size=300))
def test_garbage_behind_the_magic_never_gives_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, whole: bytes, tail: bytes
) -> None:
    path = tmp_path_factory.mktemp("garbage") / "a.mcap"
    path.write_bytes(whole[:8] + tail)
    with open_log(path) as log:
        assert log.damage
        log.tables()


def test_a_summary_with_a_wrong_schema_is_checked_too(tmp_path: Path, whole: bytes) -> None:
    """A summary whose CRC is right may still lie about where things are: the file is then walked through."""
    footer = spans_of(whole, Opcode.FOOTER)[0]
    start = int.from_bytes(whole[footer.body : footer.body + 8], "little")
    summary = bytearray(whole[start : footer.end - 4])
    index = next(span for span in spans_of(whole, Opcode.CHUNK_INDEX))
    struct.pack_into("<Q", summary, index.body - start + 16, 17)
    crc = struct.pack("<I", zlib.crc32(summary))
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[:start] + bytes(summary) + crc + whole[footer.end :])
    assert times_read(path)["/sensors/imu"] == recorded_times("/sensors/imu")


# --- repair ---------------------------------------------------------------------------------------------


def test_a_whole_log_is_left_alone(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(whole)
    before = path.stat()
    recovery = recover(path)
    assert recovery.damage == () and recovery.torn is None
    assert recovery.messages == sum(map(len, EXPECTED.values()))
    assert path.stat().st_ino == before.st_ino and path.read_bytes() == whole
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("seed", range(12))
def test_a_repaired_log_holds_every_whole_chunk_and_every_byte_is_kept(
    tmp_path: Path, whole: bytes, seed: int
) -> None:
    cut = random.Random(seed).randrange(60, len(whole))
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[:cut])
    path.chmod(0o640)
    readable = times_read(path)
    recovery = recover(path)
    assert times_read(path) == readable
    assert path.stat().st_mode & 0o777 == 0o640
    with open_log(path) as log:
        assert log.complete and log.verify() == []
        assert sum(info.messages for info in log.topics.values()) == recovery.messages
    with path.open("rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == recovery.messages
    torn = recovery.torn.read_bytes() if recovery.torn else b""
    assert len(torn) == recovery.torn_bytes and whole[:cut].endswith(torn)
    assert recover(path).damage == ()


def test_repair_keeps_what_lies_on_both_sides_of_damage(tmp_path: Path, whole: bytes) -> None:
    chunks = spans_of(whole, Opcode.CHUNK)
    damaged = bytearray(whole)
    damaged[chunks[1].end - 100] ^= 1
    path = tmp_path / "a.mcap"
    path.write_bytes(damaged)
    recovery = recover(path)
    assert recovery.messages == sum(messages_in(whole, chunk) for chunk in chunks if chunk != chunks[1])
    assert recovery.torn == tmp_path / "a.mcap.torn"
    assert damaged[chunks[1].offset : chunks[1].end] in recovery.torn.read_bytes()
    log = open_log(path)
    assert log.attachment("vehicle.toml") and log.metadata["flight"]["seed"] == "7" and not log.verify()


def test_an_earlier_torn_tail_is_not_overwritten(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "a.mcap"
    (tmp_path / "a.mcap.torn").write_bytes(b"precious")
    path.write_bytes(whole[: spans_of(whole, Opcode.CHUNK)[1].end - 7])
    assert recover(path).torn == tmp_path / "a.mcap-2.torn"
    assert (tmp_path / "a.mcap.torn").read_bytes() == b"precious"


def test_a_log_that_is_being_recorded_is_not_repaired(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS) as recorder:
        for topic, message in flight(0.5, ALL_TOPICS):
            recorder.record(topic, message)
        recorder.flush()
        with pytest.raises(InputError, match="being recorded"):
            recover(recorder.path)
    assert open_log(recorder.path).complete


def test_what_is_no_log_is_not_touched_by_repair(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("precious")
    with pytest.raises(InputError, match="not an MCAP log"):
        recover(path)
    assert path.read_text() == "precious" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(InputError, match="cannot repair"):
        recover(tmp_path / "missing.mcap")


def test_a_repair_leaves_no_lock_behind(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(whole[:-30])
    recover(path)
    with path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_behind_a_link_the_file_itself_is_repaired(tmp_path: Path, whole: bytes) -> None:
    (tmp_path / "far").mkdir()
    target, link = tmp_path / "far" / "a.mcap", tmp_path / "a.mcap"
    target.write_bytes(whole[: len(whole) // 2])
    link.symlink_to(target)
    done = recover(link)
    assert link.is_symlink() and open_log(target).complete and open_log(target).verify() == []
    assert done.messages > 0 and done.torn == target.with_name("a.mcap.torn")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "far"]


def test_altered_metadata_of_a_file_that_was_cut_off_are_left_out_and_told(tmp_path: Path, whole: bytes) -> None:
    torn = whole[: len(whole) * 3 // 4]
    place = torn.index(str(EPOCH_NS).encode())
    path = tmp_path / "a.mcap"
    path.write_bytes(torn)
    with open_log(path) as log:
        assert log.boot_ns == EPOCH_NS and "flight" in log.metadata
        assert not any("metadata" in line for line in log.damage)
    with open_log(altered(path, torn, place + 2)) as log:
        assert log.boot_ns == log.start_ns and "flight" in log.metadata
        assert any("metadata" in line and "checksum" in line for line in log.damage)
