"""What the screen needs is asked of vehicles that do not send it by themselves; on a clock of our own."""

from __future__ import annotations

from typing import Any

import pytest
from foreign_vehicles import ArduPlane, ForeignVehicle, Px4
from lossy_vehicle import LossyVehicle

from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.transport import Packet
from groundstation.link.connection import Connection
from groundstation.link.station import LOOK, LOOK_AGAIN, Station
from groundstation.link.stream_request import GROUPS, STREAMS

ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL


class Wire:
    """A link to a vehicle that beats once a second and says its attitude as often as it was asked to."""

    datagrams = True

    def __init__(self, vehicle: LossyVehicle, default_rate: float = 0.0) -> None:
        self.vehicle, self.default_rate, self.now = vehicle, default_rate, 0.0
        self._reader, self._packer = FrameReader(), mavlink.MAVLink(None, 1, 1)
        self._answers: list[Any] = []
        self._beat = self._turn = 0.0

    def clock(self) -> float:
        return self.now

    def pause(self, seconds: float) -> None:
        self.now += seconds

    def send(self, data: bytes) -> None:
        for frame in self._reader.feed(data):
            self._answers += self.vehicle.answers(decode(frame))

    def _rate(self) -> float:
        interval = getattr(self.vehicle, "intervals", {}).get(ATTITUDE)
        return self.default_rate if interval is None else 1e6 / interval

    def receive(self, now: float) -> list[Packet]:
        said, self._answers = self._answers, []
        if now >= self._beat:
            self._beat = now + 1.0
            said.append(self.vehicle.heartbeat())
        if self._rate() and now >= self._turn:
            self._turn = now + 1.0 / self._rate()
            said.append(mavlink.MAVLink_attitude_message(round(now * 1e3) + 1, 0.2, 0.1, 1.0, 0, 0, 0))
        return [Packet(message.pack(self._packer), ("air", 1)) for message in said]

    def register_peer(self, peer: Any) -> None:
        pass

    def close(self) -> None:
        pass


def watched(wire: Wire, monkeypatch: pytest.MonkeyPatch, until: float) -> Station:
    """A station that has watched for a while."""
    monkeypatch.setattr("groundstation.link.connection.open_transport", lambda url: wire)
    station = Station(Connection("udpin:test", clock=wire.clock, pause=wire.pause), wire.clock)
    while wire.now < until:
        station.poll()
        wire.pause(0.01)
    return station


@pytest.mark.parametrize("kind", [ArduPlane, Px4])
@pytest.mark.parametrize("default_rate", [0.0, 1.0])
def test_a_vehicle_that_says_little_is_asked_for_what_the_screen_shows(
    kind: type[ForeignVehicle], default_rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    vehicle = kind()
    station = watched(Wire(vehicle, default_rate), monkeypatch, LOOK + 6.0)
    assert vehicle.intervals == {stream.number: 1e6 / stream.rate for stream in STREAMS}
    assert station.connection.state.roll is not None
    (row,) = [row for row in station.traffic.rows(LOOK + 6.0) if row.name == "ATTITUDE"]
    assert row.rate == pytest.approx(10.0, rel=0.15)


def test_what_comes_often_enough_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = ArduPlane()
    watched(Wire(vehicle, 25.0), monkeypatch, LOOK + 6.0)
    assert ATTITUDE not in vehicle.intervals and len(vehicle.intervals) == len(STREAMS) - 1


def test_who_knows_no_interval_is_asked_for_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = ArduPlane()
    vehicle.results[INTERVAL] = mavlink.MAV_RESULT_UNSUPPORTED
    watched(Wire(vehicle), monkeypatch, LOOK + 3.0)
    assert vehicle.groups == list(GROUPS)


def test_what_a_vehicle_does_not_send_is_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = ArduPlane()
    vehicle.results[INTERVAL] = mavlink.MAV_RESULT_DENIED
    asked: list[int] = []
    answer = vehicle._command_long

    def remember(message: Any) -> list[Any]:
        asked.extend([int(message.param1)] if message.command == INTERVAL else [])
        return answer(message)

    monkeypatch.setattr(vehicle, "_command_long", remember)
    watched(Wire(vehicle), monkeypatch, LOOK + 2 * LOOK_AGAIN + 10.0)
    assert asked == [stream.number for stream in STREAMS]


class Disguised(ArduPlane):
    """Our own flight computer, which says that it is ArduPilot's."""

    def _version(self) -> Any:
        none = [0] * 8
        return mavlink.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, none, none, none, 0, 0, 0x77696E67)


@pytest.mark.parametrize("vehicle", [LossyVehicle(), Disguised()], ids=["generic", "ardupilot"])
def test_our_own_vehicle_is_not_asked(vehicle: LossyVehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    station = watched(Wire(vehicle), monkeypatch, LOOK + 3.0)
    assert station.connection.state.messages and not getattr(vehicle, "intervals", {})
