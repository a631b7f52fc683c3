"""MAVSDK flies the vehicle: everything that a script written for it does."""

from __future__ import annotations

import asyncio
import math
import time
from pathlib import Path

import pytest
from ground_links import TRANSPORTS, Addresses
from mavsdk_station import Station, action, first, from_wire, param, station, telemetry, to_wire
from radio import radio
from simulated_vehicle import (
    ALTITUDE,
    HURRY,
    PROFILES,
    Profile,
    aircraft,
    assert_same,
    fence,
    matrix,
    parameter_values,
    plan,
    rally,
    send_text,
)

from avionics.link.dialect import mavlink
from sim_bridge.environment.home import COLLEGE_PARK

FlightMode, LandedState = telemetry.FlightMode, telemetry.LandedState


@pytest.mark.parametrize(("transport", "identity"), matrix(always=("udp", "generic")))
def test_mavsdk_flies_from_the_hand_to_the_ground(transport: str, identity: str, tmp_path: Path) -> None:
    with TRANSPORTS[transport]() as link, aircraft(link, PROFILES[identity], tmp_path):
        asyncio.run(fly(link.mavsdk, PROFILES[identity]))


async def fly(url: str, profile: Profile) -> None:
    async with station(url) as mavsdk:
        assert await check_parameters(mavsdk) < HURRY
        await check_telemetry(mavsdk)
        await change_a_parameter(mavsdk)
        await exchange_plans(mavsdk, profile)
        await arm_and_disarm(mavsdk)
        await take_off(mavsdk)
        await change_modes(mavsdk)
        await land(mavsdk)


async def check_parameters(mavsdk: Station) -> float:
    """Seconds from before it connected to the last parameter."""
    told = await mavsdk.parameters.get_all_params()
    took = time.monotonic() - mavsdk.started
    assert {each.name: each.value for each in told.float_params} == pytest.approx(parameter_values(), rel=1e-6)
    return took


async def check_telemetry(mavsdk: Station) -> None:
    observed = mavsdk.telemetry
    position = await first(observed.subscribe_position(), lambda value: math.isfinite(value.latitude_deg))
    assert math.radians(position.latitude_deg) == pytest.approx(COLLEGE_PARK.latitude, abs=2e-6)
    assert math.radians(position.longitude_deg) == pytest.approx(COLLEGE_PARK.longitude, abs=2e-6)
    assert (await first(observed.subscribe_battery())).voltage_v == pytest.approx(8.0, abs=1.0)
    assert await first(observed.subscribe_landed_state()) == LandedState.ON_GROUND
    assert await first(observed.subscribe_flight_mode()) == FlightMode.MANUAL
    assert not await first(observed.subscribe_armed())
    await first(observed.subscribe_health_all_ok(), bool)
    await observed.set_rate_landed_state(10.0)


async def change_a_parameter(mavsdk: Station) -> None:
    await mavsdk.parameters.set_param_float("NAV_LOITER_TIME", 20.0)
    assert await mavsdk.parameters.get_param_float("NAV_LOITER_TIME") == 20.0
    with pytest.raises(param.ParamError) as unknown:
        await mavsdk.parameters.get_param_float("NO_SUCH")
    assert unknown.value.result == param.ParamResult.DOES_NOT_EXIST
    with pytest.raises(param.ParamError) as beyond:
        await mavsdk.parameters.set_param_float("NAV_LOITER_TIME", -1.0)
    assert beyond.value.result == param.ParamResult.VALUE_OUT_OF_RANGE
    assert await mavsdk.parameters.get_param_float("NAV_LOITER_TIME") == 20.0


async def exchange_plans(mavsdk: Station, profile: Profile) -> None:
    there = mavsdk.mission
    await there.upload_mission(to_wire(plan(profile), mavlink.MAV_MISSION_TYPE_MISSION))
    await there.upload_geofence(to_wire(fence(), mavlink.MAV_MISSION_TYPE_FENCE))
    await there.upload_rally_points(to_wire(rally(), mavlink.MAV_MISSION_TYPE_RALLY))
    assert_same(from_wire(await there.download_mission()), plan(profile), profile.first_item)
    assert_same(from_wire(await there.download_geofence()), fence())
    assert_same(from_wire(await there.download_rallypoints()), rally())


