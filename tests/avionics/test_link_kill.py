"""A station kills a vehicle that flies: over a real link, asked of the real flight computer."""

from __future__ import annotations

import copy
import functools
import math
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from link_station import PATIENCE
from ports import free_port
from surrogate import Bird
from surrogate_gains import VEHICLE

from avionics.inputs import FORCED_DISARM
from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.ground import GroundLink
from avionics.messages import Command, CommandKind, Input, Stage
from avionics.missions import load_mission
from avionics.view import FlightView

ARM_DISARM, TERMINATE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_FLIGHTTERMINATION
DENIED, ACCEPTED = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_ACCEPTED


@functools.cache
def on_the_hand() -> str:
    """Memory of a flight computer in the air, armed, in AUTO."""
    view, bird = FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None), Bird()
    due = {3.0: CommandKind.SET_MODE, 3.5: CommandKind.ARM}
    for tick in range(round(8.0 * 200)):
        kind = due.get(tick / 200)
        commands = () if kind is None else (Command(0, kind, "AUTO"),)
        if tick == 4 * 200:
            bird.throw()
        bird.advance(view.autopilot.step(bird.frame(), commands))
    return view.autopilot.snapshot()


def flying() -> FlightView:
    view = FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None)
    view.autopilot.restore(on_the_hand())
    assert view.armed and view.autopilot.memory.modes.stage in (Stage.CLIMB_OUT, Stage.EN_ROUTE)
    return view


@contextmanager
def linked(view: FlightView) -> Iterator[tuple[GroundLink, socket.socket]]:
    port = free_port()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], view)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.connect(("127.0.0.1", port))
        station.setblocking(False)
        try:
            yield link, station
        finally:
            link.close()


def requested(view: FlightView, command: int, *params: float) -> tuple[int, list[Input]]:
    """The result that the station is told, and what goes into the flight computer."""
    inputs: list[Input] = []
    reader = FrameReader()
    message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *params, *(0.0,) * (7 - len(params)))
    with linked(view) as (link, station):
        station.send(FrameWriter(255, 190).pack(message))
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            inputs += link.poll(time.monotonic())
            for answer in received(station, reader):
                if answer.get_type() == "COMMAND_ACK":
                    return answer.result, inputs
    raise AssertionError("no COMMAND_ACK")


def received(station: socket.socket, reader: FrameReader) -> list[Any]:
    try:
        return [decode(frame) for frame in reader.feed(station.recv(2048))]
    except BlockingIOError:
        return []


@pytest.mark.parametrize(
    ("command", "params", "kind"),
    [
        (TERMINATE, (1.0,), CommandKind.KILL),
        (ARM_DISARM, (0.0, FORCED_DISARM), CommandKind.DISARM),
    ],
)
def test_a_flying_vehicle_is_killed_from_the_ground(
    command: int, params: tuple[float, ...], kind: CommandKind
) -> None:
    view = flying()
    before = copy.copy(view.autopilot.memory)
    result, inputs = requested(view, command, *params)
    assert result == ACCEPTED
    assert [entry.kind for entry in inputs if isinstance(entry, Command)] == [kind]
    assert view.autopilot.state == before, "the link alone changes nothing"
    frame = Bird().frame()._replace(time_us=view.time_us + 5000)
    actuators = view.autopilot.step(frame, inputs)
    assert not view.armed
    assert view.autopilot.memory.modes.killed == 1
    assert actuators.armed == 0


@pytest.mark.parametrize(
    ("command", "params"),
    [(TERMINATE, (math.nan,)), (TERMINATE, (0.0,)), (ARM_DISARM, (0.0, 0.0)), (ARM_DISARM, (0.0, math.nan))],
)
def test_what_is_no_kill_leaves_it_flying(command: int, params: tuple[float, ...]) -> None:
    view = flying()
    assert requested(view, command, *params) == (DENIED, [])
    assert view.armed
