"""How far it is to a fence, and what the modes make of it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from surrogate import Bird
from surrogate_gains import VEHICLE
from test_guidance_modes import CRUISE, FLYING, run

from avionics import topics
from avionics.autopilot import Autopilot
from avionics.guidance import fence, modes
from avionics.guidance.mission import Fence, ItemKind, MissionItem, Zone
from avionics.messages import Breach, Command, CommandKind, Failsafe, Mode, Stage
from avionics.missions import load_mission

GAINS = VEHICLE.gains.modes
SQUARE = Zone(1, ((-100.0, -100.0), (-100.0, 100.0), (100.0, 100.0), (100.0, -100.0)))
BITTEN = Zone(1, ((-100.0, -100.0), (-100.0, 100.0), (100.0, 100.0), (0.0, 0.0), (100.0, -100.0)))
"""a square with a wedge cut out of its north side down to its middle"""
places = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@given(place=places)
def test_the_depth_in_a_square_is_the_way_to_its_nearest_side(place: tuple[float, float]) -> None:
    north, east = abs(place[0]), abs(place[1])
    inside = min(100.0 - north, 100.0 - east)
    beyond = math.hypot(max(north - 100.0, 0.0), max(east - 100.0, 0.0))
    assert fence.depth(SQUARE, place) == pytest.approx(inside if inside > 0.0 else -beyond, abs=1e-9)


@given(place=places, centre=places, radius=st.floats(10, 300))
def test_the_depth_in_a_circle_is_its_radius_less_the_distance(place, centre, radius) -> None:
    assert fence.depth(Zone(1, (centre,), radius), place) == pytest.approx(radius - math.dist(place, centre))


def test_a_concave_corner_is_outside() -> None:
    assert fence.depth(BITTEN, (50.0, 0.0)) == pytest.approx(-50.0 / math.sqrt(2.0))
    assert fence.depth(BITTEN, (-20.0, 0.0)) == pytest.approx(20.0)


@given(place=places, shift=places, turn=st.floats(0, math.tau))
def test_a_fence_that_moves_and_turns_with_the_place_is_as_far_away(place, shift, turn) -> None:
    c, s = math.cos(turn), math.sin(turn)

    def moved(point: tuple[float, float]) -> tuple[float, float]:
        return point[0] * c - point[1] * s + shift[0], point[0] * s + point[1] * c + shift[1]

    there = fence.depth(Zone(1, tuple(moved(corner) for corner in BITTEN.places)), moved(place))
    here = fence.depth(BITTEN, place)
    assert abs(there) == pytest.approx(abs(here), abs=1e-6)
    assert there == pytest.approx(here, abs=1e-6) or abs(here) < 1e-6


@pytest.mark.parametrize(
    ("item", "reason"),
    [
        (MissionItem(ItemKind.WAYPOINT, 90.0, 90.0, 20.0), ""),
        (MissionItem(ItemKind.WAYPOINT, 110.0, 0.0, 20.0), "outside the fence"),
        (MissionItem(ItemKind.LOITER, 60.0, 0.0, 20.0), "outside the fence"),
        (MissionItem(ItemKind.LAND, 60.0, 0.0), "outside the fence"),
        (MissionItem(ItemKind.WAYPOINT, 110.0, 0.0, 20.0, here=1), ""),
        (MissionItem(ItemKind.TAKEOFF, altitude=51.0), "above the fence's ceiling of 50 m"),
        (MissionItem(ItemKind.CIRCLE, 0.0, 0.0, 9.0), "below the fence's floor of 10 m"),
        (MissionItem(ItemKind.LAND, 0.0, 0.0), ""),
    ],
)
def test_mission_item_outside_the_fence_is_named(item: MissionItem, reason: str) -> None:
    border = Fence((SQUARE, Zone(0, ((60.0, 0.0),), 20.0)), 10.0, 50.0)
    expected = f"mission item 1 is {reason}" if reason else ""
    assert fence.mission_breach(border, (MissionItem(ItemKind.TAKEOFF, altitude=20.0), item)) == expected


def test_mission_outside_its_fence_denies_auto_and_arming() -> None:
    """GIVEN a waypoint beyond the plan's fence THEN a warning names it, and AUTO and arming in AUTO are denied."""
    said: list[str] = []
    events = lambda topic, message: said.append(message.text) if topic is topics.EVENTS else None  # noqa: E731
    autopilot, bird = Autopilot(VEHICLE, load_mission("circuit"), events), Bird()
    mission = (MissionItem(ItemKind.TAKEOFF, altitude=20.0), MissionItem(ItemKind.WAYPOINT, 150.0, 0.0, 20.0))

    def step(*commands: Command, ticks: int = 1) -> Autopilot:
        for tick in range(ticks):
            bird.advance(autopilot.step(bird.frame(), commands if tick == 0 else ()))
        return autopilot

    auto, arm = Command(0, CommandKind.SET_MODE, "AUTO"), Command(0, CommandKind.ARM)
    step(Command(0, CommandKind.SET_MISSION, payload=mission), auto, ticks=600)
    step(Command(0, CommandKind.SET_FENCE, payload=Fence((SQUARE,))))
    assert said[-1] == "mission item 1 is outside the fence: AUTO will be denied"
    assert not step(arm).state.modes.armed and "arming denied: mission item 1 is outside the fence" in said
    step(Command(0, CommandKind.SET_MODE, "MANUAL"), auto)
    assert autopilot.state.modes.mode == Mode.MANUAL and said[-1].startswith("mode AUTO denied: mission item 1")
    step(Command(0, CommandKind.SET_FENCE, payload=Fence()), auto, arm)
    assert autopilot.state.modes.armed and autopilot.state.modes.mode == Mode.AUTO


