"""``wingbeat gcs`` with our own flight computer, whoever it says that it is."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from flight_computer import HERE, aboard

from avionics.link.dialect import mavlink
from avionics.link.mission_codec import to_degrees
from avionics.link.vehicle import PROFILES, Home, Identity
from avionics.messages import Mode
from groundstation.command.main import main
from groundstation.link.connection import Connection
from groundstation.link.vehicle_state import VehicleState, receive
from groundstation.link.vehicle_topics import entry_of

Capture = pytest.CaptureFixture[str]
HOME = Home(*HERE)
ALIGNED = 10.0
"""s since boot; the attitude is known by then, without which it does not arm"""
EVERY_IDENTITY = pytest.mark.parametrize("identity", PROFILES.values(), ids=PROFILES)


def gcs(*words: str) -> int:
    return main(["gcs", *words, "--no-record"])


@pytest.fixture(params=PROFILES.values(), ids=PROFILES)
def vehicle(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The address of a flight computer that knows its home."""
    with aboard(tmp_path / "raven.json", outdoors_as=request.param) as url:
        with contextlib.closing(Connection(url)) as connection:
            connection.listen(10.0, lambda state: state.latitude is not None)
        yield url


Place = tuple[float, float]


def planned(
    command: int, place: tuple[float, float] | None, params: tuple[float, ...] = (0.0,) * 4
) -> dict[str, Any]:
    """An item at a place in m from home, or at none."""
    latitude, longitude = (0.0, 0.0) if place is None else to_degrees(HOME, *place)
    where = [latitude, longitude, 0.0 if command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH else 30.0]
    item = {"type": "SimpleItem", "command": command, "frame": 3, "params": [*params, *where], "autoContinue": True}
    return {**item, "doJumpId": 1}


def plan(path: Path, *items: dict[str, Any]) -> str:
    """A plan as QGroundControl writes it."""
    latitude, longitude = to_degrees(HOME, 0.0, 0.0)
    numbered = [{**item, "doJumpId": number} for number, item in enumerate(items, 1)]
    mission = {
        "version": 2, "firmwareType": 0, "vehicleType": 1, "cruiseSpeed": 15, "hoverSpeed": 5,
        "plannedHomePosition": [latitude, longitude, HOME.altitude], "items": numbered,
    }  # fmt: skip
    document = {
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission,
        "geoFence": {"version": 2, "circles": [], "polygons": []}, "rallyPoints": {"version": 2, "points": []},
    }  # fmt: skip
    path.write_text(json.dumps(document))
    return str(path)


@pytest.mark.parametrize(
    "takeoff",
    [(35.0, 12.0), pytest.param((0.0, 0.0), marks=pytest.mark.validate), None],
    ids=["beside home", "at home", "nowhere"],
)
def test_a_plan_with_a_takeoff_and_cameras_goes_up_and_comes_back_the_same(
    vehicle: str, takeoff: Place | None, tmp_path: Path, capsys: Capture
) -> None:
    file = plan(
        tmp_path / "field.plan",
        planned(mavlink.MAV_CMD_NAV_TAKEOFF, takeoff),
        planned(mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST, None, (25.0, 0.0, 1.0, 0.0)),
        planned(mavlink.MAV_CMD_NAV_WAYPOINT, (120.0, -40.0)),
        {**planned(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, None), "frame": 2},
    )
    assert gcs(vehicle, "mission", "upload", file) == 0
    capsys.readouterr()
    assert gcs(vehicle, "mission", "diff", file) == 0
    assert capsys.readouterr().out == ""
    assert gcs(vehicle, "mission", "show", "--json") == 0
    items = json.loads(capsys.readouterr().out)["items"]
    kept = next(item for item in items if item["command"] == mavlink.MAV_CMD_NAV_TAKEOFF)
    assert (kept["latitude"] is not None) is (takeoff is not None)


def test_a_takeoff_at_another_place_is_a_difference(vehicle: str, tmp_path: Path, capsys: Capture) -> None:
    rest = planned(mavlink.MAV_CMD_NAV_WAYPOINT, (120.0, -40.0))
    files = [
        plan(tmp_path / f"{north}.plan", planned(mavlink.MAV_CMD_NAV_TAKEOFF, (north, 5.0)), rest)
        for north in (30.0, 60.0)
    ]
    assert gcs(vehicle, "mission", "upload", files[0]) == 0
    assert gcs(vehicle, "mission", "diff", files[0]) == 0
    assert gcs(vehicle, "mission", "diff", files[1]) == 1


def test_our_own_mission_goes_up_in_metres_and_comes_back_the_same(vehicle: str, capsys: Capture) -> None:
    file = str(Path(__file__).parents[2] / "avionics" / "missions" / "circuit.toml")
    assert gcs(vehicle, "mission", "upload", file) == 0
    assert gcs(vehicle, "mission", "diff", file) == 0


def test_modes_and_parameters_go_by_our_names(vehicle: str, capsys: Capture) -> None:
    assert gcs(vehicle, "mode", "altitude_hold", "--json") == 0
    assert json.loads(capsys.readouterr().out)["mode"] == "ALTITUDE_HOLD"
    assert gcs(vehicle, "param", "set", "PITCH_P", "0.5") == 0


def stated(identity: Identity, *messages: Any) -> VehicleState:
    """What is known of a vehicle in mode AUTO."""
    beat = mavlink.MAVLink_heartbeat_message(
        identity.type, identity.autopilot, 0, identity.numbers(Mode.AUTO).custom_mode, 4, 3
    )
    state = VehicleState()
    for message in (beat, *messages):
        message.pack(mavlink.MAVLink(None, 1, 1))
        state = receive(state, message, 0.0)
    return state


@EVERY_IDENTITY
def test_recordings_have_our_mode_and_our_airspeed(identity: Identity) -> None:
    navigation = mavlink.MAVLink_wingbeat_navigation_message(1, 0, 0, 40, 0, 2, 3, 0)
    state = stated(identity, navigation)
    entry = entry_of(navigation, 1000, state)
    assert entry is not None and entry.message.mode == Mode.AUTO
    entry = entry_of(mavlink.MAVLink_vfr_hud_message(7.5, 6.5, 90, 62, 40.0, -0.5), 1000, state)
    assert entry is not None and entry.message.airspeed == 7.5


def test_a_takeoff_tells_the_mode_that_it_leads_to_and_leaves_the_planned_altitude(
    vehicle: str, capsys: Capture
) -> None:
    circuit = str(Path(__file__).parents[2] / "avionics" / "missions" / "circuit.toml")
    with contextlib.closing(Connection(vehicle)) as connection:
        connection.listen(20.0, lambda state: (state.time or 0.0) > ALIGNED)
    assert gcs(vehicle, "mission", "upload", circuit) == gcs(vehicle, "arm") == 0
    capsys.readouterr()
    assert gcs(vehicle, "takeoff", "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"done": "takeoff accepted", "mode": "TAKEOFF", "armed": True}
    assert gcs(vehicle, "mission", "diff", circuit) == 0
