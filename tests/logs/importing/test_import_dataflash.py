"""ArduPilot's logs: what they say, what is damaged in them, and the same rows as pymavlink's reader gives."""

from __future__ import annotations

import json
import math
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import SHARED, imported, needs_shared, new_dataflash
from pymavlink.DFReader import DFReader_binary

from avionics import topics
from logs.importing.dataflash import find_records, read_dataflash
from logs.importing.log_import import IMPORT, REPORT
from logs.reader import open_log
from wingbeat.errors import InputError


def test_an_imported_log_opens_like_a_flown_one(tmp_path: Path) -> None:
    log = new_dataflash()
    source = tmp_path / "00000012.BIN"
    source.write_bytes(log.data)
    out, report = imported(source, tmp_path)
    assert (report.dropped, report.damage) == ((), ())
    with open_log(out) as opened:
        assert opened.complete and opened.verify() == []
        imu, attitude, power = (opened.columns(t) for t in (topics.IMU, topics.ATTITUDE, topics.POWER))
        assert imu.time[0] == 1.0 and len(imu.time) == 200 and imu.units["gyro_y"] == "rad/s"
        assert imu["gyro_x"] == pytest.approx(0.01 * np.arange(200), abs=1e-6)
        assert np.isnan(imu["mag_x"]).all()
        assert attitude["pitch"] == pytest.approx(math.radians(-4.5))
        assert attitude["yaw"] == pytest.approx(math.radians(-90.0))
        assert attitude["quaternion_w"][0] == pytest.approx(math.cos(math.pi / 4) * math.cos(math.radians(2.25)))
        assert power["voltage"][0] == pytest.approx(7.4) and power["charge"][0] == pytest.approx(360.0)
        assert [event.text for event in opened.events()] == ["ArduPlane V4.5.7 (0a1b2c3d)", "mode 5"]
        assert opened.parameters.initial == {"Q_TILT_MAX": 45.0}
        noted = opened.metadata[IMPORT]
        assert noted["vehicle"].startswith("ArduPlane") and noted["source"] == "00000012.BIN"
        assert len(noted["sha256"]) == 64 and noted["dropped"] == "0"


def test_several_sensors_in_one_message_are_kept_apart(tmp_path: Path) -> None:
    source = tmp_path / "two.bin"
    source.write_bytes(new_dataflash().data)
    out, _ = imported(source, tmp_path)
    with open_log(out) as opened:
        first, second = opened.columns("/dataflash/IMU"), opened.columns("/dataflash/IMU_1")
        assert len(first.time) == len(second.time) == 200
        assert set(first["AccY"]) == {0.0} and set(second["AccY"]) == {1.0}
        assert set(opened.columns(topics.IMU)["accel_y"]) == {0.0}
        assert opened.columns("/dataflash/ATT").units["Roll"] == "deg"


def test_the_same_rows_as_pymavlink_reads(tmp_path: Path) -> None:
    path = tmp_path / "whole.bin"
    path.write_bytes(new_dataflash(1.0).data)
    ours = read_dataflash(path.read_bytes())[0].series
    reader = DFReader_binary(str(path))
    theirs: dict[str, list[dict[str, float]]] = {}
    while (message := reader.recv_msg()) is not None:
        theirs.setdefault(message.get_type(), []).append(message.to_dict())
    reader.close()
    for row, expected in enumerate(theirs["ATT"]):
        assert ours["ATT"].time_us[row] == expected["TimeUS"]
        assert all(
            ours["ATT"].columns[name][row] == pytest.approx(expected[name]) for name in ("Roll", "Pitch", "Yaw")
        )
    second = [row for row in theirs["IMU"] if row["I"] == 1]
    assert ours["IMU_1"].columns["GyrX"] == pytest.approx([row["GyrX"] for row in second])


