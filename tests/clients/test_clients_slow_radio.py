"""A flying vehicle and our ground station on radios of 57,600 baud that lose what comes too fast.

A pseudo-terminal ignores its baud rate, so the relay between two of them keeps it: the vehicle has to.
"""

from __future__ import annotations

import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from ground_links import BAUD, Addresses
from radio import radio
from simulated_vehicle import PATIENCE, PROFILES, aircraft

from avionics.link.budget import DEPTH
from avionics.link.dialect import mavlink
from avionics.link.stream_table import STREAMS
from groundstation.link import orders
from groundstation.link.answers import NoAnswer
from groundstation.link.connection import Connection
from groundstation.link.frames import Arrival
from groundstation.link.station import Station

RATE = BAUD / 10.0
"""bytes/s; of a serial line, with start and stop bits"""
BUFFER = 2048
"""bytes; of a small radio: a third of a second"""
ASKED = 20.0
"""Hz; of every stream that there is: some five times what the line carries"""
SECONDS = 6
"""s; counted: longer than a thinned stream waits for its turn"""
DETAILS = ("SERVO_OUTPUT_RAW", "WINGBEAT_NAVIGATION", "NAV_CONTROLLER_OUTPUT")
"""of the lowest ranks"""


class Ground:
    """Our ground station, which listens; ``received`` counts the messages of the vehicle."""

    def __init__(self, url: str) -> None:
        self.connection = Connection(url, stays=True)
        self.station = Station(self.connection)
        self.connection.overhear(self._receive)
        self.received: Counter[str] = Counter()

    def _receive(self, arrival: Arrival) -> None:
        if arrival.message is not None:
            self.received[arrival.message.get_type()] += 1

    def listen(self, duration: float) -> None:
        until = time.monotonic() + duration
        while time.monotonic() < until:
            self.station.poll()
            time.sleep(0.005)

    @property
    def reports(self) -> str:
        """All that the vehicle said in words."""
        return "; ".join(event.text for event in self.connection.state.events)

    def listen_for(self, word: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while word not in self.reports:
            assert time.monotonic() < deadline, f"it never said {word!r}, but {self.reports}"
            self.listen(0.05)

    def take_off(self) -> None:
        """As soon as the vehicle knows its attitude: until then it refuses."""
        deadline = time.monotonic() + PATIENCE
        while not self.connection.state.armed:
            assert time.monotonic() < deadline, "it was never ready to be armed"
            with suppress(NoAnswer):
                self.connection.run(orders.arm(self.connection.target))
            self.listen(0.3)
        self.connection.run(orders.takeoff(self.connection, 20.0, None))

    def request_everything(self) -> None:
        for entry in STREAMS:
            params: tuple[Any, ...] = (entry.message_id, 1e6 / ASKED, 0, 0, 0, 0, 0)
            interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            self.connection.send(mavlink.MAVLink_command_long_message(1, 1, interval, 0, *params))
            self.listen(0.02)


def counted_seconds(arrived: list[tuple[float, int]], started: float) -> list[int]:
    """Bytes in each whole second since ``started`` (s)."""
    return [sum(size for at, size in arrived if 0.0 <= at - started - second < 1.0) for second in range(SECONDS)]


@pytest.mark.validate
def test_a_flying_vehicle_keeps_to_the_rate_of_a_slow_radio_and_loses_nothing(tmp_path: Path) -> None:
    with radio(RATE, BUFFER) as ends:
        link = Addresses(f"serial:{ends.vehicle},{BAUD}", "", ())
        with aircraft(link, PROFILES["generic"], tmp_path, speed=2.0):
            ground = Ground(f"serial:{ends.ground},{BAUD}")
            ground.connection.find_vehicle(PATIENCE)
            ground.take_off()
            ground.request_everything()
            ground.listen_for("launched")
            before, started = ground.received.copy(), time.monotonic()
            ground.listen(SECONDS)
            received, quality = ground.received - before, ground.station.picture().quality
            dropped = (ends.down.dropped, ends.up.dropped)  # before nobody reads any more
            ground.connection.close()
    assert dropped == (0, 0)
    assert (quality.lost, quality.bad_bytes) == (0, 0)
    seconds = counted_seconds(ends.down.arrived, started)
    assert 0.8 * RATE < sum(seconds) / SECONDS <= RATE
    # What a pause of a busy host held back may come in the next second, as much as may be sent at once.
    assert max(seconds) <= RATE * (1.0 + DEPTH) and sum(each <= RATE for each in seconds) >= SECONDS - 1
    shares = {name: received[name] / (ASKED * SECONDS) for name in ("ATTITUDE", "GLOBAL_POSITION_INT", *DETAILS)}
    assert received["HEARTBEAT"] >= SECONDS - 1 and shares["ATTITUDE"] > 0.9 and shares["GLOBAL_POSITION_INT"] > 0.9
    assert all(0.0 < shares[name] < 0.2 for name in DETAILS)
    assert "stream rates reduced" in ground.reports
