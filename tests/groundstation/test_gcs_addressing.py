"""Whose words count in a conversation, where several vehicles and ground stations share a link."""

from __future__ import annotations

from typing import Any

import pytest

from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.transport import Packet
from groundstation.link.answers import NoAnswer
from groundstation.link.commands import CommandExchange
from groundstation.link.connection import Connection
from groundstation.link.exchange import Exchange, Target
from groundstation.link.missions import MissionDownload
from groundstation.link.parameters import ParameterRead

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
DENIED = mavlink.MAV_RESULT_DENIED
Said = tuple[int, int, Any]
"""system, component, message"""


def beat(autopilot: int = 0) -> Any:
    return mavlink.MAVLink_heartbeat_message(16, autopilot, 1, 65536, 4, 3)


class Air:
    """A link on which the vehicle 1, component 1 is not alone; ``answers`` come in their order to any question."""

    datagrams = True

    def __init__(self, *answers: Said) -> None:
        self.now = 0.0
        self.answers = answers
        self.requested: list[Any] = []
        self._reports: list[Said] = [(1, 1, beat())]
        self._reader = FrameReader()

    def clock(self) -> float:
        return self.now

    def pause(self, seconds: float) -> None:
        self.now += seconds

    def send_text(self, *reports: Said) -> None:
        self._reports.extend(reports)

    def send(self, data: bytes) -> None:
        questions = [message for message in map(decode, self._reader.feed(data)) if message.get_type() != "HEARTBEAT"]
        self.requested += questions
        if questions:
            self.send_text(*self.answers)

    def receive(self, now: float) -> list[Packet]:
        """One message at a time, so that nothing waits for what comes behind it."""
        reports, self._reports = self._reports[:1], self._reports[1:]
        return [Packet(message.pack(mavlink.MAVLink(None, *who)), ("air", 1)) for *who, message in reports]

    def register_peer(self, peer: Any) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture
def connect(monkeypatch: pytest.MonkeyPatch) -> Any:
    def over(air: Air) -> Connection:
        monkeypatch.setattr("groundstation.link.connection.open_transport", lambda url: air)
        connection = Connection("udpin:test", clock=air.clock, pause=air.pause)
        connection.find_vehicle()
        return connection

    return over


def ack(result: int, system: int = 0, component: int = 0) -> Any:
    return mavlink.MAVLink_command_ack_message(ARM, result, 0, 0, system, component)


@pytest.mark.parametrize(
    "stranger",
    [
        (2, 1, ack(0)),
        (1, 154, ack(0)),
        (1, 1, ack(0, 254, 190)),
        (1, 1, ack(0, 255, 230)),
        (255, 190, ack(0, 255, 190)),
    ],
    ids=["another vehicle", "its camera", "to another station", "to another program", "an echo"],
)
@pytest.mark.parametrize("to", [(0, 0), (255, 0), (255, 190)])
def test_a_command_is_acknowledged_by_the_vehicle_and_to_us(
    stranger: Said, to: tuple[int, int], connect: Any
) -> None:
    connection = connect(Air(stranger, (1, 1, ack(DENIED, *to))))
    with pytest.raises(NoAnswer, match="COMPONENT_ARM_DISARM denied: denied"):
        connection.run(CommandExchange(connection.target, ARM, (1.0,)))


def test_beside_other_things_it_is_the_same(connect: Any) -> None:
    air = Air((2, 1, ack(0)), (1, 1, ack(DENIED)))
    connection = connect(air)
    ended: list[Any] = []
    connection.begin(CommandExchange(connection.target, ARM, (1.0,)), ended.append)
    while not ended:
        connection.receive()
        connection.wait()
    assert ended[0].failure == "COMPONENT_ARM_DISARM denied: denied"


def test_the_reason_of_another_vehicle_is_none(connect: Any) -> None:
    other = mavlink.MAVLink_statustext_message(4, b"battery low")
    connection = connect(Air((2, 1, other), (1, 154, other), (1, 1, ack(DENIED))))
    with pytest.raises(NoAnswer, match="COMPONENT_ARM_DISARM denied: denied"):
        connection.run(CommandExchange(connection.target, ARM, (1.0,)))


def value(number: float) -> Any:
    return mavlink.MAVLink_param_value_message(b"GAIN", number, 9, 1, 0)


def test_a_parameter_is_the_vehicles_own(connect: Any) -> None:
    connection = connect(Air((2, 1, value(7.0)), (1, 154, value(8.0)), (1, 1, value(9.0))))
    read = connection.run(ParameterRead(connection.target, "GAIN"))
    assert read.value is not None and read.value.value == 9.0


def count(items: int, system: int, component: int) -> Any:
    return mavlink.MAVLink_mission_count_message(system, component, items)


def test_a_mission_that_another_station_reads_is_not_ours(connect: Any) -> None:
    connection = connect(Air((1, 1, count(3, 254, 190)), (2, 1, count(4, 255, 190)), (1, 1, count(0, 255, 190))))
    download: Exchange = connection.run(MissionDownload(connection.target))
    assert download.progress().done == download.progress().total == 0


def test_the_autopilot_is_found_among_the_components_of_the_vehicle_alone(connect: Any) -> None:
    air = Air()
    connection = connect(air)
    air.send_text((2, 25, beat()), (1, 154, beat(mavlink.MAV_AUTOPILOT_INVALID)), (1, 26, beat()))
    connection.listen(1.0)
    assert connection.target == Target(1, 1)


def test_component_1_is_the_autopilot_where_another_spoke_first(connect: Any) -> None:
    air = Air()
    air._reports = [(1, 26, beat())]
    connection = connect(air)
    assert connection.target == Target(1, 26)
    air.send_text((1, 1, beat()))
    connection.receive()
    assert connection.target == Target(1, 1)
