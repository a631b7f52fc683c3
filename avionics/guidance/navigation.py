"""Navigation: from the mission's items and the mode to an altitude and a heading to fly.

One function per kind of item; each returns the target it asks for and whether the item is done. To add a
kind: declare it in `mission.ItemKind`, write its function, enter it in ``ITEMS``.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, NamedTuple

from avionics.guidance.mission import Excitation, ItemKind, Mission, MissionItem
from avionics.limits import clip, wrap
from avionics.messages import Mode, Stage
from avionics.quantities import Quantity

FUNNEL = 0.25
"""-; half width per way to go of the funnel in which an approach is joined, 14 degrees to each side"""
JOINING_TURN = 0.5
"""rad; greatest turn with which it is joined"""


class Gains(NamedTuple):
    """What the navigation is tuned with."""

    lookahead: Annotated[float, Quantity("m", 1.0, 500.0)]
    """m; distance ahead on the leg at which the course aims"""
    acceptance: Annotated[float, Quantity("m", 0.5, 200.0)]
    """m; radius at which a waypoint counts as reached"""
    capture_altitude: Annotated[float, Quantity("m", 0.1, 50.0)]
    """m; altitude error at which a take-off is over and the time of a hold begins"""
    capture_heading: Annotated[float, Quantity("rad", 0.02, 3.2)]
    """rad; heading error at which the time of a hold begins"""
    capture_limit: Annotated[float, Quantity("s", 0.0, 600.0)]
    """s; after which the time of a hold begins anyway"""
    return_altitude: Annotated[float, Quantity("m", 2.0, 1000.0)]
    """m; altitude of the way home"""
    loiter_radius: Annotated[float, Quantity("m", 3.0, 500.0)]
    """m; of the circle flown at home"""
    loiter_time: Annotated[float, Quantity("s", 0.0, 36000.0)]
    """s; circled at home before landing"""
    approach_length: Annotated[float, Quantity("m", 5.0, 2000.0)]
    """m; of the straight line down to the landing place"""
    approach_altitude: Annotated[float, Quantity("m", 2.0, 300.0)]
    """m; at which that line begins"""
    approach_margin: Annotated[float, Quantity("m", 0.1, 100.0)]
    """m; above the head of the line from which it may be begun; from higher a circle is flown there first"""
    flare_altitude: Annotated[float, Quantity("m", 0.0, 30.0)]
    """m; below which the nose is raised and the flapping reduced"""
    flare_throttle: Annotated[float, Quantity("-", 0.0, 1.0)]
    """-; flapping in the flare"""
    flare_pitch: Annotated[float, Quantity("rad", -0.5, 1.2)]
    """rad; pitch in the flare"""
    stick_climb: Annotated[float, Quantity("m/s", 0.0, 10.0)]
    """m/s; change of the held altitude at full pitch stick (altitude hold)"""
    stick_dead_band: Annotated[float, Quantity("-", 0.0, 0.5)]
    """-; stick that counts as centred"""


class State(NamedTuple):
    """What the navigation remembers."""

    mode: int = Mode.MANUAL
    """-; mode of the last step"""
    item: int = 0
    """-; mission item being flown"""
    begun: int = 0
    """-; 1 once the item's start has been taken"""
    elapsed: float = 0.0
    """s; in the item, from its capture if it has one"""
    waiting: float = 0.0
    """s; for the capture of a hold"""
    from_north: float = 0.0
    """m; where the leg begins"""
    from_east: float = 0.0
    """m; where the leg begins"""
    heading: float = 0.0
    """rad; heading held"""
    altitude: float = 0.0
    """m; altitude held"""
    final: int = 0
    """-; 1 on the straight line down"""
    flare: int = 0
    """-; 1 once the flare has begun; it is not left again"""
    touch_north: float = 0.0
    """m; landing place"""
    touch_east: float = 0.0
    """m; landing place"""
    arrived: int = 0
    """-; 1 once home was reached on a return, or the head of the approach on a landing"""
    excitations: int = 0
    """-; excitations that were finished when the item began"""
    extra: Excitation | None = None
    """-; an identification input asked for over the link"""


class Situation(NamedTuple):
    """What the navigation looks at."""

    mode: int
    """-; flight mode"""
    stage: int
    """-; stage of the flight"""
    north: float
    """m; from home"""
    east: float
    """m; from home"""
    valid: int
    """-; 1 while the position can be steered by"""
    heading: float
    """rad; course over ground or yaw, whichever is steered"""
    altitude: float
    """m; positive up"""
    stick_pitch: float
    """-; -1 to 1"""
    excitations: int
    """-; excitations finished since boot"""


