"""What a ground station heard, in a file that opens like a vehicle's log."""

from __future__ import annotations

import json
import math
import re
import sys
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from foreign_vehicles import ekf_report
from lossy_vehicle import LossyVehicle, on_the_air
from mcap.reader import make_reader

from avionics.link.dialect import mavlink
from groundstation.command.main import main
from groundstation.link.frames import Arrival, GroundReader, read
from groundstation.link.recording import Recording, Where
from logs.info import summary
from logs.new_files import locked_name
from logs.reader import open_log

Capture = pytest.CaptureFixture[str]
HEARTBEAT = (16, 0, 129, 4 << 16 | 4 << 24, 4, 3)
EPOCH = 1_700_000_000_000_000_000


class Ground:
    """A recording whose clock and vehicle are ours."""

    def __init__(self, folder: Path, **where: Any) -> None:
        self.now = 500.0
        self.recording = Recording(Where("udpin:test", folder=folder, **where), epoch_ns=self.epoch_ns)
        self._packer = mavlink.MAVLink(None, 1, 1)
        self._reader = GroundReader()

    def epoch_ns(self) -> int:
        return EPOCH + round((self.now - 500.0) * 1e9)

    def handle_frame(self, *messages: Any) -> None:
        for message in messages:
            self.raw(message.pack(self._packer))

    def raw(self, data: bytes) -> None:
        for frame in self._reader.feed(data):
            self.recording.handle_frame(Arrival(frame, read(frame), self.now))

    def fly(self, seconds: float, boot: float = 0.0) -> None:
        """HEARTBEAT and ATTITUDE at 10 Hz of a vehicle whose clock is ``boot`` s old."""
        for tick in range(round(10 * seconds)):
            stamp = round(1000 * (boot + 0.1 * tick)) + 1
            self.handle_frame(mavlink.MAVLink_heartbeat_message(*HEARTBEAT))
            self.handle_frame(mavlink.MAVLink_attitude_message(stamp, 0.3, 0.2, 1.0, 0.01, 0.02, 0.03))
            self.now += 0.1


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"), key=lambda path: (len(path.name), path.name))


def sent(file: Path) -> list[dict[str, Any]]:
    with file.open("rb") as stream:
        return [json.loads(message.data) for *_, message in make_reader(stream).iter_messages("/ground/sent")]


