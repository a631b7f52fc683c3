"""A stock MAVLink client, pymavlink's mavutil over UDP, against the link."""

from __future__ import annotations

import math
import random
import re
import socket
import struct
import time
from typing import Any

import pytest
from link_station import PATIENCE, expect, greet, running, settle, stock_client
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from ports import free_port
from pymavlink import mavutil

from avionics import messages as m
from avionics import topics as t
from avionics.guidance.mission import (
    NO_FENCE,
    Channel,
    Excitation,
    Fence,
    ItemKind,
    MissionItem,
    RallyPoint,
    Shape,
    Zone,
)
from avionics.link import telemetry
from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink as ours
from avionics.link.ground import GroundLink
from avionics.link.vehicle import Identity, LinkGains, px4_mode
from avionics.messages import CommandKind
from wingbeat.message import Event, Severity

mavlink: Any = mavutil.mavlink


def command(client: Any, number: int, *params: float) -> Any:
    """Send a COMMAND_LONG and take its acknowledgement."""
    client.mav.command_long_send(1, 1, number, 0, *params, *[0.0] * (7 - len(params)))
    return expect(client, "COMMAND_ACK", lambda ack: ack.command == number)


def test_the_telemetry_arrives_in_the_standards_units() -> None:
    with stock_client() as (client, _):
        heartbeat = client.messages["HEARTBEAT"]
        assert (heartbeat.type, heartbeat.autopilot) == (
            mavlink.MAV_TYPE_FLAPPING_WING,
            mavlink.MAV_AUTOPILOT_GENERIC,
        )
        assert heartbeat.base_mode & 1 and heartbeat.custom_mode == px4_mode(1)
        assert expect(client, "ATTITUDE").pitch == pytest.approx(0.2)
        assert expect(client, "VFR_HUD").heading == 331 and client.messages["VFR_HUD"].alt == pytest.approx(560.0)
        place = expect(client, "GLOBAL_POSITION_INT")
        assert (place.lat, place.lon, place.relative_alt, place.vx) == (481003000, 115997000, 40000, 600)
        assert expect(client, "LOCAL_POSITION_NED").z == pytest.approx(-40.0)
        battery = expect(client, "BATTERY_STATUS")
        assert (battery.voltages[0], battery.current_battery, battery.current_consumed) == (7400, 250, 100)
        assert (battery.energy_consumed, battery.battery_remaining) == (25, 80)
        status = expect(client, "SYS_STATUS")
        assert status.voltage_battery == 7400
        assert status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_GEOFENCE
        fence = expect(client, "FENCE_STATUS")
        assert (fence.breach_status, fence.breach_count, fence.breach_time) == (1, 2, 11_500)
        assert fence.breach_type == mavlink.FENCE_BREACH_MAXALT
        channels = expect(client, "RC_CHANNELS")
        assert (channels.chancount, channels.chan2_raw, channels.chan9_raw, channels.rssi) == (8, 1400, 65535, 200)
        assert expect(client, "GPS_RAW_INT").h_acc == 2500
        assert expect(client, "EXTENDED_SYS_STATE").landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
        assert expect(client, "HOME_POSITION").altitude == 520_000
        assert expect(client, "SERVO_OUTPUT_RAW").servo1_raw == round(1500 + 500 * 0.5 / (math.pi / 2))
        mirror = expect(client, "NAMED_VALUE_FLOAT", lambda each: each.name == "flap_freq")
        assert mirror.value == pytest.approx(4.2)
        wind = expect(client, "WIND_COV")
        assert (wind.wind_x, wind.wind_y, wind.wind_alt) == (3.0, -1.0, 560.0)
        assert math.isnan(wind.wind_z) and math.isnan(wind.var_horiz)
        assert wind.horiz_accuracy == 0.5
        assert abs(expect(client, "SYSTEM_TIME").time_unix_usec / 1e6 - time.time()) < 60.0


@pytest.mark.parametrize(
    ("flag", "sensor"),
    [
        (m.Failsafe.RECEIVER_LOST, "SENSOR_RC_RECEIVER"),
        (m.Failsafe.PITOT_BLOCKED, "SENSOR_DIFFERENTIAL_PRESSURE"),
        (m.Failsafe.BARO_REFUSED, "SENSOR_ABSOLUTE_PRESSURE"),
        (m.Failsafe.MAG_DISTURBED, "SENSOR_3D_MAG"),
        (m.Failsafe.FENCE, "GEOFENCE"),
    ],
)
def test_a_failure_speaks_against_its_sensor_alone(flag: m.Failsafe, sensor: str) -> None:
    vehicle = FakeVehicle()
    vehicle.topics[t.PRESSURES.name] = m.PressureSample(1, 0, 0, 0)
    well = telemetry.sys_status(vehicle).onboard_control_sensors_health
    vehicle.topics[t.HEALTH.name] = vehicle.latest(t.HEALTH)._replace(failsafe=int(flag))
    assert well & ~telemetry.sys_status(vehicle).onboard_control_sensors_health == getattr(
        mavlink, f"MAV_SYS_STATUS_{sensor}"
    )
    assert telemetry.rc_channels(vehicle).rssi == (0 if flag is m.Failsafe.RECEIVER_LOST else 200)