def test_rows_of_garbage_are_dropped_and_told(tmp_path: Path) -> None:
    """GIVEN values that no aircraft has, as a damaged chip gives them WHEN imported THEN they are left out."""
    log = new_dataflash()
    log.write("ATT", 5_100_000, 0, 9500, 0)  # pitch 95 degrees
    log.write("IMU", 5_120_000, 0, 1e30, 0, 0, 0, 0, -9.8)
    log.write("IMU", 5_140_000, 0, 0, math.nan, 0, 0, 0, -9.8)
    log.write("ATT", 8 * 3_600_000_000, 0, 0, 0)
    log.write("BAT", 100, 7.4, 1.0, 1.0)
    source = tmp_path / "garbage.bin"
    source.write_bytes(log.data)
    out, report = imported(source, tmp_path)
    told = {(one.topic, one.reason, one.rows) for one in report.dropped}
    assert told == {
        ("/attitude/ahrs", "pitch out of range", 1),
        ("/dataflash/IMU", "GyrX out of range", 1),
        ("/sensors/imu", "gyro_y not finite", 1),
        ("/dataflash/ATT", "time far from the rest of the log", 1),
        ("/dataflash/BAT", "time runs backwards", 1),
    }
    with open_log(out) as opened:
        for name in ("/dataflash/ATT", "/attitude/ahrs"):
            assert len(opened.columns(name).time) == 40
        assert len(opened.columns("/dataflash/IMU").time) == len(opened.columns(topics.IMU).time) == 200
        kept = json.loads(opened.attachment(REPORT))
        assert {(one["topic"], one["reason"], one["rows"]) for one in kept["dropped"]} == told
        assert opened.metadata[IMPORT]["dropped"] == "5"


def test_bytes_between_records_are_told_and_the_records_around_them_kept() -> None:
    log = new_dataflash(1.0)
    at = log.records[-5]
    whole = find_records(log.data)
    torn = find_records(log.data[:at] + b"\x13\x37\xa3\x95\xff garbage" + log.data[at:])
    # The record in front of the garbage is not followed by another, so that it may be damaged itself.
    assert sum(map(len, torn.places.values())) == sum(map(len, whole.places.values())) - 1
    assert torn.damage[0].endswith("in 1 place outside of records")


def test_a_format_that_comes_twice_is_the_first(tmp_path: Path) -> None:
    """GIVEN a log behind whose beginning a damaged format renames one, and another repeats a name."""
    log = new_dataflash(1.0)
    number, packing = log.number("ATT"), "<BB4s16s64s"
    for kind, name in ((number, b"ATU"), (200, b"ATT")):
        log.data += b"\xa3\x95\x80" + struct.pack(packing, kind, 17, name, b"Qhhh", b"TimeUS,A,B,C")
    log.write("ATT", 2_000_000, 100, 200, 300)
    whole = read_dataflash(log.data)[0].series
    assert "ATU" not in whole and whole["ATT"].columns["Pitch"][-1] == 2.0


def test_records_without_a_time_have_that_of_the_one_before_them(tmp_path: Path) -> None:
    log = new_dataflash(1.0)
    log.define("PM", "HH", "NLon,MaxT")
    log.write("PM", 3, 4)
    series = read_dataflash(log.data)[0].series["PM"]
    assert series.time_us.tolist() == [1_980_000] and series.columns["MaxT"].tolist() == [4]


def test_a_file_cut_in_a_record_says_so_and_the_end_of_the_chip_is_no_damage() -> None:
    log = new_dataflash(1.0)
    cut = find_records(log.data[:-4])
    assert cut.damage and "cut off in the middle of a record" in cut.damage[0]
    assert find_records(log.data + b"\xff" * 5000).damage == ()


@pytest.mark.parametrize("seed", range(40))
def test_flipped_bits_and_cuts_give_what_can_be_true_or_one_line(seed: int, tmp_path: Path) -> None:
    source, data = random.Random(seed), bytearray(new_dataflash(1.0).data)
    for _ in range(20):
        data[source.randrange(len(data))] ^= 1 << source.randrange(8)
    path = tmp_path / "flipped.bin"
    path.write_bytes(bytes(data[: source.randrange(500, len(data))]))
    try:
        out, report = imported(path, tmp_path)
    except InputError as reason:
        assert "\n" not in str(reason) and list(tmp_path.iterdir()) == [path]
        return
    with open_log(out) as log:
        assert log.verify() == [] and log.duration < 10.0
        for name, columns in log.tables([name for name in log.topics if log.topics[name].layout]).items():
            assert (np.diff(columns.time) >= 0.0).all(), name
        attitude = log.columns(topics.ATTITUDE) if topics.ATTITUDE.name in log.topics else {}
        assert all(np.abs(attitude[name]).max() < 3.2 for name in ("roll", "pitch", "yaw") if name in attitude)
    assert report.messages == sum(row.messages for row in report.topics)


