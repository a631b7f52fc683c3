"""The identities of the vehicle before a stock client."""

from __future__ import annotations

from typing import Any

import pytest
from link_station import expect, settle, stock_client
from link_vehicle import FakeVehicle
from pymavlink import mavutil

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.vehicle import PROFILES, Identity, load_identity
from avionics.messages import CommandKind, Mode, Stage
from wingbeat.errors import InputError

mavlink: Any = mavutil.mavlink
PLANE = PROFILES["ardupilot"]
MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.WAYPOINT, 120.0, -35.0, 40.0),
    MissionItem(ItemKind.JUMP, jump_to=1, repeats=2),
    MissionItem(ItemKind.RETURN),
)


def item(client: Any, sequence: int) -> Any:
    client.mav.mission_request_int_send(1, 1, sequence)
    return expect(client, "MISSION_ITEM_INT", lambda got: got.seq == sequence)


def upload(client: Any, items: list[Any]) -> int:
    client.mav.mission_count_send(1, 1, len(items))
    while (message := expect(client, ["MISSION_REQUEST_INT", "MISSION_ACK"])).get_type() != "MISSION_ACK":
        client.mav.send(items[message.seq])
    return int(message.type)


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
def test_every_mode_of_a_profile_can_be_set_by_its_number_and_is_shown_with_it(identity: Identity) -> None:
    assert {entry.mode for entry in identity.modes} == set(Mode)
    assert len({entry.custom_mode for entry in identity.modes}) == len(Mode) + 1
    with stock_client(identity=identity) as (client, vehicle):
        vehicle.mission = (MissionItem(ItemKind.TAKEOFF, altitude=20.0),)
        for entry in identity.modes:
            client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, entry.custom_mode, 0, 0, 0, 0, 0)
            assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
            beat = expect(client, "HEARTBEAT", lambda got, expected=entry: got.custom_mode == expected.custom_mode)
            assert (beat.type, beat.autopilot) == (identity.type, identity.autopilot)
            assert vehicle.mode is entry.mode


def on_ground(vehicle: FakeVehicle, stage: Stage = Stage.WAIT_LAUNCH) -> None:
    navigation = vehicle.topics[topics.NAVIGATION.name]
    vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=stage)


@pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)
@pytest.mark.parametrize("by_main_and_sub", [False, True])
def test_a_hold_mode_on_the_ground_is_accepted_shown_and_waits(identity: Identity, by_main_and_sub: bool) -> None:
    """GIVEN a vehicle in the hand WHEN a client sets a hold mode, as MAVSDK before it arms THEN AUTO stays."""
    for hold in identity.standby_modes:
        with stock_client(identity=identity) as (client, vehicle):
            on_ground(vehicle)
            vehicle.mode = Mode.AUTO
            vehicle.refusals[CommandKind.SET_MODE] = "not on the ground"
            split = (hold >> 16 & 0xFF, hold >> 24) if by_main_and_sub and hold > 0xFFFF else (hold, 0)
            client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, *split, 0, 0, 0, 0)
            assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
            expect(client, "HEARTBEAT", lambda got, number=hold: got.custom_mode == number)
            client.arducopter_arm()
            assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
            settle(client)
            assert vehicle.armed and vehicle.mode is Mode.AUTO
            on_ground(vehicle, Stage.CLIMB_OUT)
            auto = identity.numbers(Mode.AUTO).custom_mode
            expect(client, "HEARTBEAT", lambda got, number=auto: got.custom_mode == number)
            assert CommandKind.SET_MODE not in [each.kind for each in vehicle.inputs]


def test_px4_s_profile_has_px4_s_numbers_and_encoding() -> None:
    identity = PROFILES["px4"]
    names = {name: main << 16 | sub << 24 for name, (_, main, sub) in mavutil.px4_map.items()}
    same = {"MANUAL": Mode.MANUAL, "STABILIZED": Mode.STABILIZED, "ALTCTL": Mode.ALTITUDE_HOLD,
            "MISSION": Mode.AUTO, "RTL": Mode.RETURN, "LOITER": Mode.LOITER, "LAND": Mode.LAND,
            "OFFBOARD": Mode.OFFBOARD, "TAKEOFF": Mode.AUTO, "POSCTL": Mode.ALTITUDE_HOLD}  # fmt: skip
    assert {name: identity.by_custom_mode(names[name]) for name in same} == same
    with stock_client(identity=identity) as (client, _):
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
        version = expect(client, "AUTOPILOT_VERSION")
        encodings = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        encodings |= mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        assert version.capabilities & encodings == mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        assert bytes(version.flight_custom_version) == b"wingbeat"


