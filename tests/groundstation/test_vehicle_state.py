"""Telemetry collected from MAVLink messages."""

from __future__ import annotations

import math
from typing import Any

import pytest

from avionics.link.dialect import mavlink
from avionics.messages import Stage
from groundstation.link import modes
from groundstation.link.vehicle_state import EVENTS_KEPT, VehicleState, new_events, receive
from groundstation.views.panels import vehicle_name
from wingbeat.message import Severity


def received(*messages: Any, system: int = 1) -> VehicleState:
    state = VehicleState()
    for number, message in enumerate(messages):
        if message.get_srcSystem() == 0:
            message.pack(mavlink.MAVLink(None, system, 1))
        state = receive(state, message, float(number))
    return state


def from_system(message: Any, system: int) -> Any:
    message.pack(mavlink.MAVLink(None, system, 1))
    return message


HEARTBEAT = (16, 0, 129, 4 << 16 | 4 << 24, 4, 3)


def test_heartbeat_tells_mode_and_arming() -> None:
    state = received(mavlink.MAVLink_heartbeat_message(*HEARTBEAT))
    assert state.armed is True and state.system == 1
    assert modes.mode_name(state) == "AUTO"


def test_nothing_heard_is_none_everywhere() -> None:
    state = VehicleState()
    assert state.altitude is None and state.armed is None and modes.mode_name(state) == ""


def test_other_ground_stations_and_gimbals_are_not_the_vehicle() -> None:
    station = from_system(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), 255)
    gimbal = from_system(mavlink.MAVLink_heartbeat_message(26, 8, 0, 0, 4, 3), 1)
    assert received(station, gimbal).system is None


def test_a_second_vehicle_on_the_link_changes_nothing() -> None:
    first = from_system(mavlink.MAVLink_heartbeat_message(*HEARTBEAT), 1)
    second = from_system(mavlink.MAVLink_attitude_message(5, 1.0, 1.0, 1.0, 0, 0, 0), 2)
    assert received(first, second).roll is None


def test_what_was_said_has_the_time_of_the_stamp_before_it() -> None:
    attitude = mavlink.MAVLink_attitude_message(9000, 0.1, 0, 0, 0, 0, 0)
    state = received(
        attitude,
        mavlink.MAVLink_system_time_message(0, 8400),
        mavlink.MAVLink_statustext_message(5, b"launched"),
        mavlink.MAVLink_system_time_message(0, 9300),
        mavlink.MAVLink_statustext_message(6, b"a" * 50, 3, 0),
        mavlink.MAVLink_statustext_message(6, b"b", 3, 1),
        attitude,
        mavlink.MAVLink_statustext_message(6, b"no stamp"),
    )
    assert [event.time for event in state.events] == [8.4, 9.3, 9.0]
    late = receive(received(attitude), from_system(mavlink.MAVLink_system_time_message(0, 8400), 1), 1.0)
    assert late.time == 9.0, "an event that comes late does not turn the vehicle's time back"


def test_wire_units_become_si() -> None:
    state = received(
        mavlink.MAVLink_global_position_int_message(2500, 389900000, -769400000, 0, 40250, 0, 0, 0, 0),
        mavlink.MAVLink_vfr_hud_message(7.5, 6.5, 90, 62, 40.0, -0.5),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 7900, 180, 92, 0, 0, 0, 0, 0, 0),
    )
    assert state.time == 2.5 and state.altitude == 40.25
    assert state.latitude == pytest.approx(math.radians(38.99))
    assert (state.airspeed, state.climb_rate, state.throttle) == (7.5, -0.5, 0.62)
    assert state.voltage == pytest.approx(7.9) and state.current == pytest.approx(1.8)
    assert state.power == pytest.approx(7.9 * 1.8) and state.battery_remaining == 0.92


def test_measured_power_is_kept_over_volts_times_amperes() -> None:
    state = received(
        mavlink.MAVLink_wingbeat_power_message(100, 8.0, 2.0, 13.5, 1.0, 80.0, 2.0, 0.9),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 8000, 200, 90, 0, 0, 0, 0, 0, 0),
    )
    assert state.power == 13.5


def test_supply_and_power_are_means_over_the_same_time_and_multiply() -> None:
    """At 3.2 times the stroke each message is of another phase: 8.27 V, 0.95 A beside a mean of 32 W."""
    state = received(
        mavlink.MAVLink_wingbeat_power_message(1000, 8.27, 0.95, 7.9, 100.0, 800.0, 2.0, 0.9),
        mavlink.MAVLink_wingbeat_power_message(1500, 8.27, 0.95, 7.9, 102.0, 816.0, 2.0, 0.9),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 8270, 95, 90, 0, 0, 0, 0, 0, 0),
    )
    assert (state.voltage, state.current, state.power) == pytest.approx((8.0, 4.0, 32.0)) and state.mean_supply
    assert state.battery_remaining == 0.9


def test_the_first_message_of_the_supply_and_one_just_behind_another_tell_a_moment() -> None:
    first = mavlink.MAVLink_wingbeat_power_message(1000, 8.27, 0.95, 7.9, 100.0, 800.0, 2.0, 0.9)
    again = mavlink.MAVLink_wingbeat_power_message(1100, 8.2, 1.0, 8.2, 100.4, 803.2, 2.0, 0.9)
    assert not received(first).mean_supply
    assert received(first, again).power == pytest.approx(8.2) and not received(first, again).mean_supply