def test_parameters_are_listed_read_and_set() -> None:
    with stock_client() as (client, vehicle):
        client.mav.param_request_list_send(1, 1)
        values: dict[int, Any] = {}
        while len(values) < len(vehicle.parameters):
            value = expect(client, "PARAM_VALUE")
            values[value.param_index] = value
        assert [values[index].param_id for index in sorted(values)] == [each.name for each in vehicle.parameters]
        assert {value.param_count for value in values.values()} == {len(vehicle.parameters)}
        client.mav.param_set_send(1, 1, b"PITCH_P", 1.25, mavlink.MAV_PARAM_TYPE_REAL32)
        assert expect(client, "PARAM_VALUE").param_value == 1.25
        assert vehicle.parameters[0].value == 1.25
        client.mav.param_request_read_send(1, 1, b"CLIMB_P", -1)
        assert expect(client, "PARAM_VALUE").param_value == pytest.approx(0.1)


def test_a_set_that_is_refused_is_answered_with_the_old_value_and_a_reason() -> None:
    with stock_client() as (client, vehicle):
        for value in (99.0, math.nan, -math.inf):
            client.mav.param_set_send(1, 1, b"PITCH_P", value, mavlink.MAV_PARAM_TYPE_REAL32)
            assert expect(client, "PARAM_VALUE").param_value == pytest.approx(0.8)
            assert expect(client, "STATUSTEXT").text == "PITCH_P must be within 0 and 5 rad/s"
        client.mav.param_request_read_send(1, 1, b"NOT_THERE", -1)
        assert expect(client, "PARAM_ERROR").error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
        settle(client)
        assert vehicle.inputs == []


@pytest.mark.parametrize("mode", list(m.Mode))
def test_every_mode_can_be_set_and_shows_at_once(mode: m.Mode) -> None:
    names = {entry.mode_name: entry for entry in _available_modes()}
    assert set(names) == {"TAKEOFF", *(each.name for each in m.Mode)}
    with stock_client() as (client, vehicle):
        raw = names[mode.name].custom_mode
        client.set_mode(raw)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        expect(client, "HEARTBEAT", lambda heartbeat: heartbeat.custom_mode == raw)
        settle(client)
        assert vehicle.mode is mode
        vehicle.mode = m.Mode.MANUAL if mode is not m.Mode.MANUAL else m.Mode.AUTO
        ack = command(client, mavlink.MAV_CMD_DO_SET_MODE, 1, raw >> 16 & 0xFF, raw >> 24)
        assert ack.result == mavlink.MAV_RESULT_ACCEPTED
        expect(client, "HEARTBEAT", lambda heartbeat: heartbeat.custom_mode == raw)


def _available_modes() -> list[Any]:
    with stock_client() as (client, _):
        ack = command(client, mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES)
        assert ack.result == mavlink.MAV_RESULT_ACCEPTED
        first = expect(client, "AVAILABLE_MODES")
        return [first, *(expect(client, "AVAILABLE_MODES") for _ in range(first.number_modes - 1))]


