"""QGroundControl's files flown by the simulated bird: a plan with its geofence and rally point, a plain list."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulate import RAVEN, simulate

from avionics import topics
from avionics.messages import Breach, Mode, Stage
from avionics.missions.files import load_flight_plan
from avionics.missions.script import plan_commands
from avionics.vehicles import load_vehicle
from logs.reader import open_log
from sim_bridge.flight.world import Scenario

HOME = (47.4, 8.5)
"""deg; where the plans were drawn, far from where they are flown"""
RADIUS = 6_371_000.0
"""m; of the earth, to place things by: a metre at 200 m is near enough"""
BORDER = 100.0
"""m; from home to the area that the leg leads into"""
RALLY = (35.0, 45.0, 20.0)
"""m; north, east, altitude"""


def place(north: float, east: float) -> list[float]:
    """Latitude and longitude in degrees."""
    latitude = HOME[0] + math.degrees(north / RADIUS)
    return [latitude, HOME[1] + math.degrees(east / (RADIUS * math.cos(math.radians(HOME[0]))))]


def item(command: int, number: int, *params: float | None) -> dict[str, Any]:
    return {"type": "SimpleItem", "command": command, "doJumpId": number, "frame": 3, "params": list(params)}


def plan(*items: dict[str, Any], **parts: Any) -> str:
    mission = {"version": 2, "plannedHomePosition": [*HOME, 400.0], "items": items}
    fence = {"version": 2, "circles": parts.get("circles", []), "polygons": []}
    rally = {"version": 2, "points": parts.get("points", [])}
    head = {"fileType": "Plan", "version": 1, "groundStation": "QGroundControl"}
    return json.dumps({**head, "mission": mission, "geoFence": fence, "rallyPoints": rally})


TAKEOFF = item(22, 1, 15, 0, 0, None, *HOME, 15)


@pytest.mark.validate
def test_a_plan_whose_leg_leads_out_of_its_fence_ends_at_its_rally_point(tmp_path: Path) -> None:
    away = item(16, 2, 0, 0, 0, None, *place(200.0, 0.0), 15)
    circle = {"circle": {"center": place(BORDER + 30.0, 0.0), "radius": 30.0}, "inclusion": False, "version": 1}
    path = tmp_path / "field.plan"
    path.write_text(plan(TAKEOFF, away, circles=[circle], points=[[*place(*RALLY[:2]), RALLY[2]]]))
    loaded = load_flight_plan(path)
    scenario = Scenario(seed=1, duration=56.0)
    flight = simulate(RAVEN, scenario, loaded.mission, commands=plan_commands(loaded))
    truth, radius = flight.truth, load_vehicle(RAVEN).gains.navigation.loiter_radius
    time, north, east = truth["time_us"] * 1e-6, truth["north"], truth["east"]
    breached = flight.event_time("failsafe: returning, outside the fence")
    assert np.interp(breached, time, np.hypot(north, east)) == pytest.approx(BORDER, abs=5.0)
    assert flight.event_time("waypoint 0 reached (takeoff 15 m)") < breached
    assert [(told.kind, told.breaches) for told in flight.of(topics.FENCE)[-1:]] == [(Breach.BORDER, 1)]
    from_rally = np.hypot(north - RALLY[0], east - RALLY[1])
    late = time > time[-1] - 4.0
    assert np.abs(from_rally[late] - radius).max() < 10.0
    assert flight.of(topics.NAVIGATION)[-1].mode == Mode.RETURN
    assert flight.altitude()[-1] == pytest.approx(RALLY[2], abs=2.0)
    assert np.hypot(north, east).max() < BORDER + 25.0


LANDING = {
    "type": "ComplexItem",
    "complexItemType": "fwLandingPattern",
    "version": 2,
    "landingApproachCoordinate": [*place(160.0, -100.0), 15],
    "landCoordinate": [*place(30.0, -100.0), 0],
    "loiterRadius": 25,
}
LIST = "\n".join(
    "\t".join(str(field) for field in row)
    for row in (
        ("QGC WPL 110",),
        (0, 1, 0, 16, 0, 0, 0, 0, *HOME, 400.0, 1),
        (1, 0, 3, 22, 15, 0, 0, 0, 0, 0, 15, 1),
        (2, 0, 3, 16, 0, 0, 0, 0, *place(150.0, 0.0), 15, 1),
        (3, 0, 3, 18, 1, 0, 25, 0, *place(150.0, -60.0), 15, 1),
        (4, 0, 3, 21, 0, 0, 0, 180, *place(30.0, -100.0), 0, 1),
    )
)
FILES = {
    "field.plan": plan(
        TAKEOFF,
        item(16, 2, 0, 0, 0, None, *place(150.0, 0.0), 15),
        item(18, 3, 1, 0, 25, 0, *place(150.0, -60.0), 15),
        LANDING,
    ),
    "field.waypoints": LIST,
}


@pytest.mark.validate
def test_circle_without_a_place_is_flown_about_where_the_item_before_ended(tmp_path: Path) -> None:
    path = tmp_path / "here.plan"
    servo = {**item(183, 2, 5, 1500, 0, 0, 0, 0, 0), "frame": 2}
    turns = item(18, 4, 1, 0, 25, 0, 0, 0, None)
    path.write_text(plan(TAKEOFF, servo, item(16, 3, 0, 0, 0, None, *place(90.0, 0.0), 15), turns))
    loaded = load_flight_plan(path)
    assert loaded.notes == ("passed over in flight: DO_SET_SERVO (183)",)
    assert [(each.here, each.altitude) for each in loaded.mission[2:]] == [(0, 15.0), (1, 15.0)]
    flight = simulate(RAVEN, Scenario(seed=1, duration=52.0), loaded.mission)
    time, truth = flight.truth["time_us"] * 1e-6, flight.truth
    begun, done = flight.event_time("waypoint 2 "), flight.event_time("waypoint 3 completed (circle")
    assert begun < done
    circling = (time > 0.5 * (begun + done)) & (time < done)
    assert np.hypot(truth["north"][circling] - 90.0, truth["east"][circling]) == pytest.approx(25.0, abs=6.0)


@pytest.mark.validate
@pytest.mark.parametrize("name", FILES)
def test_the_command_flies_a_file_from_the_hand_to_the_ground(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(FILES[name])
    log = tmp_path / "flight.mcap"
    words = ["fly", "--mission", str(tmp_path / name), "--log", str(log), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "groundstation.command.main", *words], capture_output=True, text=True, timeout=300
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["log"] == str(log)
    with open_log(log) as flight:
        said = [event.text for event in flight.events()]
        navigation, truth = flight.columns(topics.NAVIGATION), flight.columns("/truth/state")
    assert [any(text.startswith(f"waypoint {number} ") for text in said) for number in range(3)] == [True] * 3
    assert "touchdown, disarmed" in said
    assert not [text for text in said if "failsafe" in text]
    assert navigation["stage"][-1] == Stage.LANDED
    # On the line of the final approach; how far it floats along it is the landing's affair.
    assert truth["east"][-1] == pytest.approx(-100.0, abs=15.0)
    assert -120.0 < truth["north"][-1] < 60.0
    from_centre = np.hypot(truth["north"] - 150.0, truth["east"] + 60.0)
    assert np.mean(np.abs(from_centre - 25.0) < 4.0) > 0.1
