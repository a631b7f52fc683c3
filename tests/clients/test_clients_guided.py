"""Control from a companion computer: MAVSDK's offboard plug-in, pymavlink and dronekit in ArduPlane's GUIDED."""

from __future__ import annotations

import asyncio
import collections
import math
import time
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from ground_links import udp
from pymavlink import mavutil
from simulated_vehicle import ALTITUDE, ARDUPILOT, GENERIC, PATIENCE, PROFILES, Profile, aircraft, plan, send_text

from avionics.link.dialect import mavlink
from avionics.vehicles import load_vehicle
from sim_bridge.environment.home import COLLEGE_PARK

RADIUS = load_vehicle("robo_raven_ii_d").gains.navigation.loiter_radius
NORTH, EAST = 60.0, 40.0
"""m; position setpoint from home"""
ABOVE = 15.0
"""m; altitude of the setpoints above home"""
TIMEOUT = 4.0
"""s of flight time: the station streams on the wall clock"""
CLOSE = 8.0
"""m; off the circle"""
GUIDED = 15


# --- MAVSDK --------------------------------------------------------------------------------------------------


@pytest.mark.validate
@pytest.mark.parametrize("identity", PROFILES)
def test_mavsdk_offboard(identity: str, tmp_path: Path) -> None:
    """GIVEN setpoints WHEN offboard is started THEN the vehicle circles, flies a course, and holds after the stop."""
    station = pytest.importorskip("mavsdk_station")
    with udp() as link, aircraft(link, PROFILES[identity], tmp_path):
        asyncio.run(fly_offboard(link.mavsdk, PROFILES[identity], station))


async def fly_offboard(url: str, profile: Profile, kit: Any) -> None:
    plugin = pytest.importorskip("mavsdk.asyncio.plugins.offboard")
    async with kit.station(url) as mavsdk:
        telemetry = mavsdk.telemetry
        offboard = plugin.OffboardAsync(mavsdk.system)
        await kit.first(telemetry.subscribe_health_all_ok(), bool)
        await mavsdk.parameters.set_param_float("NAV_OFFB_TIMEOUT", TIMEOUT)
        await mavsdk.mission.upload_mission(kit.to_wire(plan(profile), mavlink.MAV_MISSION_TYPE_MISSION))
        await mavsdk.action.arm()
        await mavsdk.action.takeoff()
        await kit.first(telemetry.subscribe_position(), lambda sample: sample.relative_altitude_m > ALTITUDE / 2)
        await offboard.set_position_ned(plugin.PositionNedYaw(NORTH, EAST, -ABOVE, math.nan))
        await offboard.start()
        assert await offboard.is_active()
        # MAVSDK sets GUIDED of ArduPlane, but has no name for it.
        mode = "UNKNOWN" if profile is ARDUPILOT else "OFFBOARD"
        await kit.first(telemetry.subscribe_flight_mode(), lambda sample: sample == kit.telemetry.FlightMode[mode])
        await telemetry.set_rate_position_velocity_ned(20.0)

        def off_circle(sample: Any) -> float:
            return abs(math.hypot(sample.position.north_m - NORTH, sample.position.east_m - EAST) - RADIUS)

        await kit.first(telemetry.subscribe_position_velocity_ned(), lambda sample: off_circle(sample) < 2.0)
        await asyncio.sleep(2.0)
        circled = await kit.first(telemetry.subscribe_position_velocity_ned())
        assert off_circle(circled) < CLOSE
        await offboard.set_velocity_ned(plugin.VelocityNedYaw(0.0, -6.0, 0.0, math.nan))

        def off_course(sample: Any) -> float:
            return abs(math.degrees(math.atan2(sample.velocity.east_m_s, sample.velocity.north_m_s)) + 90.0)

        await kit.first(telemetry.subscribe_position_velocity_ned(), lambda sample: off_course(sample) < 2.0)
        await asyncio.sleep(1.0)
        straight = await kit.first(telemetry.subscribe_position_velocity_ned())
        assert off_course(straight) < 10.0
        await offboard.stop()
        await kit.first(telemetry.subscribe_flight_mode(), lambda mode: mode == kit.telemetry.FlightMode.HOLD)
        place = (math.degrees(COLLEGE_PARK.latitude), math.degrees(COLLEGE_PARK.longitude))
        behavior = kit.action.OrbitYawBehavior.HOLD_FRONT_TANGENT_TO_CIRCLE
        await mavsdk.action.do_orbit(-RADIUS, math.nan, behavior, *place, COLLEGE_PARK.altitude + ABOVE)

        def off_orbit(sample: Any) -> float:
            return abs(math.hypot(sample.position.north_m, sample.position.east_m) - RADIUS)

        await kit.first(telemetry.subscribe_position_velocity_ned(), lambda sample: off_orbit(sample) < 2.0)
        await asyncio.sleep(2.0)
        assert off_orbit(await kit.first(telemetry.subscribe_position_velocity_ned())) < CLOSE
        send_text(
            f"MAVSDK: {off_circle(circled):.1f} m off the circle, {off_course(straight):.1f} degrees off the course"
        )


