"""What a person says on the command line about links: profiles and keys."""

from __future__ import annotations

from pathlib import Path

import pytest

from avionics.link.urls import OPTIONS
from groundstation.command import avionics, fly, options
from wingbeat.errors import InputError

BOARD = ["--board", "hil:tcp:127.0.0.1:9"]


@pytest.mark.parametrize("run", [avionics.run, fly.run])
@pytest.mark.parametrize(
    ("words", "reports"),
    [
        (["--identity", "betaflight"], "generic, ardupilot, px4"),
        (["--signing-key", "no-such.key"], "no such file"),
        (["--gcs", "udpin:127.0.0.1:1?rate=fast"], OPTIONS),
    ],
)
def test_what_cannot_be_is_refused_before_anything_begins(
    run: object, words: list[str], reports: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WINGBEAT_STATE", str(tmp_path / "state"))
    assert callable(run)
    with pytest.raises(InputError, match=reports):
        run([*(BOARD if run is avionics.run else []), *words])


def test_a_key_that_others_may_read_is_refused_by_both_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bird.key"
    path.write_text("00" * 32)
    path.chmod(0o644)
    for run, words in ((avionics.run, BOARD), (fly.run, [])):
        with pytest.raises(InputError, match="chmod 600"):
            run([*words, "--signing-key", str(path)])


def test_the_key_is_the_users_own_unless_another_or_none_is_named(tmp_path: Path) -> None:
    usual, other = tmp_path / "usual.key", tmp_path / "other.key"
    other.touch(0o600)
    assert options.key_file(options.NO_KEY, usual) is None and options.key_file(None, None) is None
    chosen = [options.key_file(None, usual), options.key_file(str(other), usual)]
    assert [file.path if file is not None else None for file in chosen] == [usual, other]
