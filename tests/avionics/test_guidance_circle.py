"""Circles, LOITER, jumps, the way home: what the navigation asks for, and flown by a point that obeys it."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from surrogate_gains import VEHICLE

from avionics.guidance import navigation, path
from avionics.guidance.approach import LONGEST, SHORTEST, slope_length
from avionics.guidance.mission import ItemKind, MissionItem, RallyPoint
from avionics.guidance.navigation import Situation
from avionics.guidance.route import lookahead, turning_distance
from avionics.limits import wrap
from avionics.messages import Mode, Stage

GAINS = VEHICLE.gains.navigation
DT = 0.05
SPEED = 7.5
SEEN = Situation(
    mode=Mode.AUTO, stage=Stage.EN_ROUTE, north=0.0, east=0.0, valid=1, heading=0.5, altitude=40.0, stick_pitch=0.0,
    excitations=0, airspeed=SPEED, ground_speed=SPEED,
)  # fmt: skip


class Point:
    """Flies the course asked for, turning no faster than a bank of half a radian."""

    def __init__(self, mission=(), observed: Situation = SEEN) -> None:
        self.mission, self.observed = mission, observed
        self.state = navigation.State(mode=Mode.AUTO)
        self.track: list[tuple[float, float]] = []

    def fly(self, seconds: float, climb: float = 1.0) -> "Point":
        for _ in range(round(seconds / DT)):
            self.state, self.target = navigation.step(GAINS, self.state, DT, self.mission, self.observed)
            observed, most = self.observed, 9.81 * math.tan(0.5) / SPEED * DT
            turn = min(max(wrap(self.target.heading - observed.heading), -most), most)
            up = min(max(self.target.altitude - observed.altitude, -climb * DT), climb * DT)
            heading = wrap(observed.heading + turn)
            self.observed = observed._replace(
                north=observed.north + SPEED * DT * math.cos(heading),
                east=observed.east + SPEED * DT * math.sin(heading),
                heading=heading,
                altitude=observed.altitude + up,
            )
            self.track.append((self.observed.north, self.observed.east))
        return self

    def distances(self, place: tuple[float, float], since: int = 0) -> list[float]:
        return [math.dist(place, each) for each in self.track[since:]]


def circle(radius: float = 30.0, **values: float) -> MissionItem:
    return MissionItem(ItemKind.CIRCLE, 60.0, 40.0, 40.0, radius=radius, **values)


WAY_ON = MissionItem(ItemKind.WAYPOINT, 1e4, 0.0, 40.0)


@given(bearing=st.floats(-3.1, 3.1), distance=st.floats(2.0, 200.0), sign=st.sampled_from([-1.0, 1.0]))
def test_following_the_circle_course_ends_on_the_circle_in_its_direction(bearing, distance, sign) -> None:
    north, east = distance * math.cos(bearing), distance * math.sin(bearing)
    for _ in range(500):
        course = path.circle_course(sign * 25.0, GAINS.lookahead, north, east)
        before = math.atan2(east, north)
        north, east = north + math.cos(course), east + math.sin(course)
    assert math.hypot(north, east) == pytest.approx(25.0, abs=1.0)
    assert wrap(math.atan2(east, north) - before) * sign > 0.0


@pytest.mark.parametrize("radius", [30.0, -30.0])
@pytest.mark.parametrize("turns", [1.0, 2.5])
def test_a_circle_is_flown_for_its_turns(radius: float, turns: float) -> None:
    bird = Point((circle(radius, turns=turns), WAY_ON))
    while bird.state.item == 0 and len(bird.track) < 10_000:
        bird.fly(DT)
    joined = next(i for i, away in enumerate(bird.distances((60.0, 40.0))) if abs(away - 30.0) < 3.0)
    bearings = [math.atan2(east - 40.0, north - 60.0) for north, east in bird.track[joined:]]
    swept = sum(wrap(b - a) for a, b in pairwise(bearings))
    assert swept == pytest.approx(math.copysign(math.tau * turns, radius), abs=0.7)
    assert max(abs(away - 30.0) for away in bird.distances((60.0, 40.0), joined + 100)) < 2.0


def test_a_circle_is_flown_for_its_time_from_where_it_is_joined() -> None:
    bird = Point((circle(duration=20.0), WAY_ON))
    while bird.state.item == 0 and len(bird.track) < 10_000:
        bird.fly(DT)
    reached = min(range(len(bird.track)), key=lambda i: abs(bird.distances((60.0, 40.0))[i] - 42.0))
    assert (len(bird.track) - reached) * DT == pytest.approx(20.0, abs=1.0)


def test_a_waypoint_is_circled_for_its_hold_time() -> None:
    bird = Point((MissionItem(ItemKind.WAYPOINT, 60.0, 40.0, 40.0, duration=20.0), WAY_ON))
    while bird.state.item == 0 and len(bird.track) < 10_000:
        bird.fly(DT)
    held = bird.distances((60.0, 40.0))[-round(19.0 / DT) :]
    assert all(abs(away - abs(GAINS.loiter_radius)) < 0.5 * abs(GAINS.loiter_radius) for away in held)
    assert 20.0 <= len(bird.track) * DT < 60.0
    assert bird.state.item == 1


def test_a_circle_without_turns_or_time_ends_at_its_altitude() -> None:
    bird = Point((circle()._replace(altitude=70.0), WAY_ON)).fly(20.0, climb=1.0)
    assert bird.state.item == 0
    while bird.state.item == 0 and len(bird.track) < 10_000:
        bird.fly(DT, climb=1.0)
    assert bird.observed.altitude == pytest.approx(70.0 - GAINS.capture_altitude, abs=0.1)


def test_a_loiter_item_has_no_end_and_names_no_radius() -> None:
    bird = Point((MissionItem(ItemKind.LOITER, 60.0, 40.0, 40.0), WAY_ON)).fly(300.0)
    assert bird.state.item == 0
    assert bird.distances((60.0, 40.0))[-1] == pytest.approx(GAINS.loiter_radius, abs=2.0)


def test_the_bank_of_a_circle_is_known_on_it_and_not_far_from_it() -> None:
    bird = Point((circle(-30.0, duration=1000.0),), SEEN._replace(north=-200.0)).fly(DT)
    assert bird.target.curvature == 0.0
    bird.fly(60.0)
    assert bird.target.curvature == pytest.approx(-1.0 / 30.0, rel=0.1)


def test_the_mode_loiter_circles_here_at_this_altitude() -> None:
    bird = Point((), SEEN._replace(mode=Mode.LOITER, altitude=33.0, heading=0.0)).fly(60.0)
    assert bird.observed.altitude == pytest.approx(33.0, abs=0.1)
    beside = (0.0, GAINS.loiter_radius)
    assert max(abs(away - GAINS.loiter_radius) for away in bird.distances(beside)) < 2.0
    assert bird.target.stage == Stage.EN_ROUTE


def test_without_a_position_the_mode_loiter_keeps_turning() -> None:
    blind = SEEN._replace(mode=Mode.LOITER, valid=0, heading=2.9)
    _, target = navigation.step(GAINS, navigation.State(), DT, (), blind)
    assert 0.2 < wrap(target.heading - blind.heading) < 0.8
    assert target.altitude == 40.0


def test_a_place_to_circle_can_be_given_from_the_ground() -> None:
    bird = Point((), SEEN._replace(mode=Mode.LOITER)).fly(1.0)
    wanted = MissionItem(ItemKind.LOITER, 150.0, -50.0, 60.0, radius=-40.0)
    bird.state = navigation.loiter_at(GAINS, bird.state, wanted, bird.observed)
    bird.fly(80.0)
    assert bird.distances((150.0, -50.0))[-1] == pytest.approx(40.0, abs=2.0)
    assert bird.observed.altitude == pytest.approx(60.0, abs=0.1)


# --- jumps ----------------------------------------------------------------------------------------------

NEAR = MissionItem(ItemKind.WAYPOINT, 60.0, 0.0, 40.0)
BACK = MissionItem(ItemKind.WAYPOINT, 0.0, 60.0, 40.0)


def visited(mission, seconds: float) -> list[int]:
    """Items that were flown, in their order."""
    bird, items = Point(mission), [0]
    for _ in range(round(seconds)):
        bird.fly(1.0)
        item = bird.state.item
        if item != items[-1] and mission[item].kind != ItemKind.JUMP:
            items.append(item)
    return items


def test_a_jump_is_followed_as_often_as_it_says() -> None:
    jump = MissionItem(ItemKind.JUMP, jump_to=0, repeats=2)
    assert visited((NEAR, BACK, jump, WAY_ON), 120.0) == [0, 1, 0, 1, 0, 1, 3]


def test_a_jump_without_end_is_followed_for_ever() -> None:
    items = visited((NEAR, BACK, MissionItem(ItemKind.JUMP, jump_to=0, repeats=-1), WAY_ON), 300.0)
    assert 3 not in items and items.count(1) > 8


def test_a_mission_of_jumps_alone_is_at_its_end() -> None:
    state, target = navigation.step(
        GAINS, navigation.State(mode=Mode.AUTO), DT, (MissionItem(ItemKind.JUMP, jump_to=0, repeats=-1),), SEEN
    )
    assert (state.item, target.altitude) == (1, GAINS.return_altitude)


# --- the way home ---------------------------------------------------------------------------------------

FAR = SEEN._replace(mode=Mode.RETURN, north=300.0, east=100.0)


def test_a_return_flies_straight_home_and_circles_there() -> None:
    bird = Point((), FAR).fly(70.0)
    assert bird.distances((0.0, 0.0))[-1] == pytest.approx(GAINS.loiter_radius, abs=3.0)
    line = [abs(path.leg((300.0, 100.0), (0.0, 0.0), place).cross) for place in bird.track[200:600]]
    assert max(line) < 12.0


def test_a_return_that_the_wind_carries_past_home_turns_round() -> None:
    """The old line leads away from home beyond its end: it was followed for two minutes, through the fence."""
    bird = Point((), FAR).fly(2.0)
    bird.observed = bird.observed._replace(north=-2.0 * GAINS.loiter_radius, east=-GAINS.loiter_radius)
    bird.fly(DT)
    assert bird.target.heading == pytest.approx(math.atan2(1.0, 2.0), abs=0.05)
    bird.fly(25.0)
    assert bird.distances((0.0, 0.0))[-1] == pytest.approx(GAINS.loiter_radius, abs=3.0)


def test_a_return_from_low_climbs_straight_ahead_first() -> None:
    bird = Point((), FAR._replace(altitude=4.0)).fly(10.0, climb=1.0)
    assert (bird.target.heading, bird.target.curvature) == (FAR.heading, 0.0)
    assert bird.observed.heading == pytest.approx(FAR.heading)
    assert bird.target.altitude == GAINS.return_altitude
    bird.fly(60.0, climb=1.0)
    assert bird.distances((0.0, 0.0))[-1] < 60.0


def test_a_return_goes_to_the_nearest_rally_point_and_its_altitude() -> None:
    rally = (RallyPoint(-500.0, 0.0, 30.0), RallyPoint(200.0, -100.0, 55.0))
    bird = Point((), FAR._replace(rally=rally)).fly(45.0)
    assert bird.distances((200.0, -100.0))[-1] == pytest.approx(GAINS.loiter_radius, abs=3.0)
    assert bird.target.altitude == 55.0


@pytest.mark.parametrize("wind_from_deg", [0.0, 57.0, 135.0, 250.0])
@pytest.mark.parametrize("mission", [(), (MissionItem(ItemKind.RETURN),)])
def test_return_lands_at_home_into_the_mean_wind(mission, wind_from_deg: float) -> None:
    """GIVEN wind at the goal WHEN the loiter is over THEN the line is into the wind and the flare reaches home."""
    wind_from = math.radians(wind_from_deg)
    north, east = -3.0 * math.cos(wind_from), -3.0 * math.sin(wind_from)
    mode = Mode.AUTO if mission else Mode.RETURN
    bird = Point(mission, FAR._replace(mode=mode, wind_north=north, wind_east=east))
    while not bird.state.final:
        assert len(bird.fly(DT).track) * DT < 200.0
    assert bird.state.heading == pytest.approx(wrap(wind_from), abs=0.01)
    ratio = 1.0 - 3.0 / GAINS.approach_airspeed
    assert bird.state.slope_length == pytest.approx(ratio * GAINS.approach_length, rel=0.01)
    reach = ratio * GAINS.flare_reach
    end = (-reach * math.cos(wind_from), -reach * math.sin(wind_from))
    assert (bird.state.touch_north, bird.state.touch_east) == pytest.approx(end, abs=0.5)
    assert abs(wrap(bird.observed.heading - wind_from)) < 0.6
    # On the line down to there, and not beside it.
    bird.fly(bird.state.slope_length / SPEED)
    assert bird.distances(end)[-1] < 15.0


def test_return_lands_at_the_rally_point() -> None:
    bird = Point((), FAR._replace(rally=(RallyPoint(200.0, -100.0, 40.0),)))
    while not bird.state.final:
        assert len(bird.fly(DT).track) * DT < 200.0
    touch = (bird.state.touch_north, bird.state.touch_east)
    assert math.dist(touch, (200.0, -100.0)) == pytest.approx(GAINS.flare_reach)


def test_landing_heading_follows_no_single_gust() -> None:
    """GIVEN 3 m/s from north and a gust from east for 2 s at the end of the loiter THEN the line leads north."""
    bird = Point((), FAR._replace(north=30.0, east=0.0, wind_north=-3.0)).fly(GAINS.loiter_time)
    while bird.state.elapsed < GAINS.loiter_time - 1.0:
        bird.fly(DT)
    bird.observed = bird.observed._replace(wind_north=-1.5, wind_east=-2.5)
    assert bird.fly(2.0).state.landing == 1
    assert abs(bird.state.heading) < 0.2


def test_a_circle_taken_by_a_failsafe_low_is_flown_above_the_floor() -> None:
    low = SEEN._replace(mode=Mode.LOITER, altitude=1.0, rescued=1)
    bird = Point((), low).fly(10.0)
    assert bird.observed.heading == pytest.approx(low.heading)
    bird.fly(60.0)
    assert bird.observed.altitude >= GAINS.return_floor
    assert bird.target.curvature == pytest.approx(1.0 / GAINS.loiter_radius, rel=0.1)
    chosen = Point((), low._replace(rescued=0)).fly(5.0)
    assert (chosen.target.altitude, chosen.state.radius) == (1.0, GAINS.loiter_radius)


@pytest.mark.parametrize("mission", [(), (MissionItem(ItemKind.LAND, -300.0, 0.0),)])
@pytest.mark.parametrize("ceiling", [25.0, 8.0])
def test_nothing_above_the_fence_is_asked_on_the_way_home(mission, ceiling: float) -> None:
    rally = (RallyPoint(200.0, -100.0, 55.0),)
    mode = Mode.AUTO if mission else Mode.RETURN
    bird = Point(mission, FAR._replace(mode=mode, ceiling=ceiling, rally=rally, altitude=2.0))
    for _ in range(45):
        assert bird.fly(1.0).target.altitude <= ceiling
    assert bird.distances((300.0, 100.0))[-1] > 60.0


# --- in the wind ----------------------------------------------------------------------------------------


def test_the_lookahead_grows_with_a_following_winds_ground_speed() -> None:
    assert lookahead(GAINS, SEEN) == GAINS.lookahead
    assert lookahead(GAINS, SEEN._replace(ground_speed=0.5 * SPEED)) == GAINS.lookahead
    assert lookahead(GAINS, SEEN._replace(ground_speed=1.4 * SPEED)) == pytest.approx(1.4 * GAINS.lookahead)
    assert lookahead(GAINS, SEEN._replace(ground_speed=9.0 * SPEED)) == 2.0 * GAINS.lookahead
    assert lookahead(GAINS, SEEN._replace(airspeed=0.0)) == GAINS.lookahead


@pytest.mark.parametrize(
    ("wind", "ratio"),
    [(-0.4, 0.6), (0.0, 1.0), (0.4, 1.4), (-0.9, SHORTEST), (0.9, LONGEST)],
)
def test_line_length_follows_the_ground_speed(wind: float, ratio: float) -> None:
    """``wind`` in units of the approach airspeed."""
    state = navigation.State(wind_north=wind * GAINS.approach_airspeed)
    assert slope_length(GAINS, state, 0.0) == pytest.approx(ratio * GAINS.approach_length)
    opposite = GAINS.approach_length * min(max(1.0 - wind, SHORTEST), LONGEST)
    assert slope_length(GAINS, state, math.pi) == pytest.approx(opposite)


def test_line_length_is_kept_once_begun() -> None:
    here = SEEN._replace(mode=Mode.LAND, heading=0.0, wind_north=-3.0, altitude=GAINS.approach_altitude)
    begun = navigation.State(mode=Mode.AUTO, wind_north=-3.0)
    state, target = navigation.step(GAINS, begun, DT, (), here)
    assert target.distance == pytest.approx((1.0 - 3.0 / GAINS.approach_airspeed) * GAINS.approach_length)
    _, later = navigation.step(GAINS, state, DT, (), here._replace(wind_north=2.0))
    assert (later.distance, later.altitude) == (target.distance, target.altitude)


# --- corners --------------------------------------------------------------------------------------------

CORNER = (MissionItem(ItemKind.WAYPOINT, 200.0, 0.0, 40.0), MissionItem(ItemKind.WAYPOINT, 200.0, 300.0, 40.0))


def overshoot(observed: Situation, mission=CORNER) -> float:
    """How far (m) a corner is overshot, beyond the next leg."""
    bird = Point(mission, observed).fly(45.0)
    return max(north for north, _ in bird.track) - 200.0


def test_a_corner_is_turned_into_before_it_comes() -> None:
    assert overshoot(SEEN._replace(heading=0.0)) < 1.5


def test_a_turn_into_a_following_wind_begins_earlier() -> None:
    windy = SEEN._replace(heading=0.0, wind_east=2.0)
    state, _ = navigation.step(GAINS, navigation.State(mode=Mode.AUTO), DT, CORNER, SEEN._replace(heading=0.0))
    calm, downwind = (turning_distance(GAINS, state, observed) for observed in (SEEN, windy))
    assert calm == pytest.approx(SPEED**2 / (9.81 * math.tan(0.4)), rel=0.01)
    assert downwind == pytest.approx(calm * ((SPEED + 2.0) / SPEED) ** 2)
    gust = SEEN._replace(airspeed=14.0, wind_east=3.0)
    assert turning_distance(GAINS, state, gust) == GAINS.loiter_radius


def test_no_more_than_half_a_leg_is_cut_off_and_nothing_before_another_kind_of_item() -> None:
    short = (MissionItem(ItemKind.WAYPOINT, 30.0, 0.0, 40.0), MissionItem(ItemKind.WAYPOINT, 30.0, 300.0, 40.0))
    fast = SEEN._replace(heading=0.0, wind_east=8.0, ground_speed=14.0)
    state, _ = navigation.step(GAINS, navigation.State(mode=Mode.AUTO), DT, short, fast._replace(north=14.0))
    assert state.item == 0
    state, _ = navigation.step(GAINS, state, DT, short, fast._replace(north=23.5))
    assert state.item == 1
    alone = (short[0], MissionItem(ItemKind.RETURN))
    state, _ = navigation.step(GAINS, navigation.State(mode=Mode.AUTO), DT, alone, fast)
    assert turning_distance(GAINS, state, fast) == 0.0
