"""``wingbeat identify --report`` and ``--model``: refused before the long work, one clear line."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from avionics import topics
from avionics.messages import ActuatorCommand
from groundstation.command import identify
from groundstation.command.identify_out import names_of, sha256
from logs.identification.report import Identification
from logs.recorder import McapRecorder
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity


@pytest.mark.parametrize(
    ("option", "name", "stated"),
    [
        ("--report", "kept.html", r"kept.html exists: it is not overwritten$"),
        ("--model", "kept.toml", r"kept.toml exists: it is not overwritten$"),
        ("--model", "kept.html", r"^--model .*kept.html: the name of a model ends in .toml$"),
        ("--model", "bird.toml", r"bird exists: it is not overwritten$"),
        ("--report", "nowhere/a.html", r"there is no folder"),
    ],
)
def test_a_file_that_exists_is_refused_before_the_log_is_opened(
    tmp_path: Path, option: str, name: str, stated: str
) -> None:
    for kept in ("kept.html", "kept.toml"):
        (tmp_path / kept).write_text("mine", encoding="utf-8")
    (tmp_path / "bird").mkdir()
    with pytest.raises(InputError, match=stated) as refused:
        identify.run([str(tmp_path / "no_such_log.mcap"), option, str(tmp_path / name)])
    assert "\n" not in str(refused.value)
    assert (tmp_path / "kept.html").read_text(encoding="utf-8") == "mine"


def test_the_hash_is_that_of_the_whole_file(tmp_path: Path) -> None:
    data = bytes(range(256)) * 9000
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    assert sha256(path) == hashlib.sha256(data).hexdigest()


def test_logs_of_the_same_name_are_told_apart_by_their_folders() -> None:
    logs = [SimpleNamespace(path=Path(path)) for path in ("monday/a.mcap", "tuesday/a.mcap", "tuesday/b.mcap")]
    assert names_of(logs) == (str(Path("monday/a.mcap")), str(Path("tuesday/a.mcap")), "b.mcap")  # type: ignore[arg-type]


def test_a_damaged_log_says_so_beside_what_it_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cut.mcap"
    with McapRecorder(path) as recorder:
        for time_us in range(0, 10_000_000, 10_000):
            recorder.record(topics.EVENTS, Event(time_us, Severity.INFO, "test", "on it goes"))
    whole = path.read_bytes()
    monkeypatch.setattr(identify, "identified", lambda *_, **__: Identification())
    assert identify.run([str(path), "servo", "--json"]) == 0
    assert capsys.readouterr().err == ""
    path.write_bytes(whole[: len(whole) // 2])
    assert identify.run([str(path), "servo", "--json"]) == 0
    stated = capsys.readouterr()
    assert json.loads(stated.out)
    assert stated.err.startswith(f"wingbeat: {path}: ") and stated.err.endswith("readable data were identified\n")


def test_an_elevator_is_not_made_where_the_log_tells_its_angle(tmp_path: Path) -> None:
    path = tmp_path / "own.mcap"
    with McapRecorder(path) as recorder:
        recorder.record(topics.ACTUATORS, ActuatorCommand(0, 0.0, 0.0, 0.0, 0.0, 0.0, 1))
    with pytest.raises(InputError, match="tells the elevator's angle"):
        identify.run([str(path), "modes", "--elevator", "/mixing/actuators.elevator", "1"])


def test_what_a_damaged_log_lacks_is_refused_with_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    with McapRecorder(path) as recorder:
        recorder.record(topics.EVENTS, Event(0, Severity.INFO, "test", "on it goes"))
    with pytest.raises(InputError) as whole:
        identify.run([str(path), "servo"])
    assert "damaged" not in str(whole.value)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError) as torn:
        identify.run([str(path), "servo"])
    assert str(torn.value).startswith(str(whole.value)) and "the file was cut off" in str(torn.value)


def test_held_out_logs_stand_behind_the_others() -> None:
    files = [Path(f"{name}.mcap") for name in "abc"]
    every, held_out = identify._held_out(files, [Path("a.mcap"), Path("d.mcap")], None)
    assert [one.stem for one in every] == ["b", "c", "a", "d"] and held_out == [2, 3]
    every, held_out = identify._held_out(files, [], 0.3)
    backwards, _ = identify._held_out(files[::-1], [], 0.3)
    assert sorted(every) == files and held_out == [2] and every[2] == backwards[2]


def test_help_has_both_options_with_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        identify.run(["--help"])
    text = capsys.readouterr().out
    assert "--report OUT.html" in text and "--model OUT.toml" in text and "wingbeat fly --vehicle OUT" in text


@pytest.mark.parametrize("what", ["servo", "aero"])
def test_a_method_of_modes_is_refused_elsewhere(what: str) -> None:
    with pytest.raises(InputError, match=f"--method is of modes, not of {what}"):
        identify.run(["flight.mcap", what, "--method", "era"])
