"""``wingbeat sim`` alone: what it says of the launcher, on a port that a flight computer meets."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest

from avionics.board.hil import HilBoard
from groundstation.command import sim
from groundstation.command.main import main
from sim_bridge.bridge.world import NEUTRAL

HELD = 30
"""frames before it arms"""


def fly(url: str, received: list[int]) -> None:
    """A flight computer that arms after `HELD` frames and answers until the world ends."""
    board = HilBoard(url)
    while (frame := board.read()) is not None:
        received.append(frame.time_us)
        board.write(NEUTRAL._replace(time_us=frame.time_us, armed=int(len(received) > HELD)))
    board.close()


def test_a_world_alone_says_what_the_launcher_does_and_when_a_fault_comes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sim, "pin_to_core", lambda core: None)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"tcp:127.0.0.1:{probe.getsockname()[1]}"
    received: list[int] = []
    computer = threading.Thread(target=fly, args=(url, received))
    computer.start()
    log = tmp_path / "world.mcap"
    code = main(["sim", "--listen", url, "--log", str(log), "--duration", "1", "--fault", "gps_lost@0.5"])
    computer.join(20.0)
    said = capsys.readouterr()
    assert (code, said.out, len(received)) == (0, "", 200)
    assert said.err.splitlines() == [
        f"Robo Raven II with wing D (Gerdes, Bruck, Gupta 2017), waiting for a flight computer on {url}",
        f"{sim.WAITING}{sim.HURRIED}",
        "   0.2 s  armed: launch in 8 s",
        "   0.5 s  fault gps_lost: no GPS fix",
        f"ended after 1.0 s, not launched: the simulation finished; recorded in {log}",
    ]
