"""``wingbeat gcs`` as a user runs it, against a vehicle on a real UDP port."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
from lossy_vehicle import LossyVehicle, on_the_air

from avionics.link.dialect import mavlink
from avionics.missions.reader import FOLDER as MISSIONS
from groundstation.command.gcs import build_parser
from groundstation.command.main import main
from groundstation.link.missions import Item
from groundstation.link.waypoints import convention_of, read_upload
from wingbeat.errors import InputError

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings are left where a test leaves its other files."""
    monkeypatch.chdir(tmp_path)


def gcs(*words: str) -> int:
    return main(["gcs", *words])


def test_arm_and_disarm_wait_for_the_heartbeat(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    with on_the_air(vehicle) as url:
        assert gcs(url, "arm") == 0
        assert vehicle.armed
        assert gcs(url, "disarm", "--json") == 0
    lines = capsys.readouterr().out.split("\n", 1)
    assert lines[0] == "armed"
    assert json.loads(lines[1]) == {"done": "disarmed", "mode": "MANUAL", "armed": False}


def test_a_refusal_is_one_line_and_exit_code_1(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    vehicle.results[400] = mavlink.MAV_RESULT_DENIED
    vehicle.reports = ["arming denied: battery 3 %, minimum 30 %"]
    with on_the_air(vehicle) as url:
        assert gcs(url, "arm") == 1
    said = capsys.readouterr()
    assert said.err == "wingbeat: COMPONENT_ARM_DISARM denied: arming denied: battery 3 %, minimum 30 %\n"
    assert said.out == ""


def test_mode_by_name_in_any_case(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    with on_the_air(vehicle) as url:
        assert gcs(url, "mode", "altitude-hold") == 0
        assert vehicle.custom_mode == 2 << 16
        assert gcs(url, "mode", "hover") == 2
    assert capsys.readouterr().err.startswith(
        "wingbeat: the vehicle has no mode 'hover'; it has ALTITUDE_HOLD, AUTO,"
    )


def test_negative_numbers_with_an_exponent_are_values(capsys: Capture) -> None:
    """GIVEN -1e9 and -.5e-2 as a value THEN they are numbers, and an unknown option stays one."""
    parser = build_parser()
    for text in ("-1e9", "-.5E-2", "-2.", "-7"):
        assert parser.parse_args(["udpin:0.0.0.0:1", "param", "set", "PITCH_P", text]).value == float(text)
    with pytest.raises(InputError, match="VALUE"):
        parser.parse_args(["udpin:0.0.0.0:1", "param", "set", "PITCH_P", "-e9"])


def test_parameters_list_get_and_set(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    with on_the_air(vehicle) as url:
        assert gcs(url, "param", "list", "GAIN_1", "--json") == 0
        listed = json.loads(capsys.readouterr().out)
        assert [row["name"] for row in listed["parameters"]] == ["GAIN_1", *(f"GAIN_1{n}" for n in range(10))]
        assert gcs(url, "param", "set", "GAIN_7", "-0.25") == 0
        assert vehicle.values["GAIN_7"] == -0.25
        assert gcs(url, "param", "get", "GAIN_7", "--json") == 0
    document = capsys.readouterr().out.split("\n", 1)[1]
    assert json.loads(document) == {"name": "GAIN_7", "value": -0.25, "type": "float"}


def test_mission_download_and_upload(tmp_path: Path, capsys: Capture) -> None:
    vehicle = LossyVehicle()
    vehicle.mission = [
        Item(3, 16, (0.0, 0.0, 0.0, 0.0), 389_900_000, -769_400_000, 40.0),
        Item(2, 20, (0,) * 4, 0, 0, 0),
    ]
    file = tmp_path / "flight.waypoints"
    with on_the_air(vehicle) as url:
        assert gcs(url, "mission", "download", str(file)) == 0
        before, vehicle.mission = vehicle.mission, []
        assert gcs(url, "mission", "upload", str(file)) == 0
        assert vehicle.mission == before
        text = file.read_text()
        assert gcs(url, "mission", "download", str(file)) == 2
        assert file.read_text() == text
        assert gcs(url, "mission", "show") == 0
    said = capsys.readouterr()
    assert said.err == f"wingbeat: {file} exists already; choose another name\n"
    assert "fly to" in said.out and "38.990000°  -76.940000°" in said.out and "return to launch" in said.out
    assert "2 items written to" in said.out and "sent 2 mission items" in said.out


def test_a_mission_is_shown_in_words_and_units_and_told_in_si(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    vehicle.mission = list(read_upload(MISSIONS / "circuit.toml", convention_of(0)).mission)
    with on_the_air(vehicle) as url:
        assert gcs(url, "mission", "show", "--json") == 0
        items = json.loads(capsys.readouterr().out)["items"]
        assert gcs(url, "mission", "show") == 0
    rows = capsys.readouterr().out.splitlines()[1:]
    for number, (row, item) in enumerate(zip(rows, items, strict=True)):
        assert row.split()[0] == str(number) and item["does"] in row
    asked = [item["excitation"] for item in items if item["excitation"]]
    assert asked and all(set(EXCITATION) == set(one) for one in asked)


EXCITATION = (
    "shape", "elevator", "throttle", "rudder", "width", "settle", "repeats", "low", "high", "loops",
)  # fmt: skip


def test_the_present_mode_is_spelled_as_in_the_list_of_modes(capsys: Capture) -> None:
    vehicle = LossyVehicle()
    with on_the_air(vehicle) as url:
        assert gcs(url, "mode", "altitude_hold", "--json") == 0
        assert json.loads(capsys.readouterr().out)["mode"] == "ALTITUDE_HOLD"
        assert gcs(url, "status", "--json") == 0
        document = json.loads(capsys.readouterr().out)
        assert document["mode"] in document["modes"] and document["mode"] == "ALTITUDE_HOLD"
        assert gcs(url, "status") == 0
    assert "ALTITUDE_HOLD" in capsys.readouterr().out


def test_status_has_the_documented_keys(capsys: Capture) -> None:
    with on_the_air(LossyVehicle()) as url:
        assert gcs(url, "status", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["mode"] == "MANUAL" and document["armed"] is False and document["system"] == 1
    assert document["altitude"] is None and document["events"] == []
    assert "AUTO" in document["modes"]


def test_nobody_there_is_exit_code_2(capsys: Capture) -> None:
    assert gcs("udpout:127.0.0.1:9", "arm", "--timeout", "0.2") == 2
    assert capsys.readouterr().err == (
        "wingbeat: no vehicle on udpout:127.0.0.1:9: no heartbeat for 0.2 s, no other messages;"
        " check if it needs --signing-key\n"
    )


def test_a_port_that_refuses_is_told_as_such(capsys: Capture) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"tcp:127.0.0.1:{taken.getsockname()[1]}"
        assert gcs(url, "--timeout", "0.3", "status") == 2
    assert capsys.readouterr().err == f"wingbeat: no vehicle on {url}: connection refused\n"
