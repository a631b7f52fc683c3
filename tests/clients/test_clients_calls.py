"""MAVSDK's plug-ins, call by call: what works in every identity, and what does not, named."""

from __future__ import annotations

import asyncio
import importlib
import math
from collections.abc import AsyncIterator, Awaitable
from pathlib import Path
from typing import Any

import pytest
from ground_links import TRANSPORTS
from mavsdk_station import Station, first, station, to_wire
from simulated_vehicle import ALTITUDE, PROFILES, Profile, aircraft, plan, send_text

from sim_bridge.environment.home import COLLEGE_PARK

LIMIT = 8.0
"""s; for a call to be answered"""
LATITUDE, LONGITUDE = math.degrees(COLLEGE_PARK.latitude), math.degrees(COLLEGE_PARK.longitude)
STREAMS = """
position home in_air landed_state armed vtol_state attitude_quaternion attitude_euler velocity_ned gps_info raw_gps
battery flight_mode health rc_status actuator_output_status odometry position_velocity_ned fixedwing_metrics imu
scaled_imu raw_imu unix_epoch_time scaled_pressure heading altitude wind attitude_angular_velocity_body
actuator_control_target ground_truth distance_sensor
"""
RATES = """
position home attitude_quaternion attitude_euler velocity_ned battery odometry imu scaled_imu raw_imu altitude
actuator_output_status
"""
NO_VALUE = """
speed_m_s gimbal_pitch_deg gimbal_yaw_deg loiter_time_s camera_photo_interval_s yaw_deg camera_photo_distance_m
"""
UNSUPPORTED = {
    "telemetry.actuator_control_target": "a stroke and a tail have no such groups",
    "telemetry.ground_truth": "the vehicle does not know the truth of a simulation",
    "telemetry.distance_sensor": "the vehicle carries none",
    "info.get_speed_factor": "MAVSDK measures it between two messages that this connection is too short for",
    "ftp.upload": "files of the vehicle are read alone",
    "action.set_relay": "there is none",
    "action.transition_to_multicopter": "it is none",
    "follow_me.start": "not offered",
    "events.report": "health is in SYS_STATUS and STATUSTEXT",
    "calibration.gyro": "gyros are calibrated at rest before every arming",
    "manual_control.start_position": "sticks do not command positions",
    "action.disarm in the air": "the wings do not stop in flight",
}
"""What MAVSDK 4.1 cannot do with this vehicle, and why"""
BY_IDENTITY = {
    "ardupilot": {
        "action.get_return_to_launch_altitude": "MAVSDK offers it for PX4 alone",
        "action.set_return_to_launch_altitude": "MAVSDK offers it for PX4 alone",
        "mission.download": "MAVSDK refuses home, which ArduPilot's list begins with",
        "calibration.gyro": "MAVSDK offers it for PX4 alone",
        "manual_control.start_altitude": "MAVSDK knows no such mode of ArduPlane",
    },
    "px4": dict.fromkeys(
        (
            "action.get_return_to_launch_altitude",
            "action.set_return_to_launch_altitude",
            "action.get_takeoff_altitude",
            "action.set_takeoff_altitude",
        ),
        "parameters of PX4",
    ),
}
BY_IDENTITY["generic"] = BY_IDENTITY["px4"]


class Calls:
    """Makes calls and notes how each ended."""

    def __init__(self) -> None:
        self.failed: dict[str, str] = {}
        self.count = 0

    async def make(self, name: str, call: Awaitable[Any], limit: float = LIMIT) -> Any:
        """The answer; None where there is none."""
        self.count += 1
        try:
            return await asyncio.wait_for(call, limit)
        except TimeoutError:
            self.failed[name] = f"no answer in {limit:g} s"
        except Exception as error:
            self.failed[name] = f"{type(error).__name__}: {error}"
        return None