def test_each_command_gets_exactly_one_acknowledgement() -> None:
    asked = [
        (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_RESULT_ACCEPTED, (1.0,)),
        (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_DENIED, (1.0, 77.0)),
        (mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_RESULT_ACCEPTED, ()),
        (mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, mavlink.MAV_RESULT_ACCEPTED, ()),
        (mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_RESULT_DENIED, ()),
        (mavlink.MAV_CMD_NAV_LOITER_UNLIM, mavlink.MAV_RESULT_ACCEPTED, ()),
        (mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_RESULT_ACCEPTED, (-1, 0, 30, 0, 48.101, 11.601, 560)),
        (mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_RESULT_DENIED, (-1, 0, 30, 0, 8.1, 11.6, 560)),
        (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, mavlink.MAV_RESULT_ACCEPTED, (1.0,)),
        (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, mavlink.MAV_RESULT_DENIED, (0.0,)),
        (mavlink.MAV_CMD_DO_MOTOR_TEST, mavlink.MAV_RESULT_UNSUPPORTED, ()),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_RESULT_ACCEPTED, (148.0,)),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_RESULT_ACCEPTED, (397.0,)),
        (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_RESULT_UNSUPPORTED, (259.0,)),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_RESULT_ACCEPTED, (30.0, 20000.0)),
        (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_RESULT_UNSUPPORTED, (math.nan, math.nan)),
        (520, mavlink.MAV_RESULT_ACCEPTED, (1.0,)),
        (mavlink.MAV_CMD_GET_HOME_POSITION, mavlink.MAV_RESULT_ACCEPTED, ()),
    ]
    with stock_client() as (client, vehicle):
        vehicle.refusals[CommandKind.SET_MISSION] = "not now"
        for number, _, params in asked:
            client.mav.command_long_send(1, 0, number, 0, *params, *[0.0] * (7 - len(params)))
        client.mav.command_int_send(1, 1, 0, mavlink.MAV_CMD_MISSION_START, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        client.mav.ping_send(0, 77, 0, 0)
        acks = []
        while True:
            message = expect(client, ["COMMAND_ACK", "PING"])
            if message.get_type() == "PING":
                break
            acks.append((message.command, message.result))
        sent = [(number, result) for number, result, _ in asked]
        assert acks == [*sent, (mavlink.MAV_CMD_MISSION_START, mavlink.MAV_RESULT_DENIED)]
        assert message.target_system == 255
        settle(client)
        assert vehicle.armed and vehicle.mode is m.Mode.LOITER
        circles = [each for each in vehicle.inputs if getattr(each, "kind", None) is m.CommandKind.LOITER_AT]
        assert [(each.payload.kind, each.payload.radius) for each in circles] == [(ItemKind.LOITER, 30.0)]
        assert circles[0].payload.altitude == pytest.approx(40.0)
        kills = [each for each in vehicle.inputs if getattr(each, "kind", None) is m.CommandKind.KILL]
        assert len(kills) == 1


@pytest.mark.parametrize(
    ("expected", "kind"),
    [(148, "AUTOPILOT_VERSION"), (242, "HOME_POSITION"), (300, "PROTOCOL_VERSION"), (435, "AVAILABLE_MODES"),
     (436, "CURRENT_MODE"), (437, "AVAILABLE_MODES_MONITOR"), (0, "HEARTBEAT"), (1, "SYS_STATUS"),
     (2, "SYSTEM_TIME"), (30, "ATTITUDE"), (31, "ATTITUDE_QUATERNION"), (32, "LOCAL_POSITION_NED"),
     (33, "GLOBAL_POSITION_INT"), (24, "GPS_RAW_INT"), (36, "SERVO_OUTPUT_RAW"), (42, "MISSION_CURRENT"),
     (74, "VFR_HUD"), (147, "BATTERY_STATUS"), (231, "WIND_COV"), (244, "MESSAGE_INTERVAL"),
     (245, "EXTENDED_SYS_STATE")],
)  # fmt: skip
def test_each_message_of_the_table_can_be_asked_for_once(expected: int, kind: str) -> None:
    answers = answers_to(512, expected, 30 if kind == "MESSAGE_INTERVAL" else 0)
    assert answers[0].get_type() == "COMMAND_ACK" and answers[0].result == mavlink.MAV_RESULT_ACCEPTED
    times = len(Identity().modes) if kind == "AVAILABLE_MODES" else 1
    assert [each.get_type() for each in answers[1:]] == [kind] * times


@pytest.mark.parametrize(
    ("old", "kind"), [(519, "PROTOCOL_VERSION"), (520, "AUTOPILOT_VERSION"), (410, "HOME_POSITION")]
)
def test_the_old_requests_are_answered_too(old: int, kind: str) -> None:
    assert [each.get_type() for each in answers_to(old, 1)] == ["COMMAND_ACK", kind]


def answers_to(number: int, *params: float) -> list[Any]:
    """All that a COMMAND_LONG is answered with, without what comes by itself."""
    wire = Wire("udpin:127.0.0.1:1")
    link = GroundLink([wire], FakeVehicle())
    link.poll(0.0)
    wire.take()
    padded = (*params, *(0.0,) * (7 - len(params)))
    wire.put(Voice(255).frame(ours.MAVLink_command_long_message(1, 1, number, 0, *padded)))
    link.poll(0.1)
    return wire.incoming()


@pytest.mark.parametrize(
    ("frame", "z", "altitude"),
    [(0, 560.0, 40.0), (5, 580.0, 60.0), (3, 45.0, 45.0), (6, 45.0, 45.0), (6, math.nan, 40.0)],
)
def test_a_reposition_by_integers_names_the_place_to_a_centimetre(frame: int, z: float, altitude: float) -> None:
    with stock_client() as (client, vehicle):
        client.mav.command_int_send(1, 1, frame, 192, 0, 0, -1, 1, 25, 1, 481010000, 116010000, z)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_ACCEPTED
        settle(client)
        (asked,) = [each.payload for each in vehicle.inputs if each.kind is m.CommandKind.LOITER_AT]
        assert (asked.north, asked.east) == pytest.approx((111.319, 74.344), abs=0.01)
        assert (asked.altitude, asked.radius) == (pytest.approx(altitude), -25.0)


@pytest.mark.parametrize(
    ("frame", "x", "y", "z"),
    [(2, 481010000, 116010000, 40.0), (6, 81010000, 116010000, 40.0), (6, 2**31 - 2, 1, 40.0)],
)
def test_a_reposition_to_nowhere_is_refused_and_says_why(frame: int, x: int, y: int, z: float) -> None:
    with stock_client() as (client, vehicle):
        client.mav.command_int_send(1, 1, frame, 192, 0, 0, -1, 1, 25, 0, x, y, z)
        assert expect(client, "COMMAND_ACK").result == mavlink.MAV_RESULT_DENIED
        assert expect(client, "STATUSTEXT").text
        settle(client)
        assert vehicle.inputs == []


def test_the_check_before_arming_shows_whether_it_would_arm() -> None:
    vehicle = FakeVehicle()
    bit = ours.MAV_SYS_STATUS_PREARM_CHECK
    assert telemetry.sys_status(vehicle).onboard_control_sensors_health & bit
    vehicle.refusals[m.CommandKind.ARM] = "no fix"
    status = telemetry.sys_status(vehicle)
    assert status.onboard_control_sensors_present & bit and not status.onboard_control_sensors_health & bit
    vehicle.armed = True
    assert telemetry.sys_status(vehicle).onboard_control_sensors_health & bit


def test_a_command_for_another_vehicle_is_not_ours() -> None:
    with stock_client() as (client, vehicle):
        client.mav.command_long_send(9, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
        client.mav.ping_send(0, 1, 0, 0)
        assert expect(client, ["COMMAND_ACK", "PING"]).get_type() == "PING"
        settle(client)
        assert vehicle.inputs == []


def test_a_refusal_of_the_flight_core_says_why() -> None:
    with stock_client() as (client, vehicle):
        reason = "the battery is too low to fly the whole mission and come home again safely"
        vehicle.refusals[m.CommandKind.ARM] = reason
        assert command(client, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1).result == mavlink.MAV_RESULT_DENIED
        parts = [expect(client, "STATUSTEXT") for _ in range(2)]
        assert "".join(part.text for part in parts) == reason
        assert [part.chunk_seq for part in parts] == [0, 1] and parts[0].id == parts[1].id != 0
        settle(client)
        assert not vehicle.armed


MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.WAYPOINT, 120.0, -35.0, 40.0),
    MissionItem(ItemKind.HOLD, altitude=45.0, heading=math.radians(90.0), duration=12.0),
    MissionItem(ItemKind.EXCITE, excitation=Excitation(Channel.ELEVATOR, Shape.MULTISTEP_3211, 0.125, 0.25, 2.0, 3)),
    MissionItem(
        ItemKind.EXCITE,
        excitation=Excitation(Channel.RUDDER, Shape.LOGARITHMIC_SWEEP, 0.125, 12.5, 1.0, 2, 0.25, 4.0, loops=1),
    ),
    MissionItem(
        ItemKind.EXCITE,
        excitation=Excitation(
            Channel.ELEVATOR, Shape.MULTISINE, 0.0625, 8.0, 0.5, 1, 0.375, 3.0, (0.0, 0.125, 0.25), 1
        ),
    ),
    MissionItem(ItemKind.CIRCLE, 60.0, 20.0, 50.0, radius=-30.0, turns=2.5),
    MissionItem(ItemKind.CIRCLE, 60.0, 20.0, 50.0, duration=40.0),
    MissionItem(ItemKind.CIRCLE, 60.0, 20.0, 80.0, radius=25.0),
    MissionItem(ItemKind.JUMP, jump_to=1, repeats=-1),
    MissionItem(ItemKind.LOITER, 60.0, 20.0, 50.0, radius=-30.0),
    MissionItem(ItemKind.RETURN),
    MissionItem(ItemKind.LAND, 10.0, 5.0, heading=math.radians(-45.0)),
)


