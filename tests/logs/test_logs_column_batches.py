"""Columns are the same however many chunks are unpacked at a time, and on however many threads."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import Writer
from recorded import EPOCH_NS, FIXED_TOPICS, flight, record

from avionics import messages as m
from avionics import topics
from logs import column_batches
from logs.index import read_index
from logs.layout import layout_of
from logs.listing import Places
from logs.reader import Log, open_log
from logs.records import records
from logs.schema import descriptor_set
from wingbeat.errors import InputError


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("sample") / "a.mcap", flight(4.0))


def same(one: Log, other: Log, **window: float) -> None:
    tables = other.tables(FIXED_TOPICS, **window)
    for name, columns in one.tables(FIXED_TOPICS, **window).items():
        assert np.array_equal(columns.log_time_ns, tables[name].log_time_ns)
        for field in columns:
            assert np.array_equal(columns[field], tables[name][field]), (name, field)


@pytest.mark.parametrize("window", [{}, {"start": 1.003, "end": 3.002}, {"start": 3.999}, {"start": 9.0}], ids=str)
@pytest.mark.parametrize("size", [1, 200_000])
def test_batches_of_any_size_give_the_same(
    path: Path, size: int, window: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a file whose chunks fit into one batch WHEN they are read as many THEN no value differs."""
    with open_log(path) as log, open_log(path) as whole:
        expected = whole.tables(FIXED_TOPICS, **window)
        monkeypatch.setattr(column_batches, "BATCH_BYTES", size)
        same(log, whole, **window)
        for topic in FIXED_TOPICS:
            times = expected[topic.name].time
            assert np.all((times >= window.get("start", 0.0)) & (times < window.get("end", 9.0)))


def test_damage_in_any_batch_is_one_line(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN two damaged chunks WHEN they are unpacked on several threads THEN the first of them is named."""
    data = bytearray(path.read_bytes())
    chunks = [span for span in records(bytes(data), 8, len(data)) if span.opcode == Opcode.CHUNK]
    for chunk in chunks[2], chunks[-1]:
        data[chunk.end - 100] ^= 0xFF
    damaged = tmp_path / "a.mcap"
    damaged.write_bytes(data)
    monkeypatch.setattr(column_batches, "BATCH_BYTES", 1)
    with open_log(damaged) as log, pytest.raises(InputError, match=f"chunk at byte {chunks[2].offset} "):
        log.tables()


def test_on_one_core_no_thread_is_begun(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(column_batches, "BATCH_BYTES", 1)
    with open_log(path) as log, open_log(path) as other:
        expected = other.columns(topics.IMU)
        monkeypatch.setattr(column_batches, "available_cores", lambda: 1)
        monkeypatch.setattr(column_batches, "ThreadPoolExecutor", None)
        assert np.array_equal(log.columns(topics.IMU)["accel_x"], expected["accel_x"])


@pytest.mark.parametrize("time_s", [0.5, 1.5])
def test_an_altered_time_in_a_message_index_leaves_nothing_out_of_a_window(
    path: Path, tmp_path: Path, time_s: float
) -> None:
    """GIVEN an index that puts a message out of the window, or into it, WHEN it is read THEN its own time counts."""
    data = bytearray(path.read_bytes())
    with open_log(path) as log:
        expected = log.columns(topics.IMU, 1.0, 2.0)["time_us"].tolist()
    channel = topics.IMU.channel
    for chunk in read_index(bytes(data)).chunks:
        span = chunk.indexes[channel] + 15
        time = EPOCH_NS + round(time_s * 1e9)
        if abs(struct.unpack_from("<Q", data, span)[0] - EPOCH_NS - 1e9) < 5e8:
            struct.pack_into("<Q", data, span, time)
    altered = tmp_path / "a.mcap"
    altered.write_bytes(data)
    with open_log(altered) as log:
        assert log.columns(topics.IMU, 1.0, 2.0)["time_us"].tolist() == expected


def test_a_listing_is_the_same_one_by_one(path: Path) -> None:
    """GIVEN one index that names another channel THEN the others are still read, and the one as it is."""
    data = bytearray(path.read_bytes())
    chunks = read_index(bytes(data)).chunks
    channel = topics.IMU.channel
    places = Places(chunks)
    whole = places.listing(bytes(data), channel)
    data[chunks[1].indexes[channel] + 9] ^= 0x40
    altered = places.listing(bytes(data), channel)
    assert whole is not None and altered is not None
    assert len(whole.times) == 800
    assert all(np.array_equal(one, other) for one, other in zip(whole, altered, strict=True))
    data[chunks[1].indexes[channel] + 11] ^= 0x01
    assert places.listing(bytes(data), channel) is None


def test_an_index_that_names_a_message_twice_is_not_believed(path: Path, tmp_path: Path) -> None:
    """GIVEN an entry that repeats the one before it WHEN columns are read THEN each message is there once."""
    data = bytearray(path.read_bytes())
    channel = topics.IMU.channel
    chunks = read_index(bytes(data)).chunks
    entry = chunks[1].indexes[channel] + 15
    data[entry + 16 : entry + 32] = data[entry : entry + 16]
    assert Places(chunks).listing(bytes(data), channel) is None
    altered = tmp_path / "a.mcap"
    altered.write_bytes(data)
    with open_log(altered) as log, open_log(path) as whole:
        assert np.array_equal(log.columns(topics.IMU)["time_us"], whole.columns(topics.IMU)["time_us"])


def test_a_topic_on_two_channels_is_one_table(tmp_path: Path) -> None:
    """GIVEN a writer that changed the channel from message to message THEN the table has all of them in turn."""
    layout = layout_of(m.DriveTorque)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        channels = [writer.register_channel("/both", "protobuf", schema) for _ in range(2)]
        for n in range(40):
            writer.add_message(channels[n % 2], n, layout.encode(m.DriveTorque(n, 0.5 * n, 0.0)), n)
        writer.finish()
    with open_log(path) as log:
        columns = log.columns("/both")
    assert columns["time_us"].tolist() == list(range(40))
    assert columns["left"].tolist() == [0.5 * n for n in range(40)]


def test_whole_numbers_beyond_int64_stay_what_they_are(tmp_path: Path) -> None:
    layout = layout_of(m.DriveTorque)
    path = tmp_path / "a.mcap"
    times = [2**63 + 5, 3, 2**64 - 1]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        channel = writer.register_channel("/torque", "protobuf", schema)
        for n, time_us in enumerate(times):
            writer.add_message(channel, n, layout.encode(m.DriveTorque(time_us, 0.0, 0.0)), n)
        writer.finish()
    assert open_log(path).columns("/torque")["time_us"].tolist() == times