def plugin(mavsdk: Station, name: str) -> tuple[Any, Any]:
    """Module and object of one of MAVSDK's plug-ins."""
    module = importlib.import_module(f"mavsdk.asyncio.plugins.{name}")
    made = next(value for key, value in vars(module).items() if key.endswith("Async"))
    return module, made(mavsdk.system)


async def any_value(stream: AsyncIterator[Any]) -> Any:
    return await anext(aiter(stream))


async def to_the_end(stream: AsyncIterator[Any]) -> None:
    async for _ in stream:
        pass


async def on_the_ground(mavsdk: Station, calls: Calls, folder: Path) -> None:
    telemetry, action = mavsdk.telemetry, mavsdk.action
    await first(telemetry.subscribe_health_all_ok(), bool)
    _, info = plugin(mavsdk, "info")
    for name in ("get_identification", "get_product", "get_version", "get_speed_factor"):
        await calls.make(f"info.{name}", getattr(info, name)())
    await calls.make("info.flight_information", any_value(info.subscribe_flight_information()))
    for name in RATES.split():
        await calls.make(f"telemetry.set_rate_{name}", getattr(telemetry, f"set_rate_{name}")(5.0))
    for name in STREAMS.split():
        await calls.make(f"telemetry.{name}", any_value(getattr(telemetry, f"subscribe_{name}")()), 3.0)
    await calls.make("telemetry.get_gps_global_origin", telemetry.get_gps_global_origin())
    for name, value in (("takeoff_altitude", 15.0), ("return_to_launch_altitude", 30.0)):
        await calls.make(f"action.get_{name}", getattr(action, f"get_{name}")())
        await calls.make(f"action.set_{name}", getattr(action, f"set_{name}")(value))
    await missions(mavsdk, calls)
    await files(mavsdk, calls, folder)
    _, events = plugin(mavsdk, "events")
    await calls.make("events.report", events.get_health_and_arming_checks_report())
    _, calibration = plugin(mavsdk, "calibration")
    await calls.make("calibration.gyro", to_the_end(calibration.calibrate_gyro()))


async def missions(mavsdk: Station, calls: Calls) -> None:
    module, mission = plugin(mavsdk, "mission")
    parts = dict.fromkeys(NO_VALUE.split(), math.nan)
    items = [
        module.MissionItem(
            latitude_deg=LATITUDE + north,
            longitude_deg=LONGITUDE,
            relative_altitude_m=ALTITUDE,
            is_fly_through=True,
            camera_action=0,
            vehicle_action=0,
            acceptance_radius_m=10.0,
            **{**parts, "speed_m_s": speed},
        )
        for north, speed in ((3e-4, math.nan), (9e-4, 7.0), (12e-4, math.nan))
    ]
    await calls.make("mission.upload", mission.upload_mission(module.MissionPlan(items)))
    await calls.make("mission.download", mission.download_mission())
    await calls.make("mission.get_return_after", mission.get_return_to_launch_after_mission())
    await calls.make("mission.set_return_after", mission.set_return_to_launch_after_mission(True))
    await mission.upload_mission(module.MissionPlan(items))  # a download that fails has emptied MAVSDK's list
    await calls.make("mission.progress", any_value(mission.subscribe_mission_progress()))
    await calls.make("mission.set_current", mission.set_current_mission_item(0))
    await calls.make("mission.clear", mission.clear_mission())
    module, fence = plugin(mavsdk, "geofence")
    corners = [
        module.Point(LATITUDE + 5e-3 * n, LONGITUDE + 5e-3 * e) for n, e in ((-1, -1), (-1, 1), (1, 1), (1, -1))
    ]
    data = module.GeofenceData([module.Polygon(corners, 0)], [])
    await calls.make("geofence.upload", fence.upload_geofence(data))
    await calls.make("geofence.clear", fence.clear_geofence())


