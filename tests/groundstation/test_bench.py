"""``wingbeat avionics --board razor:`` as a user runs it, on a fake Razor behind a pseudo terminal."""

from __future__ import annotations

import io
import json
import math
import os
import re
from pathlib import Path

import pytest
from fake_razor import FakeRazor, Motion
from rich.console import Console

from avionics.board.line_watch import Losses
from avionics.board.razor_protocol import Angles
from avionics.messages import Attitude
from avionics.runtime.flight_computer import FlightComputer
from avionics.state import zero
from groundstation.command import avionics
from groundstation.command.main import main
from groundstation.views.bench import Bench, BenchView, plain_line, render

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")

Capture = pytest.CaptureFixture[str]


def leaning(time: float) -> Motion:
    return Motion(0.3, -0.2, 0.0, (0.0, 0.0, 0.0))


@pytest.fixture
def razor(monkeypatch: pytest.MonkeyPatch) -> FakeRazor:
    """A Razor that takes its turns whenever the flight computer has nothing else to do."""
    fake = FakeRazor(leaning)
    monkeypatch.setattr(FlightComputer, "idle", lambda self: fake.pump())
    return fake


def run(folder: Path, razor: FakeRazor, *words: str, options: str = "") -> int:
    given = ["--board", razor.address + options, "--parameters", "none", "--log", str(folder / "bench.mcap")]
    return main(["avionics", *given, *words])


def test_the_attitude_is_told_in_lines_where_there_is_no_terminal(
    tmp_path: Path, razor: FakeRazor, capsys: Capture
) -> None:
    assert run(tmp_path, razor, "--duration", "2") == 0
    said = capsys.readouterr()
    assert all("roll" in line and "Hz" in line for line in said.out.splitlines()) and said.out
    assert re.search(r"roll +\+17\.\d°  pitch +-11\.\d°", said.out)
    assert said.err.splitlines()[-1].startswith("ended after 2.0 s: the time is up; recorded in ")
    assert "failsafe" not in said.err


def test_one_document_at_the_end_with_its_own_angles(tmp_path: Path, razor: FakeRazor, capsys: Capture) -> None:
    assert run(tmp_path, razor, "--duration", "2", "--json", options=",57600,ox") == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert said.err == "" and set(document) == set(avionics.JSON_KEYS)
    assert document["attitude"]["roll"] == pytest.approx(0.3, abs=0.02)
    assert document["own_attitude"] == pytest.approx({"roll": 0.3, "pitch": -0.2, "yaw": 0.0}, abs=1e-3)
    assert document["losses"]["lost"] == 0 and document["frames"] > 50 and document["events"] == []


@pytest.mark.parametrize("as_json", [False, True])
def test_a_pulled_plug_is_one_clear_line(
    tmp_path: Path, razor: FakeRazor, capsys: Capture, monkeypatch: pytest.MonkeyPatch, as_json: bool
) -> None:
    pump, turns = razor.pump, iter(range(10**6))
    monkeypatch.setattr(razor, "pump", lambda: razor.line.close() if next(turns) == 60 else pump())
    assert run(tmp_path, razor, *(["--json"] if as_json else [])) == 2
    said = capsys.readouterr()
    complaint = f"wingbeat: Razor at {razor.line.device} disconnected: check the cable"
    assert said.err.splitlines()[-1] == complaint and said.err.count("disconnected") == 1
    if as_json:
        assert said.err.count("\n") == 1 and json.loads(said.out)["ended"] == complaint.removeprefix("wingbeat: ")


@pytest.mark.parametrize(
    ("address", "part"),
    [
        ("nonsense", "is not one of hil:tcp:HOST:PORT"),
        ("razor:/dev/no-such-device", "cannot open serial device /dev/no-such-device"),
        ("razor:/dev/ttyUSB0,57600,ypr", "the output must be one of oscb"),
        ("hil:serial:/dev/no-such-device,921600", "cannot open serial device /dev/no-such-device"),
    ],
)
def test_a_bad_address_is_one_line_and_code_2(tmp_path: Path, capsys: Capture, address: str, part: str) -> None:
    log = str(tmp_path / "log.mcap")
    assert main(["avionics", "--board", address, "--parameters", "none", "--log", log, "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and part in said.err


def test_help_lists_what_a_board_may_be(capsys: Capture) -> None:
    assert main(["avionics", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for form in ("hil:tcp:HOST:PORT", "hil:serial:DEVICE,BAUD", "razor:DEVICE[,BAUD[,OUTPUT]]"):
        assert form in text


SEEN = Bench(
    "razor:/dev/ttyUSB0",
    100,
    0.02,
    zero(Attitude)._replace(time_us=2_000_000, roll=0.1, yaw=math.pi - 0.01, tilt_sigma=0.02, heading_sigma=0.1),
    Angles(0.11, 0.0, -math.pi + 0.01),
    Losses(3, 0, 70, 0),
    1,
)


def test_the_picture_has_both_attitudes_and_the_shorter_way_between_them() -> None:
    output = io.StringIO()
    console = Console(file=output, force_terminal=True, width=100, color_system=None)
    with BenchView(console, clock=lambda: 5.0) as view:
        assert view.due
        view.show(SEEN)
        assert not view.due
    text = output.getvalue()
    assert "+179.4°" in text and "-179.4°" in text and "+1.1°" in text
    assert "50.0 Hz, 100 frames, 3 lost, 1 restart" in text
    console.print(render(SEEN._replace(local=None)))
    assert "own  +6.3" not in plain_line(SEEN._replace(local=None))
    assert "own" in plain_line(SEEN)
