"""``wingbeat avionics`` as a user runs it, on a simulated world behind a real port: what it says, and its JSON."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from ports import free_port

from avionics.link.dialect import mavlink
from groundstation.command import avionics
from groundstation.command.main import main
from logs.reader import open_log
from sim_bridge.bridge.server import BridgeServer, BridgeStatistics
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

Capture = pytest.CaptureFixture[str]
RAVEN = "robo_raven_ii_d"


def simulate(folder: Path, monkeypatch: pytest.MonkeyPatch, *words: str) -> tuple[int, str]:
    """The command on a world of 2.5 s; its exit code and the board's address."""
    monkeypatch.setattr(avionics, "pin_to_core", lambda core: None)
    server = BridgeServer(f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    told: list[BridgeStatistics] = []
    world = SimulatedWorld(load_vehicle(RAVEN), Scenario(duration=2.5))
    serving = threading.Thread(target=lambda: told.append(server.serve(world)))
    serving.start()
    board = f"hil:tcp:127.0.0.1:{server.port}"
    given = ["--board", board, "--parameters", "none", "--log", str(folder / "flight.mcap")]
    code = main(["avionics", "--vehicle", RAVEN, *given, *words])
    serving.join(20.0)
    server.close()
    assert told[0].frames == 500
    return code, board


def test_it_says_who_flies_what_it_waits_for_what_happens_and_why_it_ended(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, board = simulate(tmp_path, monkeypatch, "--start", "--gcs", "udpout:127.0.0.1:9")
    said = capsys.readouterr()
    assert (code, said.out) == (0, "")
    assert said.err.splitlines() == [
        "Robo Raven II with wing D (Gerdes 2017), mission circuit of 9 items",
        "ground stations on udpout:127.0.0.1:9",
        f"recording to {tmp_path / 'flight.mcap'}",
        f"waiting for the board on {board}",
        "first sensor frame at 0.005 s",
        "   2.0 s  armed",
        "   2.0 s  mode AUTO",
        f"ended after 2.5 s: simulation ended; recorded in {tmp_path / 'flight.mcap'}",
    ]


def test_on_a_terminal_it_says_now_and_then_where_it_is(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(avionics, "LINE_EVERY", 1.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert simulate(tmp_path, monkeypatch, "--start")[0] == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "altitude" in line]
    assert [line.split("  altitude")[0].split() for line in lines] == [
        ["1.0", "s", "MANUAL", "on", "ground"],
        ["2.0", "s", "AUTO", "on", "ground"],
    ]
    assert all(re.search(r"altitude +-?\d+\.\d m +airspeed +\d+\.\d m/s +heading", line) for line in lines)
    assert simulate(tmp_path / "json", monkeypatch, "--start", "--json")[0] == 0
    assert capsys.readouterr().err == ""


def test_with_json_it_says_one_document_at_the_end(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, board = simulate(tmp_path, monkeypatch, "--start", "--json")
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert (code, said.err, set(document)) == (0, "", set(avionics.JSON_KEYS))
    assert (document["board"], document["frames"], document["time"]) == (board, 500, 2.5)
    assert document["ended"] == "simulation ended"
    assert [event["text"] for event in document["events"]] == ["armed", "mode AUTO"]
    with open_log(tmp_path / "flight.mcap") as log:
        # Nobody beside it records the world: what it believes is what viewers can be shown.
        shown = log.columns("/view/estimated/transforms").time
        assert len(shown) == log.duration // 0.02 + 1 and log.topics["/view/estimated/scene"].messages == 3
        fixes = log.columns("/sensors/gps")
        assert log.topics["/view/location"].messages == (fixes["fix_type"] >= 2).sum() > 5


def test_without_a_link_it_says_how_to_open_one(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulate(tmp_path, monkeypatch)
    assert "no link for a ground station (--gcs)" in capsys.readouterr().err.splitlines()


@contextlib.contextmanager
def unsigned_station(port: int) -> Iterator[None]:
    """A ground station without a key that calls a UDP port again and again."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 255, 190))
    over = threading.Event()

    def call() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller:
            while not over.wait(0.01):
                caller.sendto(beat, ("127.0.0.1", port))

    calling = threading.Thread(target=call)
    calling.start()
    try:
        yield
    finally:
        over.set()
        calling.join()


def test_who_is_refused_for_want_of_a_key_is_told_once_though_nobody_is_answered(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = tmp_path / "my.key"
    key.write_text("passphrase the goose is loose\n")
    key.chmod(0o600)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with unsigned_station(port):
        simulate(tmp_path, monkeypatch, "--gcs", f"udpin:127.0.0.1:{port}", "--signing-key", str(key))
    assert capsys.readouterr().err.count(f"unsigned frames rejected on udpin:127.0.0.1:{port}") == 1
