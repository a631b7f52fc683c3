"""QGroundControl's requests when it connects (order of InitialConnectStateMachine) and its guided actions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from link_vehicle import HOME, FakeVehicle
from link_wires import Voice, Wire

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.vehicle import PROFILES, Identity
from avionics.messages import Mode, Stage

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
PLAN = (
    MissionItem(ItemKind.TAKEOFF, altitude=30.0),
    MissionItem(ItemKind.WAYPOINT, 100.0, 20.0, 30.0),
    MissionItem(ItemKind.RETURN),
)
STREAMED = (
    "HEARTBEAT SYS_STATUS ATTITUDE VFR_HUD GLOBAL_POSITION_INT GPS_RAW_INT BATTERY_STATUS EXTENDED_SYS_STATE"
    " HOME_POSITION SERVO_OUTPUT_RAW RC_CHANNELS MISSION_CURRENT WIND_COV"
)


class QGroundControl:
    """Sends a message and reads what comes back within 50 ms of the vehicle's time."""

    def __init__(self, identity: Identity) -> None:
        self.vehicle, self.wire, self.voice, self.now = FakeVehicle(), Wire("udpin:127.0.0.1:1"), Voice(255), 1.0
        self.vehicle.mission = PLAN
        self.identity = identity
        self.link = GroundLink([self.wire], self.vehicle, identity)

    def read(self, seconds: float = 0.05) -> list[Any]:
        received, end = [], self.now + seconds
        while self.now < end:
            self.now += 0.01
            self.vehicle.apply(self.link.poll(self.now))
            self.link.stream(self.now)
            received += self.wire.incoming()
            self.wire.take()
        return received

    def answer(self, message: Any, kind: str) -> Any:
        """The first answer of a kind."""
        self.wire.put(self.voice.frame(message))
        return next(each for each in self.read() if each.get_type() == kind)

    def command(self, number: int, *params: float) -> list[Any]:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.wire.put(self.voice.frame(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded)))
        return self.read()

    def result(self, number: int, *params: float) -> int:
        """The one acknowledgement of a command."""
        acks = [each for each in self.command(number, *params) if each.get_type() == "COMMAND_ACK"]
        assert [each.command for each in acks] == [number]
        return int(acks[0].result)

    def requested(self, message_id: int, kind: str, index: float = 0.0) -> Any:
        """A message by REQUEST_MESSAGE."""
        answers = self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, index)
        assert next(each.result for each in answers if each.get_type() == "COMMAND_ACK") == ACCEPTED
        return next(each for each in answers if each.get_type() == kind)

    def plan(self, mission_type: int) -> list[Any]:
        count = self.answer(mavlink.MAVLink_mission_request_list_message(1, 1, mission_type), "MISSION_COUNT").count
        return [
            self.answer(mavlink.MAVLink_mission_request_int_message(1, 1, number, mission_type), "MISSION_ITEM_INT")
            for number in range(count)
        ]


@pytest.fixture(params=["ardupilot", "px4"])
def station(request: pytest.FixtureRequest) -> Iterator[QGroundControl]:
    yield QGroundControl(PROFILES[request.param])


def test_first_connection(station: QGroundControl) -> None:
    beat = next(each for each in station.read(1.5) if each.get_type() == "HEARTBEAT")
    assert (beat.autopilot, beat.type) == (station.identity.autopilot, station.identity.type)
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    version = station.requested(148, "AUTOPILOT_VERSION")
    for bit in ("MISSION_INT", "COMMAND_INT", "MAVLINK2", "FTP", "MISSION_FENCE", "MISSION_RALLY"):
        assert version.capabilities & getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{bit}")
    first = station.requested(435, "AVAILABLE_MODES", 1.0)
    modes = [station.requested(435, "AVAILABLE_MODES", float(index + 1)) for index in range(first.number_modes)]
    assert {each.custom_mode for each in modes} == {each.custom_mode for each in station.identity.modes}
    assert station.requested(397, "COMPONENT_METADATA").uri.startswith("mftp")
    assert station.requested(300, "PROTOCOL_VERSION").max_version == 200
    assert station.requested(242, "HOME_POSITION").altitude == round(HOME.altitude * 1e3)
    for absent in (259, 280, 283, 388):  # camera, gimbals, what does not exist: a quick refusal
        assert station.result(mavlink.MAV_CMD_REQUEST_MESSAGE, absent) != ACCEPTED
    station.wire.put(station.voice.frame(mavlink.MAVLink_param_request_list_message(1, 1)))
    values = [each for each in station.read(4.0) if each.get_type() == "PARAM_VALUE"]
    assert {each.param_index for each in values} == set(range(values[0].param_count))
    mission = station.plan(mavlink.MAV_MISSION_TYPE_MISSION)
    assert [each.command for each in mission][station.identity.first_item :] == [22, 16, 20]
    assert station.plan(mavlink.MAV_MISSION_TYPE_FENCE) == station.plan(mavlink.MAV_MISSION_TYPE_RALLY) == []
    kinds = {each.get_type() for each in station.read(4.0)}
    assert set(STREAMED.split()) <= kinds


def test_guided_actions(station: QGroundControl) -> None:
    """Arm, take off, hold, mission, return, land, go to, orbit, change altitude: QGroundControl's buttons."""
    vehicle, identity = station.vehicle, station.identity
    navigation = vehicle.topics[topics.NAVIGATION.name]
    vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.WAIT_LAUNCH, item=0)
    assert station.result(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == ACCEPTED and vehicle.armed
    assert station.result(
        mavlink.MAV_CMD_NAV_TAKEOFF, -1.0, 0, 0, float("nan"), float("nan"), float("nan"), 40.0
    ) == (ACCEPTED)
    assert vehicle.mode is Mode.AUTO
    vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.EN_ROUTE, item=1)
    for mode in (Mode.LOITER, Mode.AUTO, Mode.RETURN, Mode.LAND):
        numbers = identity.numbers(mode).custom_mode
        sub = (numbers >> 16 & 0xFF, numbers >> 24) if identity.first_item == 0 else (numbers, 0)
        assert station.result(mavlink.MAV_CMD_DO_SET_MODE, 1.0, *sub) == ACCEPTED and vehicle.mode is mode
    place = (round(48.101e7), round(11.601e7))
    for number, params in (
        (mavlink.MAV_CMD_DO_REPOSITION, (-1.0, 1.0, 0.0, float("nan"))),
        (mavlink.MAV_CMD_DO_ORBIT, (40.0, float("nan"), 0.0, 0.0)),
    ):
        message = mavlink.MAVLink_command_int_message(1, 1, 0, number, 0, 0, *params, *place, HOME.altitude + 40.0)
        assert station.answer(message, "COMMAND_ACK").result == ACCEPTED
    assert station.result(mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, 50.0, 3.0) == ACCEPTED
    assert station.result(mavlink.MAV_CMD_MISSION_START) == ACCEPTED and vehicle.mode is Mode.AUTO
    chosen = 1 + identity.first_item
    answer = station.answer(mavlink.MAVLink_mission_set_current_message(1, 1, chosen), "MISSION_CURRENT")
    assert answer.seq == chosen