# --- pymavlink -----------------------------------------------------------------------------------------------


class Script:
    """A pymavlink script in flight."""

    def __init__(self, url: str) -> None:
        self.link = mavutil.mavlink_connection(url, source_system=255, dialect="ardupilotmega")
        self.link.wait_heartbeat(timeout=PATIENCE)
        self.link.mav.request_data_stream_send(1, 1, mavlink.MAV_DATA_STREAM_ALL, 10, 1)
        ready = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        self.expect("SYS_STATUS", lambda status: status.onboard_control_sensors_health & ready)

    def expect(self, kind: str, accept: Callable[[Any], bool] = lambda message: True) -> Any:
        deadline, beat = time.monotonic() + PATIENCE, 0.0
        while time.monotonic() < deadline:
            if time.monotonic() - beat > 1.0:
                beat = time.monotonic()
                self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
            message = self.link.recv_match(type=kind, blocking=True, timeout=0.5)
            if message is not None and accept(message):
                return message
        raise AssertionError(f"no {kind} within {PATIENCE} s")

    def command(self, number: int, *params: float) -> int:
        self.link.mav.command_long_send(1, 1, number, 0, *params, *(0.0,) * (7 - len(params)))
        return int(self.expect("COMMAND_ACK", lambda ack: ack.command == number).result)

    def upload(self, profile: Profile) -> None:
        items = plan(profile)
        self.link.mav.mission_count_send(1, 1, len(items))
        for seq, item in enumerate(items):
            self.expect("MISSION_REQUEST_INT", lambda request, number=seq: request.seq == number)
            place = (item.x, item.y, item.z)
            self.link.mav.mission_item_int_send(1, 1, seq, item.frame, item.command, 0, 1, *item.params, *place)
        assert self.expect("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED

    def position(self) -> tuple[float, float]:
        """North and east (m) of the start."""
        sample = self.expect("LOCAL_POSITION_NED")
        return sample.x, sample.y


@contextmanager
def script(tmp_path: Path, profile: Profile) -> Iterator[Script]:
    with udp() as link, aircraft(link, profile, tmp_path):
        station = Script(link.mavproxy[0].removeprefix("--master="))
        try:
            yield station
        finally:
            station.link.close()


@pytest.mark.validate
def test_pymavlink_guided(tmp_path: Path) -> None:
    """GIVEN GUIDED of ArduPlane WHEN one position is sent THEN it is circled, and an offset changes the altitude."""
    with script(tmp_path, ARDUPILOT) as station:
        station.upload(ARDUPILOT)
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
        assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, ALTITUDE) == mavlink.MAV_RESULT_ACCEPTED
        station.expect("VFR_HUD", lambda hud: hud.alt - COLLEGE_PARK.altitude > ALTITUDE - 2.0)
        station.link.set_mode(GUIDED)
        station.expect("HEARTBEAT", lambda beat: beat.custom_mode == GUIDED)
        position, altitude = 0b1101_1111_1000, 0b1101_1111_1011
        place = (
            round(math.degrees(COLLEGE_PARK.latitude) * 1e7) + 5_400,
            round(math.degrees(COLLEGE_PARK.longitude) * 1e7),
        )
        relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        station.link.mav.set_position_target_global_int_send(0, 1, 1, relative, position, *place, ABOVE, *(0,) * 8)

        def off_circle() -> float:
            north, east = station.position()
            return abs(math.hypot(north - 60.1, east) - RADIUS)

        deadline = time.monotonic() + PATIENCE
        while off_circle() > 2.0 and time.monotonic() < deadline:
            pass
        station.link.mav.set_position_target_global_int_send(
            0, 1, 1, relative, altitude, 0, 0, ABOVE + 6.0, *(0,) * 8
        )
        station.expect("VFR_HUD", lambda hud: hud.alt - COLLEGE_PARK.altitude > ABOVE + 5.0)
        assert off_circle() < CLOSE
        assert station.expect("HEARTBEAT").custom_mode == GUIDED


