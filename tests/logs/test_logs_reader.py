"""Columns equal what was recorded, in files of ours and of others."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as Ros2Writer
from recorded import ALL_TOPICS, EPOCH_NS, FIXED_TOPICS, flight, record

from avionics import messages as m
from avionics import topics
from logs.columns import Columns
from logs.index import read_index
from logs.layout import Field, Layout, layout_of
from logs.log_file import TEXT_SCHEMA
from logs.reader import open_log
from logs.schema import descriptor_set, layout_from_schema
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.topic import Topic


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[tuple[Any, Any]]]:
    messages = flight(3.0)
    return record(tmp_path_factory.mktemp("sample") / "a.mcap", messages), messages


@pytest.mark.parametrize("topic", FIXED_TOPICS, ids=lambda topic: topic.name)
def test_columns_equal_what_was_recorded(sample: tuple[Path, list[Any]], topic: Topic) -> None:
    path, messages = sample
    columns = open_log(path).columns(topic)
    recorded = [message for t, message in messages if t is topic]
    assert list(columns) == list(topic.message._fields)
    for name in columns:
        assert columns[name].tolist() == [
            list(value) if isinstance(value, tuple) else value
            for value in (getattr(message, name) for message in recorded)
        ]
    assert columns.units["time_us"] == "us"
    assert columns.log_time_ns.tolist() == [EPOCH_NS + message.time_us * 1000 for message in recorded]
    assert np.array_equal(columns.time, columns["time_us"] * 1e-6)


def test_whole_numbers_do_not_wrap(sample: tuple[Path, list[Any]]) -> None:
    columns = open_log(sample[0]).columns(topics.ENCODER)
    assert {values.dtype for values in columns.values()} == {np.dtype(np.int64)}


def test_topics_tell_what_they_are(sample: tuple[Path, list[Any]]) -> None:
    path, messages = sample
    log = open_log(path)
    assert list(log.topics) == [topic.name for topic in sorted(ALL_TOPICS, key=lambda topic: topic.channel)]
    for topic in ALL_TOPICS:
        info = log.topics[topic.name]
        assert (info.channel, info.rate, info.deterministic) == (topic.channel, topic.rate, topic.deterministic)
        assert info.messages == sum(t is topic for t, _ in messages)
    layout = log.topics[truth_topics.WING.name].layout
    assert layout is not None and layout.fields[8].unit == "N m"


def test_events_texts_attachments_metadata_and_duration(sample: tuple[Path, list[Any]]) -> None:
    path, messages = sample
    log = open_log(path)
    events = [message for topic, message in messages if topic.message is Event]
    assert log.events() == sorted(events, key=lambda event: event.time_us)
    assert log.texts(topics.INPUTS) == [message for topic, message in messages if topic is topics.INPUTS]
    assert log.attachment("vehicle.toml") == b"name = 'raven'\n"
    assert log.metadata["flight"] == {"vehicle": "robo_raven_ii_d", "seed": "7"}
    assert log.boot_ns == EPOCH_NS
    assert log.duration == pytest.approx(3.0 - 0.005)
    assert log.verify() == [] and log.complete and log.damage == ()


@settings(max_examples=40, deadline=None)
@given(start=st.floats(-1.0, 4.0), end=st.floats(-1.0, 4.0))
def test_time_slices(sample: tuple[Path, list[Any]], start: float, end: float) -> None:
    path, messages = sample
    times = open_log(path).columns(topics.ATTITUDE, start, end)["time_us"].tolist()
    low, high = round(start * 1e9), round(end * 1e9)
    assert times == [msg.time_us for t, msg in messages if t is topics.ATTITUDE and low <= msg.time_us * 1000 < high]


def test_several_topics_in_one_pass(sample: tuple[Path, list[Any]]) -> None:
    log = open_log(sample[0])
    tables = log.tables([topics.IMU, "/main/wing", topics.IMU])
    assert list(tables) == ["/sensors/imu", "/main/wing"]
    assert np.array_equal(tables["/main/wing"]["phase"], log.columns(topics.WING)["phase"])
    assert set(log.tables()) == set(log.topics)


def test_an_unknown_topic_names_the_known_ones(sample: tuple[Path, list[Any]]) -> None:
    log = open_log(sample[0])
    with pytest.raises(InputError, match=r"no topic /nowhere; it has: /sensors/imu, "):
        log.columns("/nowhere")
    with pytest.raises(InputError, match="no texts"):
        log.texts(topics.IMU)
    with pytest.raises(InputError, match=r"no attachment x; it has: vehicle\.toml"):
        log.attachment("x")


def test_messages_out_of_order_are_sorted_by_log_time(tmp_path: Path) -> None:
    times = [5, 3, 400_000, 200_000, 1_000_000, 900_000]
    path = record(tmp_path / "a.mcap", [(topics.DRIVE_TORQUE, m.DriveTorque(t, t * 1.0, 0.0)) for t in times])
    columns = open_log(path).columns(topics.DRIVE_TORQUE)
    assert columns["left"].tolist() == sorted(times)


def test_a_log_without_messages(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", []))
    assert (log.topics, log.duration, log.events(), log.tables()) == ({}, 0.0, [], {})


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"PK\x03\x04 not a log", b"\x00" * 5000])
def test_what_is_not_a_log_is_bad_input(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError) as raised:
        open_log(path)
    assert str(path) in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize("place", ["missing.mcap", "."])
def test_what_cannot_be_read_is_bad_input(tmp_path: Path, place: str) -> None:
    with pytest.raises(InputError, match="cannot read"):
        open_log(tmp_path / place)


# --- files of other writers -----------------------------------------------------------------------------


def foreign(path: Path, **options: Any) -> Path:
    """A file by the `mcap` package's writer: our torque topic without metadata, JSON, a nested message."""
    layout = layout_of(m.DriveTorque)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=500, **options)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        torque = writer.register_channel("/torque", "protobuf", schema)
        text = writer.register_channel("/json", "json", writer.register_schema("Any", "jsonschema", b"{}"))
        files = build_file_descriptor_set(LocationFix).SerializeToString()
        fixes = writer.register_channel(
            "/fix", "protobuf", writer.register_schema("foxglove.LocationFix", "protobuf", files)
        )
        blob = writer.register_channel("/blob", "cdr", 0)
        for n in range(60):
            time = n * 10**7
            writer.add_message(torque, time, layout.encode(m.DriveTorque(n * 10**4, n * 0.5, -1.0)), time)
            writer.add_message(text, time, json.dumps({"a": n, "b": {"c": [n]}, "d": "x" * n}).encode(), time)
            fix = LocationFix(latitude=n, velocity={"x": n}, position_covariance=[n] * 9)
            writer.add_message(fixes, time, fix.SerializeToString(), time)
            writer.add_message(blob, time, b"?", time)
        writer.finish()
    return path


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"use_statistics": False},
        {"repeat_channels": False},
        {"enable_crcs": False},
    ],
    ids=str,
)
def test_files_of_another_writer(tmp_path: Path, options: dict[str, Any]) -> None:
    log = open_log(foreign(tmp_path / "a.mcap", **options))
    torque = log.columns("/torque")
    assert torque["left"].tolist() == [n * 0.5 for n in range(60)]
    assert torque.units["left"] == "N m"
    text = log.columns("/json")
    assert text["a"].tolist() == list(range(60)) and text["d"][3] == "xxx" and text["b.c"][5].tolist() == [5]
    fix = log.columns("/fix", 0.1, 0.2)
    assert fix["velocity.x"].tolist() == fix["latitude"].tolist() == list(range(10, 20))
    assert fix["position_covariance"].shape == (10, 9)
    assert log.topics["/torque"].messages == 60
    with pytest.raises(InputError, match="/blob is encoded as cdr"):
        log.columns("/blob")


