"""``wingbeat tune`` and ``wingbeat linearize --out``: what they print and write, what they refuse."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from avionics.vehicles import load_vehicle
from groundstation.command import tune
from groundstation.command.main import main
from sim_bridge.flight.tuning.proof import Flown
from sim_bridge.vehicles import load_vehicle as load_world

Capture = pytest.CaptureFixture[str]
MODELS = Path(__file__).parents[1] / "data" / "models"
RAVEN, ARIZONA = str(MODELS / "robo_raven_ii_d.toml"), str(MODELS / "arizona_100cm.toml")

SHARP = (
    ("heading", "proportional", 0.6),
    ("roll", "proportional", 2.5),
    ("roll", "integral", 0.3),
    ("roll", "damping", 0.4),
    ("tail", "rudder_share", 0.45),
)


def badly_tuned(name: str, folder: Path) -> str:
    """A user's vehicle whose lateral loops are too sharp, whatever the flown vehicle's gains may be."""
    text = load_vehicle(name).file.text
    for section, key, value in SHARP:
        text, count = re.subn(
            rf"(?ms)(^\[{section}\].*?^{key} = {{ value = )[-\d.]+", rf"\g<1>{value}", text, count=1
        )
        assert count == 1
    folder.mkdir()
    (folder / "avionics.toml").write_text(text)
    (folder / "world.toml").write_text(load_world(name).text)
    return str(folder)


@pytest.mark.validate
def test_a_design_is_told_to_people_on_a_hundred_columns(capsys: Capture, tmp_path: Path) -> None:
    out = tmp_path / "my_bird"
    bird = badly_tuned("robo_raven_ii_d", tmp_path / "sharp")
    assert main(["tune", RAVEN, "--vehicle", bird, "--no-fly", "--out", str(out)]) == 0
    said = capsys.readouterr()
    for word in ("pitch", "roll", "climb", "altitude", "heading", "before", "after", "gain margin", "phase margin"):
        assert word in said.out
    assert re.search(r"roll +before +3\.0 dB !", said.out), "what falls short of 6 dB is marked"
    assert "gains of roll are for 6.8 m/s before, 6.8 m/s after" in said.out
    table = [line.rstrip() for line in said.out.splitlines() if "written" not in line]
    assert max(len(line) for line in table) <= 100
    assert str(out / "avionics.toml") in said.out.replace("\n", "")
    assert load_vehicle(out / "avionics.toml").gains != load_vehicle("robo_raven_ii_d").gains
    assert load_world(str(out / "world.toml")).name == "robo_raven_ii_d"


@pytest.mark.validate
def test_what_was_written_is_tuned_no_more(capsys: Capture, tmp_path: Path) -> None:
    """The folder is a vehicle; its own gains are the design's."""
    out = tmp_path / "my_bird"
    assert main(["tune", ARIZONA, "--no-fly", "--out", str(out)]) == 0
    capsys.readouterr()
    assert main(["tune", ARIZONA, "--vehicle", str(out), "--no-fly", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    for loop in told["loops"]:
        assert loop["before"]["keeps"], loop["name"]
    inner = [loop for loop in told["loops"] if loop["name"] in ("pitch", "roll")]
    assert all(loop["before"]["gains"] == loop["after"]["gains"] for loop in inner)


@pytest.mark.validate
def test_tuning_flies_before_and_after_and_tells_programs(capsys: Capture, tmp_path: Path) -> None:
    bird = badly_tuned("arizona_100cm", tmp_path / "sharp")
    assert main(["tune", ARIZONA, "--vehicle", bird, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {name for key in tune.JSON_KEYS for name in key.split(", ")}
    assert all(loop["after"]["keeps"] and loop["after"]["stable"] for loop in told["loops"])
    assert not all(loop["before"]["keeps"] for loop in told["loops"])
    assert told["written"] == []
    before, after = told["flights"]["before"], told["flights"]["after"]
    assert set(before) == set(Flown._fields)
    for flight in (before, after):
        assert flight["holds"] == 2 and flight["airtime"] == pytest.approx(36.0) and not flight["touched"]
    # The lateral loops without margins chased the gusts with the rudder.
    assert after["rudder_rate"] < 0.5 * before["rudder_rate"]
    assert after["altitude_rms"] < 2.0 and after["heading_rms"] < 0.2 and after["pitch_rms"] < 0.04


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["tune"], "the following arguments are required: VEHICLE|MODEL"),
        (["tune", "no_such_bird"], "unknown vehicle 'no_such_bird'"),
        (["tune", "robo_raven_ii_a"], "robo_raven_ii_a has no file for the flight computer"),
        (["tune", "arizona_100cm", "--airspeed", "16"], "no trim at 16 m/s"),
        (["tune", "arizona_100cm", "--airspeed", "0"], "0 is not above 0"),
        (["tune", "arizona_100cm", "--vehicle", "arizona_100cm"], "--vehicle goes with a MODEL"),
        (["tune", RAVEN, "--airspeed", "7"], "go with a VEHICLE"),
        (["tune", RAVEN, "--vehicle", "no_such_bird"], "unknown vehicle 'no_such_bird'"),
        (["tune", "no_such_model.json"], "unknown vehicle 'no_such_model.json'"),
    ],
)
def test_what_cannot_be_tuned_is_one_line(words: list[str], part: str, capsys: Capture) -> None:
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == "" and part in said.err
    assert said.err.startswith("wingbeat: ") and said.err.count("\n") == 1


@pytest.mark.parametrize("taken", ["avionics.toml", "world.toml"])
def test_an_existing_vehicle_is_never_overwritten(taken: str, capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / taken).write_text("mine")
    assert main(["tune", RAVEN, "--no-fly", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and f"{taken} exists already and is not overwritten" in said.err
    assert [path.name for path in tmp_path.iterdir()] == [taken]
    assert (tmp_path / taken).read_text() == "mine"


@pytest.mark.validate
def test_a_linear_model_is_written_for_tune_and_not_over_another(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    assert main(["linearize", "arizona_100cm", "--out", str(path)]) == 0
    written = path.read_text()
    assert main(["linearize", "arizona_100cm", "--out", str(path)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert path.read_text() == written
    assert main(["tune", str(path), "--no-fly", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["loops"][0]["name"] == "pitch"


def test_a_file_that_is_no_model_is_told_apart(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text("[1, 2]")
    assert main(["tune", str(path)]) == 2
    assert "not a model: no [longitudinal]" in capsys.readouterr().err
