"""MAVProxy, headless, flies the vehicle by what a person types, with the mode map that is shipped."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest
from ground_links import TRANSPORTS
from mavproxy_console import Console, console, read_plan, write_plan
from simulated_vehicle import (
    HURRY,
    PROFILES,
    Profile,
    aircraft,
    assert_same,
    matrix,
    parameter_values,
    plan,
    send_text,
)

from avionics.messages import Mode
from sim_bridge.environment.home import COLLEGE_PARK

FLOWN = ("generic", "ardupilot")
"""Identities whose modes MAVProxy 1.8.75 can set: its ``mode`` command raises an error of its own on PX4"""


@pytest.mark.validate
@pytest.mark.parametrize(("transport", "identity"), matrix(("tcp", "ardupilot"), FLOWN))
def test_mavproxy_flies_from_the_hand_to_the_ground(transport: str, identity: str, tmp_path: Path) -> None:
    profile = PROFILES[identity]
    with (
        TRANSPORTS[transport]() as link,
        aircraft(link, profile, tmp_path),
        console(link.mavproxy, tmp_path / "home") as mavproxy,
    ):
        took = check_parameters(mavproxy)
        assert took < HURRY
        check_telemetry(mavproxy, profile)
        change_a_parameter(mavproxy)
        exchange_a_mission(mavproxy, profile, tmp_path)
        arm_and_disarm(mavproxy)
        take_off(mavproxy, profile)
        change_modes(mavproxy, profile)
        land(mavproxy, profile)
        assert "fence breach" not in mavproxy.printed


def check_parameters(mavproxy: Console) -> float:
    """Seconds from where it begins to connect, its modules being loaded, to the last parameter."""
    target = len(parameter_values())
    mavproxy.wait_for("Connect ")
    began = time.monotonic()
    mavproxy.wait_for("Detected vehicle 1:1")
    mavproxy.wait_for(f"Received {target} parameters")
    return time.monotonic() - began


def check_telemetry(mavproxy: Console, profile: Profile) -> None:
    assert f"Mode {profile.names[Mode.MANUAL]}" in mavproxy.printed
    kind, autopilot = profile.heartbeat
    mavproxy.request("status HEARTBEAT", rf"HEARTBEAT \{{type : {kind}, autopilot : {autopilot}, base_mode : 65")
    seen = mavproxy.request("status GLOBAL_POSITION_INT", r"GLOBAL_POSITION_INT \{.*?lat : (-?\d+), lon : (-?\d+)")
    place = [math.radians(int(degrees) * 1e-7) for degrees in seen.groups()]
    assert place == pytest.approx([COLLEGE_PARK.latitude, COLLEGE_PARK.longitude], abs=2e-6)


def change_a_parameter(mavproxy: Console) -> None:
    before = parameter_values()["NAV_LOITER_TIME"]
    mavproxy.request("param show NAV_LOITER_TIME", rf"NAV_LOITER_TIME +{before:.1f}")
    mavproxy.send("param set NAV_LOITER_TIME 20")
    mavproxy.wait_for("NAV_LOITER_TIME set to 20 s")
    mavproxy.send("param fetch NAV_LOITER_TIME")
    mavproxy.wait_for(r"NAV_LOITER_TIME = 20\.0")


def exchange_a_mission(mavproxy: Console, profile: Profile, folder: Path) -> None:
    target, there = plan(profile), folder / "there.txt"
    write_plan(target, folder / "wanted.txt")
    mavproxy.send(f"wp load {folder / 'wanted.txt'}")
    mavproxy.wait_for(f"Loaded {len(target)} waypoints in")
    mavproxy.wait_for(rf"mission accepted \({len(target) - profile.first_item} items\)")
    mavproxy.send(f"wp save {there}")
    mavproxy.wait_for(f"Requesting {len(target)} waypoints")
    mavproxy.wait_for(f"Saved {len(target)} waypoints to")
    assert_same(read_plan(there), target, profile.first_item)


def arm_and_disarm(mavproxy: Console) -> None:
    mavproxy.send("arm throttle")
    mavproxy.wait_for(r"\bARMED")
    mavproxy.send("disarm")
    mavproxy.wait_for("DISARMED")


def take_off(mavproxy: Console, profile: Profile) -> None:
    mavproxy.send("arm throttle")
    mavproxy.wait_for(r"\bARMED")
    mavproxy.send("takeoff 12")
    mavproxy.wait_for("TAKEOFF> ")
    mavproxy.wait_for("launched")


def change_modes(mavproxy: Console, profile: Profile) -> None:
    """The prompt tells the vehicle's mode; what MAVProxy says of it comes seconds later."""
    for mode in (Mode.LOITER, Mode.AUTO, Mode.RETURN):
        mavproxy.send(f"mode {profile.names[mode]}")
        mavproxy.wait_for(f"{profile.names[mode]}> ")
    mavproxy.send("disarm")
    mavproxy.wait_for("disarm denied: in flight")


def land(mavproxy: Console, profile: Profile) -> None:
    mavproxy.send(f"mode {profile.names[Mode.LAND]}")
    mavproxy.wait_for(f"{profile.names[Mode.LAND]}> ")
    mavproxy.wait_for("DISARMED")


@pytest.mark.validate
def test_mavproxy_sets_a_key_and_goes_on_signed(tmp_path: Path) -> None:
    """The key is sent once, in the clear, to a vehicle on the same computer; then unsigned frames are refused."""
    with (
        TRANSPORTS["udp"]() as link,
        aircraft(link, PROFILES["generic"], tmp_path),
        console(link.mavproxy, tmp_path / "home") as mavproxy,
    ):
        mavproxy.wait_for(f"Received {len(parameter_values())} parameters")
        mavproxy.send("signing setup the goose is loose")
        mavproxy.wait_for("signing: on, until the next start")
        change_a_parameter(mavproxy)
        mavproxy.send("signing disable")
        mavproxy.send("arm throttle")
        mavproxy.wait_for("unsigned frames rejected")
        assert "ARMED" not in mavproxy.printed


@pytest.mark.bench
@pytest.mark.parametrize("transport", TRANSPORTS)
def test_how_long_from_the_first_connect_to_the_last_parameter(transport: str, tmp_path: Path) -> None:
    with (
        TRANSPORTS[transport]() as link,
        aircraft(link, PROFILES["generic"], tmp_path, speed=1.0),
        console(link.mavproxy, tmp_path / "home") as mavproxy,
    ):
        took = check_parameters(mavproxy)
    send_text(
        f"\nMAVProxy over {transport}: all parameters {took:.2f} s after the connect began, asked within {HURRY:g} s"
    )
