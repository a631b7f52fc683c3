"""The verbs of ``wingbeat gcs`` that list, compare, watch and say how far they are."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from lossy_vehicle import LossyVehicle, on_the_air

from avionics.link.dialect import mavlink
from groundstation.command.main import main
from groundstation.link.missions import Item
from groundstation.views.progress import ProgressBar

Capture = pytest.CaptureFixture[str]


class Talking(LossyVehicle):
    """Says its attitude and speed whenever it is spoken to."""

    def answers(self, message: object) -> list[object]:
        turn = mavlink.MAVLink_attitude_message(1000 + 100 * len(self.requests), 0.25, -0.5, 1.0, 0, 0, 0)
        return [*super().answers(message), turn, mavlink.MAVLink_vfr_hud_message(7.5, 6.0, 90, 50, 40.0, 0.0)]


def gcs(*words: str) -> int:
    return main(["gcs", *words, "--no-record"])


def test_watch_prints_each_field_as_it_comes_with_its_unit(capsys: Capture) -> None:
    with on_the_air(Talking()) as url:
        assert gcs(url, "watch", "attitude.pitch", "VFR_HUD.airspeed", "ATTITUDE.roll", "--count", "2") == 0
    lines = [line.split(maxsplit=1)[1] for line in capsys.readouterr().out.splitlines()]
    assert sorted(lines) == ["ATTITUDE.pitch -0.5 rad  ATTITUDE.roll 0.25 rad", "VFR_HUD.airspeed 7.5 m/s"]


def test_watch_in_json_is_an_object_a_line(capsys: Capture) -> None:
    with on_the_air(Talking()) as url:
        assert gcs(url, "watch", "ATTITUDE.pitch", "--count", "3", "--json") == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert len(lines) == 3 and all(line["ATTITUDE.pitch"] == -0.5 and line["time"] >= 1.1 for line in lines)


def test_watch_asks_for_a_rate_and_a_refusal_ends_it(capsys: Capture) -> None:
    vehicle = Talking()
    with on_the_air(vehicle) as url:
        assert gcs(url, "watch", "ATTITUDE.pitch", "--count", "1", "--rate", "20") == 0
        vehicle.results[mavlink.MAV_CMD_SET_MESSAGE_INTERVAL] = mavlink.MAV_RESULT_UNSUPPORTED
        assert gcs(url, "watch", "ATTITUDE.pitch", "--count", "1", "--rate", "20") == 1
    assert "SET_MESSAGE_INTERVAL denied" in capsys.readouterr().err


class Attended(Talking):
    """Notes what those who speak to it say they are."""

    def __init__(self) -> None:
        super().__init__()
        self.callers: set[int] = set()

    def _heartbeat(self, message: Any) -> list[Any]:
        self.callers.add(message.type)
        return []


@pytest.mark.parametrize(
    "words",
    [
        ("watch", "ATTITUDE.pitch", "--count", "1"),
        ("watch", "ATTITUDE.pitch", "--duration", "1.2"),
        ("record", "a.mcap", "--duration", "0.3"),
    ],
)
def test_who_listens_for_a_while_is_no_ground_station_whose_silence_is_a_lost_link(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    vehicle = Attended()
    with on_the_air(vehicle) as url:
        assert main(["gcs", url, *words]) == 0
    assert vehicle.callers == {mavlink.MAV_TYPE_ONBOARD_CONTROLLER}


def test_what_never_comes_is_said(capsys: Capture) -> None:
    with on_the_air(LossyVehicle()) as url:
        assert gcs(url, "watch", "ATTITUDE.pitch", "--duration", "0.3") == 1
    assert "no ATTITUDE received within 0.3 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("field", "reports"),
    [
        ("pitch", "'pitch' is not MESSAGE.FIELD"),
        ("ATITUDE.pitch", "unknown message ATITUDE (meant 'ATTITUDE'?)"),
        ("ATTITUDE.pich", "ATTITUDE has no field 'pich' (meant 'pitch'?); it has time_boot_ms, roll, pitch"),
        ("BATTERY_STATUS.voltages", "BATTERY_STATUS.voltages is an array of 10: BATTERY_STATUS.voltages[0]"),
        ("BATTERY_STATUS.voltages[10]", "BATTERY_STATUS.voltages is an array of 10"),
        ("ATTITUDE.pitch[0]", "ATTITUDE.pitch is no array"),
    ],
)
def test_a_wrong_field_is_one_line_that_helps(field: str, reports: str, capsys: Capture) -> None:
    assert gcs("udpout:127.0.0.1:9", "watch", field) == 2
    text = capsys.readouterr().err
    assert reports in text and text.count("\n") == 1


def test_names_that_are_near_a_misspelt_one_are_offered(tmp_path: Path, capsys: Capture) -> None:
    file = tmp_path / "a.params"
    file.write_text("1\t1\tGIAN_7\t1.0\t9\n")
    with on_the_air(LossyVehicle()) as url:
        assert gcs(url, "param", "get", "PICH_P") == 1
        assert "PICH_P" in (reports := capsys.readouterr().err) and "(meant 'PITCH_P'?)" in reports
        assert gcs(url, "param", "load", str(file)) == 2
        assert f"no parameter GIAN_7 of {file} (meant 'GAIN_7'?)" in capsys.readouterr().err
        assert gcs(url, "mode", "LOITTER") == 2
        assert "no mode 'LOITTER' (meant 'LOITER'?); it has" in capsys.readouterr().err


def test_parameters_are_compared_with_a_file_both_ways(tmp_path: Path, capsys: Capture) -> None:
    vehicle, file = LossyVehicle(), tmp_path / "a.params"
    with on_the_air(vehicle) as url:
        assert gcs(url, "param", "save", str(file)) == 0
        assert gcs(url, "param", "diff", str(file)) == 0
        vehicle.values["GAIN_3"] = 0.1
        with file.open("a") as more:
            more.write("1\t1\tNEW\t2.5\t9\n")
        assert gcs(url, "param", "diff", str(file)) == 1
        text = capsys.readouterr().out
        assert gcs(url, "param", "diff", str(file), "--json") == 1
    lines = [" ".join(line.split()) for line in text.splitlines()[1:]]
    assert lines == ["GAIN_3 file 3 vehicle 0.1", "NEW file 2.5 vehicle –"]
    document = json.loads(capsys.readouterr().out)
    assert document["same"] is False and document["differences"][1] == {"name": "NEW", "file": 2.5, "vehicle": None}


def test_a_mission_is_compared_with_a_file(tmp_path: Path, capsys: Capture) -> None:
    vehicle, file = LossyVehicle(), tmp_path / "a.waypoints"
    vehicle.mission = [Item(3, 16, (0.0,) * 4, 389_900_000, -769_400_000 + 900 * n, 40.0) for n in range(3)]
    with on_the_air(vehicle) as url:
        assert gcs(url, "mission", "download", str(file)) == 0
        assert gcs(url, "mission", "diff", str(file)) == 0
        vehicle.mission[1] = vehicle.mission[1]._replace(z=55.0)
        vehicle.mission.append(vehicle.mission[0])
        assert gcs(url, "mission", "diff", str(file)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("mission 1  file     fly to") and lines[1].endswith("40 m")
    assert lines[2].strip().startswith("vehicle  fly to") and lines[2].endswith("55 m")
    assert lines[3].startswith("mission 3  file     nothing")


def test_status_tells_how_good_the_link_is(capsys: Capture) -> None:
    with on_the_air(Talking()) as url:
        assert gcs(url, "status", "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["airspeed"] == 7.5 and document["flap_phase"] is None
    assert document["link"]["loss"] == 0.0 and document["link"]["messages_per_s"] > 1.0


def test_orders_without_a_place(capsys: Capture) -> None:
    vehicle = Talking()
    with on_the_air(vehicle) as url:
        for verb in ("return", "land", "takeoff"):
            assert gcs(url, verb) == 0
        assert capsys.readouterr().out.splitlines() == ["return accepted", "land accepted", "takeoff accepted"]
        for verb, mode in (("return", "RETURN"), ("land", "LAND"), ("takeoff", "AUTO")):
            assert gcs(url, verb, "--json") == 0
            assert json.loads(capsys.readouterr().out) == {"done": f"{verb} accepted", "mode": mode, "armed": False}


def test_progress_is_a_line_on_stderr_where_there_is_no_terminal(capsys: Capture) -> None:
    now = [0.0]
    with ProgressBar("parameters", quiet=True, reporting=True, clock=lambda: now[0]) as bar:
        for step in range(60):
            now[0] = 0.1 * step
            bar.show(step, 120, f"got {10 * (step // 10)} of 120 parameters, retrying")
    with ProgressBar("designing", quiet=True, clock=lambda: now[0]) as bar:
        now[0] = 9.0
        bar.show(1, 2, "a step")
    assert capsys.readouterr().err.splitlines() == [
        f"got {n} of 120 parameters, retrying" for n in (10, 20, 30, 40, 50)
    ]


def test_a_lossy_link_says_that_it_retries_and_gets_all(capsys: Capture) -> None:
    with on_the_air(Deaf()) as url:
        assert gcs(url, "param", "list", "--json") == 0
    reports = capsys.readouterr()
    assert len(json.loads(reports.out)["parameters"]) == 40
    assert "got 20 of 40 parameters, retrying" in reports.err.splitlines()


class Deaf(LossyVehicle):
    """Sends half of its list, and hears the first questions after it not at all."""

    def __init__(self) -> None:
        super().__init__()
        self.silent_link = 3 * 12

    def _param_request_list(self, message: object) -> list[object]:
        return super()._param_request_list(message)[:20]

    def _param_request_read(self, message: object) -> list[object]:
        self.silent_link -= 1
        return [] if self.silent_link >= 0 else super()._param_request_read(message)


@pytest.mark.parametrize("place", [("0", "0"), ("0.00000004", "-0.0")])
def test_a_place_that_means_here_on_the_wire_is_refused(place: tuple[str, str], capsys: Capture) -> None:
    assert gcs("udpout:127.0.0.1:9", "--timeout", "0.1", "goto", *place, "--altitude", "30") == 2
    reports = capsys.readouterr().err
    assert "latitude and longitude 0 mean the current position" in reports and reports.count("\n") == 1


class Standing(LossyVehicle):
    """On the ground, where its altitude trembles about 0."""

    def answers(self, message: object) -> list[object]:
        place = mavlink.MAVLink_global_position_int_message(1000, 389_900_000, -769_400_000, 0, -55, 0, 0, 0, 0)
        return [*super().answers(message), place]

    def _command_int(self, message: Any) -> list[Any]:
        self.custom_mode = 4 << 16 | 3 << 24  # LOITER
        return [mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_ACCEPTED)]


def test_goto_on_the_ground_asks_for_an_altitude(capsys: Capture) -> None:
    vehicle = Standing()
    with on_the_air(vehicle) as url:
        assert gcs(url, "goto", "38.99", "-76.94") == 2
        assert capsys.readouterr().err.endswith("too low for a circle: specify --altitude\n")
        assert "COMMAND_INT" not in vehicle.requests
        assert gcs(url, "goto", "38.99", "-76.94", "--altitude", "30") == 0


def test_loaded_parameters_are_told_with_what_they_were_before(tmp_path: Path, capsys: Capture) -> None:
    vehicle, file = LossyVehicle(), tmp_path / "a.params"
    with on_the_air(vehicle) as url:
        assert gcs(url, "param", "save", str(file)) == 0
        vehicle.values["GAIN_3"] = 0.125
        capsys.readouterr()
        assert gcs(url, "param", "load", str(file)) == 0
        assert capsys.readouterr().out.splitlines() == ["GAIN_3            0.125 -> 3", "1 parameter changed"]
        vehicle.values["GAIN_3"] = 0.125
        assert gcs(url, "param", "load", str(file), "--json") == 0
    document = json.loads(capsys.readouterr().out)
    assert document["parameters"] == [{"name": "GAIN_3", "value": 3.0, "type": "float", "before": 0.125}]


@pytest.mark.parametrize(
    ("words", "reports"),
    [
        (("mission", "download", "m.toml"), "m.toml: its name must end in .waypoints or "),
        (("record", "q.txt"), "q.txt: its name must end in .mcap"),
    ],
)
def test_a_file_is_written_in_the_format_of_its_name_alone(
    words: tuple[str, ...], reports: str, capsys: Capture
) -> None:
    assert main(["gcs", "udpout:127.0.0.1:9", *words]) == 2
    text = capsys.readouterr().err
    assert reports in text and text.count("\n") == 1