def test_the_aeroplane_of_ardupilot_has_its_mode_numbers() -> None:
    names = mavutil.mode_mapping_byname(mavlink.MAV_TYPE_FIXED_WING)
    same = {"MANUAL": Mode.MANUAL, "FBWA": Mode.STABILIZED, "FBWB": Mode.ALTITUDE_HOLD, "AUTO": Mode.AUTO,
            "RTL": Mode.RETURN, "LOITER": Mode.LOITER, "AUTOLAND": Mode.LAND, "GUIDED": Mode.OFFBOARD,
            "STABILIZE": Mode.STABILIZED, "TAKEOFF": Mode.AUTO}  # fmt: skip
    assert {name: PLANE.by_custom_mode(names[name]) for name in same} == same
    assert PLANE.by_custom_mode(names["QHOVER"]) is None
    with stock_client(identity=PLANE) as (client, vehicle):
        assert client.flightmode == "MANUAL"
        client.set_mode("RTL")
        expect(client, "HEARTBEAT", lambda beat: beat.custom_mode == 11)
        assert (client.flightmode, vehicle.mode) == ("RTL", Mode.RETURN)
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
        encodings = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        encodings |= mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        told = expect(client, "AUTOPILOT_VERSION").capabilities
        assert told & encodings == mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST


def test_item_0_is_home_for_ardupilot_and_the_mission_comes_back_as_it_was_sent() -> None:
    with stock_client(identity=PLANE) as (client, vehicle):
        vehicle.mission = MISSION
        client.mav.mission_request_list_send(1, 1)
        count = expect(client, "MISSION_COUNT").count
        items = [item(client, sequence) for sequence in range(count)]
        assert [each.command for each in items] == [16, 22, 16, 177, 20]
        assert (items[0].x, items[0].y, items[0].z) == (481000000, 116000000, 520.0)
        assert items[3].param1 == 2.0  # the jump goes to the waypoint, which is item 2 now
        vehicle.mission = ()
        for each in items:
            each.target_system, each.target_component = 1, 1
        assert upload(client, items) == mavlink.MAV_MISSION_ACCEPTED
        assert [each.kind for each in vehicle.mission] == [each.kind for each in MISSION]
        assert vehicle.mission[2] == MISSION[2]
        assert upload(client, items[:1]) == mavlink.MAV_MISSION_ACCEPTED
        assert vehicle.mission == ()
        client.mav.mission_request_list_send(1, 1)
        assert expect(client, "MISSION_COUNT").count == 0


def test_a_jump_to_home_is_refused() -> None:
    with stock_client(identity=PLANE) as (client, vehicle):
        home = mavlink.MAVLink_mission_item_int_message(1, 1, 0, 0, 16, 0, 1, 0, 0, 0, 0, 0, 0, 0.0)
        jump = mavlink.MAVLink_mission_item_int_message(1, 1, 1, 2, 177, 0, 1, 0, 3, 0, 0, 0, 0, 0.0)
        assert upload(client, [home, jump]) == mavlink.MAV_MISSION_INVALID_PARAM1
        assert expect(client, "STATUSTEXT").text.startswith("mission item 1: DO_JUMP")
        assert vehicle.mission == ()


@pytest.mark.parametrize(("identity", "shift"), [(Identity(), 0), (PLANE, 1)])
def test_item_numbers_are_those_of_the_profile_everywhere(identity: Identity, shift: int) -> None:
    with stock_client(identity=identity) as (client, vehicle):
        vehicle.mode, vehicle.mission = Mode.AUTO, MISSION
        flown = vehicle.topics["/guidance/navigation"]
        vehicle.topics["/guidance/navigation"] = flown._replace(item=1)
        assert expect(client, "MISSION_ITEM_REACHED").seq == shift
        assert expect(client, "MISSION_CURRENT", lambda got: got.seq == 1 + shift).total == len(MISSION)
        assert [item(client, n).current for n in range(shift, 3 + shift)] == [0, 1, 0]
        client.mav.mission_set_current_send(1, 1, 3 + shift)
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 0, 2 + shift, 0, 0, 0, 0, 0, 0)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        client.mav.mission_set_current_send(1, 1, 4 + shift)
        assert expect(client, "STATUSTEXT").text == f"there is no mission item {4 + shift}, only 4 items"
        settle(client)
        chosen = [each.value for each in vehicle.inputs if each.kind is CommandKind.SET_CURRENT_ITEM]
        assert chosen == [3.0, 2.0]


def test_an_unknown_profile_is_refused_with_the_names() -> None:
    assert load_identity("generic").modes[0].custom_mode == 1 << 16
    with pytest.raises(InputError, match="generic, ardupilot, px4"):
        load_identity("betaflight")
