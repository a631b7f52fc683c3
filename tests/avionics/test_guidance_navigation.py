"""Navigation: the geometry of legs and circles, and what each kind of item asks for and when it is done."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from surrogate_gains import VEHICLE

from avionics.guidance import navigation, path
from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.guidance.navigation import Situation
from avionics.limits import wrap
from avionics.messages import Mode, Stage

GAINS = VEHICLE.gains.navigation
SEEN = Situation(
    mode=Mode.AUTO,
    stage=Stage.EN_ROUTE,
    north=0.0,
    east=0.0,
    valid=1,
    heading=0.5,
    altitude=40.0,
    stick_pitch=0.0,
    excitations=0,
)
AUTO = navigation.State(mode=Mode.AUTO)
DT = 0.05
places = st.tuples(st.floats(-500, 500), st.floats(-500, 500))


def separation(a, b):
    return math.hypot(a[0] - b[0], a[1] - b[1]) > 1.0


@given(start=places, end=places, along=st.floats(-1, 2), cross=st.floats(-200, 200))
def test_a_leg_tells_how_far_along_and_how_far_to_the_right(start, end, along, cross) -> None:
    if not separation(start, end):
        return
    length = math.dist(start, end)
    n, e = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    place = (start[0] + n * along * length - e * cross, start[1] + e * along * length + n * cross)
    line = path.leg(start, end, place)
    assert line.length == pytest.approx(length)
    assert line.along == pytest.approx(along * length, abs=1e-6)
    assert line.cross == pytest.approx(cross, abs=1e-6)


@given(start=places, end=places, place=places)
def test_the_course_leads_toward_the_leg_and_never_backward(start, end, place) -> None:
    if not separation(start, end):
        return
    line = path.leg(start, end, place)
    turn = wrap(path.course_to_leg(line, GAINS.lookahead) - line.course)
    assert abs(turn) < math.pi / 2
    assert turn * line.cross <= 1e-9


@given(start=places, end=places, cross=st.floats(-400, 400))
def test_passing_abeam_counts_as_reached_however_far_aside(start, end, cross) -> None:
    if not separation(start, end):
        return
    length = math.dist(start, end)
    n, e = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    beyond = (end[0] + 0.1 * n - cross * e, end[1] + 0.1 * e + cross * n)
    assert path.reached(path.leg(start, end, beyond), GAINS.acceptance)


@given(place=places, sign=st.sampled_from([-1.0, 1.0]))
def test_following_the_course_ends_on_the_leg(place, sign) -> None:
    start, end = (0.0, 0.0), (5000.0 * sign, 1000.0)
    north, east = place
    for _ in range(400):
        course = path.course_to_leg(path.leg(start, end, (north, east)), GAINS.lookahead)
        north, east = north + 2.0 * math.cos(course), east + 2.0 * math.sin(course)
    assert abs(path.leg(start, end, (north, east)).cross) < 2.0


@given(bearing=st.floats(-3.1, 3.1), distance=st.floats(2.0, 200.0))
def test_following_the_circle_course_ends_on_the_circle_clockwise(bearing: float, distance: float) -> None:
    north, east = distance * math.cos(bearing), distance * math.sin(bearing)
    for _ in range(500):
        course = path.circle_course(25.0, GAINS.lookahead, north, east)
        before = math.atan2(east, north)
        north, east = north + math.cos(course), east + math.sin(course)
    assert math.hypot(north, east) == pytest.approx(25.0, abs=1.0)
    assert wrap(math.atan2(east, north) - before) > 0.0


def fly(mission, observed: Situation, state: navigation.State = AUTO, seconds: float = DT):
    for _ in range(max(1, round(seconds / DT))):
        state, target = navigation.step(GAINS, state, DT, mission, observed)
    return state, target


TAKEOFF = MissionItem(ItemKind.TAKEOFF, altitude=40.0)
HOLD = MissionItem(ItemKind.HOLD, altitude=30.0, heading=1.0, duration=5.0)


def test_takeoff_keeps_the_heading_of_the_launch() -> None:
    waiting = SEEN._replace(stage=Stage.WAIT_LAUNCH, altitude=1.0)
    state, _ = fly((TAKEOFF,), waiting._replace(heading=-1.0))
    state, _ = fly((TAKEOFF,), waiting._replace(heading=0.7), state)
    state, target = fly((TAKEOFF,), SEEN._replace(stage=Stage.CLIMB_OUT, altitude=5.0, heading=0.2), state)
    assert (target.heading, target.altitude, target.stage) == (0.7, 40.0, Stage.CLIMB_OUT)
    assert state.item == 0


def test_takeoff_is_over_within_the_capture_of_its_altitude_but_not_on_the_hand() -> None:
    state, _ = fly((TAKEOFF, HOLD), SEEN._replace(altitude=39.5))
    assert state.item == 1
    state, _ = fly((TAKEOFF, HOLD), SEEN._replace(altitude=39.5, stage=Stage.WAIT_LAUNCH))
    assert state.item == 0


def test_the_time_of_a_hold_begins_with_its_capture() -> None:
    away, there = SEEN._replace(altitude=38.0, heading=1.0), SEEN._replace(altitude=30.2, heading=1.05)
    state, target = fly((HOLD,), away, seconds=6.0)
    assert (state.item, target.altitude, target.heading) == (0, 30.0, 1.0)
    state, _ = fly((HOLD,), there, state, seconds=4.8)
    assert state.item == 0
    state, _ = fly((HOLD,), there, state, seconds=0.4)
    assert state.item == 1


def test_a_hold_that_cannot_be_captured_ends_anyway() -> None:
    state, _ = fly((HOLD,), SEEN._replace(altitude=50.0), seconds=GAINS.capture_limit + 5.5)
    assert state.item == 1


def test_waypoints_are_flown_leg_by_leg() -> None:
    mission = (
        MissionItem(ItemKind.WAYPOINT, 100.0, 0.0, 35.0),
        MissionItem(ItemKind.WAYPOINT, 100.0, 100.0, 30.0),
    )
    state, target = fly(mission, SEEN)
    assert (target.heading, target.altitude) == (pytest.approx(0.0), 35.0)
    state, target = fly(mission, SEEN._replace(north=50.0, east=5.0), state)
    assert target.heading < 0.0
    assert target.cross_track == pytest.approx(5.0)
    state, _ = fly(mission, SEEN._replace(north=93.0), state)
    state, target = fly(mission, SEEN._replace(north=98.0), state)
    assert state.item == 1
    # The leg begins at the waypoint, 2 m to the left of where the corner was cut.
    assert target.cross_track == pytest.approx(2.0)
    assert target.heading == pytest.approx(math.pi / 2 - math.atan2(2.0, GAINS.lookahead))


def test_without_a_position_a_waypoint_holds_the_course() -> None:
    mission = (MissionItem(ItemKind.WAYPOINT, 100.0, 0.0, 35.0),)
    state, before = fly(mission, SEEN._replace(north=20.0, east=3.0))
    state, blind = fly(mission, SEEN._replace(north=999.0, valid=0), state)
    assert blind.heading == before.heading
    assert state.item == 0


EXCITE = MissionItem(ItemKind.EXCITE, excitation=Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.1, 0.2, 0.5, 2))


def test_an_excitation_keeps_the_setpoints_of_the_item_before() -> None:
    captured = SEEN._replace(altitude=30.4, heading=1.1)
    state, _ = fly((HOLD, EXCITE), captured, seconds=5.1)
    state, target = fly((HOLD, EXCITE), captured, state)
    assert (target.altitude, target.heading, target.excitation) == (30.0, 1.0, EXCITE.excitation)
    state, target = fly((HOLD, EXCITE), captured._replace(excitations=1), state)
    assert (state.item, target.excitation) == (2, None)


def test_after_the_last_item_it_goes_home_circles_and_lands() -> None:
    state, target = fly((TAKEOFF,), SEEN._replace(north=300.0))
    state, target = fly((TAKEOFF,), SEEN._replace(north=300.0), state)
    assert (state.item, target.altitude) == (1, GAINS.return_altitude)
    assert abs(target.heading) == pytest.approx(math.pi, abs=1e-6)
    state, target = fly((TAKEOFF,), SEEN._replace(north=20.0), state, GAINS.loiter_time + 0.2)
    assert target.stage == Stage.APPROACH


LAND = MissionItem(ItemKind.LAND, north=200.0, east=0.0, heading=0.0)
END = LAND.north - GAINS.flare_reach
"""m; north of the end of its line down in still air"""
HEAD = SEEN._replace(north=END - GAINS.approach_length, heading=0.0)


def test_landing_flies_to_the_head_of_the_line_first() -> None:
    _, target = fly((LAND,), SEEN._replace(north=HEAD.north - 50.0, east=-80.0))
    assert (target.stage, target.altitude) == (Stage.APPROACH, GAINS.approach_altitude)
    assert 0.0 < target.heading < math.pi / 2


def test_a_landing_that_comes_in_high_circles_down_before_the_line() -> None:
    state, _ = fly((LAND,), HEAD._replace(north=HEAD.north - 50.0))
    state, _ = fly((LAND,), HEAD._replace(altitude=90.0), state)
    state, target = fly((LAND,), HEAD._replace(altitude=90.0, north=HEAD.north + 5.0), state)
    assert (state.final, target.altitude) == (0, GAINS.approach_altitude)
    assert target.heading > 0.0
    state, _ = fly((LAND,), HEAD._replace(altitude=GAINS.approach_altitude), state)
    assert state.final == 1


def on_the_line(remaining: float, cross: float = 0.0, turn: float = 0.0, above: float = 0.0) -> Situation:
    """``remaining`` m before the end of the line, ``above`` m above and ``cross`` m right of it, ``turn`` rad off."""
    altitude = GAINS.approach_altitude * remaining / GAINS.approach_length + above
    return SEEN._replace(north=END - remaining, east=cross, heading=turn, altitude=altitude)


@pytest.mark.parametrize("cross", [-12.0, 0.0, 12.0])
@pytest.mark.parametrize("remaining", [60.0, 100.0, GAINS.approach_length])
def test_a_landing_joins_the_line_where_it_meets_it(remaining: float, cross: float) -> None:
    state, _ = fly((LAND,), on_the_line(remaining, cross, turn=0.3, above=2.0))
    assert state.final == 1
    _, target = fly((LAND,), on_the_line(remaining, cross, turn=0.3, above=2.0), state)
    assert target.altitude == pytest.approx(GAINS.approach_altitude * remaining / GAINS.approach_length)
    assert target.heading * cross <= 0.0


@pytest.mark.parametrize(
    "observed",
    [
        on_the_line(-5.0),
        on_the_line(60.0, cross=20.0),
        on_the_line(60.0, turn=0.7),
        on_the_line(60.0, turn=math.pi),
        on_the_line(GAINS.approach_length + 30.0),
    ],
    ids=["past the place", "beside the funnel", "turned away", "coming back", "before the head"],
)
def test_a_landing_from_outside_the_funnel_flies_to_the_head(observed: Situation) -> None:
    state, target = fly((LAND,), observed)
    assert (state.final, state.arrived) == (0, 0)
    assert target.altitude == GAINS.approach_altitude


def test_a_landing_that_meets_the_line_from_too_high_circles_at_once() -> None:
    state, target = fly((LAND,), on_the_line(60.0, above=GAINS.approach_margin + 1.0))
    assert (state.final, state.arrived, target.altitude) == (0, 1, GAINS.approach_altitude)
    state, _ = fly((LAND,), HEAD._replace(altitude=GAINS.approach_altitude), state)
    assert state.final == 1


def test_the_line_descends_with_the_way_to_go_and_then_flares_for_good() -> None:
    low = HEAD._replace(altitude=GAINS.approach_altitude)
    state, _ = fly((LAND,), low)
    half = low._replace(north=END - 0.5 * GAINS.approach_length, east=4.0, altitude=10.0)
    state, target = fly((LAND,), half, state)
    assert target.altitude == pytest.approx(0.5 * GAINS.approach_altitude)
    assert (target.cross_track, target.heading < 0.0) == (pytest.approx(4.0), True)
    state, target = fly((LAND,), half._replace(altitude=GAINS.flare_altitude), state)
    assert target.stage == Stage.FLARE
    state, target = fly((LAND,), half._replace(altitude=GAINS.flare_altitude + 2.0), state)
    assert target.stage == Stage.FLARE


def test_landing_without_a_position_goes_straight_down() -> None:
    blind = SEEN._replace(valid=0, heading=0.8)
    state, _ = fly((LAND,), blind)
    _, target = fly((LAND,), blind, state)
    assert target.altitude < 0.0


def test_the_mode_land_descends_on_the_present_course_at_the_usual_angle() -> None:
    here = SEEN._replace(mode=Mode.LAND, north=10.0, altitude=GAINS.approach_altitude, heading=0.0)
    _, target = fly((), here, navigation.State(mode=Mode.ALTITUDE_HOLD))
    assert target.altitude == pytest.approx(GAINS.approach_altitude)
    assert target.distance == pytest.approx(GAINS.approach_length)
    assert (target.heading, target.stage) == (0.0, Stage.APPROACH)


def test_altitude_hold_takes_the_present_altitude_and_the_stick_moves_it() -> None:
    hold = SEEN._replace(mode=Mode.ALTITUDE_HOLD, altitude=33.0)
    state, target = fly((), hold)
    assert target.altitude == 33.0
    state, target = fly((), hold._replace(stick_pitch=1.0, altitude=50.0), state, 2.0)
    assert target.altitude == pytest.approx(33.0 + 2.0 * GAINS.stick_climb)
    _, target = fly((), hold._replace(stick_pitch=0.5 * GAINS.stick_dead_band), state, 2.0)
    assert target.altitude == pytest.approx(33.0 + 2.0 * GAINS.stick_climb)


def test_an_excitation_over_the_link_is_flown_between_the_items() -> None:
    mission = (MissionItem(ItemKind.WAYPOINT, 500.0, 0.0, 35.0),)
    state, _ = fly(mission, SEEN)
    state = navigation.excite(state, EXCITE.excitation, SEEN)
    state, target = fly(mission, SEEN, state)
    assert (target.excitation, target.altitude) == (EXCITE.excitation, 40.0)
    state, _ = fly(mission, SEEN._replace(excitations=1), state)
    state, target = fly(mission, SEEN._replace(excitations=1), state)
    assert (state.extra, target.excitation, target.altitude) == (None, None, 35.0)