def test_a_message_that_lacks_a_field_is_decoded_one_by_one(tmp_path: Path) -> None:
    layout = layout_of(m.DriveTorque)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        channel = writer.register_channel("/torque", "protobuf", schema)
        whole = layout.encode(m.DriveTorque(7, 1.5, 2.5))
        for time, data in enumerate((whole, whole[:18], whole[9:] + whole[:9])):
            writer.add_message(channel, time, data, time)
        writer.finish()
    columns = open_log(path).columns("/torque")
    assert columns["left"].tolist() == [1.5, 1.5, 1.5]
    assert columns["right"].tolist() == [2.5, 0.0, 2.5]
    assert columns["time_us"].tolist() == [7, 7, 7]
    assert columns.units["right"] == "N m"


def test_numbers_that_some_messages_of_json_lack(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    documents = [
        {"x": 1, "on": True, "id": 2**60, "none": None},
        {"x": None, "y": 0.5, "none": None},
        {"on": False, "id": 3, "text": "a", "none": None},
    ]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/json", "json", 0)
        for time, document in enumerate(documents):
            writer.add_message(channel, time, json.dumps(document).encode(), time)
        writer.finish()
    columns = open_log(path).columns("/json")
    assert columns["x"].tolist() == pytest.approx([1.0, np.nan, np.nan], nan_ok=True)
    assert columns["y"].tolist() == pytest.approx([np.nan, 0.5, np.nan], nan_ok=True)
    assert columns["on"].tolist() == [True, None, False] and columns["id"].tolist() == [2**60, None, 3]
    assert columns["text"].tolist() == [None, None, "a"]


# --- ROS 2 ----------------------------------------------------------------------------------------------

ODOMETRY = """\
builtin_interfaces/Time stamp
string frame
bool good
float64[3] position
float32[] ranges
uint8[] picture
geometry_msgs/Quaternion orientation
geometry_msgs/Vector3[] points
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def ros2(path: Path, **options: Any) -> Path:
    """A file by the writer of the mcap-ros2-support package."""
    with path.open("wb") as file, Ros2Writer(file, chunk_size=500, **options) as writer:
        schema = writer.register_msgdef("nav_msgs/msg/Odometry", ODOMETRY)
        for n in range(30):
            message = {
                "stamp": {"sec": -1, "nanosec": n},
                "frame": f"bird{n}",
                "good": n % 2 == 0,
                "position": [n, n + 0.5, -n],
                "ranges": [0.25 * n] * (n % 3),
                "picture": bytes([n, 255]),
                "orientation": {"w": 0.5, "x": n * 0.1},
                "points": [{"x": n, "y": 1.5}],
            }
            writer.write_message("/odometry", schema, message, log_time=n * 10**8, sequence=n)
    return path


@pytest.mark.parametrize("compression", list(CompressionType), ids=lambda one: one.name)
def test_messages_of_ros_2(tmp_path: Path, compression: CompressionType) -> None:
    log = open_log(ros2(tmp_path / "a.mcap", compression=compression))
    columns = log.columns("/odometry")
    assert (log.topics["/odometry"].encoding, log.topics["/odometry"].messages) == ("cdr", 30)
    assert columns["stamp.nanosec"].tolist() == list(range(30)) and set(columns["stamp.sec"]) == {-1}
    assert columns["frame"][7] == "bird7" and columns["good"].tolist()[:3] == [True, False, True]
    assert columns["position"].shape == (30, 3) and columns["position"][4].tolist() == [4.0, 4.5, -4.0]
    assert columns["picture"].tolist()[3] == [3, 255]
    assert columns["ranges"].dtype == object and columns["ranges"][2] == [0.5, 0.5]
    assert columns["orientation.x"] == pytest.approx(0.1 * np.arange(30)) and set(columns["orientation.w"]) == {0.5}
    assert columns["points"][9] == [{"x": 9.0, "y": 1.5, "z": 0.0}]
    assert columns.time == pytest.approx(0.1 * np.arange(30))
    table = log.aligned(["/odometry.orientation.w", "/odometry.orientation.x"], rate=100.0)
    assert np.all(table["/odometry.orientation.w"] ** 2 + table["/odometry.orientation.x"] ** 2 <= 1.0 + 1e-12)


def test_a_message_of_ros_2_that_is_too_short_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schemas = [
            writer.register_schema(name, "ros2msg", text) for name, text in (("a/A", b"int64 x"), ("b/B", b"?"))
        ]
        whole, wrong = (writer.register_channel(f"/{n}", "cdr", schema) for n, schema in enumerate(schemas))
        writer.add_message(whole, 1, b"\x00\x01\x00\x00" + b"\x07" * 4, 1)
        writer.add_message(wrong, 1, b"\x00\x01\x00\x00", 1)
        writer.finish()
    log = open_log(path)
    with pytest.raises(InputError, match="a message of /0 cannot be read"):
        log.columns("/0")
    with pytest.raises(InputError, match="schema b/B cannot be read"):
        log.columns("/1")


def test_without_its_package_ros_2_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = open_log(ros2(tmp_path / "a.mcap"))
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    with pytest.raises(
        InputError, match=r"needs mcap-ros2-support, which is not installed: \S+ -m pip install"
    ) as raised:
        log.columns("/odometry")
    assert "\n" not in str(raised.value)


def test_times_come_from_the_message_indexes_alone(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", flight(2.0))
    log = open_log(path)
    for topic in FIXED_TOPICS:
        assert log.times(topic) == pytest.approx(log.columns(topic).time, abs=1e-9)
    with pytest.raises(InputError, match="has no topic /nothing"):
        log.times("/nothing")


def test_a_damaged_message_index_gives_no_wrong_times(tmp_path: Path) -> None:
    """GIVEN indexes whose channel was flipped THEN the chunks are walked through instead."""
    path = record(tmp_path / "a.mcap", flight(2.0, (topics.IMU, topics.HEALTH)))
    whole = open_log(path).times(topics.IMU)
    data = bytearray(path.read_bytes())
    spans = [chunk.indexes[topics.IMU.channel] for chunk in read_index(bytes(data)).chunks]
    for offset in spans:
        data[offset + 9] ^= 0x40
    path.write_bytes(data)
    assert open_log(path).times(topics.IMU).tolist() == whole.tolist()


def test_the_order_of_writing_is_told_whatever_the_times(tmp_path: Path) -> None:
    """GIVEN a clock that ran back by a second WHEN the order is asked for THEN it is that of the recorder."""
    times = [*range(0, 2_000_000, 50_000), *range(1_000_000, 3_000_000, 50_000)]
    written: list[Any] = []
    for i, time_us in enumerate(times):
        written.append((topics.HEALTH, m.Health(time_us, 0, 0, i)))
        written.append((topics.EVENTS, Event(time_us, Severity.INFO, "x", str(i))))
    path = record(tmp_path / "a.mcap", written)
    log = open_log(path)
    kinds, rows = log.order([topics.HEALTH, topics.EVENTS])
    assert kinds.tolist() == [0, 1] * len(times)
    ticks, said = log.columns(topics.HEALTH)["ticks"], log.events()
    assert ticks[rows[kinds == 0]].tolist() == list(range(len(times)))
    assert [int(said[row].text) for row in rows[kinds == 1]] == list(range(len(times)))


@pytest.mark.parametrize(
    "metadata",
    [
        {"lengths": '{"data": "var"}'},
        {"lengths": '{"data": null}'},
        {"lengths": '{"data": -3}'},
        {"lengths": '{"data": 100000000000}'},
        {"lengths": '{"data": 3.5}'},
        {"lengths": '{"data": true}'},
        {"lengths": "[" * 100_000},
        {"labels": '{"data": ["a"], "time_us": ["a"]}'},
        {"labels": '{"time_us": {"one": "a"}}'},
        {"labels": '{"time_us": {"1": ["a"]}}'},
    ],
)
def test_what_another_writer_means_by_metadata_of_our_names_is_passed_over(
    tmp_path: Path, metadata: dict[str, str]
) -> None:
    """GIVEN our layout of a message with an array and metadata of our names THEN they are read all the same."""
    fields = (Field("time_us", 1, "fixed64"), Field("data", 2, "double", 3))
    layout = Layout("other.Array", "", fields)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(layout.name, "protobuf", descriptor_set(layout))
        channel = writer.register_channel("/array", "protobuf", schema, metadata)
        for n in range(5):
            writer.add_message(channel, n, layout.encode((n, (n, 0.5, -1.0))), n)
        writer.finish()
    found = open_log(path).columns("/array")
    assert found["data"].tolist() == [[n, 0.5, -1.0] for n in range(5)]
    assert found["time_us"].tolist() == list(range(5)) and found.labels == {}


def test_a_schema_whose_fields_cannot_be_columns_is_not_believed() -> None:
    for fields in (
        (Field("a", 1, "double"), Field("a", 2, "double")),
        (Field("a", -1, "double"),),
        (Field("", 1, "double"),),
    ):
        assert layout_from_schema("x.Y", descriptor_set(Layout("x.Y", "", fields)), {}) is None


def test_json_that_is_nested_too_deeply_is_one_line(tmp_path: Path) -> None:
    depth = 100_000
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        text = writer.register_schema(TEXT_SCHEMA, "jsonschema", b"{}")
        for topic, schema in (("/json", 0), ("/text", text)):
            writer.add_message(
                writer.register_channel(topic, "json", schema), 0, b'{"a":' * depth + b"1" + b"}" * depth, 0
            )
        writer.finish()
    log = open_log(path)
    with pytest.raises(InputError, match="a JSON message cannot be read") as raised:
        log.columns("/json")
    assert "\n" not in str(raised.value)
    with pytest.raises(InputError, match="a text message cannot be read"):
        log.texts("/text")


def test_a_log_time_beyond_what_can_be_is_one_line(tmp_path: Path) -> None:
    """Loose messages are under no checksum: one flip may make a log time of the year 2500."""
    path = foreign(tmp_path / "a.mcap", use_chunking=False, index_types=IndexType.NONE)
    data = path.read_bytes()
    times = (10**7).to_bytes(8, "little") * 2
    altered = data.replace(times, times[:7] + b"\xff" + times[8:])
    assert altered != data
    path.write_bytes(altered)
    log = open_log(path)
    for topic in ("/torque", "/json"):
        for read in (log.columns, log.times):
            with pytest.raises(InputError, match="a log time of /") as raised:
                read(topic)
            assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("start", "end"), [(1e300, None), (-1e300, 1e300), (-math.inf, math.inf), (0.0, 1e12)])
def test_any_number_is_a_time(sample: tuple[Path, list[Any]], start: float | None, end: float | None) -> None:
    log = open_log(sample[0])
    whole = 0 if start == 1e300 else len(log.columns(topics.IMU).time)
    assert len(log.columns(topics.IMU, start, end).time) == whole
    assert len(log.columns(topics.EVENTS, start, end).time) == (
        0 if start == 1e300 else len(log.events(topics.EVENTS))
    )


def test_no_number_is_no_time(sample: tuple[Path, list[Any]]) -> None:
    with pytest.raises(InputError, match="nan s is no time"):
        open_log(sample[0]).columns(topics.IMU, math.nan)


@pytest.mark.parametrize("recorded", ["begun", "calibration_count"])
def test_renamed_field_is_read_by_both_names(recorded: str) -> None:
    counts = np.array([1, 2])
    columns = Columns(topics.CALIBRATION.name, {recorded: counts}, {}, np.zeros(2, np.int64), 0)
    assert columns["begun"] is counts and columns["calibration_count"] is counts
    assert "begun" in columns and list(columns) == [recorded]
    with pytest.raises(KeyError):
        Columns("/other", {recorded: counts}, {}, np.zeros(2, np.int64), 0)["start"]
