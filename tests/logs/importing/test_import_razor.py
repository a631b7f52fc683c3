"""Captures of a Razor's serial line: frames in the firmware's raster, damaged ones told."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import imported

from avionics import topics
from logs.importing.log_import import IMPORT
from logs.reader import open_log
from wingbeat.errors import InputError

LEVEL = ((0.0, 0.0, 256.0), (40.0, 0.0, 90.0), (10.0, 20.0, -30.0))
"""accelerometer, magnetometer, gyroscope in counts"""


def text_frame(number: int) -> bytes:
    """#osct of a sensor that lies level and turns faster from frame to frame."""
    accel, field, gyro = LEVEL
    rows = (("A-C", accel), ("M-C", field), ("G-C", (gyro[0] + number, *gyro[1:])))
    return b"".join(f"#{name}={','.join(f'{v:.2f}' for v in values)}\r\n".encode() for name, values in rows)


def binary_frame() -> bytes:
    return struct.pack("<9f", *(value for row in LEVEL for value in row))


def captured(folder: Path, data: bytes) -> Path:
    path = folder / "bench.razor"
    path.write_bytes(data)
    return path


def test_a_capture_of_text_is_an_imu_in_si_and_frd(tmp_path: Path) -> None:
    source = captured(tmp_path, b"1.00,2.00\r\n" + b"".join(text_frame(n) for n in range(100)))
    out, report = imported(source, tmp_path)
    assert report.format == "Razor 9DOF serial capture" and report.dropped == ()
    with open_log(out) as log:
        imu = log.columns(topics.IMU)
        assert imu["accel_z"] == pytest.approx(-9.80665) and imu["mag_x"] == pytest.approx(0.2)
        assert imu["gyro_x"] == pytest.approx(math.radians(0.06957) * (10 + np.arange(100)))
        assert set(np.diff(imu["time_us"])) == {20_000} and log.topics["/sensors/imu"].rate == 50.0
        assert log.metadata[IMPORT]["clock"].endswith("20 ms")


def test_a_damaged_frame_keeps_its_place_in_time(tmp_path: Path) -> None:
    frames = [text_frame(n) for n in range(10)]
    frames[4] = frames[4].replace(b"M-C=4", b"M-C=\x00")
    out, report = imported(captured(tmp_path, b"".join(frames)), tmp_path)
    assert report.damage and "damaged" in report.damage[0]
    with open_log(out) as log:
        imu = log.columns(topics.IMU)
        turned = np.round(imu["gyro_x"] / math.radians(0.06957) - 10).astype(int)
        assert turned.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
        assert np.diff(imu["time_us"]).tolist() == [20_000] * 3 + [40_000] + [20_000] * 4


def test_a_binary_capture_is_believed_between_its_tokens(tmp_path: Path) -> None:
    token = b"#SYNCH%02d\r\n"
    whole, torn = binary_frame() * 5, binary_frame() * 4 + binary_frame()[:-1]
    data = b"junk" + token % 1 + whole + token % 2 + torn + token % 3 + whole + token % 4 + binary_frame()
    out, report = imported(captured(tmp_path, data), tmp_path)
    assert len(report.damage) == 2 and report.damage[1].startswith("36 bytes at the end")
    with open_log(out) as log:
        imu = log.columns(topics.IMU)
        assert len(imu.time) == 10 and imu["accel_z"] == pytest.approx(-9.80665)
        assert imu["time_us"][-1] == 14 * 20_000


def test_own_angles_are_an_attitude(tmp_path: Path) -> None:
    lines = b"".join(b"#YPR=%.2f,-5.00,10.00\r\n" % (170.0 + n) for n in range(20))
    out, _ = imported(captured(tmp_path, lines), tmp_path)
    with open_log(out) as log:
        attitude = log.columns(topics.ATTITUDE)
        assert attitude["pitch"] == pytest.approx(math.radians(-5.0))
        assert attitude["yaw"][-1] == pytest.approx(math.radians(189.0 - 360.0))
        assert topics.IMU.name not in log.topics


def test_a_binary_capture_without_tokens_says_what_is_missing(tmp_path: Path) -> None:
    source = captured(tmp_path, b"#SYNCH01\r\n" + binary_frame() * 5)
    with pytest.raises(InputError, match="between two synch tokens"):
        imported(source, tmp_path)
    assert list(tmp_path.iterdir()) == [source]