def download(client: Any, mission_type: int = 0) -> list[Any]:
    client.mav.mission_request_list_send(1, 1, mission_type)
    items = []
    for sequence in range(expect(client, "MISSION_COUNT").count):
        client.mav.mission_request_int_send(1, 1, sequence, mission_type)
        items.append(expect(client, "MISSION_ITEM_INT", lambda item, expected=sequence: item.seq == expected))
    client.mav.mission_ack_send(1, 1, 0, mission_type)
    return items


def upload(client: Any, items: list[Any], mission_type: int = 0) -> Any:
    client.mav.mission_count_send(1, 1, len(items), mission_type)
    while True:
        message = expect(client, ["MISSION_REQUEST_INT", "MISSION_ACK"])
        if message.get_type() == "MISSION_ACK":
            return message
        client.mav.send(items[message.seq])


def test_a_mission_goes_up_and_comes_down_the_same() -> None:
    with stock_client() as (client, vehicle):
        vehicle.mission = MISSION
        first = download(client)
        vehicle.mission = ()
        for item in first:
            item.target_system, item.target_component = 1, 1
        assert upload(client, first).type == mavlink.MAV_MISSION_ACCEPTED
        assert [item.kind for item in vehicle.mission] == [item.kind for item in MISSION]
        for got, sent in zip(vehicle.mission, MISSION, strict=True):
            assert got[1:6] == pytest.approx(sent[1:6], abs=0.02)
            assert got.excitation == sent.excitation
        second = download(client)
        skip = ("target_system", "target_component")
        for before, after in zip(first, second, strict=True):
            fields = [name for name in before.get_fieldnames() if name not in skip]
            assert [getattr(after, name) for name in fields] == pytest.approx(
                [getattr(before, name) for name in fields], nan_ok=True
            )


