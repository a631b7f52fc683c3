"""The command as a whole: help, bad input, JSON; every failure is one line and an exit code."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from avionics.board.parameter_file import ParameterFile
from avionics.messages import Attitude
from avionics.state import zero
from avionics.topics import ATTITUDE
from avionics.vehicles import load_vehicle
from avionics.vehicles.loader import FOLDER as COMPUTERS
from groundstation.command.main import SUBCOMMANDS, main
from logs.recorder import McapRecorder
from sim_bridge.environment.levels import LEVELS
from sim_bridge.vehicles import FOLDER as WORLDS

Capture = pytest.CaptureFixture[str]
WINGBEAT = (sys.executable, "-m", "groundstation.command.main")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log of two seconds of attitude."""
    path = tmp_path / "short.mcap"
    recorder = McapRecorder(path, start_epoch_ns=0)
    recorder.note("wingbeat.avionics", {"vehicle": "test_bird"})
    for tick in range(400):
        recorder.record(ATTITUDE, zero(Attitude)._replace(time_us=tick * 5000))
    recorder.close()
    return path


def error_text(capsys: Capture) -> str:
    """The one line on stderr; nothing may be on stdout."""
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("wingbeat: ") and said.err.count("\n") == 1
    return said.err


def test_overview_names_every_command(capsys: Capture) -> None:
    for words in ([], ["--help"], ["help"]):
        assert main(words) == 0
        text = capsys.readouterr().out
        assert all(f"\n  {name} " in text for name in SUBCOMMANDS)


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_every_command_helps_with_an_example(name: str, capsys: Capture) -> None:
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"usage: wingbeat {name}" in text
    assert "example" in text and f"\n  wingbeat {name}" in text
    assert "--json" not in text or "keys of --json:" in text


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_the_keys_of_json_are_a_table_that_fits_the_terminal(
    name: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([name, "--help"]) == 0
    lines = capsys.readouterr().out.partition("keys of --json:\n")[2].splitlines()
    assert all(len(line) <= 80 for line in lines)
    columns = {line.rindex("  ") for line in lines if "  " in line.lstrip()}
    assert len(columns) <= 1


@pytest.mark.parametrize("name", ["fly", "sim"])
def test_every_level_of_turbulence_is_named(name: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    assert main([name, "--help"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("  --turbulence"))
    assert all(level in line.replace(",", " ").split() for level in LEVELS)
    assert main([name, "--turbulence", "storm"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and all(level in told.replace(",", " ").split() for level in LEVELS)


def test_the_overview_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom groundstation.command.main import main\nmain([])\n"
        "print(sorted({'numpy', 'rich', 'pymavlink', 'numba', 'mcap'} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]\n"


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["soar"], "unknown command 'soar'; commands: fly,"),
        (["fly", "--vehicle", "no_such_bird"], "no_such_bird"),
        (["fly", "--mission", "no_such_mission"], "no mission no_such_mission"),
        (["fly", "--speed", "fast"], "fast is not a number"),
        (["fly", "--speed", "0"], "0 is not above 0"),
        (["fly", "--duration", "nan"], "nan is not a finite number"),
        (["fly", "--duration", "-1"], "-1 is not above 0"),
        (["fly", "--seed", "-3"], "-3 is not a whole number"),
        (["fly", "--vibration", "loud"], "'loud' is none of none, vehicle or a factor from 0"),
        (["fly", "--vibration", "1e9"], "vibration must be a factor from 0 (none) to 100, not 1e+09"),
        (["fly", "--seed", "1.5"], "1.5 is not a whole number"),
        (["fly", "--gcs", "http://here"], "is not one of udpin:HOST:PORT"),
        (["fly", "--fast"], "unrecognized arguments: --fast"),
        (["log", "view", "a.mcap", "--fast"], "unrecognized arguments: --fast (see wingbeat log view --help)"),
        (["gcs", "udpin:0.0.0.0:14550", "status", "--fast"], "--fast (see wingbeat gcs URL status --help)"),
        (["fly", "--aerodynamics", "panels"], 'unknown aerodynamic model "panels"; known: strip_theory, '),
        (["fly", "--aerodynamics", "regression"], "no section [regression]; it has strip_theory, quasi_steady"),
        (["sim", "--vehicle", "no_such_bird"], "no_such_bird"),
        (["sim", "--aerodynamics", "panels"], 'unknown aerodynamic model "panels"'),
        (["sim", "--aerodynamics", "regression"], "no section [regression]"),
        (["sim", "--listen", "udpin:127.0.0.1:4560"], "a world listens on tcp:HOST:PORT"),
        (["fly", "--fault", "gps_lost@-5"], "fault gps_lost: its time must be 0 s or more since boot, not -5"),
        (["fly", "--fault", "gps_lost@nan"], "must be 0 s or more since boot, not nan"),
        (["fly", "--fault", "gps_lost@300"], "fault gps_lost@300: the flight ends at 300 s at the latest"),
        (["fly", "--duration", "20", "--fault", "gps_lost@30-40"], "fault gps_lost@30-40: the flight ends at 20 s"),
        (["sim", "--duration", "20", "--fault", "gps_lost@30"], "fault gps_lost@30: the flight ends at 20 s"),
        (["avionics"], "--board"),
        (["gcs", "udpin:0.0.0.0", "status"], "is not one of udpin:HOST:PORT"),
        (["gcs", "udpin:0.0.0.0:14550", "dance"], "dance"),
        (["log", "info", "no_such.mcap"], "cannot read no_such.mcap"),
        (["identify", "no_such.mcap"], "cannot read no_such.mcap"),
        (
            ["identify", "a.mcap", "b.mcap"],
            "several logs give their modes together (wingbeat identify a.mcap b.mcap modes)",
        ),
        (["identify", "a.mcap", "b.mcap", "aero"], "aero is of one log at a time"),
        (["identify", "a.mcap", "b.mcap", "modes", "--report", "no/r.html"], "no/r.html: there is no folder no"),
        (["identify", "a.mcap", "a.mcap", "modes"], "a.mcap is named twice"),
        (["identify", "a.mcap", "modes", "--validate", "a.mcap"], "every log is held out for validation"),
        (["identify", "a.mcap", "aero", "--validate", "b.mcap"], "aero is of one log at a time"),
        (["identify", "a.mcap", "modes", "--validate-share", "0.3"], "between 0 and 1, of two logs or more"),
        (
            ["identify", "a.mcap", "b.mcap", "modes", "--validate", "b.mcap", "--validate-share", "0.3"],
            "--validate-share draws what is held out",
        ),
        (["identify", "a.csv", "--map", "m.toml", "--validate", "b.csv"], "--validate and --validate-share are for"),
        (["identify", "a.mcap", "b.mcap", "modes", "--json"], "cannot read a.mcap"),
        (["identify", "a.mcap", "b.csv"], "tables need --map MAP.toml"),
        (["replay", "--imu", "no_such.npz"], "no_such.npz"),
        (["log", "import", "."], "cannot read .: it is a folder"),
        (["replay"], "--imu"),
        (["vehicles", "no_such_bird"], "no_such_bird"),
        (["fyl"], "unknown command 'fyl' (meant 'fly'?); commands: fly,"),
        (["trim", "robo_raven_ii"], "unknown vehicle 'robo_raven_ii' (meant 'robo_raven_ii_d'?); known:"),
        (["fly", "--vehicle", "arizona_100"], "(meant 'arizona_100cm'?)"),
        (["fly", "--mision", "circuit"], "--mision circuit (meant '--mission'?) (see wingbeat fly --help)"),
        (["log", "inof", "a.mcap"], "(meant 'info'?) (see wingbeat log --help)"),
        (["gcs", "udpin:0.0.0.0:14550", "staus"], "(meant 'status'?) (see wingbeat gcs --help)"),
        (["gcs", "udpin:0.0.0.0:14550", "param", "gett", "X"], "(meant 'get'?)"),
        (["fly", "--sticks", "by_hand.csv"], "cannot read by_hand.csv: there is no such file\n"),
        (["fly", "--mission", "no.plan"], "no mission no.plan: neither a file nor one of circuit\n"),
        (["fly", "--vehicle", "no.toml"], "cannot read vehicle file no.toml: there is no such file\n"),
        (["tune", "no.toml"], "cannot read vehicle file no.toml: there is no such file\n"),
        (["tune", "no.json"], "unknown vehicle 'no.json'"),
        (["campaign", "no.toml"], "cannot read campaign no.toml: there is no such file\n"),
        (["design", "robo_raven_ii_d", "--out", "no/x.toml"], "cannot write no/x.toml: there is no folder no\n"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    words: list[str], part: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert part in error_text(capsys)
    assert not any(tmp_path.iterdir()), "bad input must leave nothing behind"


def test_a_malformed_mission_names_item_key_and_range(tmp_path: Path, capsys: Capture) -> None:
    mission = tmp_path / "bad.toml"
    mission.write_text('[[item]]\nkind = "takeoff"\naltitude = -4\n')
    assert main(["fly", "--mission", str(mission)]) == 2
    line = error_text(capsys)
    assert "item 1" in line and "altitude" in line and "1 to 1000 m" in line


def test_a_malformed_vehicle_names_the_key(tmp_path: Path, capsys: Capture) -> None:
    vehicle = tmp_path / "bird.toml"
    vehicle.write_text("[wings]\n")
    assert main(["fly", "--vehicle", str(vehicle)]) == 2
    assert "unknown section [wings]" in error_text(capsys)


@pytest.mark.parametrize("command", ["fly", "sim"])
def test_bodies_that_make_no_vehicle_are_told_before_anything_is_recorded(
    command: str, tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, started = tmp_path / "bird", tmp_path / "here"
    folder.mkdir()
    started.mkdir()
    monkeypatch.chdir(started)
    text = (WORLDS / "robo_raven_ii_d.toml").read_text(encoding="utf-8")
    (folder / "world.toml").write_text(text.replace('mirror_of = "right_wing"', 'mirror_of = "wing"'))
    (folder / "avionics.toml").write_text((COMPUTERS / "robo_raven_ii_d.toml").read_text(encoding="utf-8"))
    assert main([command, "--vehicle", str(folder if command == "fly" else folder / "world.toml")]) == 2
    assert "bodies.left_wing.mirror_of" in error_text(capsys)
    assert not any(started.iterdir())


@pytest.mark.parametrize(
    "verb", [["log", "info"], ["log", "view"], ["log", "export"], ["log", "recover"], ["identify"]]
)
@pytest.mark.parametrize("content", [b"", b"not a log", b"\x89MCAP"])
def test_what_is_no_log_is_refused_and_kept(verb: list[str], content: bytes, tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    assert main([*verb, str(path)]) == 2
    error_text(capsys)
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("verb", [["log", "info"], ["log", "view"], ["replay"]])
@pytest.mark.parametrize(
    ("name", "content", "part"),
    [
        ("00000012.BIN", b"any", "wingbeat log import 00000012.BIN makes one of it\n"),
        ("a.tlog", b"any", "wingbeat log import a.tlog makes one of it\n"),
        ("flight", b"ULog\x01\x12\x35\x01", "wingbeat log import flight makes one of it\n"),
        ("a flight.log", b"\xa3\x95\x80\x80", "wingbeat log import 'a flight.log' makes one of it\n"),
        ("README.md", b"# Wingbeat", "makes one of .bin, .ulg, .tlog, .c3d, and with --map MAP.toml of any table\n"),
    ],
)
def test_what_makes_a_log_of_another_file_is_told(
    verb: list[str], name: str, content: bytes, part: str,
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(content)
    assert main([*verb, name]) == 2
    told = error_text(capsys)
    assert told.startswith(f"wingbeat: {name} is not an MCAP log: ") and told.endswith(part)
    (tmp_path / "a.csv").write_text("t,a\n1,2\n")
    assert main([*verb, "a.csv"]) == 2
    assert "--map MAP.toml" in error_text(capsys)


@pytest.mark.parametrize("name", ["a.bin", "a.ulg", "a.tlog"])
def test_identify_imports_a_log_of_another_program_and_refuses_a_false_one(
    name: str, tmp_path: Path, capsys: Capture
) -> None:
    path = tmp_path / name
    path.write_bytes(b"not a log")
    assert main(["identify", str(path)]) == 2
    assert error_text(capsys).startswith(f"wingbeat: {path}: ")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("command", [["fly"], ["avionics", "--board", "hil:tcp:127.0.0.1:9"]])
def test_the_parameters_of_another_vehicle_are_refused_and_left_alone(
    command: list[str], tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "raven.json"
    ParameterFile(path, load_vehicle("robo_raven_ii_d")).save({"PITCH_P": 0.7})
    before = path.read_bytes()
    assert main([*command, "--vehicle", "arizona_100cm", "--parameters", "raven.json"]) == 2
    assert "raven.json belongs to vehicle robo_raven_ii_d and is not changed" in error_text(capsys)
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == before


@pytest.mark.parametrize("command", [["fly"], ["sim"], ["avionics", "--board", "hil:tcp:127.0.0.1:9"]])
def test_an_existing_log_is_never_overwritten(command: list[str], tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(b"precious")
    where = ["--listen", "tcp:127.0.0.1:0"] if command == ["sim"] else []
    if where:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            where[1] = f"tcp:127.0.0.1:{probe.getsockname()[1]}"
    assert main([*command, *where, "--log", str(path)]) == 2
    assert str(path) in error_text(capsys)
    assert path.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [path]


def test_a_port_in_use_is_told_before_anything_is_recorded(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert main(["fly", "--gcs", f"udpin:127.0.0.1:{port}"]) == 2
        assert f"cannot listen on port {port}" in error_text(capsys)
        assert main(["gcs", f"udpin:127.0.0.1:{port}", "monitor"]) == 2
        assert f"cannot listen on port {port}" in error_text(capsys)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        assert main(["sim", "--listen", f"tcp:127.0.0.1:{port}"]) == 2
        assert f"cannot listen on port {port}" in error_text(capsys)
    assert not any(tmp_path.iterdir())


def test_log_info_and_export(log: Path, tmp_path: Path, capsys: Capture) -> None:
    assert main(["log", "info", str(log), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["vehicle"] == "test_bird" and document["complete"] is True
    assert [(row["topic"], row["messages"]) for row in document["topics"]] == [("/attitude/ahrs", 400)]
    assert main(["log", "info", str(log)]) == 0
    text = capsys.readouterr().out
    assert "test_bird" in text and "/attitude/ahrs" in text and "200 Hz" in text
    assert main(["log", "export", str(log), "--to", str(tmp_path / "csv"), "--json"]) == 0
    (file,) = json.loads(capsys.readouterr().out)["files"]
    assert len(Path(file).read_text().splitlines()) == 401
    assert main(["log", "export", str(log), "--topic", "/nope"]) == 2
    assert "/nope; it has" in error_text(capsys)
    assert main(["log", "export", str(log), "--topic", "/attitude/ahsr"]) == 2
    assert "/attitude/ahsr (meant '/attitude/ahrs'?); it has" in error_text(capsys)


def test_a_part_of_a_log_is_exported_in_the_form_asked_for(log: Path, tmp_path: Path, capsys: Capture) -> None:
    part = ["--topic", "/attitude/ahrs.roll", "--rate", "10", "--start", "0.5", "--end", "1.5"]
    assert main(["log", "export", str(log), "--to", str(tmp_path / "a.csv"), *part]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'a.csv'}\n"
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "time [s],/attitude/ahrs.roll [rad]" and len(lines) == 11 and lines[1] == "0.5,0.0"
    assert main(["log", "export", str(log), "--format", "mat", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == {"files": [str(log.with_suffix(".mat"))], "left_out": []}
    assert main(["log", "export", str(log), "--format", "csv"]) == 0
    assert (log.with_suffix("") / "attitude_ahrs.csv").exists()
    capsys.readouterr()
    assert main(["log", "export", str(log), "--format", "xls"]) == 2
    assert "invalid choice: 'xls'" in error_text(capsys)
    assert main(["log", "export", str(log), "--to", str(tmp_path / "b.csv"), "--rate", "0"]) == 2
    assert "0 is not above 0" in error_text(capsys)
    assert main(["log", "export", str(log), "--to", str(tmp_path / "a.csv"), *part]) == 2
    assert "exists: it is not overwritten" in error_text(capsys)


def test_log_view_writes_a_page_beside_the_log_and_never_over_another(
    log: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["log", "view", str(log), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["path"] == str(log.with_suffix(".html")) and Path(told["path"]).stat().st_size == told["bytes"]
    assert "Pitch" in told["panels"] and "truth" in told["missing"] and told["events"] == 0
    assert main(["log", "view", str(log)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith(f"{log.with_name(log.stem + '-2.html')}   ") and said[1].startswith("not in this log: ")
    page = tmp_path / "mine.html"
    page.write_text("mine")
    assert main(["log", "view", str(log), "--to", str(tmp_path / "to.html")]) == 0
    assert (tmp_path / "to.html").exists() and capsys.readouterr().out.startswith(str(tmp_path / "to.html"))
    assert main(["log", "view", str(log), "--out", str(page)]) == 2
    assert capsys.readouterr().err == f"wingbeat: {page} exists: it is not overwritten\n"
    assert page.read_text() == "mine"


def test_a_log_that_was_cut_off_says_so_and_is_recovered(log: Path, capsys: Capture) -> None:
    log.write_bytes(log.read_bytes()[:-700])
    assert main(["log", "info", str(log)]) == 0
    assert "wingbeat log recover" in capsys.readouterr().out
    assert main(["log", "recover", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damage"]
    assert main(["log", "info", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damage"] == []


def test_a_log_without_an_excitation_is_refused_with_the_reason(log: Path, capsys: Capture) -> None:
    assert main(["identify", str(log), "modes"]) == 2
    assert "excitation" in error_text(capsys)


def test_a_vehicle_without_a_flight_computer_is_not_flown(capsys: Capture) -> None:
    assert main(["fly", "--vehicle", "slow_hawk"]) == 2
    assert "slow_hawk has no flight-computer file: it can be trimmed and linearized" in error_text(capsys)


def test_vehicles_lists_values_with_sources(capsys: Capture) -> None:
    assert main(["vehicles", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["vehicles"]
    assert {"robo_raven_ii_d", "arizona_100cm"} <= {vehicle["name"] for vehicle in listed}
    flying = {"robo_raven_ii_d", "arizona_100cm", "ulg_ornithopter"}
    assert {bird["name"] for bird in listed if bird["flies"]} == flying
    assert all(vehicle["sources"]["published"] > 0 for vehicle in listed)
    models = {"strip_theory", "quasi_steady", "blade_element"}
    assert all(models <= set(bird["aerodynamics"]) for bird in listed if bird["flies"])
    assert main(["vehicles", "robo_raven_ii_d", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)["values"]
    assert all(value["kind"] in ("published", "identified", "chosen") and value["source"] for value in values)
    units = {value["key"]: value["unit"] for value in values}
    assert (units["bodies.fuselage.mass"], units["drive.pwm_frequency"]) == ("kg", "Hz")
    assert (units["drive.kind"], units["wing.strips"]) == (None, "-")
    assert main(["vehicles", "robo_raven_ii_d"]) == 0
    told = capsys.readouterr().out
    assert re.search(r"bodies\.fuselage\.mass +[0-9.]+ kg ", told)
    assert re.search(r"fuselage\.imu_position +0\.02 0 0 m ", told)
    assert "flown with strip_theory; --aerodynamics takes quasi_steady, blade_element, vortex_lattice too" in told


def test_a_folder_is_a_vehicle_of_the_list_too(tmp_path: Path, capsys: Capture) -> None:
    folder = tmp_path / "bird"
    folder.mkdir()
    (folder / "world.toml").write_text((WORLDS / "robo_raven_ii_d.toml").read_text(encoding="utf-8"))
    for flies in (False, True):
        if flies:
            (folder / "avionics.toml").write_text((COMPUTERS / "robo_raven_ii_d.toml").read_text(encoding="utf-8"))
        assert main(["vehicles", str(folder), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["vehicles"][0]["flies"] is flies and told["values"]
        assert main(["vehicles", str(folder)]) == 0
        assert ("the flight computer's file has" in capsys.readouterr().out) is flies
    (folder / "avionics.toml").unlink()
    assert main(["fly", "--vehicle", str(folder)]) == 2
    assert error_text(capsys) == (
        f"wingbeat: cannot read vehicle file {folder / 'avionics.toml'}: there is no such file\n"
    )


@pytest.mark.parametrize("command", [["fly"], ["campaign"], ["avionics", "--board", "hil:tcp:127.0.0.1:9"]])
def test_a_folder_that_cannot_be_written_to_is_one_clear_line(
    command: list[str], tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recordings").write_text("a file where the folder would be")
    campaign = [str(Path(__file__).parents[2] / "docs" / "examples" / "gusts.toml")]
    assert main([*command, *(campaign if command == ["campaign"] else [])]) == 2
    assert "recordings is not a folder" in error_text(capsys)


def test_a_file_that_the_system_refuses_is_told_with_what_was_wanted_of_it(capsys: Capture) -> None:
    assert main(["validate", "--only", "grauer", "--plots", "/dev/null/pictures"]) == 2
    assert error_text(capsys) == "wingbeat: cannot read or write /dev/null/pictures: Not a directory\n"


def test_the_help_of_gcs_names_the_verbs_as_they_are_written(capsys: Capture) -> None:
    assert main(["gcs", "--help"]) == 0
    told = capsys.readouterr().out
    assert "or compare" not in told and "set, compare" not in told
    assert len(re.findall(r"^ +(?:param|mission)  +.*\bdiff\b", told, re.M)) == 2


@pytest.mark.parametrize("name", [[], ["robo_raven_ii_a"], ["hawkmoth"]])
def test_vehicles_are_told_within_a_hundred_columns(name: list[str], capsys: Capture) -> None:
    assert main(["vehicles", *name]) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= 100 and "…" not in told.replace(" … ", "")


def test_a_broken_pipe_is_quiet(log: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([*WINGBEAT, "log", "info", str(log)], stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert done.stderr == b"" and done.returncode == 0


def test_ctrl_c_ends_quietly_with_130() -> None:
    child = subprocess.Popen(
        [*WINGBEAT, "gcs", "udpout:127.0.0.1:9", "monitor"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline and not _listening(child.pid):
        time.sleep(0.05)
    child.send_signal(2)
    out, err = child.communicate(timeout=20)
    assert (child.returncode, out, err) == (130, b"", b"")


def _listening(pid: int) -> bool:
    """Whether the process has opened its link (a socket among its files)."""
    folder = Path(f"/proc/{pid}/fd")
    try:
        return any(str(file.readlink()).startswith("socket:") for file in folder.iterdir())
    except OSError:
        return False


@pytest.mark.parametrize("window", [("--start", "50", "--end", "20"), ("--start", "500"), ("--end", "-1")])
def test_a_window_without_anything_is_not_exported(log: Path, window: tuple[str, ...], capsys: Capture) -> None:
    assert main(["log", "export", str(log), "--to", str(log.with_suffix(".npz")), *window]) == 2
    assert "no data between" in error_text(capsys) and not log.with_suffix(".npz").exists()