async def arm_and_disarm(mavsdk: Station) -> None:
    await mavsdk.action.arm()
    await first(mavsdk.telemetry.subscribe_armed(), bool)
    await mavsdk.action.disarm()
    await first(mavsdk.telemetry.subscribe_armed(), lambda armed: not armed)


async def take_off(mavsdk: Station) -> None:
    await mavsdk.action.arm()
    await mavsdk.action.takeoff()
    await reached(mavsdk, FlightMode.TAKEOFF)
    await first(mavsdk.telemetry.subscribe_landed_state(), lambda state: state == LandedState.TAKING_OFF)
    await first(mavsdk.telemetry.subscribe_in_air(), bool)
    await first(mavsdk.telemetry.subscribe_position(), lambda observed: observed.relative_altitude_m > ALTITUDE / 2)


async def change_modes(mavsdk: Station) -> None:
    """Circle here, go on, circle there, return; and the wings do not stop in the air."""
    there = (math.degrees(COLLEGE_PARK.latitude) + 1e-3, math.degrees(COLLEGE_PARK.longitude))
    await mavsdk.action.hold()
    await reached(mavsdk, FlightMode.HOLD)
    await mavsdk.mission.start_mission()
    await reached(mavsdk, FlightMode.MISSION)
    await mavsdk.action.goto_location(*there, COLLEGE_PARK.altitude + ALTITUDE, math.nan)
    await reached(mavsdk, FlightMode.HOLD)
    await mavsdk.action.return_to_launch()
    await reached(mavsdk, FlightMode.RETURN_TO_LAUNCH)
    with pytest.raises(action.ActionError) as refused:
        await mavsdk.action.disarm()
    assert refused.value.result == action.ActionResult.COMMAND_DENIED


async def reached(mavsdk: Station, mode: int) -> None:
    await first(mavsdk.telemetry.subscribe_flight_mode(), lambda observed: observed == mode)


async def land(mavsdk: Station) -> None:
    """The world ends soon after the touchdown: all that follows from it is listened for before."""
    landed, armed = mavsdk.telemetry.subscribe_landed_state, mavsdk.telemetry.subscribe_armed
    down = asyncio.gather(
        first(landed(), lambda state: state == LandedState.ON_GROUND), first(armed(), lambda value: not value)
    )
    await mavsdk.action.land()
    await first(landed(), lambda state: state == LandedState.LANDING)
    await down


@pytest.mark.bench
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_how_long_from_the_first_connect_to_the_last_parameter(transport: str, tmp_path: Path) -> None:
    with TRANSPORTS[transport]() as link, aircraft(link, PROFILES["generic"], tmp_path, speed=1.0):
        took = asyncio.run(time_parameters(link.mavsdk))
    send_text(
        f"\nMAVSDK over {transport}: all parameters {took:.2f} s after it began to connect, asked within {HURRY:g} s"
    )


SLOW_BAUD = 57_600
"""of a telemetry radio"""
PATIENT = 15.0
"""s; from the beginning of the connection to the last parameter over it"""


@pytest.mark.bench
def test_how_long_to_the_last_parameter_over_a_slow_radio(tmp_path: Path) -> None:
    with radio(SLOW_BAUD / 10.0) as ends:
        link = Addresses(f"serial:{ends.vehicle},{SLOW_BAUD}", f"serial://{ends.ground}:{SLOW_BAUD}", ())
        with aircraft(link, PROFILES["ardupilot"], tmp_path, speed=1.0):
            took = asyncio.run(time_parameters(link.mavsdk))
    send_text(f"\nMAVSDK at {SLOW_BAUD} baud: all parameters after {took:.2f} s, asked within {PATIENT:g} s")
    assert took < PATIENT


async def time_parameters(url: str) -> float:
    async with station(url) as mavsdk:
        return await check_parameters(mavsdk)
