"""A simulator that falls silent in mid-flight: the real bridge, the real command, a short patience."""

from __future__ import annotations

import functools
import math
import socket
import threading
from pathlib import Path

import pytest
from ports import free_port
from simulate import RAVEN

from avionics import topics
from avionics.board import boards
from avionics.board.hil import HilBoard, Timeouts
from groundstation.command import avionics
from groundstation.command.main import main
from logs.reader import open_log
from sim_bridge.bridge.server import BridgeServer, BridgeStatistics
from sim_bridge.flight.faults import parse_fault
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle

SILENT_AT = 0.5
"""s; since boot"""


def test_a_silent_simulator_is_named_the_log_is_whole_and_the_command_ends_with_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(boards, "HilBoard", functools.partial(HilBoard, timeouts=Timeouts(frame=0.3)))
    monkeypatch.setattr(avionics, "pin_to_core", lambda core: None)
    world = SimulatedWorld(load_vehicle(RAVEN), Scenario(faults=(parse_fault(f"sim_silent@{SILENT_AT}"),)))
    server = BridgeServer(f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}")
    told: list[BridgeStatistics] = []
    serving = threading.Thread(target=lambda: told.append(server.serve(world)))
    serving.start()
    log = tmp_path / "flight.mcap"
    board = f"hil:tcp:127.0.0.1:{server.port}"
    code = main(["avionics", "--vehicle", RAVEN, "--board", board, "--parameters", "none", "--log", str(log)])
    serving.join(20.0)
    server.close()
    said = capsys.readouterr().err.strip().splitlines()
    last = SILENT_AT - 0.005
    assert code == 2
    assert said[-1] == (
        f"wingbeat: simulator at {board[4:]} sent no sensor frame for 0.3 s, last at t = {last:.3f} s"
    )
    assert not [line for line in said[:-1] if line.startswith("wingbeat: ")]
    assert told[0].ended == f"no sensor frame from {SILENT_AT:g} s on: fault sim_silent"
    with open_log(log) as flight:
        assert flight.complete
        times = flight.columns(topics.IMU)["time_us"]
    assert len(times) == told[0].frames == math.floor(last / 0.005)
    assert times[-1] == round(last * 1e6)