def test_telemetry_is_in_the_vehicles_own_topics_with_the_vehicles_time(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(3.0, boot=60.0)
    ground.handle_frame(mavlink.MAVLink_global_position_int_message(63_050, 0, 0, 0, 40_250, 0, 0, -150, 0))
    ground.handle_frame(
        mavlink.MAVLink_wingbeat_wing_state_message(63_050, 0.1, 0.2, 1.0, 2.0, 0.5, 4.2, 0.9, 1.0, 0, 0.5, 7, 1)
    )
    ground.recording.close()
    (file,) = files(tmp_path)
    assert file.name.startswith("gcs-flapping_wing-1-")
    with open_log(file) as log:
        turn = log.columns("/attitude/ahrs")
        assert turn.time[0] == pytest.approx(60.001) and np.all(np.diff(turn.time) > 0.0)
        assert turn["pitch"][0] == pytest.approx(0.2) and turn.units["pitch"] == "rad"
        q = [turn[f"quaternion_{axis}"][0] for axis in "wxyz"]
        # The third row of the matrix: earth's down in body axes has -sin(pitch) along the nose.
        assert 2 * (q[1] * q[3] - q[2] * q[0]) == pytest.approx(-math.sin(0.2))
        assert math.isnan(turn["bias_x"][0])
        height = log.columns("/main/altitude")
        assert (height["altitude"][0], height["climb_rate"][0]) == (40.25, 1.5)
        assert log.columns("/main/wing")["frequency"][0] == pytest.approx(4.2)
        assert log.topics["/view/estimated/transforms"].messages == len(turn.time)
        document = summary(log)
        assert log.boot_ns == pytest.approx(EPOCH - 60.0e9, abs=0.2e9)
    assert document["vehicle"] == "flapping wing-1" and document["complete"]


def test_every_message_has_a_channel_with_units_and_labels(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(0.5)
    ground.handle_frame(mavlink.MAVLink_param_value_message(b"PITCH_P", 0.5, 9, 40, 3))
    ground.handle_frame(mavlink.MAVLink_battery_status_message(0, 0, 1, 32767, [8000, *[65535] * 9], 150, 0, 0, 90))
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        turn = log.columns("/mavlink/ATTITUDE")
        assert turn.units["rollspeed"] == "rad/s" and turn["roll"][0] == pytest.approx(0.3)
        beat = log.columns("/mavlink/HEARTBEAT")
        assert len(beat.time) == 5 and beat["custom_mode"][0] == HEARTBEAT[3]
        assert log.columns("/mavlink/BATTERY_STATUS")["voltages"][0].tolist() == [8000, *[65535] * 9]
        assert log.topics["/mavlink/PARAM_VALUE"].messages == 1


def test_foreign_and_unknown_messages_are_kept(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(0.5)
    ground.handle_frame(ekf_report())
    ground.raw(bytes([0xFD, 3, 0, 0, 9, 1, 1, 0xFF, 0xFF, 0x77, 1, 2, 3, 0xAA, 0xBB]))
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        assert log.columns("/mavlink/EKF_STATUS_REPORT")["pos_horiz_variance"][0] == pytest.approx(0.2)
        assert log.topics["/mavlink/unknown"].messages == 1


def test_what_is_said_is_an_event_with_its_own_time(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(1.0, boot=20.0)
    ground.handle_frame(
        mavlink.MAVLink_system_time_message(0, 19_500), mavlink.MAVLink_statustext_message(4, b"wind")
    )
    ground.fly(0.5, boot=21.0)
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        (event,) = log.events()
        assert (event.time_us, event.severity.name, event.text) == (19_500_000, "WARNING", "wind")


def test_the_shortest_conversation_is_in_the_file_with_what_was_asked_before_it_began(tmp_path: Path) -> None:
    ground = Ground(tmp_path, verb="param_get")
    ground.handle_frame(mavlink.MAVLink_heartbeat_message(*HEARTBEAT))
    ground.recording.sent(mavlink.MAVLink_param_request_read_message(1, 1, b"PITCH_P", -1))
    ground.now += 0.25
    assert files(tmp_path) == []
    ground.handle_frame(mavlink.MAVLink_attitude_message(60_250, 0.3, 0.2, 1.0, 0.01, 0.02, 0.03))
    ground.recording.sent(mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))
    ground.recording.close()
    (file,) = files(tmp_path)
    assert file.name.startswith("gcs-flapping_wing-1-param_get-") and ground.recording.files == [file]
    assert [one["message"] for one in sent(file)] == ["PARAM_REQUEST_READ", "COMMAND_LONG"]
    assert [one["time_us"] for one in sent(file)] == [60_000_000, 60_250_000]
    with open_log(file) as log:
        assert log.topics["/mavlink/HEARTBEAT"].messages == 1


def test_what_was_asked_is_kept_where_the_vehicle_says_no_time(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.handle_frame(mavlink.MAVLink_heartbeat_message(*HEARTBEAT))
    ground.recording.sent(mavlink.MAVLink_param_request_list_message(1, 1))
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        assert log.topics["/ground/sent"].messages == 1 and log.topics["/mavlink/HEARTBEAT"].messages == 1


def test_where_nothing_was_heard_there_is_no_file(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.recording.sent(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    ground.recording.sent(mavlink.MAVLink_param_request_list_message(1, 1))
    ground.recording.close()
    assert files(tmp_path) == [] and not ground.recording.failure


def test_a_signing_key_is_kept_neither_heard_nor_sent(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    key = mavlink.MAVLink_setup_signing_message(1, 1, bytes(range(32)), 0)
    ground.recording.sent(key)
    ground.fly(0.5)
    ground.handle_frame(key)
    ground.recording.sent(key)
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        assert not {"/ground/sent", "/mavlink/SETUP_SIGNING"} & set(log.topics)


def test_two_that_begin_in_the_same_second_have_two_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given another program that holds the name without a file of it yet, a further one is taken."""
    ground = Ground(tmp_path)
    monkeypatch.setattr("logs.names.datetime", SimpleNamespace(now=lambda: datetime(2026, 11, 21, 13, 15, 0)))
    with locked_name(tmp_path / "gcs-flapping_wing-1-20261121-131500.mcap") as ours:
        assert ours
        ground.fly(0.5)
    ground.recording.close()
    assert ground.recording.files == [tmp_path / "gcs-flapping_wing-1-20261121-131500-2.mcap"]


def test_a_vehicle_that_boots_anew_begins_a_file_and_none_is_overwritten(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(2.0, boot=100.0)
    ground.fly(2.0, boot=1.0)
    ground.recording.close()
    first, second = files(tmp_path)
    with open_log(first) as a, open_log(second) as b:
        assert a.columns("/attitude/ahrs").time[0] == pytest.approx(100.001)
        assert b.columns("/attitude/ahrs").time[0] == pytest.approx(1.001)


def test_a_vehicle_without_a_clock_is_recorded_by_the_grounds(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    for _ in range(50):
        ground.handle_frame(mavlink.MAVLink_vfr_hud_message(7.0, 6.0, 90, 50, 40.0, 0.0))
        ground.now += 0.1
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        hud = log.columns("/mavlink/VFR_HUD")
        assert hud.time[0] == 0.0 and hud.time[-1] == pytest.approx(4.9, abs=1e-6)


def test_times_of_other_clocks_do_not_move_the_vehicles(tmp_path: Path) -> None:
    ground = Ground(tmp_path)
    ground.fly(1.0, boot=30.0)
    ground.handle_frame(mavlink.MAVLink_ping_message(49_000_000_000, 1, 255, 190))
    ground.handle_frame(mavlink.MAVLink_gps_raw_int_message(1_700_000_000_000_000, 3, 0, 0, 0, 1, 1, 0, 0, 9))
    ground.fly(1.0, boot=31.0)
    ground.recording.close()
    with open_log(files(tmp_path)[0]) as log:
        assert log.columns("/sensors/gps").time[0] == pytest.approx(31.0, abs=0.2)
        assert log.topics["/attitude/ahrs"].messages == 20


def test_a_folder_that_cannot_be_written_costs_the_recording_alone(tmp_path: Path) -> None:
    blocked = tmp_path / "recordings"
    blocked.write_text("a file where the folder would be")
    ground = Ground(blocked)
    ground.fly(2.0)
    ground.recording.close()
    assert "cannot record to" in ground.recording.failure


def test_record_says_what_it_wrote_and_never_overwrites(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.mcap"
    with on_the_air(LossyVehicle()) as url:
        assert main(["gcs", url, "record", str(out), "--duration", "1.2"]) == 0
        assert str(out) in capsys.readouterr().out
        kept = out.read_bytes()
        assert main(["gcs", url, "record", str(out), "--duration", "0.2"]) == 2
        assert main(["gcs", url, "record", str(tmp_path / "b.mcap"), "--no-record"]) == 2
    assert out.read_bytes() == kept and not (tmp_path / "b.mcap").exists()
    with open_log(out) as log:
        assert log.topics["/mavlink/HEARTBEAT"].messages > 0


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def recorded(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*.mcap"))


def test_every_question_leaves_a_recording_in_the_folder_of_its_day(here: Path, capsys: Capture) -> None:
    vehicle = LossyVehicle()
    vehicle.results[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = mavlink.MAV_RESULT_DENIED
    with on_the_air(vehicle) as url:
        assert main(["gcs", url, "param", "get", "GAIN_3", "--json"]) == 0
        assert main(["gcs", url, "arm"]) == 1
    (day,) = (here / "recordings").iterdir()
    assert re.fullmatch(r"gcs-\d{8}", day.name)
    first, second = recorded(day)
    assert re.fullmatch(r"gcs-flapping_wing-1-arm-\d{8}-\d{6}\.mcap", first)
    assert re.fullmatch(r"gcs-flapping_wing-1-param_get-\d{8}-\d{6}\.mcap", second)
    assert "PARAM_REQUEST_READ" in [one["message"] for one in sent(day / second)]
    with open_log(day / second) as log:
        assert log.topics["/mavlink/PARAM_VALUE"].messages == 1
    # Where there is no terminal nothing more is said than what was asked for.
    assert capsys.readouterr().err.count("\n") == 1


def test_on_a_terminal_one_line_says_where_but_not_behind_a_failure(
    here: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    vehicle = LossyVehicle()
    with on_the_air(vehicle) as url:
        assert main(["gcs", url, "disarm", "--record-to", "mine"]) == 0
        (name,) = recorded(here)
        assert name.startswith("mine/gcs-flapping_wing-1-disarm-")
        assert capsys.readouterr().err == f"recorded in {name}\n"
        assert main(["gcs", url, "disarm", "--json"]) == 0
        assert main(["gcs", url, "disarm", "--no-record"]) == 0
        assert capsys.readouterr().err == ""
        vehicle.results[mavlink.MAV_CMD_COMPONENT_ARM_DISARM] = mavlink.MAV_RESULT_DENIED
        assert main(["gcs", url, "arm"]) == 1
    assert capsys.readouterr().err == "wingbeat: COMPONENT_ARM_DISARM denied: denied\n"
    assert len(recorded(here)) == 3


@pytest.mark.parametrize("words", [["status"], ["monitor"], ["record", "out.mcap"], ["param", "list"]])
def test_who_reaches_nobody_leaves_no_file(words: list[str], here: Path, capsys: Capture) -> None:
    assert main(["gcs", "serial:/dev/none,57600", *words]) == 2
    assert "cannot open serial device /dev/none" in capsys.readouterr().err
    if words != ["monitor"]:
        assert main(["gcs", "udpout:127.0.0.1:9", "--timeout", "0.2", *words]) == 2
    assert list(here.iterdir()) == []


def test_options_of_recordings_that_exclude_each_other(here: Path, capsys: Capture) -> None:
    for words in (
        ["status", "--no-record", "--record-to", "a"],
        ["record", "a.mcap", "--record-to", "a"],
        ["record", "a.mcap", "--no-record"],
    ):
        assert main(["gcs", "udpout:127.0.0.1:9", *words]) == 2
    assert [line.endswith("exclude each other") for line in capsys.readouterr().err.splitlines()] == [True] * 3
    assert list(here.iterdir()) == []
