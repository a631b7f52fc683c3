"""A board that falls silent in the middle: nothing that was asked meanwhile moves the wings when it is back."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from test_onboard import TICK_US, Memory, Rest

from avionics import topics
from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.ground import GroundLink
from avionics.link.transport import Packet, Peer
from avionics.link.urls import parse_url
from avionics.messages import CommandKind
from avionics.missions import load_mission
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import load_vehicle
from wingbeat.message import Event

POLL = 0.05
"""s; a waiting board calls `idle` as often"""
ACCEPTED, LATER = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
KILL_ON = 1900
"""us; a switch that is on"""


class Ear:
    """A transport whose other end is the test."""

    datagrams = True
    peers = None
    portion = 65536
    dropped = 0

    def __init__(self) -> None:
        self.url = parse_url("udpin:127.0.0.1:14550")
        self.received: list[Any] = []
        self._station = FrameWriter(255, 190)
        self._waiting: list[Packet] = []

    def send_text(self, message: Any) -> None:
        self._waiting.append(Packet(self._station.pack(message), "station"))

    def receive(self, now: float) -> list[Packet]:
        packets, self._waiting = self._waiting, []
        return packets

    def register_peer(self, peer: Peer) -> None:
        pass

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        self.received += [decode(frame) for frame in FrameReader().feed(data)]

    def close(self) -> None:
        pass


class Bench(Rest):
    """Frames on a clock of the test; before those of ``pauses`` it is silent while ``meanwhile`` is called."""

    def __init__(self, ticks: int, pauses: dict[int, Callable[[], Iterator[float]]]) -> None:
        super().__init__(ticks)
        self.ear, self.memory, self.now = Ear(), Memory(), 0.0
        vehicle, mission = load_vehicle("robo_raven_ii_d"), load_mission("circuit")
        self.onboard = FlightComputer(vehicle, mission, self.memory, clock=lambda: self.now)
        self._pauses = pauses

    def read(self) -> Any:
        tick = self.time_us // TICK_US + 1
        for wait in self._pauses.get(tick, lambda: iter(()))():
            self.now += wait
            self.onboard.idle()
        self.now += TICK_US * 1e-6
        return super().read()

    def fly(self) -> None:
        self.onboard.fly(self, GroundLink([self.ear], self.onboard.view))

    def request(self, command: int, *params: float) -> None:
        self.ear.send_text(mavlink.MAVLink_command_long_message(1, 1, command, 0, *(*params, *(0.0,) * 7)[:7]))

    def received(self, kind: str) -> list[Any]:
        return [each for each in self.ear.received if each.get_type() == kind]

    def acks(self) -> list[tuple[int, int]]:
        return [(each.command, each.result) for each in self.received("COMMAND_ACK")]

    def texts(self) -> list[str]:
        """What was said of the silence."""
        return [each.text for each in self.received("STATUSTEXT") if "no sensor frames" in each.text]

    def obeyed(self) -> list[tuple[str, int]]:
        """Kinds of the commands that entered, and the tick in which they did."""
        entered = [json.loads(each.text) for topic, each in self.memory.kept if topic is topics.INPUTS]
        return [(each["kind"], each["time_us"] // TICK_US) for each in entered]

    def sticks(self) -> list[int]:
        """Ticks in which the sticks moved."""
        return [each.time_us // TICK_US for topic, each in self.memory.kept if topic is topics.PILOT]


def bench(meanwhile: Callable[[Bench], Iterator[float]], ticks: int = 40, at: int = 20) -> Bench:
    """Flown, with a pause before tick ``at`` that lasts as long as ``meanwhile`` says."""
    board: Bench

    def pause() -> Iterator[float]:
        yield from meanwhile(board)

    board = Bench(ticks, {at: pause})
    board.fly()
    return board


def idle(duration: float) -> Iterator[float]:
    yield from (POLL for _ in range(round(duration / POLL)))


def stabilize(board: Bench) -> None:
    board.request(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 7 << 16)


def test_a_command_while_the_board_is_silent_is_refused_and_not_obeyed_later() -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        yield from idle(1.0)
        board.request(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        stabilize(board)
        board.ear.send_text(mavlink.MAVLink_set_mode_message(1, 1, 7 << 16))
        board.ear.send_text(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
        yield from idle(20.0)

    board = bench(meanwhile)
    arm, mode = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE
    assert board.acks() == [(arm, LATER), (mode, LATER), (mode, LATER)]
    assert board.texts() == ["no sensor frames"] * 4
    assert board.obeyed() == []


def test_nothing_moves_before_the_first_frame_either() -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        stabilize(board)
        yield from idle(0.2)

    board = bench(meanwhile, at=1)
    assert board.acks() == [(mavlink.MAV_CMD_DO_SET_MODE, LATER)] and board.obeyed() == []


def test_a_command_that_was_accepted_just_before_is_forgotten_and_that_is_said_once() -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        stabilize(board)
        yield from idle(0.1)
        assert board.acks() == [(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)]
        yield from idle(5.0)

    board = bench(meanwhile)
    assert board.obeyed() == []
    said = [each.text for topic, each in board.memory.kept if isinstance(each, Event) and "no sensor" in each.text]
    assert said == ["no sensor frames: SET_MODE dropped"]
    assert board.texts() == said


def test_a_frame_that_is_a_little_late_costs_no_command() -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        stabilize(board)
        yield from idle(0.4)

    assert bench(meanwhile).obeyed() == [("SET_MODE", 20)]


def test_a_flight_computer_that_stood_still_forgets_too() -> None:
    """GIVEN a command that waits WHEN the whole computer is suspended THEN it is dropped at the next tick."""

    def meanwhile(board: Bench) -> Iterator[float]:
        stabilize(board)
        yield from idle(0.1)
        board.now += 10.0

    assert bench(meanwhile).obeyed() == []


@pytest.mark.parametrize(
    ("command", "params", "kind"),
    [
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,), CommandKind.DISARM),
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, 21196.0), CommandKind.DISARM),
        (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, (1.0,), CommandKind.KILL),
    ],
)
def test_what_stops_the_wings_waits_and_is_obeyed_at_the_first_tick_once(
    command: int, params: tuple[float, ...], kind: CommandKind
) -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        yield from idle(1.0)
        for _ in range(3):
            board.request(command, *params)
            yield from idle(3.0)

    board = bench(meanwhile)
    assert board.acks() == [(command, ACCEPTED)] * 3
    assert board.obeyed() == [(kind.name, 20)]


def test_old_sticks_are_not_flown_and_fresh_ones_are() -> None:
    def stick(board: Bench) -> None:
        board.ear.send_text(mavlink.MAVLink_manual_control_message(1, 500, 0, 500, 0, 0))

    def fallen_silent(board: Bench) -> Iterator[float]:
        stick(board)
        yield from idle(2.0)

    def fixed(board: Bench) -> Iterator[float]:
        for _ in range(40):
            stick(board)
            yield POLL

    assert bench(fallen_silent).sticks() == []
    sticks = bench(fixed).sticks()
    assert set(sticks) == {20} and len(sticks) <= 11


def test_a_kill_switch_among_old_channels_still_kills() -> None:
    def meanwhile(board: Bench) -> Iterator[float]:
        board.onboard.view.autopilot.memory.modes = board.onboard.view.autopilot.memory.modes._replace(armed=1)
        yield from idle(1.0)
        board.ear.send_text(
            mavlink.MAVLink_rc_channels_override_message(1, 1, 1500, 1500, 1000, 1500, 1000, 1000, KILL_ON, 1000)
        )
        yield from idle(5.0)

    board = bench(meanwhile)
    assert board.obeyed() == [("KILL", 20)] and not board.onboard.view.armed


def test_parameters_and_missions_are_refused_too_and_what_is_only_asked_is_answered() -> None:
    """They would be harmless later, but their answers are due now: what is confirmed as refused must stay so."""

    def meanwhile(board: Bench) -> Iterator[float]:
        yield from idle(1.0)
        board.ear.send_text(mavlink.MAVLink_param_set_message(1, 1, b"NAV_LOITER_TIME", 20.0, 9))
        board.ear.send_text(mavlink.MAVLink_mission_count_message(1, 1, 1))
        board.ear.send_text(mavlink.MAVLink_mission_clear_all_message(1, 1, mavlink.MAV_MISSION_TYPE_ALL))
        board.request(mavlink.MAV_CMD_REQUEST_MESSAGE, float(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION))
        board.request(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, float(mavlink.MAVLINK_MSG_ID_ATTITUDE), 1e5)
        yield from idle(3.0)

    board = bench(meanwhile)
    assert board.obeyed() == []
    assert [each.param_value for each in board.received("PARAM_VALUE")] == [30.0]
    assert [each.error for each in board.received("PARAM_ERROR")] == [mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED]
    assert [each.type for each in board.received("MISSION_ACK")] == [mavlink.MAV_MISSION_DENIED] * 2
    assert [result for _, result in board.acks()] == [ACCEPTED, ACCEPTED] and board.received("AUTOPILOT_VERSION")


def test_when_the_board_is_back_commands_are_taken_again() -> None:
    board: Bench

    def request() -> Iterator[float]:
        stabilize(board)
        yield 0.0

    board = Bench(40, {20: lambda: idle(30.0), 25: request})
    board.fly()
    assert board.acks() == [(mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)] and board.obeyed() == [("SET_MODE", 26)]
