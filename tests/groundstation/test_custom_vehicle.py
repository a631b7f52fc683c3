"""A vehicle of one's own: a folder for every command, its name, what can be flown."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest
from ports import free_port

from avionics.vehicles import FOLDER as FLIGHT
from groundstation.command.main import main
from groundstation.command.options import name_warnings
from sim_bridge.flight.tuning.proof import Comparison, FlightQuality, Proof
from sim_bridge.vehicles import FOLDER as WORLD
from sim_bridge.vehicles import load_vehicle

Capture = pytest.CaptureFixture[str]
RAVEN = "robo_raven_ii_d"


def copy(folder: Path, name: str = RAVEN) -> Path:
    folder.mkdir()
    for source, target in ((WORLD, "world.toml"), (FLIGHT, "avionics.toml")):
        text = (source / f"{RAVEN}.toml").read_text()
        (folder / target).write_text(text.replace(f'name = "{RAVEN}"', f'name = "{name}"', 1))
    return folder


@pytest.mark.parametrize("ending", ["", "/"])
def test_flight_computer_takes_the_folder_of_a_vehicle(tmp_path: Path, capsys: Capture, ending: str) -> None:
    """GIVEN a folder WHEN no board answers THEN that is what is reported, not the vehicle."""
    folder = copy(tmp_path / "my_bird")
    board = f"hil:tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    words = ["--vehicle", f"{folder}{ending}", "--board", board, "--parameters", "none", "--duration", "0.1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("avionics.board.boards.open_board", refuse)
        assert main(["avionics", *words, "--log", str(tmp_path / "a.mcap")]) == 2
    err = capsys.readouterr().err
    assert "nobody is there" in err and "unknown vehicle" not in err
    assert f'avionics.toml: name = "{RAVEN}" is that of another vehicle; change it to "my_bird"' in err


def refuse(*_: object) -> None:
    from wingbeat.errors import InputError

    raise InputError("nobody is there")


def test_copied_name_is_reported(tmp_path: Path, capsys: Capture) -> None:
    folder = copy(tmp_path / "my_bird")
    assert main(["vehicles", str(folder)]) == 0
    err = capsys.readouterr().err
    assert err.count("is that of another vehicle") == 2 and "world.toml" in err and "avionics.toml" in err
    assert main(["vehicles", str(copy(tmp_path / "other", "other"))]) == 0
    assert capsys.readouterr().err == ""
    assert name_warnings(load_vehicle(RAVEN)) == []


def test_list_marks_which_vehicles_can_be_flown(capsys: Capture) -> None:
    assert main(["vehicles", "--json"]) == 0
    flies = {row["name"]: row["flies"] for row in json.loads(capsys.readouterr().out)["vehicles"]}
    assert main(["vehicles"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "can fly" in lines[0]
    for name, flown in flies.items():
        (line,) = [line for line in lines if line.startswith(name)]
        assert (" yes " in line) == flown and (" no " in line) == (not flown)
    assert any(flies.values()) and not all(flies.values())


FLIGHT_BEFORE = FlightQuality(2, 36.0, False, 0.5, 0.1, 0.05, 0.04, 0.1, 0.1, 0.02, 15.0)


@pytest.mark.parametrize(
    ("after", "expected"),
    [
        (FLIGHT_BEFORE, Comparison.SAME),
        (FLIGHT_BEFORE._replace(altitude_rms=0.3), Comparison.BETTER),
        (FLIGHT_BEFORE._replace(altitude_rms=0.3, heading_rms=0.25), Comparison.WORSE),
        (FLIGHT_BEFORE._replace(altitude_rms=0.3, touched=True), Comparison.WORSE),
        (FLIGHT_BEFORE._replace(altitude_rms=0.3, completed_legs=1), Comparison.WORSE),
    ],
)
def test_flights_are_compared(after: FlightQuality, expected: Comparison) -> None:
    assert Proof(FLIGHT_BEFORE, after).comparison is expected
    opposite = {Comparison.BETTER: Comparison.WORSE, Comparison.WORSE: Comparison.BETTER}
    assert Proof(after, FLIGHT_BEFORE).comparison is opposite.get(expected, expected)


@pytest.mark.parametrize(("force", "code"), [((), 1), pytest.param(("--force",), 0, marks=pytest.mark.validate)])
def test_gains_that_fly_worse_are_not_written(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, force: tuple[str, ...], code: int
) -> None:
    model = Path(__file__).parents[1] / "data" / "models" / f"{RAVEN}.toml"
    worse = Proof(FLIGHT_BEFORE, FLIGHT_BEFORE._replace(pitch_rms=0.1))
    monkeypatch.setattr("groundstation.command.tune._proof", lambda *_: worse)
    out = tmp_path / "tuned"
    assert main(["tune", str(model), "--out", str(out), *force]) == code
    said = capsys.readouterr().out
    assert "flies worse: errors 1.19 times those before" in said
    assert out.exists() == bool(force) and ("--force writes gains that fly worse" in said) == (not force)
