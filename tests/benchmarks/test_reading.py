"""Reading a log of another program: a ROS 2 file of IMU samples, ours beside `rosbags` (``make bench``)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rows import Row, leave, peer

from logs.reader import open_log

COUNT = 100_000
TOPIC = "/imu"
IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def sample(n: int) -> dict[str, object]:
    zeros = [0.0] * 9
    return {
        "header": {"stamp": {"sec": n // 200, "nanosec": n % 200 * 5_000_000}, "frame_id": "imu"},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        "orientation_covariance": zeros,
        "angular_velocity": {"x": 0.001 * n, "y": 0.2, "z": 0.3},
        "angular_velocity_covariance": zeros,
        "linear_acceleration": {"x": 0.1, "y": 0.2, "z": 9.8},
        "linear_acceleration_covariance": zeros,
    }


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    ros2 = pytest.importorskip("mcap_ros2.writer", reason="mcap-ros2-support is not installed")
    path: Path = tmp_path_factory.mktemp("ros2") / "imu.mcap"
    with path.open("wb") as file:
        writer = ros2.Writer(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for n in range(COUNT):
            writer.write_message(TOPIC, schema, sample(n), n * 5_000_000, n * 5_000_000)
        writer.finish()
    return path


def least(run: Callable[[], object], rounds: int) -> float:
    """s; of the processor."""
    spent = []
    for _ in range(rounds):
        begun = time.process_time()
        run()
        spent.append(time.process_time() - begun)
    return min(spent)


def with_rosbags(path: Path) -> np.ndarray:
    """Time, rates and accelerations (n, 7); every message is decoded whole."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    out = np.zeros((COUNT, 7))
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for n, (connection, stamp, data) in enumerate(reader.messages()):
            message = reader.deserialize(data, connection.msgtype)
            rate, force = message.angular_velocity, message.linear_acceleration
            out[n] = (stamp, rate.x, rate.y, rate.z, force.x, force.y, force.z)
    return out


@pytest.mark.bench
def test_reading_ros2_beside_rosbags(recorded: Path) -> None:
    """GIVEN the same numbers from both THEN the times count; ours makes columns of all fields, covariances too."""
    pytest.importorskip("rosbags", reason="the package rosbags is not installed (extra `bench`)")
    table, theirs = open_log(recorded).tables()[TOPIC], with_rosbags(recorded)
    for column, name in enumerate(("x", "y", "z")):
        np.testing.assert_array_equal(table[f"angular_velocity.{name}"], theirs[:, 1 + column])
        np.testing.assert_array_equal(table[f"linear_acceleration.{name}"], theirs[:, 4 + column])
    mine, other = least(lambda: open_log(recorded).tables(), 2), least(lambda: with_rosbags(recorded), 2)
    what = "reading 100,000 ROS 2 Imu (CDR) to columns"
    leave(Row(what, COUNT / mine / 1e3, COUNT / other / 1e3, "1000 messages/s", peer("rosbags")))
