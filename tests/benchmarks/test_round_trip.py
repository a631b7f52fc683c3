"""Sensors out and actuators back between two processes over TCP, ours beside bare pymavlink (``make bench``)."""

from __future__ import annotations

import os
import socket
import statistics
import subprocess
import sys
import time
from typing import Any

import pytest
from ports import free_port
from rows import Row, leave, peer

from avionics import messages as m
from avionics.link.codec import HIL_ACTUATOR_CONTROLS, FrameWriter, decode_actuators
from avionics.link.dialect import mavlink
from avionics.link.framing import sole_payload
from avionics.link.tick_codec import decode_tick
from avionics.link.transport import Listener, SocketStream, open_stream

TRIPS, ROUNDS = 3000, 5
PATIENCE = 10.0
"""s"""
IMU = (0.1, 0.2, -9.8, 0.01, 0.02, 0.03, 0.2, 0.0, 0.4)


def here(core: int) -> None:
    """Run on this core alone."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})


def wingbeat_answer(address: str, hasty: bool) -> None:
    """The flight computer's end: an answer to each tick, until the world hangs up."""
    stream = open_stream(address, PATIENCE)
    assert isinstance(stream, SocketStream)
    if hasty:
        stream.enable_busy_poll()
    writer = FrameWriter(1, 1)
    while (data := stream.read(PATIENCE)) is not None:
        tick = decode_tick(data)
        assert tick is not None
        stream.write(writer.actuators(m.ActuatorCommand(tick.frame.time_us, 0.1, 0.1, 0.5, 0.0, 0.0, 1)))


def wingbeat_trips(stream: SocketStream) -> list[float]:
    """s; of each trip, encoder and HIL_SENSOR there, HIL_ACTUATOR_CONTROLS back."""
    writer, spent = FrameWriter(2, 1), []
    for n in range(1, TRIPS + 1):
        begun = time.perf_counter()
        encoder = m.EncoderSample(*([5000 * n] + [100] * (len(m.EncoderSample._fields) - 1)))
        stream.write(writer.sensors(m.SensorFrame(5000 * n, m.ImuSample(5000 * n, *IMU), encoder=encoder)))
        payload = sole_payload(stream.read(PATIENCE) or b"", HIL_ACTUATOR_CONTROLS)
        reply = decode_actuators(payload) if payload else None
        spent.append(time.perf_counter() - begun)
        assert reply is not None and reply.command.time_us == 5000 * n
    return spent


def pymavlink_end(url: str) -> Any:
    """A connection of `mavutil` that speaks our dialect, in which the encoder's message is."""
    from pymavlink import mavutil

    mavutil.mavlink = mavlink
    return mavutil.mavlink_connection(url, source_system=2, retries=50)


def pymavlink_answer(address: str, hasty: bool) -> None:
    """The same end with the package's connection and message objects; it knows no haste."""
    end = pymavlink_end(address)
    end.mav.wingbeat_encoder_send(*([0] * len(m.EncoderSample._fields)))
    for _ in range(ROUNDS * TRIPS):
        tick = end.recv_match(type="HIL_SENSOR", blocking=True, timeout=PATIENCE)
        end.mav.hil_actuator_controls_send(tick.time_usec, [0.1, 0.1, 0.0, 0.0, 0.5] + [0.0] * 11, 129, 1)


def pymavlink_trips(end: Any) -> list[float]:
    """s"""
    counts, spent = [100] * (len(m.EncoderSample._fields) - 1), []
    for n in range(1, TRIPS + 1):
        begun = time.perf_counter()
        end.mav.wingbeat_encoder_send(5000 * n, *counts)
        end.mav.hil_sensor_send(5000 * n, *IMU, 0.0, 0.0, 0.0, 0.0, 0x1FF)
        reply = end.recv_match(type="HIL_ACTUATOR_CONTROLS", blocking=True, timeout=PATIENCE)
        spent.append(time.perf_counter() - begun)
        assert reply is not None and reply.time_usec == 5000 * n
    return spent


def answering(kind: str, address: str, core: int, hasty: bool) -> subprocess.Popen[bytes]:
    where = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen([sys.executable, __file__, kind, address, str(core), str(int(hasty))], env=where)


def computed(core: int, address: str) -> float:
    """us; the median of the quickest round, with the partner on ``core`` and us on the first."""
    listener, hasty = Listener(address), core != 0
    with answering("ours", address, core, hasty) as partner:
        stream = listener.accept(PATIENCE)
        assert stream is not None
        if hasty:
            stream.enable_busy_poll()
        best = min(statistics.median(wingbeat_trips(stream)) for _ in range(ROUNDS))
        stream.close()
        listener.close()
        assert partner.wait(PATIENCE) == 0
    return 1e6 * best


def pymavlinks(core: int) -> float:
    """us; the same."""
    port = free_port(socket.SOCK_STREAM)
    with answering("pymavlink", f"tcp:127.0.0.1:{port}", core, False) as partner:
        end = pymavlink_end(f"tcpin:127.0.0.1:{port}")
        # It lets the partner in when it is first read from.
        assert end.recv_match(type="WINGBEAT_ENCODER", blocking=True, timeout=PATIENCE) is not None
        best = min(statistics.median(pymavlink_trips(end)) for _ in range(ROUNDS))
        assert partner.wait(PATIENCE) == 0
        end.close()
    return 1e6 * best


@pytest.mark.bench
@pytest.mark.parametrize("core", [0, 1], ids=["one core", "two cores"])
def test_round_trip_beside_pymavlink(core: int) -> None:
    """On two cores our ends look without sleeping, as a lockstep pair does there."""
    if not hasattr(os, "sched_setaffinity") or not {0, core} <= os.sched_getaffinity(0):
        pytest.skip("two cores to choose from are wanted")
    before = os.sched_getaffinity(0)
    here(0)
    try:
        mine, other = computed(core, f"tcp:127.0.0.1:{free_port(socket.SOCK_STREAM)}"), pymavlinks(core)
        local = computed(core, f"unix:wingbeat-bench-{os.getpid()}") if sys.platform == "linux" else None
    finally:
        os.sched_setaffinity(0, before)
    cores = "two cores" if core else "one core"
    package = f"{peer('pymavlink')}, mavutil"
    leave(Row(f"MAVLink round trip over TCP, {cores}, median", mine, other, "us", package))
    if local is not None:
        leave(Row(f"MAVLink round trip over a Unix socket, {cores}, median", local, other, "us", f"{package}, TCP"))


if __name__ == "__main__":
    here(int(sys.argv[3]))
    answer = {"ours": wingbeat_answer, "pymavlink": pymavlink_answer}[sys.argv[1]]
    answer(sys.argv[2], sys.argv[4] == "1")