def test_the_nearest_border_of_all_zones_counts() -> None:
    tower = Zone(0, ((60.0, 0.0),), 20.0)
    both = Fence((SQUARE, tower))
    assert fence.clearance(Fence(), 1e6, 0.0) == math.inf
    assert fence.clearance(both, 0.0, 0.0) == pytest.approx(40.0)
    assert fence.clearance(both, 0.0, 95.0) == pytest.approx(5.0)
    assert fence.clearance(both, 50.0, 0.0) == pytest.approx(-10.0)


# --- the modes ------------------------------------------------------------------------------------------


def test_close_to_the_fence_is_said_and_outside_returns() -> None:
    near = CRUISE._replace(fence_clearance=GAINS.fence_margin - 1.0)
    state, said = run(FLYING, near, 0.1)
    assert (state.mode, state.failsafe) == (Mode.AUTO, Failsafe.FENCE_NEAR)
    assert [notice.text for notice in said] == ["failsafe: near the fence"]
    state, said = run(state, CRUISE._replace(fence_clearance=-1.0), 0.1)
    # What was close stays told for its time to clear.
    assert (state.mode, state.failsafe) == (Mode.RETURN, Failsafe.FENCE | Failsafe.FENCE_NEAR)
    assert "failsafe: returning, outside the fence" in [notice.text for notice in said]


def test_the_lower_of_both_ceilings_holds() -> None:
    state, _ = run(FLYING, CRUISE._replace(altitude=61.0, fence_ceiling=60.0), 0.1)
    assert state.mode == Mode.RETURN
    state, _ = run(FLYING, CRUISE._replace(altitude=GAINS.fence_altitude + 1.0, fence_ceiling=1000.0), 0.1)
    assert state.mode == Mode.RETURN


LOW = CRUISE._replace(altitude=10.0, fence_floor=20.0)
HIGH = LOW._replace(altitude=20.0 + GAINS.fence_margin + 1.0)


def test_the_floor_holds_once_it_was_passed_and_not_on_an_approach() -> None:
    state, _ = run(FLYING, LOW, 1.0)
    assert state.mode == Mode.AUTO
    state, _ = run(state, HIGH, 1.0)
    fallen, _ = run(state, LOW, 0.1)
    assert (fallen.mode, fallen.failsafe) == (Mode.RETURN, Failsafe.FENCE)
    landing, _ = run(state._replace(stage=Stage.APPROACH), LOW._replace(requested_stage=Stage.APPROACH), 1.0)
    assert (landing.mode, landing.failsafe) == (Mode.AUTO, 0)


@pytest.mark.parametrize(
    ("observed", "kind"),
    [
        (CRUISE, Breach.NONE),
        (CRUISE._replace(fence_clearance=-1.0), Breach.BORDER),
        (CRUISE._replace(home_distance=GAINS.fence_radius + 5.0, fence_clearance=-1.0), Breach.BORDER),
        (CRUISE._replace(altitude=61.0, fence_ceiling=60.0, fence_clearance=-0.5), Breach.CEILING),
        (LOW, Breach.FLOOR),
    ],
)
def test_what_is_passed_furthest_is_told(observed: modes.Conditions, kind: Breach) -> None:
    assert fence.breach(GAINS, FLYING._replace(above_floor=1), observed) == kind
    assert fence.breach(GAINS, FLYING._replace(stage=Stage.ON_GROUND), observed) == Breach.NONE


def test_on_the_ground_there_is_no_fence() -> None:
    state, said = run(FLYING._replace(stage=Stage.ON_GROUND, armed=0), CRUISE._replace(fence_clearance=-50.0), 1.0)
    assert (state.failsafe, said) == (0, [])