def test_no_whole_record_is_refused_and_nothing_written(tmp_path: Path) -> None:
    source = tmp_path / "empty.bin"
    for data, reason in (
        (b"\xa3\x95\x80" + bytes(86), "no whole record"),
        (b"not a log", "does not begin as"),
        (b"", "empty"),
    ):
        source.write_bytes(data)
        with pytest.raises(InputError, match=reason) as error:
            imported(source, tmp_path)
        assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == [source]


def test_a_row_with_a_time_beyond_all_clocks_is_dropped(tmp_path: Path) -> None:
    log = new_dataflash(1.0)
    log.data += b"\xa3\x95" + bytes([log.number("ATT")]) + struct.pack("<QhhH", 2**63 + 5, 0, 0, 0)
    source = tmp_path / "late.bin"
    source.write_bytes(log.data)
    _, report = imported(source, tmp_path)
    assert [(one.topic, one.rows) for one in report.dropped] == [("/dataflash/ATT", 1)]


def test_each_boot_becomes_a_log_and_a_parameter_has_a_history(tmp_path: Path) -> None:
    """GIVEN two boots in one file, a parameter set in flight WHEN imported THEN two logs with their own values."""
    log = new_dataflash(20.0)
    log.write("PARM", 12_000_000, "Q_TILT_MAX", 60.0)
    for _ in range(5):
        log.write("PARM", 1_000, "Q_TILT_MAX", 30.0)
    for at in range(50):
        log.write("ATT", 2_000_000 + 100_000 * at, 0, 0, 0)
    source = tmp_path / "twice.bin"
    source.write_bytes(log.data)
    out, report = imported(source, tmp_path)
    (second,) = report.later_boots
    with open_log(out) as first:
        assert first.columns("/dataflash/ATT").time[-1] > 20.0
        assert first.parameters.initial["Q_TILT_MAX"] == 45.0
        assert [(change.time, change.value) for change in first.parameters.changes] == [(12.0, 60.0)]
    with open_log(Path(second.file)) as later:
        assert len(later.columns("/dataflash/ATT").time) == 50
        assert later.parameters.initial["Q_TILT_MAX"] == 30.0 and not later.parameters.changes


def test_a_topic_that_cannot_be_made_is_told_with_the_reason(tmp_path: Path) -> None:
    """GIVEN a battery without its current WHEN imported THEN the report names the column that is missing."""
    log = new_dataflash()
    log.define("CURR", "Qf", "TimeUS,Volt")
    for at in range(20):
        log.write("CURR", 5_000_000 + 100_000 * at, 7.4)
    data = log.data.replace(b"BAT\0", b"BAX\0")
    source = tmp_path / "battery.bin"
    source.write_bytes(data)
    _, report = imported(source, tmp_path)
    assert ("/power/state", "not made of CURR: no numbers in column Curr", 20) in report.dropped


@needs_shared
def test_the_real_quadcopter_of_2015(tmp_path: Path) -> None:
    """242 s with old time stamps; in hover the specific force is gravity, and the battery has four cells."""
    out, report = imported(SHARED / "quad_2015.bin", tmp_path)
    assert report.damage == () and report.dropped == ()
    assert report.vehicle.startswith("APM:Copter V3.3") and report.parameters == 491
    with open_log(out) as log:
        imu, power, gps = (log.columns(t, 100.0, 200.0) for t in (topics.IMU, topics.POWER, topics.GPS))
        assert len(imu.time) == pytest.approx(5000, rel=0.01)
        assert np.hypot(np.hypot(imu["accel_x"], imu["accel_y"]), imu["accel_z"]).mean() == pytest.approx(
            9.8, abs=0.3
        )
        assert 14.0 < power["voltage"].mean() < 16.8 and 5.0 < power["current"].mean() < 40.0
        assert math.degrees(gps["latitude"][0]) == pytest.approx(-35.36, abs=0.1)
        down, climb = log.columns("/dataflash/GPS", 100.0, 200.0)["VZ"], log.columns(topics.ALTITUDE, 100.0, 200.0)
        assert abs(-down.mean() - climb["climb_rate"].mean()) < 0.2
        assert {event.text for event in log.events()} >= {"Frame: QUAD"}
