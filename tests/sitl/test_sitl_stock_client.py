"""The flight computer in flight, and pymavlink's own mavutil as its ground station over UDP."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from pymavlink import mavutil

from avionics.link.vehicle import Identity
from avionics.messages import Mode
from avionics.vehicles import load_vehicle
from logs.reader import open_log

PATIENCE = 60.0
mavlink = mavutil.mavlink


def expect(client: Any, kind: str, accept: Any = lambda message: True) -> Any:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        client.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        message = client.recv_match(type=kind, blocking=True, timeout=0.5)
        if message is not None and accept(message):
            return message
    raise AssertionError(f"no such {kind} within {PATIENCE} s")


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[tuple[Any, Path, subprocess.Popen[bytes]]]:
    """A flight in twice real time: a stock client on its link, its log and its process."""
    port, log = free_port(), tmp_path / "flight.mcap"
    words = ["fly", "--speed", "2", "--duration", "24", "--json", "--log", str(log)]
    flying = subprocess.Popen(
        [sys.executable, "-m", "groundstation.command.main", *words, "--gcs", f"udpin:127.0.0.1:{port}"],
        stdout=subprocess.DEVNULL,
    )
    client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="common")
    try:
        yield client, log, flying
    finally:
        flying.kill()
        client.close()


@pytest.mark.validate
def test_a_stock_client_sees_the_flight_and_commands_it(
    flight: tuple[Any, Path, subprocess.Popen[bytes]],
) -> None:
    client, log, flying = flight
    heard = expect(client, "HEARTBEAT")
    assert (heard.type, heard.autopilot) == (mavlink.MAV_TYPE_FLAPPING_WING, mavlink.MAV_AUTOPILOT_GENERIC)
    client.target_system, client.target_component = heard.get_srcSystem(), heard.get_srcComponent()
    assert abs(expect(client, "ATTITUDE").pitch) < 1.0

    client.param_fetch_one("PITCH_P")
    gain = expect(client, "PARAM_VALUE", lambda value: value.param_id == "PITCH_P")
    flown = load_vehicle("robo_raven_ii_d").gains.pitch.proportional
    assert gain.param_value == pytest.approx(flown)

    wanted = Identity().numbers(Mode.ALTITUDE_HOLD).custom_mode
    client.mav.command_long_send(
        client.target_system, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, wanted >> 16 & 0xFF, wanted >> 24, 0, 0, 0, 0
    )
    answer = expect(client, "COMMAND_ACK", lambda ack: ack.command == mavlink.MAV_CMD_DO_SET_MODE)
    assert answer.result == mavlink.MAV_RESULT_ACCEPTED
    expect(client, "HEARTBEAT", lambda message: message.custom_mode == wanted)

    assert flying.wait(timeout=PATIENCE) == 0
    with open_log(log) as recorded:
        assert any("ALTITUDE_HOLD" in text.text for text in recorded.texts("/system/inputs"))