def test_unknown_supply_stays_unknown() -> None:
    state = received(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0))
    assert state.voltage is None and state.current is None and state.battery_remaining is None


def test_a_second_battery_is_not_the_one_that_is_flown() -> None:
    def battery(number: int, cell: int, percent: int) -> Any:
        cells = [cell] + [65535] * 9
        return mavlink.MAVLink_battery_status_message(number, 0, 0, 0, cells, 100 * (number + 1), 0, 0, percent)

    state = received(battery(0, 7900, 92), battery(1, 5000, 10))
    assert (state.voltage, state.current, state.battery_remaining) == (7.9, 1.0, 0.92)


@pytest.mark.parametrize(("autopilot", "altitude"), [(0, 35.0), (3, 40.0), (12, 40.0)])
def test_altitude_above_home_is_not_that_above_the_origin_of_others(autopilot: int, altitude: float) -> None:
    beat = mavlink.MAVLink_heartbeat_message(1, autopilot, 129, 0, 4, 3)
    globe = mavlink.MAVLink_global_position_int_message(2500, 389900000, -769400000, 0, 40000, 0, 0, 0, 0)
    local = mavlink.MAVLink_local_position_ned_message(2500, 10.0, 20.0, -35.0, 0, 0, 0)
    assert received(beat, globe, local).altitude == altitude


def test_our_vehicle_is_known_by_its_id_and_by_its_words() -> None:
    beat = mavlink.MAVLink_heartbeat_message(1, 3, 129, 10, 4, 3)
    none = [0] * 8
    version, other = (
        mavlink.MAVLink_autopilot_version_message(0, 0, 0, 0, 0, none, none, none, 0, 0, uid)
        for uid in (0x77696E67, 7)
    )
    words = mavlink.MAVLink_wingbeat_excitation_message(1, 0, 0, 0, 0, 0, 0)
    assert received(beat, version).is_wingbeat and received(beat, words).is_wingbeat
    assert not received(beat, other).is_wingbeat and not received(beat).is_wingbeat
    assert vehicle_name(received(beat, version)).startswith("flapping wing ")
    assert vehicle_name(received(beat)).startswith("fixed wing ")


def test_an_unknown_stage_is_no_crash() -> None:
    known = received(mavlink.MAVLink_wingbeat_navigation_message(1, 0, 0, 40, 0, 2, int(Stage.FLARE), 0))
    unknown = received(mavlink.MAVLink_wingbeat_navigation_message(1, 0, 0, 40, 0, 2, 99, 0))
    assert known.stage is Stage.FLARE and unknown.stage is None


def test_chunks_of_a_long_text_are_joined() -> None:
    text = "a" * 50 + "b" * 50 + "c"
    chunks = [text[i : i + 50].encode() for i in (0, 50, 100)]
    state = received(*(mavlink.MAVLink_statustext_message(4, chunk, 7, n) for n, chunk in enumerate(chunks)))
    assert [(event.text, event.severity) for event in state.events] == [(text, Severity.WARNING)]


def test_control_characters_do_not_reach_the_terminal() -> None:
    state = received(mavlink.MAVLink_statustext_message(6, b"a\x1b[31mb\nc"))
    assert state.events[0].text == "a [31mb c"


def test_events_are_bounded_and_new_ones_are_found() -> None:
    many = [mavlink.MAVLink_statustext_message(6, f"line {n}".encode()) for n in range(EVENTS_KEPT + 5)]
    state = received(*many)
    assert len(state.events) == EVENTS_KEPT and state.text_count == EVENTS_KEPT + 5
    assert [event.text for event in new_events(state, state.text_count - 2)] == ["line 203", "line 204"]
    assert new_events(state, state.text_count) == ()


def test_announced_modes_win_over_known_ones() -> None:
    state = received(
        mavlink.MAVLink_heartbeat_message(2, 12, 129, 3 << 16, 4, 3),
        mavlink.MAVLink_available_modes_message(1, 1, 0, 3 << 16, 0, b"Soaring"),
    )
    assert modes.mode_name(state) == "SOARING"


@pytest.mark.parametrize(
    ("autopilot", "vehicle_type", "custom_mode", "name"),
    [(3, 1, 10, "AUTO"), (3, 2, 5, "LOITER"), (12, 2, 4 << 16 | 5 << 24, "RTL"), (3, 1, 99, "mode 99")],
)
def test_modes_of_other_autopilots(autopilot: int, vehicle_type: int, custom_mode: int, name: str) -> None:
    state = received(mavlink.MAVLink_heartbeat_message(vehicle_type, autopilot, 81, custom_mode, 4, 3))
    assert modes.mode_name(state) == name
    assert modes.uses_main_and_sub(state) is (autopilot != 3)


@pytest.mark.parametrize(
    ("autopilot", "first"), [(mavlink.MAV_AUTOPILOT_GENERIC, 0), (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 1)]
)
def test_the_item_is_counted_as_mission_current_counts(autopilot: int, first: int) -> None:
    navigation = mavlink.MAVLink_wingbeat_navigation_message(1000, 50.0, 1.0, 30.0, 0.5, 4, 3, 0)
    navigation._header = mavlink.MAVLink_header(navigation.id, 0, 0, 0, 1, 1)
    state = VehicleState()._replace(autopilot=autopilot, system=1)
    assert receive(state, navigation, 1.0).item == 4 + first