def test_items_lost_on_the_way_are_asked_for_again_and_out_of_order_ones_dropped() -> None:
    with stock_client(LinkGains(retry_interval=0.05)) as (client, vehicle):
        item = mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 22, 0, 1, 0, 0, 0, math.nan, 0, 0, 30.0)
        late = mavlink.MAVLink_mission_item_int_message(1, 1, 1, 6, 20, 0, 1, 0, 0, 0, 0, 0, 0, 0.0)
        client.mav.mission_count_send(1, 1, 2, 0)
        assert [expect(client, "MISSION_REQUEST_INT").seq for _ in range(2)] == [0, 0]
        client.mav.send(late)
        client.mav.send(item)
        expect(client, "MISSION_REQUEST_INT", lambda request: request.seq == 1)
        client.mav.send(late)
        assert expect(client, "MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
        assert [each.kind for each in vehicle.mission] == [ItemKind.TAKEOFF, ItemKind.RETURN]
        client.mav.mission_count_send(1, 1, 3, 0)
        assert expect(client, "MISSION_ACK").type == mavlink.MAV_MISSION_OPERATION_CANCELLED
        assert len(vehicle.mission) == 2


@pytest.mark.parametrize(
    ("fields", "result"),
    [
        ((6, 82, 0.0, 0.0, 481000000, 116000000, 40.0), "MAV_MISSION_UNSUPPORTED"),
        ((6, 16, math.inf, 0.0, 481000000, 116000000, 40.0), "MAV_MISSION_INVALID_PARAM1"),
        ((6, 16, 0.0, 0.0, 481000000, 116000000, math.nan), "MAV_MISSION_INVALID_PARAM7"),
        ((6, 16, 0.0, 0.0, 910000000, 0, 40.0), "MAV_MISSION_INVALID_PARAM5_X"),
        ((9, 16, 0.0, 0.0, 1, 1, 40.0), "MAV_MISSION_UNSUPPORTED_FRAME"),
        ((2, 53000, 7.0, 0.0, 1, 0, 1.0), "MAV_MISSION_INVALID_PARAM1"),
        ((2, 53000, 0.0, 0.0, 0, 0, 1.0), "MAV_MISSION_INVALID_PARAM3"),
    ],
)
def test_an_item_that_cannot_be_flown_is_refused_and_the_old_mission_stays(fields: tuple, result: str) -> None:
    frame, number, param1, param2, x, y, z = fields
    with stock_client() as (client, vehicle):
        vehicle.mission = MISSION
        bad = mavlink.MAVLink_mission_item_int_message(1, 1, 0, frame, number, 0, 1, param1, param2, 0, 0, x, y, z)
        assert upload(client, [bad]).type == getattr(mavlink, result)
        assert expect(client, "STATUSTEXT").text.startswith("mission item 0: ")
        assert vehicle.mission == MISSION


def test_waypoint_with_a_hold_time_is_accepted() -> None:
    with stock_client() as (client, vehicle):
        item = mavlink.MAVLink_mission_item_int_message(1, 1, 0, 6, 16, 0, 1, 5, 0, 0, 0, 481000000, 116000000, 40.0)
        assert upload(client, [item]).type == mavlink.MAV_MISSION_ACCEPTED
        assert vehicle.mission[0].duration == 5.0


FENCE = Fence((
    Zone(1, ((-200.0, -200.0), (-200.0, 250.0), (300.0, 0.0))),
    Zone(0, ((50.0, 60.0), (50.0, 90.0), (80.0, 60.0), (90.0, 90.0))),
    Zone(1, ((0.0, 10.0),), 500.0),
    Zone(0, ((-90.0, 30.0),), 25.0),
))  # fmt: skip
RALLY = (RallyPoint(50.0, -40.0, 35.0), RallyPoint(-60.0, 10.0, 45.0))


def test_a_fence_and_rally_points_go_up_and_come_down_the_same() -> None:
    with stock_client() as (client, vehicle):
        vehicle.mission, vehicle.fence, vehicle.rally = MISSION, FENCE, RALLY
        fence, rally = (download(client, kind) for kind in (1, 2))
        assert [item.mission_type for item in (*fence, *rally)] == [1] * 9 + [2] * 2
        vehicle.fence, vehicle.rally = NO_FENCE, ()
        for item in (*fence, *rally):
            item.target_system, item.target_component = 1, 1
        assert upload(client, fence, 1).type == mavlink.MAV_MISSION_ACCEPTED
        assert upload(client, rally, 2).type == mavlink.MAV_MISSION_ACCEPTED
        assert vehicle.mission == MISSION
        for got, sent in zip(vehicle.fence.zones, FENCE.zones, strict=True):
            assert (got.keep_in, got.radius) == (sent.keep_in, sent.radius)
            for place, meant in zip(got.places, sent.places, strict=True):
                assert place == pytest.approx(meant, abs=0.02)
        for got, sent in zip(vehicle.rally, RALLY, strict=True):
            assert got == pytest.approx(sent, abs=0.02)
        client.mav.mission_clear_all_send(1, 1, mavlink.MAV_MISSION_TYPE_FENCE)
        assert expect(client, "MISSION_ACK").mission_type == mavlink.MAV_MISSION_TYPE_FENCE
        assert (vehicle.fence, len(vehicle.rally), vehicle.mission) == (NO_FENCE, 2, MISSION)


@pytest.mark.parametrize(
    ("commands", "words"),
    [([5001, 5001], "fewer corners"), ([5003], "a circle needs a radius"), ([5000], "FENCE_RETURN_POINT (5000)")],
)
def test_a_fence_that_is_none_is_refused(commands: list[int], words: str) -> None:
    radius = 0.0 if commands == [5003] else 3.0
    with stock_client() as (client, vehicle):
        vehicle.fence = FENCE
        items = [
            mavlink.MAVLink_mission_item_int_message(
                1, 1, n, 3, command, 0, 1, radius, 0, 0, 0, 481000000, 116000000, 0.0, 1
            )
            for n, command in enumerate(commands)
        ]
        ack = upload(client, items, 1)
        assert (ack.type != mavlink.MAV_MISSION_ACCEPTED, ack.mission_type) == (True, 1)
        assert words in expect(client, "STATUSTEXT").text
        assert vehicle.fence == FENCE


def test_clear_all_clears_fences_and_rally_points_too() -> None:
    with stock_client() as (client, vehicle):
        vehicle.mission, vehicle.rally = MISSION, RALLY
        client.mav.mission_request_list_send(1, 1, mavlink.MAV_MISSION_TYPE_FENCE)
        fence = expect(client, "MISSION_COUNT")
        assert (fence.count, fence.mission_type) == (0, mavlink.MAV_MISSION_TYPE_FENCE)
        client.mav.mission_request_int_send(1, 1, len(MISSION), 0)
        assert expect(client, "MISSION_ACK").type == mavlink.MAV_MISSION_INVALID_SEQUENCE
        client.mav.mission_clear_all_send(1, 1, mavlink.MAV_MISSION_TYPE_ALL)
        ack = expect(client, "MISSION_ACK")
        assert (ack.type, ack.mission_type) == (mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_TYPE_ALL)
        assert (vehicle.mission, vehicle.rally) == ((), ())


def test_a_reached_item_and_an_event_are_told() -> None:
    with stock_client() as (client, vehicle):
        vehicle.mode, vehicle.mission = m.Mode.AUTO, MISSION
        vehicle.topics["/guidance/navigation"] = vehicle.topics["/guidance/navigation"]._replace(item=1)
        assert expect(client, "MISSION_ITEM_REACHED").seq == 0
        vehicle.reported.append(Event(7_654_321, Severity.NOTICE, "modes", "launched"))
        assert expect(client, "SYSTEM_TIME", lambda each: each.time_boot_ms == 7654)
        text = expect(client, "STATUSTEXT")
        assert (text.text, text.severity, text.id) == ("launched", mavlink.MAV_SEVERITY_NOTICE, 0)


def test_an_excitation_by_command() -> None:
    with stock_client() as (client, vehicle):
        assert command(client, 53000, 0, 0, 0.1, 0.3, 2, 0, 1.5).result == mavlink.MAV_RESULT_ACCEPTED
        assert command(client, 53000, 0, 9, 0.1, 0.3, 2, 0, 1.5).result == mavlink.MAV_RESULT_DENIED
        assert command(client, 53010, 10, 0.1, 0.5, 4, 1001, 15000, 1).result == mavlink.MAV_RESULT_ACCEPTED
        assert command(client, 53010, 10, 0.1, 0.5, 40, 1, 15000, 1).result == mavlink.MAV_RESULT_DENIED
        assert command(client, 53011, 0.1, 0, 0.2, 10, 1, 3026, 1).result == mavlink.MAV_RESULT_ACCEPTED
        assert command(client, 53011, 0.1, 0, 0.2, 10, 1, 3005, 1).result == mavlink.MAV_RESULT_DENIED
        assert command(client, 53011, 0.1, 0, 0.2, 0, 1, 3005, 1).result == mavlink.MAV_RESULT_DENIED
        settle(client)
        taken = [each.payload for each in vehicle.inputs if each.kind is m.CommandKind.EXCITE]
        assert [each.shape for each in taken] == [Shape.DOUBLET, Shape.LOGARITHMIC_SWEEP, Shape.MULTISINE]
        assert [each.loops for each in taken] == [0, 1, 0]
        assert taken[1][3:8] == pytest.approx((15.0, 1.0, 1, 0.5, 4.0))
        assert taken[2].amplitudes() == pytest.approx((0.1, 0.0, 0.2))
        assert (taken[0].repeats, taken[0].settle) == (2, 1.5) and taken[0].width == pytest.approx(0.3)


def test_rates_follow_the_request() -> None:
    with stock_client() as (client, _):
        assert command(client, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 10000).result == mavlink.MAV_RESULT_ACCEPTED
        command(client, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30)
        assert expect(client, "MESSAGE_INTERVAL").interval_us == 10000
        began = time.monotonic()
        for _ in range(40):
            expect(client, "ATTITUDE")
        assert time.monotonic() - began < 3.0  # 4 s at the default rate of 10 Hz
        client.mav.request_data_stream_send(1, 1, mavlink.MAV_DATA_STREAM_EXTRA1, 0, 0)
        client.mav.ping_send(0, 1, 0, 0)
        expect(client, "PING")
        command(client, mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30)
        assert expect(client, "MESSAGE_INTERVAL").interval_us == -1


def test_time() -> None:
    with stock_client() as (client, vehicle):
        client.mav.timesync_send(0, 123)
        answer = expect(client, "TIMESYNC")
        assert (answer.ts1, answer.tc1) == (123, vehicle.time_us * 1000)


def test_the_sticks_arrive_with_nose_up_positive() -> None:
    with stock_client() as (client, vehicle):
        client.mav.manual_control_send(1, -500, 250, 700, 1000, 0)
        client.mav.manual_control_send(2, 900, 0, 0, 0, 0)
        settle(client)
        assert [each[1:] for each in vehicle.inputs] == [(0.5, 0.25, 1.0, 0.7, m.PilotSource.MANUAL_CONTROL)]


def test_overridden_channels_arrive_as_they_are() -> None:
    with stock_client() as (client, vehicle):
        client.mav.rc_channels_override_send(1, 1, 1500, 1600, 0, 65535, 1000, 2000, 0, 0, 1700, *[0] * 8, 65534)
        client.mav.rc_channels_override_send(7, 1, *[1500] * 8)
        settle(client)
        assert vehicle.inputs == [
            m.ChannelOverride(vehicle.time_us, (1500, 1600, 0, 65535, 1000, 2000, 0, 0, 1700, *[0] * 8, 65534))
        ]


def test_a_silent_ground_station_is_told_to_the_flight_core_and_its_return_too() -> None:
    port, vehicle = free_port(), FakeVehicle()
    vehicle.armed = True
    link = GroundLink([f"udpin:127.0.0.1:{port}"], vehicle, gains=LinkGains(silence=5.0))
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    heartbeat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(mavlink.MAVLink(None, 255, 190))

    def receive(now: float) -> list[Any]:
        client.sendto(heartbeat, ("127.0.0.1", port))
        before = link.counts[0].frames
        inputs: list[Any] = []
        deadline = time.monotonic() + PATIENCE
        while link.counts[0].frames == before and time.monotonic() < deadline:
            inputs += link.poll(now)
        return inputs

    assert link.poll(0.0) == [] and link.poll(1000.0) == []  # nobody was ever heard: nobody is missed
    assert receive(1001.0) == [] and link.stations == 1
    assert link.poll(1006.1) == [] and link.stations == 0  # a single command: nobody flew by it
    assert receive(1010.0) == [] and receive(1013.0) == []
    assert link.poll(1018.0) == []
    assert [each.kind for each in link.poll(1018.1)] == [m.CommandKind.LINK_LOST]
    assert link.poll(1020.0) == [] and link.stations == 0
    assert [each.kind for each in receive(1021.0)] == [m.CommandKind.LINK_REGAINED]
    assert [event.text.split()[0] for event in link.take_events()] == ["LINK_LOST", "LINK_REGAINED"]
    client.close()
    link.close()


def test_a_station_that_leaves_a_disarmed_vehicle_is_not_missed() -> None:
    """Else the arming of a single command would be refused: it is no station, so the link would not be back."""
    vehicle, wire, voice = FakeVehicle(), Wire("udpin:127.0.0.1:1"), Voice(255)
    link = GroundLink([wire], vehicle, gains=LinkGains(silence=5.0))

    def kinds(now: float, receives: bool) -> list[Any]:
        if receives:
            wire.put(voice.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)))
        return [each.kind for each in link.poll(now)]

    assert kinds(0.0, True) + kinds(4.0, True) + kinds(60.0, False) == []
    vehicle.armed = True
    assert kinds(61.0, False) == [], "who armed it then is there, or is a pilot"
    assert kinds(62.0, True) + kinds(66.0, True) == []
    assert kinds(72.0, False) == [m.CommandKind.LINK_LOST]
    vehicle.armed = False
    assert kinds(73.0, False) == [m.CommandKind.LINK_REGAINED], "landed: nothing is missed any more"
    assert kinds(80.0, False) == []


