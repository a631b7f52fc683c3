"""PX4's logs: a real one of a bench test, cut and damaged, and a simulated one that counts since 1970."""

from __future__ import annotations

import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import DATA, SHARED, imported, needs_shared
from pyulog import ULog

from avionics import topics
from logs.importing.log_import import IMPORT, NOTES
from logs.importing.ulog import unit_of
from logs.reader import open_log
from wingbeat.errors import InputError

BENCH = DATA / "vtol_bench.ulg"


def test_a_bench_test_opens_like_a_flown_log(tmp_path: Path) -> None:
    out, report = imported(BENCH, tmp_path)
    assert report.vehicle == "PX4 CUBEPILOT_CUBEORANGE" and report.damage == ()
    with open_log(out) as log:
        assert log.verify() == [] and log.duration == pytest.approx(26.8, abs=0.1)
        imu, attitude, air = (log.columns(t) for t in (topics.IMU, topics.ATTITUDE, topics.AIR_DATA))
        assert imu["accel_z"].mean() == pytest.approx(-9.75, abs=0.15)
        assert imu.units["accel_z"] == "m/s^2" and imu.time[0] == pytest.approx(20.33, abs=0.01)
        assert attitude["bias_z"][-1] != 0.0 and np.abs(attitude["roll"]).max() < 0.1
        assert air["density"][-1] == pytest.approx(1.19, abs=0.01)
        assert log.columns(topics.POWER)["voltage"].mean() == pytest.approx(23.4, abs=0.2)
        assert math.degrees(log.columns(topics.GPS)["latitude"][0]) == pytest.approx(63.4, abs=0.1)
        assert log.topics["/view/location"].messages > 0
        assert any("Disarmed by landing" in event.text for event in log.events())
        assert len(log.parameters.initial) == 980
        assert log.metadata[NOTES]["sys_os_name"] == "NuttX"
        assert log.metadata[IMPORT]["clock"] == "since the source's boot"


def test_what_has_no_counterpart_keeps_its_name_its_numbers_and_its_unit(tmp_path: Path) -> None:
    out, _ = imported(BENCH, tmp_path)
    reference = {(one.name, one.multi_id): one.data for one in ULog(str(BENCH)).data_list}
    with open_log(out) as log:
        outputs, baro = log.columns("/ulg/actuator_outputs_1"), log.columns("/ulg/vehicle_air_data")
        expected = reference["actuator_outputs", 1]
        assert outputs["time_us"].tolist() == expected["timestamp"].tolist()
        assert outputs["output"].shape == (65, 16)
        assert outputs["output"][:, 3].tolist() == expected["output[3]"].tolist()
        assert baro.units["baro_temp_celcius"] == "degC" and baro.units["baro_pressure_pa"] == "Pa"


def test_a_stamp_from_nowhere_is_dropped_and_told(tmp_path: Path) -> None:
    _, report = imported(BENCH, tmp_path)
    assert [tuple(one) for one in report.dropped] == [
        ("/ulg/mission", "time behind the end of the log", 1),
        ("/system/events", "time outside of the log", 1),
    ]


def test_units_are_read_from_names_and_not_from_what_only_looks_like_one() -> None:
    assert unit_of("true_airspeed_m_s") == "m/s" and unit_of("accelerometer_m_s2") == "m/s^2"
    assert unit_of("gyro_rad") == "rad/s" and unit_of("discharged_mah") == "mAh"
    assert unit_of("device_id") == unit_of("nav_state") == unit_of("vel_variance_m_s") == ""


def test_a_file_cut_in_the_middle_gives_what_is_whole_and_says_so(tmp_path: Path) -> None:
    source = tmp_path / "cut.ulg"
    data = BENCH.read_bytes()
    source.write_bytes(data[: len(data) // 2 + 1])
    out, report = imported(source, tmp_path)
    assert len(report.damage) == 1 and "cut off in the middle of a message" in report.damage[0]
    with open_log(out) as log:
        assert 300 < len(log.columns(topics.IMU).time) < 1298
        assert log.metadata[IMPORT]["damage"] == report.damage[0]


@pytest.mark.parametrize("seed", range(6))
def test_flipped_bits_give_what_can_be_true_or_one_line(seed: int, tmp_path: Path) -> None:
    source, data = random.Random(seed), bytearray(BENCH.read_bytes()[:400_000])
    for _ in range(30):
        data[source.randrange(len(data))] ^= 1 << source.randrange(8)
    path = tmp_path / "flipped.ulg"
    path.write_bytes(bytes(data))
    try:
        out, report = imported(path, tmp_path)
    except InputError as reason:
        assert "\n" not in str(reason) and list(tmp_path.iterdir()) == [path]
        return
    with open_log(out) as log:
        assert log.verify() == [] and log.duration < 120.0 and report.damage
        for name, columns in log.tables([row.topic for row in report.topics if row.source]).items():
            fields = [field for field in ("roll", "pitch", "yaw", "latitude") if field in columns]
            assert all(np.abs(np.nan_to_num(columns[field])).max() <= 3.15 for field in fields), name


def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path) -> None:
    source = tmp_path / "wrong.ulg"
    for data in (b"ULog\x01\x12\x35", b"ULog\x01\x12\x35" + bytes(9), BENCH.read_bytes()[:2000], b"MAVLink"):
        source.write_bytes(data)
        with pytest.raises(InputError) as error:
            imported(source, tmp_path)
        assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == [source]


@needs_shared
def test_a_simulation_that_counts_since_1970_begins_with_the_log(tmp_path: Path) -> None:
    out, _ = imported(SHARED / "sitl_quad.ulg", tmp_path)
    with open_log(out) as log:
        assert 0.0 <= log.columns(topics.IMU).time[0] < 1.0 and log.duration == pytest.approx(31.4, abs=0.2)
        assert log.boot_ns == 1710773350054000000
        assert log.metadata[IMPORT]["clock"].startswith("since 1970")
        assert log.columns(topics.IMU)["accel_z"].mean() == pytest.approx(-9.8, abs=0.1)


def test_a_parameter_of_a_damaged_type_is_left_out_and_told(tmp_path: Path) -> None:
    source, data = tmp_path / "flipped.ulg", BENCH.read_bytes()
    at = next(found.end() for found in re.finditer(rb"P.(?=int32_t )", data, re.DOTALL))
    source.write_bytes(data[: at + 3] + b"7" + data[at + 4 :])
    out, report = imported(source, tmp_path)
    assert len(report.damage) == 1 and "1 parameter without a number" in report.damage[0]
    with open_log(out) as log:
        assert len(log.parameters.initial) == 979


def test_a_simulation_cut_before_its_first_message_of_data_is_refused_in_one_line(tmp_path: Path) -> None:
    source, data = tmp_path / "cut.ulg", BENCH.read_bytes()
    for start in (1_710_773_350_054_000, 2**64 - 1):
        for end in (16, 40, 20_000):
            source.write_bytes(data[:8] + start.to_bytes(8, "little") + data[16:end])
            with pytest.raises(InputError, match="no whole message of data"):
                imported(source, tmp_path)


def test_a_first_time_that_cannot_be_is_told_and_costs_nothing(tmp_path: Path) -> None:
    source, data = tmp_path / "flipped.ulg", BENCH.read_bytes()
    source.write_bytes(data[:15] + b"\xff" + data[16:])
    out, report = imported(source, tmp_path)
    assert report.damage == ("its first time cannot be",)
    with open_log(out) as log:
        assert log.columns(topics.IMU).time[0] == pytest.approx(20.33, abs=0.01)
