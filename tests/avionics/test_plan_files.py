"""QGroundControl's plans and plain waypoint lists as missions of ours, and our plans as theirs."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.mission_codec import encode_item
from avionics.link.vehicle import Home
from avionics.missions import plan_file
from avionics.missions.files import load_flight_plan
from groundstation.link import waypoints
from groundstation.link.missions import Item
from wingbeat.errors import InputError

HOME = Home(math.radians(38.99), math.radians(-76.94), 20.0)
NORTH_100 = 38.99 + math.degrees(100.0 / 6_378_137.0)
EAST_50 = -76.94 + math.degrees(50.0 / (6_378_137.0 * math.cos(HOME.latitude)))


def simple(command: int, identity: int, *params: float | None, frame: int = 3) -> dict[str, Any]:
    return {
        "type": "SimpleItem", "command": command, "doJumpId": identity, "frame": frame, "autoContinue": True,
        "AMSLAltAboveTerrain": None, "Altitude": params[-1], "AltitudeMode": 1, "params": list(params),
    }  # fmt: skip


SURVEY = {
    "type": "ComplexItem",
    "complexItemType": "survey",
    "version": 5,
    "angle": 0,
    "polygon": [[38.99, -76.94], [38.991, -76.94], [38.991, -76.939]],
    "TransectStyleComplexItem": {
        "version": 1,
        "TurnAroundDistance": 10,
        "Items": [
            simple(16, 3, 0, 0, 0, None, NORTH_100, -76.94, 30),
            simple(206, 4, 25, 0, 1, 0, 0, 0, 0, frame=2),
            simple(16, 5, 0, 0, 0, None, NORTH_100, EAST_50, 30),
            simple(206, 6, 0, 0, 1, 0, 0, 0, 0, frame=2),
        ],
    },
}
LANDING = {
    "type": "ComplexItem",
    "complexItemType": "fwLandingPattern",
    "version": 2,
    "landingApproachCoordinate": [38.99, -76.94, 40],
    "landCoordinate": [NORTH_100, -76.94, 0],
    "loiterRadius": 25,
}
PLAN: dict[str, Any] = {
    "fileType": "Plan",
    "version": 1,
    "groundStation": "QGroundControl",
    "mission": {
        "version": 2,
        "firmwareType": 0,
        "vehicleType": 1,
        "cruiseSpeed": 8,
        "hoverSpeed": 5,
        "plannedHomePosition": [38.99, -76.94, 20],
        "items": [
            simple(22, 1, 15, 0, 0, None, 38.99, -76.94, 40),
            simple(18, 2, 2, 0, -30, 1, NORTH_100, EAST_50, 45),
            SURVEY,
            simple(177, 7, 3, 2, 0, 0, 0, 0, 0, frame=2),
            simple(16, 8, 0, 0, 0, None, NORTH_100, EAST_50, 75, frame=0),
            LANDING,
        ],
    },
    "geoFence": {
        "version": 2,
        "circles": [{"circle": {"center": [38.99, -76.94], "radius": 400}, "inclusion": True, "version": 1}],
        "polygons": [
            {"polygon": [[38.97, -76.96], [38.97, -76.92], [39.02, -76.92]], "inclusion": True, "version": 1},
            {"polygon": [[38.995, -76.95], [38.995, -76.949], [38.996, -76.95]], "inclusion": False, "version": 1},
        ],
    },
    "rallyPoints": {"version": 2, "points": [[NORTH_100, -76.94, 35]]},
}


def written(tmp_path: Path, plan: Any, name: str = "field.plan") -> Path:
    path = tmp_path / name
    path.write_text(plan if isinstance(plan, str) else json.dumps(plan))
    return path


def test_a_plan_is_flown_from_its_own_home(tmp_path: Path) -> None:
    plan = load_flight_plan(written(tmp_path, PLAN))
    kinds = [item.kind for item in plan.mission]
    assert kinds == [
        ItemKind.TAKEOFF, ItemKind.CIRCLE, ItemKind.WAYPOINT, ItemKind.SKIP, ItemKind.WAYPOINT, ItemKind.SKIP,
        ItemKind.JUMP, ItemKind.WAYPOINT, ItemKind.LAND_START, ItemKind.CIRCLE, ItemKind.LAND,
    ]  # fmt: skip
    circle = plan.mission[1]
    assert (circle.north, circle.east) == (pytest.approx(100.0, abs=1e-3), pytest.approx(50.0, abs=1e-3))
    assert (circle.turns, circle.radius, circle.altitude) == (2.0, -30.0, 45.0)
    assert plan.mission[7].altitude == pytest.approx(55.0)


@pytest.mark.parametrize(
    ("circling", "clockwise", "course"),
    [(True, True, math.asin(0.25)), (True, False, -math.asin(0.25)), (False, True, 0.0)],
)
def test_landing_pattern_is_flown_down_the_tangent_of_its_circle(
    circling: bool, clockwise: bool, course: float, tmp_path: Path
) -> None:
    """The course of a landing 100 m north of a circle of 25 m, as QGroundControl has it."""
    pattern = {**LANDING, "useLoiterToAlt": circling, "loiterClockwise": clockwise}
    plan = load_flight_plan(written(tmp_path, changed([*ITEMS, 5], pattern)))
    start, approach, landing = plan.mission[8:]
    assert start.kind is ItemKind.LAND_START and (approach.altitude, landing.kind) == (40.0, ItemKind.LAND)
    assert approach.radius == (25.0 if clockwise else -25.0) * circling
    assert landing.heading == pytest.approx(course, abs=1e-6)


def test_a_survey_is_its_legs_without_the_camera(tmp_path: Path) -> None:
    plan = load_flight_plan(written(tmp_path, PLAN))
    assert plan.notes == ("passed over in flight: DO_SET_CAM_TRIGG_DIST (206)",)
    ends = [(item.north, item.east, item.altitude) for item in plan.mission[2:5:2]]
    assert ends == [pytest.approx((100.0, 0.0, 30.0), abs=1e-3), pytest.approx((100.0, 50.0, 30.0), abs=1e-3)]


def test_a_jump_leads_to_the_item_of_that_name_wherever_it_stands(tmp_path: Path) -> None:
    jump = load_flight_plan(written(tmp_path, PLAN)).mission[6]
    assert (jump.jump_to, jump.repeats) == (2, 2)


def test_fence_and_rally_points_come_along(tmp_path: Path) -> None:
    plan = load_flight_plan(written(tmp_path, PLAN))
    first, second, circle = plan.fence.zones
    assert (first.keep_in, len(first.places), second.keep_in, circle.radius) == (1, 3, 0, 400.0)
    (rally,) = plan.rally
    assert rally == pytest.approx((100.0, 0.0, 35.0), abs=1e-3)


def changed(where: list[Any], value: Any) -> dict[str, Any]:
    plan = copy.deepcopy(PLAN)
    part: Any = plan
    for key in where[:-1]:
        part = part[key]
    part[where[-1]] = value
    return plan


ITEMS = ["mission", "items"]


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ("{", "not valid JSON"),
        ("[]", '"fileType": "Plan"'),
        (changed(["fileType"], "Mission"), '"fileType": "Plan"'),
        (changed(["mission"], None), "the plan: mission must be an object"),
        (changed(["mission", "plannedHomePosition"], [1, 2]), "plannedHomePosition must be a list of 3 numbers"),
        (changed(ITEMS, []), "no mission item to fly, only a fence and rally points; upload it with: wingbeat"),
        (changed(ITEMS, [simple(206, 4, 25, 0, 1, 0, 0, 0, 0, frame=2)]), "no mission item to fly, only a fence and"),
        ({**changed(ITEMS, []), "geoFence": {}, "rallyPoints": {}}, "the plan is empty"),
        (changed([*ITEMS, 0, "type"], "Thing"), "item 1: type must be SimpleItem or ComplexItem"),
        (changed([*ITEMS, 0, "command"], "up"), "item 1: command must be a whole number"),
        (changed([*ITEMS, 0, "params"], [1, 2]), "item 1: params must be a list of 7 numbers"),
        (changed([*ITEMS, 0, "params", 6], "high"), "item 1: params must be a number, not 'high'"),
        (changed([*ITEMS, 1, "command"], 84), "item 2: NAV_VTOL_TAKEOFF (84) is not flown"),
        (changed([*ITEMS, 1, "command"], 208), "item 2: DO_PARACHUTE (208) is not flown"),
        (changed([*ITEMS, 1, "params", 6], 4000), "item 2: CIRCLE: altitude = 4000 is outside 1 to 1000 m"),
        (changed([*ITEMS, 2], {"type": "ComplexItem", "complexItemType": "vtolLandingPattern"}),
         "item 3: a vtolLandingPattern cannot be flown"),
        (changed([*ITEMS, 2, "TransectStyleComplexItem", "Items", 0, "command"], 82),
         "item 3 (survey): NAV_SPLINE_WAYPOINT (82) is not flown"),
        (changed([*ITEMS, 3, "params", 0], 77), "item 4: DO_JUMP (177) leads to item 77, which is not flown"),
        (changed([*ITEMS, 4, "frame"], 12), "item 5: frame 12 is not supported"),
        (changed([*ITEMS, 5, "landCoordinate"], None), "item 6 (fwLandingPattern): landCoordinate must be a list"),
        (changed(["geoFence", "circles", 0, "circle", "radius"], -4), "fence or rally points"),
        (changed(["geoFence", "polygons", 1, "inclusion"], True), "fence, zone 2: home is outside of it"),
        (changed(["geoFence", "polygons", 0, "polygon", 0], [1]), "fence, polygon 1 must be a list of 2 numbers"),
        (changed(["rallyPoints", "points", 0], [1, 2]), "rally point 1 must be a list of 3 numbers"),
    ],
)  # fmt: skip
def test_a_plan_that_cannot_be_flown_is_refused_in_one_line(plan: Any, words: str, tmp_path: Path) -> None:
    path = written(tmp_path, plan)
    with pytest.raises(InputError) as refusal:
        load_flight_plan(path)
    assert words in str(refusal.value)
    assert str(path) in str(refusal.value) and "\n" not in str(refusal.value)


def test_hold_time_of_a_waypoint_is_kept(tmp_path: Path) -> None:
    held = load_flight_plan(written(tmp_path, changed([*ITEMS, 4, "params", 0], 12))).mission[7]
    assert (held.kind, held.duration) == (ItemKind.WAYPOINT, 12.0)
    assert encode_item(held, HOME).params[0] == 12.0


def test_old_plan_with_coordinates_beside_four_parameters(tmp_path: Path) -> None:
    """QGroundControl up to 3.1 wrote ``coordinate`` beside four ``params``."""
    plan = changed(ITEMS, PLAN["mission"]["items"][:2])
    old = copy.deepcopy(plan)
    for item in old["mission"]["items"]:
        item["params"], item["coordinate"] = item["params"][:4], item["params"][4:]
    assert load_flight_plan(written(tmp_path, old)) == load_flight_plan(written(tmp_path, plan, "new.plan"))


def test_fence_alone_is_uploaded_without_touching_the_mission(tmp_path: Path) -> None:
    path = written(tmp_path, changed(ITEMS, []))
    for autopilot in (0, 3, 12):
        upload = waypoints.read_upload(path, waypoints.convention_of(autopilot))
        assert upload.mission == () and len(upload.fence) == 7 and len(upload.rally) == 1


@pytest.mark.parametrize("decorate", [
    lambda text: "\ufeff" + text,
    lambda text: text.replace("\n", "\r\n"),
    lambda text: text.replace("\n", "   \n\n"),
    lambda text: "# drawn in an editor\n\n" + text.replace("\n", "\n  # a comment\n"),
])  # fmt: skip
def test_decorated_list_is_the_same_mission(tmp_path: Path, decorate: Any) -> None:
    plain = load_flight_plan(written(tmp_path, LIST, "plain.waypoints"))
    path = tmp_path / "decorated.waypoints"
    path.write_bytes(decorate(LIST).encode())
    assert load_flight_plan(path) == plain


# --- the ground's side ---------------------------------------------------------------------------------------


def test_upload_of_a_plan_is_the_same_for_every_vehicle(tmp_path: Path) -> None:
    path = written(tmp_path, PLAN)
    ours, theirs = (
        waypoints.read_upload(path, waypoints.convention_of(0)),
        waypoints.read_upload(path, waypoints.convention_of(12)),
    )
    assert ours[:3] == theirs[:3] and len(ours.mission) == 11
    assert ours.notes == ("passed over in flight: DO_SET_CAM_TRIGG_DIST (206)",) and theirs.notes == ()
    assert [item.command for item in theirs.mission].count(206) == 2
    assert ours.mission[6].parameters[0] == 2.0, "the jump leads to the survey's first waypoint"
    assert [item.command for item in ours.fence] == [5001] * 3 + [5002] * 3 + [5003]
    assert [item.command for item in ours.rally] == [5100]
    assert ours.mission[1].x == round(NORTH_100 * 1e7)


OUR_MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    MissionItem(ItemKind.WAYPOINT, 100.0, 50.0, 40.0),
    MissionItem(ItemKind.CIRCLE, 100.0, 50.0, 60.0, radius=-30.0, turns=2.0),
    MissionItem(ItemKind.JUMP, jump_to=1, repeats=3),
    MissionItem(ItemKind.RETURN),
)


def test_a_mission_written_as_a_plan_is_read_again(tmp_path: Path) -> None:
    items = tuple(waypoints.item_of(encode_item(item, HOME)) for item in OUR_MISSION)
    with_fence = waypoints.read_upload(written(tmp_path, PLAN), waypoints.convention_of(0))._replace(mission=items)
    path = tmp_path / "again.plan"
    waypoints.write_plan(path, with_fence, HOME)
    plan = load_flight_plan(path)
    for flown, item in zip(plan.mission, OUR_MISSION, strict=True):
        assert flown.kind == item.kind
        assert flown[1:4] == pytest.approx(item[1:4], abs=0.02)
        assert flown[7:] == item[7:]
    assert plan.rally[0] == pytest.approx((100.0, 0.0, 35.0), abs=0.02)
    assert [len(zone.places) for zone in plan.fence.zones] == [3, 3, 1]
    with pytest.raises(InputError, match="cannot write"):
        waypoints.write_plan(path, with_fence, HOME)


def test_the_plan_written_is_qgroundcontrols_document() -> None:
    file = plan_file.PlanFile(HOME, (plan_file.PlannedItem(encode_item(OUR_MISSION[1], HOME), "item 1", 1),))
    document = plan_file.document(file)
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    (item,) = document["mission"]["items"]
    assert (item["type"], item["frame"], item["command"], item["params"][3]) == ("SimpleItem", 3, 16, None)
    assert document["mission"]["plannedHomePosition"] == pytest.approx([38.99, -76.94, 20.0])


# --- plain lists ------------------------------------------------------------------------------------------------

LIST = f"""QGC WPL 110
0 1 0 16 0 0 0 0 38.99 -76.94 20 1
1 0 3 22 15 0 0 0 0 0 40 1
2 0 3 16 0 0 0 0 {NORTH_100} {EAST_50} 40 1
3 0 3 19 30 0 25 1 {NORTH_100} {EAST_50} 40 1
4 0 2 177 2 1 0 0 0 0 0 1
5 0 2 20 0 0 0 0 0 0 0 1
"""


def test_a_list_is_flown_from_its_first_line(tmp_path: Path) -> None:
    plan = load_flight_plan(written(tmp_path, LIST, "field.waypoints"))
    kinds = [item.kind for item in plan.mission]
    assert kinds == [ItemKind.TAKEOFF, ItemKind.WAYPOINT, ItemKind.CIRCLE, ItemKind.JUMP, ItemKind.RETURN]
    assert plan.mission[1][1:3] == pytest.approx((100.0, 50.0), abs=1e-3)
    assert (plan.mission[2].duration, plan.mission[2].radius, plan.mission[3].jump_to) == (30.0, 25.0, 1)


def test_a_list_without_home_cannot_be_placed(tmp_path: Path) -> None:
    lines = LIST.splitlines()
    with pytest.raises(InputError, match="first line must be home"):
        load_flight_plan(written(tmp_path, "\n".join([lines[0], *lines[2:]]), "field.waypoints"))


@pytest.mark.parametrize(("altitude", "climbs"), [(40, True), (2, False)])
def test_list_that_never_climbs_is_refused(altitude: int, climbs: bool, tmp_path: Path) -> None:
    lines = [*LIST.splitlines()[:2], f"1 0 3 16 0 0 0 0 {NORTH_100} {EAST_50} {altitude} 1"]
    lines.append(f"2 0 3 21 0 0 0 0 {NORTH_100} {EAST_50} 0 1")
    path = written(tmp_path, "\n".join(lines), "low.waypoints")
    if climbs:
        assert load_flight_plan(path).mission[0].altitude == altitude
        return
    with pytest.raises(InputError, match="no item climbs above 2 m before a landing"):
        load_flight_plan(path)


def test_places_on_the_globe_need_home_in_every_frame(tmp_path: Path) -> None:
    lines = [line.replace("2\t0\t3\t", "2\t0\t10\t") for line in LIST.splitlines()]
    with pytest.raises(InputError, match="first line must be home"):
        load_flight_plan(written(tmp_path, "\n".join([lines[0], *lines[2:]]), "terrain.waypoints"))


def test_a_list_names_the_item_that_is_not_flown(tmp_path: Path) -> None:
    text = LIST.replace("5 0 2 20", "5 0 2 208")
    with pytest.raises(InputError, match=r"item 5: DO_PARACHUTE \(208\) is not flown"):
        load_flight_plan(written(tmp_path, text, "field.waypoints"))


def test_home_is_not_sent_to_our_vehicle(tmp_path: Path) -> None:
    path = written(tmp_path, LIST, "field.waypoints")
    ours = waypoints.read_upload(path, waypoints.convention_of(0))
    assert [item.command for item in ours.mission] == [22, 16, 19, 177, 20]
    assert ours.notes == ("the first line of field.waypoints is home and is not sent",)
    assert ours.mission[3].parameters[0] == 1.0
    assert len(waypoints.read(path)) == 6


def test_wire_units_go_there_and_back() -> None:
    item = Item(1, 16, (0.0, 0.0, 0.0, 0.0), 1_600_001, -605_000, -40.0)
    assert waypoints.item_of(waypoints.wire_item(item)) == item
