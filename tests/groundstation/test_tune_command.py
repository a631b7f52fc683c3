"""``wingbeat tune`` and ``wingbeat linearize --out``: what they print and write, what they refuse."""

from __future__ import annotations

import json
import re
import shlex
from itertools import pairwise
from pathlib import Path

import pytest

from avionics.vehicles import load_vehicle, vehicle_names
from groundstation.command import linearize, tune
from groundstation.command.main import main
from sim_bridge.flight.tuning.cascade import Design
from sim_bridge.flight.tuning.proof import FlightQuality
from sim_bridge.tuning.model import LinearModel
from sim_bridge.vehicles import load_vehicle as load_world
from sim_bridge.vehicles import vehicle_names as world_names

Capture = pytest.CaptureFixture[str]
MODELS = Path(__file__).parents[1] / "data" / "models"
COMMANDS = Path(__file__).parents[2] / "docs" / "commands.md"
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
    assert load_world(str(out / "world.toml")).name == load_vehicle(out / "avionics.toml").name == "my_bird"


@pytest.mark.validate
def test_what_was_written_is_tuned_no_more(capsys: Capture, tmp_path: Path) -> None:
    """The folder is a vehicle; its own gains are the design's."""
    out = tmp_path / "my_bird"
    assert main(["tune", ARIZONA, "--no-fly", "--out", str(out)]) == 0
    capsys.readouterr()
    assert main(["tune", ARIZONA, "--vehicle", str(out), "--no-fly", "--json"]) == 0
    stated = json.loads(capsys.readouterr().out)
    for loop in stated["loops"]:
        assert loop["before"]["keeps"], loop["name"]
    inner = [loop for loop in stated["loops"] if loop["name"] in ("pitch", "roll")]
    assert all(loop["before"]["gains"] == loop["after"]["gains"] for loop in inner)


@pytest.mark.validate
def test_tuning_flies_before_and_after_and_tells_programs(capsys: Capture, tmp_path: Path) -> None:
    bird = badly_tuned("arizona_100cm", tmp_path / "sharp")
    assert main(["tune", ARIZONA, "--vehicle", bird, "--json"]) == 0
    stated = json.loads(capsys.readouterr().out)
    documented = {name for key in tune.JSON_KEYS for name in key.split(", ")}
    assert set(stated) == documented - {"parameters"}  # of another autopilot
    assert all(loop["after"]["keeps"] and loop["after"]["stable"] for loop in stated["loops"])
    assert not all(loop["before"]["keeps"] for loop in stated["loops"])
    assert stated["written"] == []
    before, after = stated["flights"]["before"], stated["flights"]["after"]
    assert set(before) == {*FlightQuality._fields, "holds"} - {"completed_legs"}
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
        (["tune", "arizona_100cm", "--vehicle", "arizona_100cm"], "--vehicle applies to a MODEL"),
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


@pytest.mark.parametrize(
    ("out", "part"),
    [("file/bird", "file is not a folder"), ("file/deep/bird", "file is not a folder"), ("no/bird.toml", None)],
)
def test_a_place_that_cannot_be_written_is_told_before_the_work(
    out: str, part: str | None, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        tune, "design", lambda model, vehicle, stated: pytest.fail("designed") if part else kept(model)
    )
    (tmp_path / "file").write_text("mine")
    assert main(["tune", RAVEN, "--no-fly", "--out", str(tmp_path / out)]) == (2 if part else 0)
    said = capsys.readouterr()
    if part is None:  # folders that are missing are made
        assert load_vehicle(tmp_path / out).gains == load_vehicle("robo_raven_ii_d").gains
    else:
        assert said.out == "" and part in said.err and "cannot write" in said.err and said.err.count("\n") == 1


@pytest.mark.parametrize("out", ["no/model.toml", "file/model.toml", "file"])
def test_a_model_that_cannot_be_written_is_told_before_the_work(
    out: str, capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(linearize, "answer", lambda chosen, examined: pytest.fail("linearised"))
    (tmp_path / "file").write_text("mine")
    assert main(["linearize", "arizona_100cm", "--out", str(tmp_path / out)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(("wingbeat: cannot write ", f"wingbeat: {tmp_path / 'file'} exists")), said
    assert said.count("\n") == 1 and (tmp_path / "file").read_text() == "mine"


def test_that_nothing_was_written_is_said_with_the_words_that_write(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tune, "design", lambda model, vehicle, stated: kept(model))
    assert main(["tune", RAVEN, "--no-fly"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("nothing was written; ") and f"wingbeat tune {RAVEN} --no-fly --out DIR" in last
    assert main(["tune", RAVEN, "--no-fly", "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["written"] == [] and "nothing was written" not in said.err


def kept(model: LinearModel) -> Design:
    """A design that leaves every gain as it is."""
    return Design(model, load_vehicle("robo_raven_ii_d").gains, (), ())


def test_documented_vehicles_are_written_before_they_fly() -> None:
    """What ``--out`` and ``--model`` name in its first list of commands is new there, and what is flown is known."""
    known, blocks = {*vehicle_names(), *world_names()}, COMMANDS.read_text(encoding="utf-8").split("```\n")
    lines = next(block for block in blocks if block.startswith("wingbeat fly --speed 1 --vehicle")).splitlines()
    for words in (shlex.split(line, comments=True) for line in lines):
        given = dict(pairwise(words))
        for flown in (given.get("--vehicle"), given.get("tune")):
            assert flown is None or flown.removesuffix(".toml") in known, " ".join(words)
        for out in (given.get("--out"), given.get("--model")):
            if out is not None:
                assert out.removesuffix(".toml") not in known, " ".join(words)
                known.add(out.removesuffix(".toml"))
    assert {"my_aircraft", "my_tuned_aircraft"} < known


@pytest.mark.validate
def test_a_linear_model_is_written_for_tune_and_not_over_another(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    assert main(["linearize", "arizona_100cm", "--out", str(path)]) == 0
    written = path.read_text()
    assert main(["linearize", "arizona_100cm", "--out", str(path)]) == 2
    assert "exists: it is not overwritten" in capsys.readouterr().err
    assert path.read_text() == written
    assert main(["tune", str(path), "--no-fly", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["loops"][0]["name"] == "pitch"


def test_a_file_that_is_no_model_is_told_apart(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text("[1, 2]")
    assert main(["tune", str(path)]) == 2
    assert "the model must be a section of keys, not [1, 2]" in capsys.readouterr().err


@pytest.mark.validate
@pytest.mark.parametrize(("form", "gain"), [("ardupilot", "PTCH_RATE_P"), ("px4", "FW_PR_P")])
def test_parameters_of_another_autopilot(capsys: Capture, tmp_path: Path, form: str, gain: str) -> None:
    """GIVEN a model WHEN tuned for another autopilot THEN document and file agree, and the file is kept."""
    out = tmp_path / "new" / "bird.param"
    assert main(["tune", RAVEN, "--format", form, "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["written"] == [str(out)] and document["flights"] is None
    assert [loop["name"] for loop in document["loops"]] == ["pitch", "roll"]
    assert all(loop["after"]["keeps"] and loop["before"] is None for loop in document["loops"])
    value = document["loops"][0]["after"]["gains"][gain]
    assert document["parameters"][gain] == value
    assert re.search(rf"(?m)^(1\t1\t)?{gain}\s+{value:g}\s", out.read_text())
    assert main(["tune", RAVEN, "--format", form, "--out", str(out)]) == 2
    assert "exists" in capsys.readouterr().err
