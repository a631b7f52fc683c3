"""``wingbeat gcs calibrate`` and ``excite`` as a user runs them, against a flight computer on a UDP port."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from flight_computer import RAVEN, aboard
from lossy_vehicle import LossyVehicle, on_the_air

from avionics.link.dialect import mavlink
from groundstation.command import gcs_calibrate
from groundstation.command.main import main
from groundstation.link import commands
from groundstation.views.progress import ProgressBar

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings are left where a test leaves its other files."""
    monkeypatch.chdir(tmp_path)


def gcs(*words: str) -> int:
    return main(["gcs", *words])


def test_a_calibration_is_told_kept_and_flown_after_a_restart(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "raven.json"
    with aboard(path) as url:
        assert gcs(url, "calibrate", "battery", "--voltage", "7.8", "--json") == 0
        document = json.loads(capsys.readouterr().out)
        assert gcs(url, "calibrate", "wings", "--angle", "1.8") == 0
        lines = capsys.readouterr().out.splitlines()
    assert document["kind"] == "battery"
    assert document["said"][0].startswith("battery: keep the drives at rest")
    assert any(line.startswith("BATTERY calibrated: ") for line in document["said"])
    changed = {row["name"]: row["value"] for row in document["parameters"]}
    assert changed["PWR_DIVIDER"] == pytest.approx(0.5 * (819 * 5.0 / 1024 / 0.5) / 7.8, rel=1e-6)
    assert any(line.startswith("WINGS calibrated") for line in lines)
    zeros = {line.split()[0]: float(line.split()[1]) for line in lines if line.startswith("WING_ZERO")}
    # 1.8 degrees are ten counts, to the six digits a wire's number has.
    assert zeros == pytest.approx({"WING_ZERO_LEFT": 2.0, "WING_ZERO_RIGHT": 10.0}, rel=1e-5)
    with aboard(path) as url:
        assert gcs(url, "param", "get", "WING_ZERO_RIGHT") == 0
        name, _, value = capsys.readouterr().out.split()
        assert (name, float(value)) == ("WING_ZERO_RIGHT", zeros["WING_ZERO_RIGHT"])


def test_a_refusal_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    with aboard(tmp_path / "raven.json") as url:
        assert gcs(url, "calibrate", "airspeed", "--in-flight") == 1
        reports = capsys.readouterr()
        assert reports.err.endswith("calibration denied: not in flight\n") and reports.out == ""
        assert gcs(url, "calibrate", "battery", "--voltage", "20") == 1
        reports = capsys.readouterr()
        assert reports.err.count("\n") == 1
        assert reports.err.endswith("BATTERY calibration failed: given 20.00 V differs from measured 8.00 V\n")
        assert reports.out.startswith("battery: keep the drives at rest") and "failed" not in reports.out


def test_what_is_out_of_range_is_told_in_the_unit_in_which_it_was_given(tmp_path: Path, capsys: Capture) -> None:
    with aboard(tmp_path / "raven.json") as url:
        assert gcs(url, "calibrate", "wings", "--angle", "500") == 1
        assert capsys.readouterr().err.endswith("calibration denied: 500 is out of range -90 to 90 degrees\n")
        assert gcs(url, "calibrate", "battery", "--voltage", "800") == 1
        assert capsys.readouterr().err.endswith("calibration denied: 800 is out of range 0 to 100 V\n")
    assert gcs("udpout:127.0.0.1:9", "excite", "doublet", "throttle", "--amplitude", "5", "--width", "0.2") == 2
    assert capsys.readouterr().err.endswith("is outside 0.005 to 0.5\n")


def test_an_excitation_on_the_ground_is_refused_and_a_bad_one_never_sent(tmp_path: Path, capsys: Capture) -> None:
    with aboard(tmp_path / "raven.json") as url:
        sweep = ("sweep", "elevator", "--amplitude", "3", "--start", "0.5", "--end", "3", "--duration", "10")
        assert gcs(url, "excite", *sweep, "--loops", "active") == 1
        assert "excitation denied: mode must be" in capsys.readouterr().err
    band = ("--period", "10", "--low", "0.3")
    assert gcs("udpout:127.0.0.1:9", "excite", "multisine", "--rudder", "5", *band, "--high", "0.3") == 2
    assert "holds 1 harmonics" in capsys.readouterr().err


def test_parameters_are_saved_to_a_file_and_loaded_from_it(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "raven.params"
    with aboard(tmp_path / "raven.json") as url:
        assert gcs(url, "param", "save", str(file)) == 0
        assert gcs(url, "param", "save", str(file)) == 2
        assert gcs(url, "param", "set", "PITCH_P", "0.5") == 0
        capsys.readouterr()
        assert gcs(url, "param", "load", str(file), "--json") == 0
        document: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert [row["name"] for row in document["parameters"]] == ["PITCH_P"]
        assert document["parameters"][0]["value"] == pytest.approx(RAVEN.gains.pitch.proportional, rel=1e-6)
        file.write_text("1\t1\tNO_SUCH\t1.0\t9\n")
        assert gcs(url, "param", "load", str(file)) == 2
        assert "no parameter NO_SUCH" in capsys.readouterr().err


class Interrupted(ProgressBar):
    """Ctrl-C as soon as the vehicle says that it calibrates."""

    def show(self, done: float, total: float, note: str = "") -> None:
        if total == 100:
            raise KeyboardInterrupt


def test_ctrl_c_ends_the_calibration_aboard_too(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gcs_calibrate, "ProgressBar", Interrupted)
    with aboard(tmp_path / "raven.json") as url:
        assert gcs(url, "calibrate", "mag") == 130
        assert capsys.readouterr().err == "calibration canceled\n"
        monkeypatch.undo()
        monkeypatch.chdir(tmp_path)
        # One that still ran would refuse the next.
        assert gcs(url, "calibrate", "battery", "--voltage", "7.8") == 0


def test_a_calibration_is_cancelled_by_a_verb_of_its_own(tmp_path: Path, capsys: Capture) -> None:
    with aboard(tmp_path / "raven.json") as url:
        assert gcs(url, "calibrate", "cancel") == 0
    assert capsys.readouterr().out == "calibration canceled\n"


class Forgetful(LossyVehicle):
    """Begins to calibrate, and says no more of it; ``confirms`` a cancel or not."""

    def __init__(self, confirms: bool) -> None:
        super().__init__()
        self.confirms = confirms
        self.cancelled = 0

    def _command_long(self, message: Any) -> list[Any]:
        if message.command != mavlink.MAV_CMD_PREFLIGHT_CALIBRATION:
            return []
        if message.param2:
            return [mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_IN_PROGRESS)]
        self.cancelled += 1
        return [mavlink.MAVLink_command_ack_message(message.command, 0)] if self.confirms else []


@pytest.mark.parametrize(
    ("confirms", "reports"), [(True, "; calibration canceled"), (False, ": the calibration may continue")]
)
def test_who_gives_up_waiting_cancels(
    confirms: bool, reports: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "LONG_WAIT", 0.3)
    vehicle = Forgetful(confirms)
    with on_the_air(vehicle) as url:
        assert gcs(url, "--no-record", "calibrate", "mag") == 1
    text = capsys.readouterr().err
    assert text.startswith("wingbeat: no response to PREFLIGHT_CALIBRATION; ") and text.endswith(f"{reports}\n")
    assert (vehicle.cancelled == 1) is confirms