def test_garbage_on_every_kind_of_port_raises_nothing_and_the_link_still_answers() -> None:
    generator = random.Random(11)
    udp, tcp = free_port(), free_port(socket.SOCK_STREAM)
    vehicle = FakeVehicle()
    link = GroundLink([f"udpin:127.0.0.1:{udp}", f"tcpin:127.0.0.1:{tcp}"], vehicle)
    with running(link, vehicle), socket.create_connection(("127.0.0.1", tcp)) as stream:
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for _ in range(300):
            noise = generator.randbytes(generator.randrange(1, 400))
            stream.sendall(generator.choice((b"", b"\xfd", b"\xfe\x09")) + noise)
            datagrams.sendto(noise, ("127.0.0.1", udp))
        datagrams.close()
        for url in (f"udpout:127.0.0.1:{udp}", f"tcp:127.0.0.1:{tcp}"):
            client = mavutil.mavlink_connection(url, source_system=255, dialect="development")
            greet(client)
            client.close()
        assert min(counts.bad_bytes for counts in link.counts) > 10_000


def test_valid_frames_with_senseless_content_raise_nothing() -> None:
    """Every known message with random payloads, straight into the services."""
    generator = random.Random(5)
    port, vehicle = free_port(), FakeVehicle()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], vehicle)
    writer = FrameWriter(255, 190)
    client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sent = 0
    for _ in range(60):
        for number, kind in ours.mavlink_map.items():
            payload = bytearray(generator.randbytes(kind.unpacker.size))
            for name in ("target_system", "target_component"):
                if name in kind.fieldnames:
                    payload[_offset(kind, name)] = 0
            client.sendto(writer.frame(number, bytes(payload)), ("127.0.0.1", port))
            sent += 1
        deadline = time.monotonic() + PATIENCE
        while link.counts[0].frames < sent and time.monotonic() < deadline:
            vehicle.apply([each for each in link.poll(float(sent)) if not isinstance(each, m.Command)])
        link.stream(float(sent))
    assert link.counts[0].frames == sent
    client.close()
    link.close()


def _offset(kind: Any, name: str) -> int:
    codes = kind.unpacker.format.lstrip("<")
    fields = re.findall(r"\d*[a-zA-Z]", codes)
    return struct.calcsize("<" + "".join(fields[: kind.ordered_fieldnames.index(name)]))


def test_noise_on_a_port_is_logged_once_a_second() -> None:
    port = free_port()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], FakeVehicle())
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(bytes(range(200)), ("127.0.0.1", port))
            assert link.poll(1.0) == []
            said = [event.text for event in link.take_events()]
            stranger.sendto(bytes(range(100)), ("127.0.0.1", port))
            link.poll(1.5)
            assert link.take_events() == []
            link.poll(2.5)
            later = [event.text for event in link.take_events()]
    finally:
        link.close()
    assert said == [f"200 bytes received on udpin:127.0.0.1:{port} are not MAVLink"]
    assert later == [f"100 bytes received on udpin:127.0.0.1:{port} are not MAVLink"]
