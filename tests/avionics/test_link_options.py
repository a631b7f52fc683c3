"""What a person says on the command line about links: profiles, keys and options of addresses."""

from __future__ import annotations

from pathlib import Path

import pytest
from link_wires import Wire

from avionics.link.urls import OPTIONS, LinkUrl, parse_url
from avionics.quantities import BadInput
from groundstation.command import avionics, fly, options

BOARD = ["--board", "hil:tcp:127.0.0.1:9"]


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpout:h:1?rate=57600", LinkUrl("udpout", "h", 1, rate=57600)),
        ("serial:/dev/ttyACM0,115200?unsigned=accept", LinkUrl("serial", "/dev/ttyACM0", 115200, unsigned=True)),
        ("tcpin:h:1?rate=9600&unsigned=accept&forward=no", LinkUrl("tcpin", "h", 1, 9600, True, False)),
    ],
)
def test_the_options_of_an_address_are_read_and_written_again(text: str, url: LinkUrl) -> None:
    assert parse_url(text) == url and str(url) == text


@pytest.mark.parametrize(
    "tail", ["?", "?rate=0", "?rate=x", "?unsigned=maybe", "?forward", "?speed=3", "?rate=1&", "?&"]
)
def test_an_unknown_option_is_refused_with_those_that_there_are(tail: str) -> None:
    with pytest.raises(BadInput) as refused:
        parse_url(f"udpin:h:1{tail}")
    assert OPTIONS in str(refused.value) and "\n" not in str(refused.value)


def test_a_serial_line_is_as_fast_as_its_baud_rate_unless_it_is_said_otherwise() -> None:
    assert parse_url("serial:/dev/x,57600").baud == 57600
    assert parse_url("serial:/dev/x,57600?rate=9600").baud == 9600
    assert parse_url("udpin:h:1").baud == 0 and Wire("udpin:h:1?rate=300").url.baud == 300


@pytest.mark.parametrize("run", [avionics.run, fly.run])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--identity", "px4"], "generic, ardupilot"),
        (["--signing-key", "no-such.key"], "no such file"),
        (["--gcs", "udpin:127.0.0.1:1?rate=fast"], OPTIONS),
    ],
)
def test_what_cannot_be_is_refused_before_anything_begins(
    run: object, words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WINGBEAT_STATE", str(tmp_path / "state"))
    assert callable(run)
    with pytest.raises(BadInput, match=said):
        run([*(BOARD if run is avionics.run else []), *words])


def test_a_key_that_others_may_read_is_refused_by_both_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "bird.key"
    path.write_text("00" * 32)
    path.chmod(0o644)
    for run, words in ((avionics.run, BOARD), (fly.run, [])):
        with pytest.raises(BadInput, match="chmod 600"):
            run([*words, "--signing-key", str(path)])


def test_the_key_is_the_users_own_unless_another_or_none_is_named(tmp_path: Path) -> None:
    usual, other = tmp_path / "usual.key", tmp_path / "other.key"
    other.touch(0o600)
    assert options.key_file(options.NO_KEY, usual) is None and options.key_file(None, None) is None
    chosen = [options.key_file(None, usual), options.key_file(str(other), usual)]
    assert [file.path if file is not None else None for file in chosen] == [usual, other]