@pytest.mark.validate
def test_pymavlink_offboard_timeout(tmp_path: Path) -> None:
    """GIVEN a stream at 20 Hz WHEN it stops THEN the vehicle changes from OFFBOARD to LOITER and reports it."""
    offboard, loiter = 6 << 16, 4 << 16 | 3 << 24
    with script(tmp_path, GENERIC) as station:
        station.upload(GENERIC)
        assert station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
        assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, ALTITUDE) == mavlink.MAV_RESULT_ACCEPTED
        station.expect("VFR_HUD", lambda hud: hud.alt - COLLEGE_PARK.altitude > ALTITUDE - 2.0)
        assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == mavlink.MAV_RESULT_DENIED
        modes: set[int] = set()
        for number in range(60):
            station.link.mav.set_position_target_local_ned_send(
                0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0b1101_1100_0111, 0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0
            )
            if number == 20:
                station.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, 6, 0, 0, 0, 0, 0)
            # The telemetry is read meanwhile: it is more than the socket keeps.
            until = time.monotonic() + 0.05
            while (left := until - time.monotonic()) > 0.0:
                beat = station.link.recv_match(type="HEARTBEAT", blocking=True, timeout=left)
                modes |= {beat.custom_mode} if beat else set()
        assert offboard in modes
        station.expect("STATUSTEXT", lambda status: "setpoints timed out" in status.text)
        station.expect("HEARTBEAT", lambda beat: beat.custom_mode == loiter)


# --- dronekit ------------------------------------------------------------------------------------------------


@pytest.mark.validate
def test_dronekit_goto(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN an upload, GUIDED and simple_takeoff WHEN simple_goto THEN the position is circled, and RTL returns."""
    # dronekit 2.9.2 imports a name that Python 3.10 moved to collections.abc.
    monkeypatch.setattr(collections, "MutableMapping", MutableMapping, raising=False)
    dronekit = pytest.importorskip("dronekit")
    with udp() as link, aircraft(link, ARDUPILOT, tmp_path):
        url = link.mavproxy[0].removeprefix("--master=")
        vehicle = dronekit.connect(url, wait_ready=True, timeout=PATIENCE, heartbeat_timeout=PATIENCE)
        try:
            fly_dronekit(dronekit, vehicle)
        finally:
            vehicle.close()


def fly_dronekit(dronekit: Any, vehicle: Any) -> None:
    wait_for(lambda: vehicle.is_armable)
    vehicle.commands.clear()
    for item in plan(ARDUPILOT)[1:]:
        place = (item.x * 1e-7, item.y * 1e-7, item.z)
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        vehicle.commands.add(dronekit.Command(0, 0, 0, frame, item.command, 0, 1, *item.params, *place))
    vehicle.commands.upload()
    vehicle.mode = dronekit.VehicleMode("GUIDED")
    wait_for(lambda: vehicle.mode.name == "GUIDED")
    vehicle.armed = True
    wait_for(lambda: vehicle.armed)
    vehicle.simple_takeoff(ALTITUDE)
    wait_for(lambda: vehicle.location.global_relative_frame.alt > ALTITUDE - 2.0)
    vehicle.mode = dronekit.VehicleMode("GUIDED")
    wait_for(lambda: vehicle.mode.name == "GUIDED")
    home = [math.degrees(angle) for angle in (COLLEGE_PARK.latitude, COLLEGE_PARK.longitude)]
    vehicle.simple_goto(dronekit.LocationGlobalRelative(home[0] + 5.4e-4, home[1], ABOVE))

    def off_circle() -> float:
        place = vehicle.location.local_frame
        return abs(math.hypot(place.north - 60.1, place.east) - RADIUS)

    wait_for(lambda: off_circle() < 2.0)
    time.sleep(2.0)
    assert off_circle() < CLOSE
    assert vehicle.location.global_relative_frame.alt == pytest.approx(ABOVE, abs=3.0)
    assert vehicle.mode.name == "GUIDED"
    vehicle.mode = dronekit.VehicleMode("RTL")
    wait_for(lambda: vehicle.mode.name == "RTL")


def wait_for(accept: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not accept():
        assert time.monotonic() < deadline, f"not reached within {PATIENCE} s"
        time.sleep(0.1)