async def files(mavsdk: Station, calls: Calls, folder: Path) -> None:
    _, logs = plugin(mavsdk, "log_files")
    await calls.make("log_files.entries", logs.get_entries())
    _, ftp = plugin(mavsdk, "ftp")
    await calls.make("ftp.list", ftp.list_directory("/"))
    for way in (True, False):
        remote = "/@PARAM/param.pck"
        await calls.make(f"ftp.download {way}", to_the_end(ftp.download(remote, str(folder), way)))
    local = folder / "file.txt"
    local.write_text("text")
    await calls.make("ftp.upload", to_the_end(ftp.upload(str(local), "/")))
    _, metadata = plugin(mavsdk, "component_metadata")
    await calls.make("metadata.request", metadata.request_autopilot_component())
    await calls.make("metadata.available", any_value(metadata.subscribe_metadata_available()), 15.0)


async def in_the_air(mavsdk: Station, calls: Calls, profile: Profile) -> None:
    telemetry, action = mavsdk.telemetry, mavsdk.action
    await calls.make("mission_raw.upload", mavsdk.mission.upload_mission(to_wire(plan(profile), 0)))
    await calls.make("action.arm", action.arm())
    await calls.make("action.takeoff", action.takeoff())
    await first(telemetry.subscribe_position(), lambda value: value.relative_altitude_m > ALTITUDE - 2.0)
    _, mission = plugin(mavsdk, "mission")
    module, offboard = plugin(mavsdk, "offboard")
    _, sticks = plugin(mavsdk, "manual_control")
    _, follow = plugin(mavsdk, "follow_me")
    there = (LATITUDE + 1e-3, LONGITUDE)
    altitude = COLLEGE_PARK.altitude + 2.0 * ALTITUDE
    await calls.make("mission.start", mission.start_mission())
    await calls.make("mission.is_finished", mission.is_mission_finished())
    await calls.make("mission.pause", mission.pause_mission())
    await calls.make("action.hold", action.hold())
    await calls.make("action.goto_location", action.goto_location(*there, altitude, math.nan))
    await calls.make("action.do_orbit", action.do_orbit(30.0, 7.0, 0, *there, altitude))
    await calls.make("action.set_current_speed", action.set_current_speed(7.0))
    await calls.make("action.set_relay", action.set_relay(0, 1))
    await calls.make("action.transition_to_multicopter", action.transition_to_multicopter())
    await calls.make("follow_me.start", follow.start())
    await calls.make("offboard.set", offboard.set_velocity_ned(module.VelocityNedYaw(7.0, 0.0, 0.0, 0.0)))
    await calls.make("offboard.start", offboard.start())
    await calls.make("offboard.stop", offboard.stop())
    for _ in range(10):
        await sticks.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
        await asyncio.sleep(0.02)
    await calls.make("manual_control.start_position", sticks.start_position_control())
    await calls.make("manual_control.start_altitude", sticks.start_altitude_control())
    await calls.make("action.return_to_launch", action.return_to_launch())
    await calls.make("action.disarm in the air", action.disarm())
    await calls.make("action.land", action.land())


async def all_calls(url: str, profile: Profile, folder: Path) -> Calls:
    calls = Calls()
    async with station(url) as mavsdk:
        await on_the_ground(mavsdk, calls, folder)
        await in_the_air(mavsdk, calls, profile)
    return calls


@pytest.mark.validate
@pytest.mark.parametrize("identity", PROFILES)
def test_mavsdk_plug_ins(identity: str, tmp_path: Path) -> None:
    with TRANSPORTS["udp"]() as link, aircraft(link, PROFILES[identity], tmp_path):
        calls = asyncio.run(all_calls(link.mavsdk, PROFILES[identity], tmp_path))
    expected = {**UNSUPPORTED, **BY_IDENTITY[identity]}
    send_text(f"\nMAVSDK 4.1, {identity}: {calls.count - len(calls.failed)} of {calls.count} calls")
    unexpected = {name: why for name, why in calls.failed.items() if name not in expected}
    assert not unexpected
