"""Telemetry logs: the vehicle apart from its ground station, and its clock instead of the ground's."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import imported, stamped, tlog
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from avionics import topics
from logs.importing.checks import boots
from logs.importing.log_import import IMPORT
from logs.importing.tlog import _unwrapped
from logs.reader import open_log
from wingbeat.errors import InputError

BOOT_US = 1_700_000_000_000_000


def imported_tlog(folder: Path, data: bytes, **options: str) -> Path:
    source = folder / "flight.tlog"
    source.write_bytes(data)
    return imported(source, folder, **options)[0]


def test_the_vehicle_is_kept_apart_from_its_ground_station(tmp_path: Path) -> None:
    with open_log(imported_tlog(tmp_path, tlog())) as log:
        assert set(log.columns("/tlog/HEARTBEAT")["type"]) == {1}
        assert set(log.columns("/tlog/system_255/HEARTBEAT")["type"]) == {6}
        assert log.columns("/tlog/system_255/COMMAND_LONG")["command"].tolist() == [400]
        assert log.metadata[IMPORT]["vehicle"] == "FIXED_WING 1"


def test_the_vehicle_is_found_though_its_ground_station_speaks_more(tmp_path: Path) -> None:
    ground = mavlink.MAVLink(None, 255, 190)
    beat = mavlink.MAVLink_heartbeat_message(18, 0, 0, 0, 4, 3)
    chatter = b"".join(stamped(BOOT_US + n, beat, ground) for n in range(500))
    with open_log(imported_tlog(tmp_path, chatter + tlog(5))) as log:
        assert len(log.columns("/tlog/ATTITUDE").time) == 50


def test_times_are_the_vehicles_by_its_stamps_and_between_them(tmp_path: Path) -> None:
    with open_log(imported_tlog(tmp_path, tlog())) as log:
        attitude, power = log.columns(topics.ATTITUDE), log.columns(topics.POWER)
        assert attitude["time_us"].tolist() == [1000 * (5000 + 100 * n) for n in range(200)]
        # What carries no stamp is as late as the last message that did.
        assert power["time_us"].tolist() == [1000 * (5000 + 1000 * n) + 300 for n in range(20)]
        assert log.boot_ns == pytest.approx(BOOT_US * 1000, abs=20_000_000)
        assert log.metadata[IMPORT]["clock"] == "since the vehicle's boot, by its stamps"


def test_the_grounds_clock_when_asked_for(tmp_path: Path) -> None:
    with open_log(imported_tlog(tmp_path, tlog(), clock="ground")) as log:
        times = log.columns(topics.ATTITUDE).time
        assert times[0] == 0.0 and set(np.round(np.diff(times), 3)) == {0.107, 0.086}
        assert "ground" in log.metadata[IMPORT]["clock"]


def test_values_are_in_si_and_the_rest_keeps_the_units_of_the_wire(tmp_path: Path) -> None:
    with open_log(imported_tlog(tmp_path, tlog())) as log:
        attitude, power = log.columns(topics.ATTITUDE), log.columns(topics.POWER)
        assert attitude["roll"][7] == pytest.approx(0.07) and attitude["pitch"][7] == pytest.approx(-0.07)
        assert attitude["yaw_rate"][0] == pytest.approx(0.3)
        assert power["voltage"][0] == pytest.approx(7.4) and power["current"][0] == pytest.approx(12.5)
        assert power["battery_remaining"][0] == pytest.approx(0.8)
        assert log.columns("/tlog/SYS_STATUS").units["voltage_battery"] == "mV"


def test_texts_modes_and_parameters(tmp_path: Path) -> None:
    with open_log(imported_tlog(tmp_path, tlog())) as log:
        told = [(round(event.time_us * 1e-6), event.text) for event in log.events()]
        assert told == [(5, "mode AUTO, armed"), (8, "Low airspeed"), (15, "mode RTL, armed")]
        assert log.parameters.initial == {"TRIM_ARSPD_CM": 1200.0}


def test_noise_and_a_cut_are_told_and_cost_themselves_alone(tmp_path: Path) -> None:
    data = tlog(10)
    frame = data.index(b"\xfd", len(data) // 2) - 8
    source = tmp_path / "noisy.tlog"
    source.write_bytes(data[:frame] + b"noise on the line" + data[frame:-3])
    out, report = imported(source, tmp_path)
    assert report.damage[0] == "17 bytes in 1 place outside of frames"
    assert report.damage[1].startswith("cut off in the middle of a frame")
    with open_log(out) as log:
        assert len(log.columns(topics.ATTITUDE).time) == 99


def test_a_message_that_no_dialect_knows_is_counted_and_noise_is_not_one(tmp_path: Path) -> None:
    data = tlog(5)
    frame = data.index(b"\xfd", len(data) // 2) - 8
    strange = bytes([0xFD, 4, 0, 0, 0, 1, 1]) + (54_321).to_bytes(3, "little") + b"data" + b"\0\0"
    source = tmp_path / "strange.tlog"
    stamp = data[frame : frame + 8]
    source.write_bytes(data[:frame] + stamp + strange + stamp + strange + b"noise" + data[frame:])
    _, report = imported(source, tmp_path)
    assert report.damage == (
        f"{8 + len(strange) + 5} bytes in 1 place outside of frames",
        "1 message of unknown dialects (ids 54321)",
    )


@pytest.mark.parametrize("seed", range(8))
def test_flipped_bits_cost_the_frames_that_they_hit(seed: int, tmp_path: Path) -> None:
    source, data = random.Random(seed), bytearray(tlog(20))
    for _ in range(20):
        data[source.randrange(len(data))] ^= 1 << source.randrange(8)
    path = tmp_path / "flipped.tlog"
    path.write_bytes(bytes(data))
    out, report = imported(path, tmp_path)
    assert report.damage
    with open_log(out) as log:
        attitude = log.columns(topics.ATTITUDE)
        assert 180 <= len(attitude.time) < 200 and log.duration < 60.0
        expected = 0.01 * ((attitude["time_us"] // 100_000 - 50) % 50)
        assert attitude["roll"] == pytest.approx(expected, abs=1e-6)


def test_each_boot_becomes_a_log(tmp_path: Path) -> None:
    """GIVEN a file with two boots WHEN imported THEN two logs, each whole and on its own clock."""
    source = tmp_path / "twice.tlog"
    source.write_bytes(tlog(20) + tlog(5, BOOT_US + 60_000_000))
    out, report = imported(source, tmp_path)
    (second,) = report.later_boots
    assert not report.dropped and not second.dropped
    assert second.file == str(out.with_name(f"{out.stem}-boot2.mcap"))
    for path, rows in ((out, 200), (Path(second.file), 50)):
        with open_log(path) as log:
            times = log.columns(topics.ATTITUDE).time
            assert len(times) == rows and (np.diff(times) >= 0.0).all()
            assert times[0] == pytest.approx(5.0)
            assert log.parameters.initial == {"TRIM_ARSPD_CM": 1200.0}
    assert {path.name for path in tmp_path.glob("*.mcap")} == {out.name, Path(second.file).name}


def test_a_false_stamp_is_no_boot_and_a_wrap_of_the_clock_is_none() -> None:
    """GIVEN one stamp of 0, or a clock that passes 49.7 days WHEN boots are sought THEN there is one."""
    steady = np.arange(100_000_000, 200_000_000, 1_000_000, dtype=np.int64)
    false = steady.copy()
    false[50] = 1
    assert boots(steady) == boots(false) == [0]
    rebooted = np.concatenate((steady, steady - 95_000_000))
    assert boots(rebooted) == [0, len(steady)]
    wrapped = (2**32 - 25 + 10 * np.arange(6)) % 2**32 * 1000
    assert (np.diff(_unwrapped(wrapped)) == 10_000).all()


@pytest.mark.parametrize("step", [-30.0, -3.0, 40.0, 5e8])
def test_a_step_of_the_grounds_clock_moves_no_message(step: float, tmp_path: Path) -> None:
    """GIVEN a ground clock that is set in flight WHEN imported THEN every message and event keeps its time."""
    data, moved, at = tlog(), bytearray(), 0
    while at < len(data):
        end = at + 8 + 12 + data[at + 9]
        ground = struct.unpack_from(">Q", data, at)[0]
        shift = step * 1e6 if ground > BOOT_US + 12_000_000 else 0.0
        moved += struct.pack(">Q", int(ground + shift)) + data[at + 8 : end]
        at = end
    for name in ("right", "moved"):
        (tmp_path / name).mkdir()
    with (
        open_log(imported_tlog(tmp_path / "right", data)) as right,
        open_log(imported_tlog(tmp_path / "moved", bytes(moved))) as log,
    ):
        for topic in ("/tlog/HEARTBEAT", "/tlog/SYS_STATUS", "/tlog/ATTITUDE"):
            assert log.columns(topic).time == pytest.approx(right.columns(topic).time, abs=0.2)
        texts = [[(event.time_us, event.text) for event in one.events()] for one in (log, right)]
        assert [text for _, text in texts[0]] == [text for _, text in texts[1]]
        assert np.abs(np.subtract([at for at, _ in texts[0]], [at for at, _ in texts[1]])).max() < 200_000


def test_a_parameter_that_changes_is_known_with_its_time(tmp_path: Path) -> None:
    """GIVEN a second value of a parameter WHEN imported THEN it is a change at its time, the first one initial."""
    vehicle = mavlink.MAVLink(None, 1, 1)
    value = mavlink.MAVLink_param_value_message(b"TRIM_ARSPD_CM", 950.0, 9, 1, 0)
    late = stamped(BOOT_US + 25_000_000, value, vehicle)
    with open_log(imported_tlog(tmp_path, tlog() + late)) as log:
        assert log.parameters.initial == {"TRIM_ARSPD_CM": 1200.0}
        (change,) = log.parameters.changes
        assert (change.name, change.value) == ("TRIM_ARSPD_CM", 950.0)
        assert change.time == pytest.approx(25.0, abs=0.5)


def test_what_is_no_telemetry_log_is_refused_in_one_line(tmp_path: Path) -> None:
    source = tmp_path / "no.tlog"
    for data in (b"\0" * 64, struct.pack(">Q", BOOT_US) + b"\xfd\x09", b"text and nothing else"):
        source.write_bytes(data)
        with pytest.raises(InputError, match="no complete MAVLink frame"):
            imported(source, tmp_path)
    assert list(tmp_path.iterdir()) == [source]
