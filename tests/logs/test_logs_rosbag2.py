"""A rosbag2 export is read by `rosbags`, with the frames of REP 103."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import EPOCH_NS, flight, record
from test_logs_export import foreign

from avionics import topics
from logs.export import Part, export
from logs.reader import Log, open_log
from logs.rosbag2 import PACKAGE, member_names, message_text
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError
from wingbeat.topic import Topic

rosbags = pytest.importorskip("rosbags.highlevel", reason="rosbags is not installed (extra ros2)")


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """All messages by topic, with the definitions that the bag holds."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with rosbags.AnyReader([path]) as reader:
        for connection, time, data in reader.messages():
            found.setdefault(connection.topic, []).append((time, reader.deserialize(data, connection.msgtype)))
    return found


def message(topic: Topic[Any], **values: Any) -> tuple[Topic[Any], Any]:
    """A message with zeros in the other fields."""
    return topic, topic.message(*([0] * len(topic.message._fields)))._replace(**values)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Log:
    return open_log(record(tmp_path_factory.mktemp("bag") / "a.mcap", flight(0.5)))


@pytest.fixture(scope="module")
def bag(log: Log, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    folder = tmp_path_factory.mktemp("bag") / "bag"
    files = export(log, folder, form="rosbag2").files
    assert [file.name for file in files] == ["bag.mcap", "metadata.yaml"]
    return read(folder)


def test_rosbags_reads_every_message_of_every_topic(log: Log, bag: dict[str, list[tuple[int, Any]]]) -> None:
    """GIVEN random messages of every topic WHEN read back by rosbags THEN count, times and values are the same."""
    for name, info in log.topics.items():
        assert len(bag[name]) == info.messages, name
        columns = log.columns(name)
        assert [time for time, _ in bag[name]] == columns.log_time_ns.tolist()
        if info.layout is None:
            continue
        assert type(bag[name][0][1]).__msgtype__.startswith(f"{PACKAGE}/msg/")
        for field, member in zip(info.layout.fields, member_names(info.layout), strict=True):
            values = np.array([getattr(one, member) for _, one in bag[name]])
            assert np.array_equal(values, columns[field.name]), (name, field.name)


def test_standard_topics_have_the_types_of_ros(bag: dict[str, list[tuple[int, Any]]]) -> None:
    kinds = {
        "/imu/data": "sensor_msgs/msg/Imu", "/imu/mag": "sensor_msgs/msg/MagneticField",
        "/gps/fix": "sensor_msgs/msg/NavSatFix", "/pressure": "sensor_msgs/msg/FluidPressure",
        "/battery_state": "sensor_msgs/msg/BatteryState", "/odom": "nav_msgs/msg/Odometry",
        "/truth/odom": "nav_msgs/msg/Odometry", "/tf": "tf2_msgs/msg/TFMessage",
        "/system/events": "rcl_interfaces/msg/Log", "/system/inputs": "std_msgs/msg/String",
    }  # fmt: skip
    for topic, kind in kinds.items():
        assert type(bag[topic][0][1]).__msgtype__ == kind


def test_frames_are_enu_and_flu(tmp_path: Path) -> None:
    """GIVEN level flight to the north at 5 m/s, 2 m up, 3 m north and 1 m east, pitching up at 0.1 rad/s
    WHEN exported THEN position is (1, 3, 2), yaw 90 degrees, velocity (5, 0, 0), rate (0, -0.1, 0), force up.
    """
    at = {"time_us": 1_000_000}
    messages = [
        message(topics.IMU, **at, accel_z=-9.81, gyro_y=0.1, mag_x=0.2, mag_z=0.4),
        message(topics.GPS, **at, latitude=0.5, longitude=-1.0, altitude=30.0, horizontal_accuracy=2.0, fix_type=3),
        message(topics.ATTITUDE, **at, quaternion_w=1.0, pitch_rate=0.1),
        message(topics.POWER, **at, voltage=7.4, current=3.0, battery_remaining=0.5),
        message(topics.AIR_DATA, **at, static_pressure=101325.0),
        message(topics.ALTITUDE, **at, altitude=2.0, climb_rate=0.0, altitude_variance=0.25),
        message(topics.POSITION, **at, north=3.0, east=1.0, v_north=5.0, position_variance=4.0, valid=1),
        message(truth_topics.STATE, **at, north=3.0, east=1.0, down=-2.0, v_north=5.0, quaternion_w=1.0),
    ]
    export(open_log(record(tmp_path / "a.mcap", messages)), tmp_path / "bag", form="rosbag2")
    found = {topic: rows[0][1] for topic, rows in read(tmp_path / "bag").items()}
    for topic in ("/odom", "/truth/odom"):
        odometry = found[topic]
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        assert odometry.header.stamp.sec * 10**9 + odometry.header.stamp.nanosec == EPOCH_NS + 10**9
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        assert (place.x, place.y, place.z) == (1.0, 3.0, 2.0)
        assert (turn.w, turn.x, turn.y, turn.z) == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
        speed = odometry.twist.twist.linear
        assert (speed.x, speed.y, speed.z) == pytest.approx((5.0, 0.0, 0.0))
    rates = found["/odom"].twist.twist.angular
    assert (rates.x, rates.y, rates.z) == (0.0, -0.1, 0.0)
    assert found["/odom"].pose.covariance[[0, 7, 14]].tolist() == [4.0, 4.0, 0.25]
    imu = found["/imu/data"]
    assert imu.linear_acceleration.z == 9.81 and imu.angular_velocity.y == -0.1
    assert imu.orientation.z == pytest.approx(math.sqrt(0.5)) and imu.orientation_covariance[0] == 0.0
    assert found["/imu/mag"].magnetic_field.z == pytest.approx(-0.4e-4)
    fix = found["/gps/fix"]
    assert (fix.latitude, fix.longitude) == pytest.approx((math.degrees(0.5), math.degrees(-1.0)))
    assert fix.position_covariance[0] == 4.0 and fix.status.status == 0
    battery = found["/battery_state"]
    assert battery.current == -3.0 and battery.percentage == 0.5 and math.isnan(battery.temperature)
    assert found["/pressure"].fluid_pressure == 101325.0
    (transform,) = found["/tf"].transforms
    assert transform.child_frame_id == "base_link" and transform.transform.translation.y == 3.0


def test_imu_without_attitude_marks_the_orientation_unknown(tmp_path: Path) -> None:
    log = open_log(record(tmp_path / "a.mcap", [message(topics.IMU, time_us=1)]))
    export(log, tmp_path / "bag", form="rosbag2")
    assert read(tmp_path / "bag")["/imu/data"][0][1].orientation_covariance[0] == -1.0


def test_message_text_has_units_and_enumerations(log: Log) -> None:
    layout = log.topics["/guidance/navigation"].layout
    assert layout is not None
    text = message_text(layout)
    assert "uint32 MODE_AUTO=4\n" in text and "\nfloat64 distance  # m; " in text


def test_one_file_of_one_topic(log: Log, tmp_path: Path) -> None:
    part = Part(["/main/wing"], 0.1, 0.2)
    (file,) = export(log, tmp_path / "a.mcap", part, "rosbag2").files
    assert list(read(file)) == ["/main/wing"]
    assert len(read(file)["/main/wing"]) == len(log.columns("/main/wing", 0.1, 0.2).time)
    other = open_log(file).columns("/main/wing")
    assert np.array_equal(other["phase"], log.columns("/main/wing", 0.1, 0.2)["phase"])


def test_documents_of_other_writers_are_json(tmp_path: Path) -> None:
    done = export(foreign(tmp_path / "a.mcap"), tmp_path / "bag", form="rosbag2")
    assert json.loads(read(tmp_path / "bag")["/json"][4][1].data)["name"] == "n4"
    assert len(done.left_out) == 1 and "/blob" in done.left_out[0]


def test_bag_refusals_leave_no_files(log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="takes no rate"):
        export(log, tmp_path / "bag", Part(rate=10.0), "rosbag2")
    with pytest.raises(InputError, match="specify --format rosbag2"):
        export(log, tmp_path / "a.mcap")
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r"needs rosbags, which is not installed: \S+ -m pip install 'rosbags"):
        export(log, tmp_path / "bag", Part(["/main/wing"]), "rosbag2")
    assert list(tmp_path.iterdir()) == []
