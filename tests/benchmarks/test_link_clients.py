"""Three clients on a flight in real time: nothing is lost, and no tick waits for them (``make validate``)."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

os.environ["MAVLINK20"] = "1"

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from avionics import topics
from avionics.processors import WHOLE_TICK
from logs.reader import open_log

pytestmark = pytest.mark.validate

DURATION = 60.0
"""s; of real time of one flight"""
FLIGHTS = 10
"""with clients, and as many without, by turns: what a machine does besides changes by the minute"""
RATE = 50.0
"""Hz; of the attitude that each client asks for"""
TICKS = 200.0
"""Hz"""
LOITER = """
[[item]]
kind = "takeoff"
altitude = 40

[[item]]
kind = "loiter"
north = 0
east = 60
altitude = 40
"""


def sequences(packet: bytes) -> Iterator[int]:
    """Sequence numbers of the vehicle's frames in a datagram, those too that the client's dialect does not know.

    What it passes on of the other clients carries theirs.
    """
    at = 0
    while at < len(packet):
        assert packet[at] == common.PROTOCOL_MARKER_V2
        if packet[at + 5] == 1:
            yield packet[at + 4]
        at += 12 + packet[at + 1] + (13 if packet[at + 2] & 1 else 0)


class Client(threading.Thread):
    """A ground station on a UDP port that asks for attitude and counts what comes, and what is missing."""

    def __init__(self, system: int) -> None:
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.5)
        self.port = self.socket.getsockname()[1]
        self.over = threading.Event()
        self.attitudes: list[int] = []
        self.missing = 0
        self._system = system

    def run(self) -> None:
        reading, writing = common.MAVLink(None), common.MAVLink(None, self._system, 190)
        reading.robust_parsing = True
        heard, stated, last = None, 0.0, -1
        while not self.over.is_set():
            try:
                packet, heard = self.socket.recvfrom(4096)
            except TimeoutError:
                packet = b""
            for sequence in sequences(packet):
                self.missing += (sequence - last - 1) % 256 if last >= 0 else 0
                last = sequence
            for message in reading.parse_buffer(packet) or ():
                if message.get_type() == "ATTITUDE":
                    self.attitudes.append(message.time_boot_ms)
            if heard and time.monotonic() - stated > 1.0:
                asked = writing.command_long_encode(1, 1, 511, 0, 30, 1e6 / RATE, 0, 0, 0, 0, 0)
                for message in (writing.heartbeat_encode(6, 8, 0, 0, 4), *((asked,) if not stated else ())):
                    self.socket.sendto(message.pack(writing), heard)
                stated = time.monotonic()
        self.socket.close()


class FlightResult(NamedTuple):
    ticks: int
    """told by the sensors' times"""
    logged: int
    """IMU samples in the log"""
    overruns: int
    """ticks that took longer than 5 ms, from the arrival of their frame until the links were served"""
    stolen: float
    """-; share of the cores that a virtual machine's host took for itself: those ticks are late, whoever listens"""


def stolen() -> float:
    """s; of core time taken by the host since boot; 0 where the system does not tell."""
    try:
        ticks = Path("/proc/stat").read_text().split("\n", 1)[0].split()[8]
    except OSError:
        return 0.0
    return int(ticks) / os.sysconf("SC_CLK_TCK") / (os.cpu_count() or 1)


def fly(folder: Path, duration: float, clients: list[Client]) -> FlightResult:
    mission, log = folder / "loiter.toml", folder / f"flight{len(clients)}.mcap"
    mission.write_text(LOITER)
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--speed", "1", "--seed", "1"]
    command += ["--duration", str(duration), "--mission", str(mission), "--log", str(log), "--parameters", "none"]
    for client in clients:
        command += ["--gcs", f"udpout:127.0.0.1:{client.port}"]
        client.start()
    began = stolen()
    subprocess.run(command, check=True, capture_output=True)
    for client in clients:
        client.over.set()
        client.join()
    with open_log(log) as flight:
        imu: Any = flight.columns(topics.IMU)["time_us"]
        timing: Any = flight.columns(topics.TIMING)
        overruns = timing["overruns"][timing["processor"] == WHOLE_TICK]
        assert len(overruns) >= duration - 3.0  # told once a second
        ticks = round((imu[-1] - imu[0]) * 1e-6 * TICKS) + 1
        return FlightResult(ticks, len(imu), int(np.sum(overruns)), (stolen() - began) / duration)


def share(flights: Sequence[FlightResult]) -> float:
    """Ticks of a hundred that overran."""
    return 100.0 * sum(flown.overruns for flown in flights) / sum(flown.ticks for flown in flights)


def stated(what: str, flights: Sequence[FlightResult]) -> str:
    """One line of the flights of a kind."""
    each = " ".join(f"{share([flown]):.2f}" for flown in flights)
    taken = 100.0 * sum(flown.stolen for flown in flights) / len(flights)
    ticks, logged = sum(flown.ticks for flown in flights), sum(flown.logged for flown in flights)
    return f"{what}: {ticks} ticks, {logged} logged; overruns {share(flights):.3f} % ({each}); {taken:.1f} % stolen\n"


def test_three_clients_cost_no_tick_and_lose_no_message(tmp_path: Path) -> None:
    watched, alone, clients = [], [], []
    for number in range(FLIGHTS):
        three = [Client(system) for system in (251, 252, 253)]
        clients += three
        turns = [(watched, three), (alone, [])]
        for flights, present in turns if number % 2 else reversed(turns):
            folder = tmp_path / f"{number}-{len(present)}"
            folder.mkdir()
            flights.append(fly(folder, DURATION, present))
    rates = [len(client.attitudes) / DURATION for client in clients]
    missing = sum(client.missing for client in clients)
    sys.stdout.write("\n" + stated("with clients", watched) + stated("without", alone))
    sys.stdout.write(f"attitude at {min(rates):.1f} to {max(rates):.1f} Hz, {missing} missing\n")
    for flown in watched + alone:
        assert flown.logged == flown.ticks > 0.98 * DURATION * TICKS
    assert share(watched) - share(alone) <= 0.1
    assert missing == 0 and min(rates) > 0.95 * RATE
    for client in clients:
        assert all(b > a for a, b in zip(client.attitudes, client.attitudes[1:], strict=False))
