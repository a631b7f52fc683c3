"""Sixteen peers that request every stream at 1000 Hz: how many ticks of a flight in real time are late for them."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

os.environ["MAVLINK20"] = "1"

import numpy as np
import pytest
from ports import free_port
from pymavlink.dialects.v20 import common
from rows import Row, leave

from avionics import topics
from avionics.link.stream_table import STREAMS
from avionics.processors import WHOLE_TICK
from logs.reader import open_log

pytestmark = pytest.mark.bench

PEERS = 16
DURATION = 60.0
"""s; of real time of one flight"""
RATE = 1000.0
"""Hz; requested of every stream"""
LATE = 0.1
"""%; of the ticks that may be late"""


class Peers(threading.Thread):
    """Peers on one port: each sends a heartbeat a second and requests every stream; what they receive is dropped."""

    def __init__(self, kind: str, port: int, count: int) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self.received = 0
        """bytes"""
        self._kind, self._port = kind, port
        self._sockets: dict[int, socket.socket] = {}
        self._systems = range(200, 200 + count)

    def run(self) -> None:
        numbers = [entry.message_id for entry in STREAMS]
        for turn in itertools.count():
            if self.over.wait(0.1):
                break
            for system in self._systems:
                with contextlib.suppress(OSError):  # the vehicle is not there yet, or no longer
                    self._serve(system, turn, numbers)
        for each in self._sockets.values():
            each.close()

    def _serve(self, system: int, turn: int, numbers: list[int]) -> None:
        if system not in self._sockets:
            self._sockets[system] = self._connected()
        connected = self._sockets[system]
        writing: Any = common.MAVLink(None, system, 190)
        if turn % 10 == 0:
            connected.send(writing.heartbeat_encode(6, 8, 0, 0, 4).pack(writing))
        if turn % 50 == 0:
            for number in numbers:
                requested = writing.command_long_encode(1, 1, 511, 0, number, 1e6 / RATE, 0, 0, 0, 0, 0)
                connected.send(requested.pack(writing))
        with contextlib.suppress(BlockingIOError):
            while data := connected.recv(1 << 16):
                self.received += len(data)

    def _connected(self) -> socket.socket:
        kind = socket.SOCK_DGRAM if self._kind == "udpin" else socket.SOCK_STREAM
        connected = socket.socket(socket.AF_INET, kind)
        connected.connect(("127.0.0.1", self._port))
        connected.setblocking(False)
        return connected


def late_ticks(folder: Path, kind: str, count: int) -> float:
    """Percentage of the ticks of a flight with ``count`` peers that took longer than 5 ms, after the first 10 s."""
    port = free_port(socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
    log = folder / f"flight-{kind}-{count}.mcap"
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--speed", "1", "--seed", "1"]
    command += ["--duration", str(DURATION), "--log", str(log), "--gcs", f"{kind}:127.0.0.1:{port}"]
    peers = Peers(kind, port, count)
    peers.start()
    subprocess.run(command, check=True, capture_output=True)
    peers.over.set()
    peers.join()
    assert peers.received >= 1e5 * count, "the peers have received telemetry"
    with open_log(log) as flight:
        timing: Any = flight.columns(topics.TIMING)
    chosen = (timing["processor"] == WHOLE_TICK) & (timing["time_us"] > 10e6)
    return 100.0 * float(np.sum(timing["overruns"][chosen])) / (200.0 * float(np.sum(chosen)))


def test_sixteen_peers_that_request_everything_make_no_tick_late(tmp_path: Path) -> None:
    alone = late_ticks(tmp_path, "udpin", 0)
    if alone > LATE:
        pytest.skip(f"{alone:.2f} % of the ticks are late without any peer: the machine is busy")
    for kind, name in (("udpin", "UDP"), ("tcpin", "TCP")):
        loaded = late_ticks(tmp_path, kind, PEERS)
        what = f"{PEERS} {name} peers, every stream requested at {RATE:g} Hz: late ticks"
        leave(Row(what, loaded, alone, "%", "without peers", f"at most {LATE:g}"))
        assert loaded <= LATE
