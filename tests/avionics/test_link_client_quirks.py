"""What real clients wait for beyond the protocol, each found by flying with one (`tests/clients`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from link_station import expect, settle, stock_client
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire

import avionics.link
from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.services.modes import available_modes
from avionics.link.vehicle import PROFILES, PX4_STYLE, Identity
from avionics.messages import CommandKind, Mode, Stage

GUIDED = 15
MODE_MAP = Path(avionics.link.__path__[0]) / "custom_mode_map.json"


def test_the_error_comes_before_the_value_so_that_mavsdk_does_not_set_it_again() -> None:
    with stock_client() as (client, vehicle):
        client.mav.param_set_send(1, 1, b"PITCH_P", 99.0, mavlink.MAV_PARAM_TYPE_REAL32)
        kinds = [expect(client, ["PARAM_ERROR", "PARAM_VALUE"]).get_type() for _ in range(2)]
        assert kinds == ["PARAM_ERROR", "PARAM_VALUE"]
        assert vehicle.parameters[0].value == 0.8


@pytest.mark.parametrize(
    ("stage", "requested"), [(Stage.WAIT_LAUNCH, []), (Stage.EN_ROUTE, ["OFFBOARD", "OFFBOARD"])]
)
def test_guided_is_accepted_before_a_takeoff_and_circles_in_the_air(stage: Stage, requested: list[str]) -> None:
    with stock_client(identity=PROFILES["ardupilot"]) as (client, vehicle):
        navigation = vehicle.topics[topics.NAVIGATION.name]
        vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=stage)
        if stage == Stage.WAIT_LAUNCH:
            vehicle.refusals[CommandKind.SET_MODE] = "not in flight"
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        client.mav.set_mode_send(1, 1, GUIDED)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        settle(client)
        assert [each.name for each in vehicle.inputs if each.kind is CommandKind.SET_MODE] == requested
        assert vehicle.mode is (Mode.OFFBOARD if requested else Mode.MANUAL)


def custom_mode(client: Any, expected: int) -> int:
    """The custom mode of the next HEARTBEAT that says it, and of a CURRENT_MODE that is asked for then."""
    beat = expect(client, "HEARTBEAT", lambda got: got.custom_mode == expected)
    client.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 436, 0, 0, 0, 0, 0, 0)
    assert expect(client, "CURRENT_MODE", lambda got: got.custom_mode == expected)
    return int(beat.custom_mode)


def test_guided_is_shown_while_it_is_true_and_no_longer() -> None:
    """GIVEN an aeroplane of ArduPilot's WHEN GUIDED is set THEN it says so until it is sent somewhere or flies on."""
    with stock_client(identity=PROFILES["ardupilot"]) as (client, vehicle):
        navigation = vehicle.topics[topics.NAVIGATION.name]
        vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.ON_GROUND)
        client.mav.set_mode_send(1, 1, GUIDED)
        assert custom_mode(client, GUIDED) == GUIDED and vehicle.mode is Mode.MANUAL
        vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.EN_ROUTE)
        assert custom_mode(client, 0) == 0  # thrown by hand, it flies on its sticks
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, GUIDED, 0, 0, 0, 0, 0)
        assert custom_mode(client, GUIDED) == GUIDED and vehicle.mode is Mode.OFFBOARD
        vehicle.mode = Mode.RETURN  # by a failsafe, say
        assert custom_mode(client, 11) == 11
        vehicle.mode = Mode.LOITER
        assert custom_mode(client, 12) == 12
        client.mav.set_mode_send(1, 1, GUIDED)
        assert custom_mode(client, GUIDED) == GUIDED
        client.mav.set_mode_send(1, 1, 12)
        assert custom_mode(client, 12) == 12
        client.mav.set_mode_send(1, 1, GUIDED)
        assert custom_mode(client, GUIDED) == GUIDED
        place = (-1, 0, 30, 0, 48.101, 11.601, 560)
        client.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_REPOSITION, 0, *place)
        assert custom_mode(client, 12) == 12  # MAVSDK's goto waits for this


def test_guided_is_one_of_the_modes_that_an_aeroplane_of_ardupilot_names_and_the_generic_vehicle_has_none() -> None:
    names = {
        profile: [entry.mode_name for entry in available_modes(identity)] for profile, identity in PROFILES.items()
    }
    assert names["generic"] == [*(entry.mode.name for entry in PX4_STYLE), "TAKEOFF"]
    assert names["ardupilot"][-2:] == ["GUIDED", "TAKEOFF"] and len(set(names["ardupilot"])) == len(Mode) + 1


def test_the_landed_state_is_said_at_once_when_it_changes_where_it_is_said_at_all() -> None:
    """GIVEN one link with the stream and one without WHEN the vehicle lands THEN the first is told at once."""
    wires = [Wire("udpin:127.0.0.1:1"), Wire("udpin:127.0.0.1:2")]
    vehicle, station = FakeVehicle(), Voice(255)
    link = GroundLink(wires, vehicle)
    off = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 245, -1, 0, 0, 0, 0, 0)
    wires[1].put(station.frame(off))
    navigation, incoming = vehicle.topics[topics.NAVIGATION.name], []
    for number in range(250):
        now = 10.0 + 0.01 * number
        if number == 120:
            vehicle.topics[topics.NAVIGATION.name] = navigation._replace(stage=Stage.LANDED)
        link.poll(now)
        link.stream(now)
        said = [[each for each in wire.incoming() if each.get_type() == "EXTENDED_SYS_STATE"] for wire in wires]
        incoming += [(number, each.landed_state) for each in said[0]]
        assert not said[1]
    in_air, on_ground = mavlink.MAV_LANDED_STATE_IN_AIR, mavlink.MAV_LANDED_STATE_ON_GROUND
    assert [each for each in incoming if each[0] < 120] == [(0, in_air), (50, in_air)]
    assert [each for each in incoming if each[0] >= 120] == [(120, on_ground), (220, on_ground)]


def test_the_mode_map_that_is_shipped_says_what_the_vehicle_says() -> None:
    shipped = json.loads(MODE_MAP.read_text())
    assert shipped == {"16": {str(entry.custom_mode): entry.name for entry in Identity().modes}}
    assert {entry.mode for entry in Identity().modes} == set(Mode)