class Target(NamedTuple):
    """What the navigation asks of the loops below."""

    stage: Stage
    """-; the stage this belongs to"""
    altitude: float
    """m; positive up"""
    heading: float
    """rad; course to fly"""
    distance: float = 0.0
    """m; to the item's place"""
    cross_track: float = 0.0
    """m; off the leg, positive to the right of it"""
    excitation: Excitation | None = None
    """-; identification input to fly now"""


class Leg(NamedTuple):
    """A straight line over ground, seen from a place."""

    course: float
    """rad; of the leg"""
    length: float
    """m"""
    along: float
    """m; the place's way along the leg"""
    cross: float
    """m; the place's distance to the right of the leg"""


Outcome = tuple[State, Target, bool]
ItemFunction = Callable[[Gains, State, float, MissionItem, Situation], Outcome]


# --- geometry -------------------------------------------------------------------------------------------


def leg(start: tuple[float, float], end: tuple[float, float], place: tuple[float, float]) -> Leg:
    """The leg from ``start`` to ``end`` (north, east in m) as seen from ``place``."""
    north, east = end[0] - start[0], end[1] - start[1]
    length = math.hypot(north, east)
    course = math.atan2(east, north)
    c, s = math.cos(course), math.sin(course)
    dn, de = place[0] - start[0], place[1] - start[1]
    return Leg(course, length, dn * c + de * s, de * c - dn * s)


def course_to_leg(line: Leg, lookahead: float) -> float:
    """Course (rad) that leads onto the leg: aims at the point ``lookahead`` m further along it."""
    return wrap(line.course - math.atan2(line.cross, lookahead))


def reached(line: Leg, acceptance: float) -> bool:
    """Whether the end of the leg is within ``acceptance`` m or has been passed abeam."""
    return math.hypot(line.length - line.along, line.cross) <= acceptance or line.along >= line.length


def circle_course(radius: float, lookahead: float, north: float, east: float) -> float:
    """Course (rad) that joins a clockwise circle about home from (``north``, ``east``) m."""
    outward = math.hypot(north, east) - radius
    return wrap(math.atan2(east, north) + 0.5 * math.pi + math.atan2(outward, lookahead))


# --- one function per kind of item ----------------------------------------------------------------------


