"""What real clients wait for beyond the protocol, each found by flying with one (`tests/clients`)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from link_station import expect, settle, stock_client

import avionics.link
from avionics import topics
from avionics.link.dialect import mavlink
from avionics.link.vehicle import PROFILES, PX4_STYLE
from avionics.messages import CommandKind, Mode, Stage

GUIDED = 15
MODE_MAP = Path(avionics.link.__path__[0]) / "custom_mode_map.json"


def test_the_error_comes_before_the_value_so_that_mavsdk_does_not_set_it_again() -> None:
    with stock_client() as (client, vehicle):
        client.mav.param_set_send(1, 1, b"PITCH_P", 99.0, mavlink.MAV_PARAM_TYPE_REAL32)
        kinds = [expect(client, ["PARAM_ERROR", "PARAM_VALUE"]).get_type() for _ in range(2)]
        assert kinds == ["PARAM_ERROR", "PARAM_VALUE"]
        assert vehicle.parameters[0].value == 0.8


@pytest.mark.parametrize(("stage", "asked"), [(Stage.WAIT_LAUNCH, []), (Stage.EN_ROUTE, ["LOITER", "LOITER"])])
def test_guided_is_accepted_before_a_takeoff_and_circles_in_the_air(stage: Stage, asked: list[str]) -> None:
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
        assert [each.name for each in vehicle.inputs if each.kind is CommandKind.SET_MODE] == asked
        assert vehicle.mode is (Mode.LOITER if asked else Mode.MANUAL)


def test_the_mode_map_that_is_shipped_says_what_the_vehicle_says() -> None:
    shipped = json.loads(MODE_MAP.read_text())
    assert shipped == {"16": {str(entry.custom_mode): entry.mode.name for entry in PX4_STYLE}}
    assert {entry.mode for entry in PX4_STYLE} == set(Mode)
