"""``wingbeat gcs --signing-key`` against a flight computer that hears nobody else."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from flight_computer import aboard

from avionics.link.key_file import KeyFile
from avionics.link.signing import Signing
from groundstation.command.main import main

Capture = pytest.CaptureFixture[str]


def key(path: Path, text: str) -> str:
    path.write_text(f"passphrase {text}\n")
    path.chmod(0o600)
    return str(path)


def gcs(*words: str) -> int:
    return main(["gcs", *words, "--no-record"])


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    right = KeyFile(Path(key(tmp_path / "right.key", "the goose is loose")))
    with aboard(tmp_path / "raven.json", Signing(time.time, right.load_key()), calls=True) as address:
        yield address


def test_who_has_the_key_is_heard(url: str, tmp_path: Path, capsys: Capture) -> None:
    right = str(tmp_path / "right.key")
    assert gcs(url, "--signing-key", right, "param", "set", "PITCH_P", "0.5") == 0
    capsys.readouterr()
    assert gcs(url, "--signing-key", right, "param", "get", "PITCH_P") == 0
    assert capsys.readouterr().out.split()[::2] == ["PITCH_P", "0.5"]


@pytest.mark.validate
def test_who_has_none_is_told_what_it_needs(url: str, capsys: Capture) -> None:
    assert gcs(url, "param", "get", "PITCH_P") == 1
    reports = capsys.readouterr().err.splitlines()
    assert reports[-1].startswith("wingbeat: ") and reports[-1].endswith("may require --signing-key")


def test_a_wrong_key_hears_nobody(url: str, tmp_path: Path, capsys: Capture) -> None:
    wrong = key(tmp_path / "wrong.key", "the goose is gone")
    assert gcs(url, "--signing-key", wrong, "--timeout", "0.5", "status") == 2
    assert "rejected by signature" in capsys.readouterr().err


def test_a_key_that_is_none_is_one_line(tmp_path: Path, capsys: Capture) -> None:
    assert gcs("udpout:127.0.0.1:9", "--signing-key", str(tmp_path / "no.key"), "status") == 2
    assert capsys.readouterr().err.endswith("there is no such file\n")
    (tmp_path / "bad.key").write_text("goose")
    (tmp_path / "bad.key").chmod(0o600)
    assert gcs("udpout:127.0.0.1:9", "--signing-key", str(tmp_path / "bad.key"), "status") == 2
    assert "not 64 hexadecimal digits" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "reports"),
    [(None, "check if it needs --signing-key"), ("the goose is gone", "check that the vehicle has this signing key")],
)
def test_a_vehicle_that_waits_and_hears_no_stranger_is_told_from_a_dead_one(
    given: str | None, reports: str, tmp_path: Path, capsys: Capture
) -> None:
    right = KeyFile(Path(key(tmp_path / "right.key", "the goose is loose")))
    words = ("--signing-key", key(tmp_path / "wrong.key", given)) if given else ()
    with aboard(tmp_path / "raven.json", Signing(time.time, right.load_key())) as url:
        assert gcs(url, *words, "--timeout", "0.3", "status") == 2
    assert capsys.readouterr().err.endswith(f"no heartbeat for 0.3 s, no other messages; {reports}\n")