def _take_off(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Straight ahead on the heading of the launch, climbing."""
    done = seen.altitude >= item.altitude - gains.capture_altitude
    return state, Target(Stage.CLIMB_OUT, item.altitude, state.heading), done


def _hold(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Hold altitude and heading for a time that begins when both have been captured."""
    captured = (
        state.elapsed > 0.0
        or state.waiting >= gains.capture_limit
        or (
            abs(item.altitude - seen.altitude) <= gains.capture_altitude
            and abs(wrap(item.heading - seen.heading)) <= gains.capture_heading
        )
    )
    state = state._replace(elapsed=state.elapsed + dt) if captured else state._replace(waiting=state.waiting + dt)
    return state, Target(Stage.EN_ROUTE, item.altitude, item.heading), state.elapsed >= item.duration


def _waypoint(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Fly the leg from where the item began; without a position hold the heading."""
    if not seen.valid:
        return state, Target(Stage.EN_ROUTE, item.altitude, state.heading), False
    line = leg((state.from_north, state.from_east), (item.north, item.east), (seen.north, seen.east))
    course = course_to_leg(line, gains.lookahead)
    distance = math.hypot(item.north - seen.north, item.east - seen.east)
    target = Target(Stage.EN_ROUTE, item.altitude, course, distance, line.cross)
    return state._replace(heading=course), target, reached(line, gains.acceptance)


def _excite(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Hold what was held at the start until the excitation has finished or was aborted."""
    done = seen.excitations > state.excitations
    asked = None if done else item.excitation
    return state, Target(Stage.EN_ROUTE, state.altitude, state.heading, excitation=asked), done


def _return(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Fly home, circle there for the loiter time; without a position hold the heading."""
    altitude = gains.return_altitude
    if not seen.valid:
        return state, Target(Stage.EN_ROUTE, altitude, state.heading), False
    distance = math.hypot(seen.north, seen.east)
    near = distance <= max(gains.acceptance, gains.loiter_radius)
    if state.arrived or near:
        state = state._replace(arrived=1, elapsed=state.elapsed + dt)
        course = circle_course(gains.loiter_radius, gains.lookahead, seen.north, seen.east)
        target = Target(Stage.EN_ROUTE, altitude, course, distance, distance - gains.loiter_radius)
        return state, target, state.elapsed >= gains.loiter_time
    line = leg((state.from_north, state.from_east), (0.0, 0.0), (seen.north, seen.east))
    course = course_to_leg(line, gains.lookahead)
    return state._replace(heading=course), Target(Stage.EN_ROUTE, altitude, course, distance, line.cross), False


def _land(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> Outcome:
    """Fly to the head of the approach, then down its line; the touchdown ends it (`modes`)."""
    if not state.final:
        state, target = _to_approach(gains, state, item, seen)
    else:
        state, target = _down_the_line(gains, state, item.heading, seen)
    return state, target, False


def _to_approach(gains: Gains, state: State, item: MissionItem, seen: Situation) -> tuple[State, Target]:
    """To the head of the line, and from too high a circle there; who is over the line already needs no way."""
    head = (
        item.north - gains.approach_length * math.cos(item.heading),
        item.east - gains.approach_length * math.sin(item.heading),
    )
    line = leg((state.from_north, state.from_east), head, (seen.north, seen.east))
    distance = math.hypot(item.north - seen.north, item.east - seen.east)
    joined, low = in_funnel(gains, item, seen), seen.altitude <= _joining_altitude(gains, item, seen)
    if state.arrived:
        course = _circle_at_head(gains, head, item.heading, seen)
        aligned = abs(wrap(item.heading - seen.heading)) <= gains.capture_heading
    else:
        course, aligned = course_to_leg(line, gains.lookahead), True
        state = state._replace(arrived=int(joined or reached(line, gains.acceptance)))
    if not seen.valid or (low and (joined or (state.arrived and aligned))):
        state = state._replace(final=1, touch_north=item.north, touch_east=item.east)
    course = course if seen.valid else state.heading
    return state, Target(Stage.APPROACH, gains.approach_altitude, course, distance, line.cross)


def in_funnel(gains: Gains, item: MissionItem, seen: Situation) -> bool:
    """Whether the line down to the landing place can be joined from here, without the way to its head.

    The funnel opens backward from the landing place to the head of the line, by `FUNNEL` to each side; inside
    it the course must be within `JOINING_TURN` of the line's.
    """
    to_go, cross = _to_go((item.north, item.east), item.heading, seen)
    along = 0.0 < to_go <= gains.approach_length and abs(cross) <= FUNNEL * to_go
    return along and abs(wrap(item.heading - seen.heading)) <= JOINING_TURN


def _joining_altitude(gains: Gains, item: MissionItem, seen: Situation) -> float:
    """Greatest altitude (m) at which the line is joined here: the line's, and what the greatest sink makes good."""
    to_go, _ = _to_go((item.north, item.east), item.heading, seen)
    share = clip(to_go / gains.approach_length, 0.0, 1.0)
    return gains.approach_altitude * share + gains.approach_margin


def _to_go(place: tuple[float, float], heading: float, seen: Situation) -> tuple[float, float]:
    """Way to go (m) along the line that reaches ``place`` at ``heading``, and distance (m) to the right of it."""
    c, s = math.cos(heading), math.sin(heading)
    dn, de = seen.north - place[0], seen.east - place[1]
    return -(dn * c + de * s), de * c - dn * s


def _circle_at_head(gains: Gains, head: tuple[float, float], heading: float, seen: Situation) -> float:
    """Course of a clockwise circle that touches the approach line at its head: to lose altitude on."""
    north = head[0] - gains.loiter_radius * math.sin(heading)
    east = head[1] + gains.loiter_radius * math.cos(heading)
    return circle_course(gains.loiter_radius, gains.lookahead, seen.north - north, seen.east - east)


def _down_the_line(gains: Gains, state: State, heading: float, seen: Situation) -> tuple[State, Target]:
    """Altitude falls with the way to go; without a position straight down at the loop's greatest sink."""
    if state.flare or seen.altitude <= gains.flare_altitude:
        return state._replace(flare=1), Target(Stage.FLARE, 0.0, heading)
    if not seen.valid:
        return state, Target(Stage.APPROACH, -gains.approach_altitude, heading)
    to_go, cross = _to_go((state.touch_north, state.touch_east), heading, seen)
    altitude = clip(
        gains.approach_altitude * to_go / gains.approach_length, -gains.approach_altitude, gains.approach_altitude
    )
    course = wrap(heading - math.atan2(cross, gains.lookahead))
    return state, Target(Stage.APPROACH, altitude, course, abs(to_go), cross)


ITEMS: dict[ItemKind, ItemFunction] = {
    ItemKind.TAKEOFF: _take_off,
    ItemKind.HOLD: _hold,
    ItemKind.WAYPOINT: _waypoint,
    ItemKind.EXCITE: _excite,
    ItemKind.RETURN: _return,
    ItemKind.LAND: _land,
}
GO_HOME = MissionItem(ItemKind.RETURN)


# --- modes ----------------------------------------------------------------------------------------------


def step(gains: Gains, state: State, dt: float, mission: Mission, seen: Situation) -> tuple[State, Target]:
    """One step; ``dt`` in s. A change of mode takes the present place, course and altitude as its start."""
    if seen.mode != state.mode:
        state = _enter_mode(gains, state, seen)
    if seen.mode == Mode.AUTO:
        return _automatic(gains, state, dt, mission, seen)
    if seen.mode == Mode.RETURN:
        return _going_home(gains, state, dt, seen)
    if seen.mode == Mode.LAND:
        return _down_the_line(gains, state, state.heading, seen)
    return _piloted(gains, state, dt, seen)


def begin_item(state: State, item: int, seen: Situation) -> State:
    """Make ``item`` the present one, starting here, on the course flown, at the altitude flown."""
    return state._replace(
        item=item,
        begun=1,
        elapsed=0.0,
        waiting=0.0,
        from_north=seen.north,
        from_east=seen.east,
        heading=seen.heading,
        altitude=seen.altitude,
        final=0,
        flare=0,
        arrived=0,
        excitations=seen.excitations,
    )


def choose_item(state: State, item: int) -> State:
    """Make ``item`` the next one to be begun."""
    return state._replace(item=item, begun=0)


def excite(state: State, excitation: Excitation | None, seen: Situation) -> State:
    """Fly an identification input now, on the present heading and at the present altitude."""
    return state._replace(
        extra=excitation, heading=seen.heading, altitude=seen.altitude, excitations=seen.excitations, elapsed=0.0
    )


def _enter_mode(gains: Gains, state: State, seen: Situation) -> State:
    state = begin_item(state, state.item, seen)._replace(mode=seen.mode, extra=None)
    if seen.mode != Mode.LAND:
        return state
    reach = gains.approach_length * max(seen.altitude, 0.0) / gains.approach_altitude
    return state._replace(
        final=1,
        touch_north=seen.north + reach * math.cos(seen.heading),
        touch_east=seen.east + reach * math.sin(seen.heading),
    )


def _automatic(gains: Gains, state: State, dt: float, mission: Mission, seen: Situation) -> tuple[State, Target]:
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, seen)
    if state.item >= len(mission):
        return _going_home(gains, state, dt, seen)
    if not state.begun or seen.stage == Stage.WAIT_LAUNCH:
        state = _begin_keeping_setpoints(state, mission, seen)
    item = mission[state.item]
    state, target, done = ITEMS[item.kind](gains, state, dt, item, seen)
    if done and seen.stage != Stage.WAIT_LAUNCH:
        state = state._replace(heading=target.heading, altitude=target.altitude, begun=0, item=state.item + 1)
    return state, target


def _begin_keeping_setpoints(state: State, mission: Mission, seen: Situation) -> State:
    """An excitation holds the setpoints of the item before it, so that no error is frozen into its trim."""
    begun = begin_item(state, state.item, seen)
    after_another = state.item > 0 and mission[state.item].kind == ItemKind.EXCITE and state.altitude > 0.0
    return begun._replace(heading=state.heading, altitude=state.altitude) if after_another else begun


def _extra_excitation(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    item = MissionItem(ItemKind.EXCITE, excitation=state.extra)
    state, target, done = _excite(gains, state, dt, item, seen)
    if done:
        state = begin_item(state, state.item, seen)._replace(extra=None)
    return state, target


def _going_home(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    """Home, a loiter, then straight down from there."""
    if state.final:
        return _down_the_line(gains, state, state.heading, seen)
    state, target, done = _return(gains, state, dt, GO_HOME, seen)
    if done:
        entered = _enter_mode(gains, state, seen._replace(mode=Mode.LAND))
        state = entered._replace(mode=seen.mode)
    return state, target


def _piloted(gains: Gains, state: State, dt: float, seen: Situation) -> tuple[State, Target]:
    """Altitude hold: the pitch stick moves the altitude that is held; other modes use their sticks directly."""
    if state.extra is not None:
        return _extra_excitation(gains, state, dt, seen)
    stick = seen.stick_pitch if abs(seen.stick_pitch) > gains.stick_dead_band else 0.0
    state = state._replace(altitude=state.altitude + gains.stick_climb * stick * dt)
    return state, Target(Stage.EN_ROUTE, state.altitude, state.heading)
