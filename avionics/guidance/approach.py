"""Landing: to the head of a straight line down to the landing place, down the line, flare.

The line's length is that of still air times the ground speed's share of the airspeed, so that the sink that it asks
for is the same in any wind.
"""

from __future__ import annotations

import math

from avionics.guidance.mission import MissionItem
from avionics.guidance.path import Place, circle_course, course_to_leg, leg, reached
from avionics.guidance.route import Gains, Situation, State, Target, here, lookahead, tailwind
from avionics.limits import clip, wrap
from avionics.messages import Stage

FUNNEL = 0.25
"""-; half width per way to go of the funnel in which an approach is joined, 14 degrees to each side"""
JOINING_TURN = 0.5
"""rad; greatest turn with which it is joined"""
SHORTEST, LONGEST = 0.5, 1.6
"""-; of the line, in units of its length in still air: in the strongest wind against and from behind"""


def slope_length(gains: Gains, heading: float, seen: Situation) -> float:
    """Length (m) of the line down at ``heading`` (rad), in the wind as it is estimated."""
    if seen.airspeed <= 1.0:
        return gains.approach_length
    share = 1.0 + tailwind(seen, heading) / seen.airspeed
    return gains.approach_length * clip(share, SHORTEST, LONGEST)


def land(gains: Gains, state: State, dt: float, item: MissionItem, seen: Situation) -> tuple[State, Target, bool]:
    """Fly to the head of the approach, then down its line; the touchdown ends it (`modes`)."""
    if not state.final:
        state, target = _to_approach(gains, state, item, seen)
    else:
        state, target = down_the_line(gains, state, item.heading, seen)
    return state, target, False


def land_ahead(gains: Gains, state: State, seen: Situation) -> State:
    """Begin the line down here, on the present course, at the usual angle."""
    length = slope_length(gains, seen.heading, seen)
    reach = length * max(seen.altitude, 0.0) / gains.approach_altitude
    return state._replace(
        final=1,
        flare=0,
        slope_length=length,
        heading=seen.heading,
        touch_north=seen.north + reach * math.cos(seen.heading),
        touch_east=seen.east + reach * math.sin(seen.heading),
    )


def _to_approach(gains: Gains, state: State, item: MissionItem, seen: Situation) -> tuple[State, Target]:
    """To the head of the line, and from too high a circle there; who is over the line already needs no way."""
    length = slope_length(gains, item.heading, seen)
    head = (item.north - length * math.cos(item.heading), item.east - length * math.sin(item.heading))
    line = leg((state.from_north, state.from_east), head, here(seen))
    distance = math.hypot(item.north - seen.north, item.east - seen.east)
    joined, low = in_funnel(gains, item, seen), seen.altitude <= _joining_altitude(gains, item, seen)
    if state.arrived:
        course = _circle_at_head(gains, head, item.heading, seen)
        aligned = abs(wrap(item.heading - seen.heading)) <= gains.capture_heading
    else:
        course, aligned = course_to_leg(line, lookahead(gains, seen)), True
        state = state._replace(arrived=int(joined or reached(line, gains.acceptance)))
    if not seen.valid or (low and (joined or (state.arrived and aligned))):
        state = state._replace(final=1, slope_length=length, touch_north=item.north, touch_east=item.east)
    course = course if seen.valid else state.heading
    return state, Target(Stage.APPROACH, gains.approach_altitude, course, distance, line.cross)


def in_funnel(gains: Gains, item: MissionItem, seen: Situation) -> bool:
    """Whether the line down to the landing place can be joined from here, without the way to its head.

    The funnel opens backward from the landing place to a lookahead before the head of the line, by `FUNNEL` to each
    side; inside it the course must be within `JOINING_TURN` of the line's.
    """
    to_go, cross = _to_go((item.north, item.east), item.heading, seen)
    longest = slope_length(gains, item.heading, seen) + gains.lookahead
    along = 0.0 < to_go <= longest and abs(cross) <= FUNNEL * to_go
    return along and abs(wrap(item.heading - seen.heading)) <= JOINING_TURN


def _joining_altitude(gains: Gains, item: MissionItem, seen: Situation) -> float:
    """Greatest altitude (m) at which the line is joined here: the line's, and what the greatest sink makes good."""
    to_go, _ = _to_go((item.north, item.east), item.heading, seen)
    share = clip(to_go / slope_length(gains, item.heading, seen), 0.0, 1.0)
    return gains.approach_altitude * share + gains.approach_margin


def _to_go(place: Place, heading: float, seen: Situation) -> tuple[float, float]:
    """Way to go (m) along the line that reaches ``place`` at ``heading``, and distance (m) to the right of it."""
    c, s = math.cos(heading), math.sin(heading)
    dn, de = seen.north - place[0], seen.east - place[1]
    return -(dn * c + de * s), de * c - dn * s


def _circle_at_head(gains: Gains, head: Place, heading: float, seen: Situation) -> float:
    """Course of a clockwise circle that touches the approach line at its head: to lose altitude on."""
    north = head[0] - gains.loiter_radius * math.sin(heading)
    east = head[1] + gains.loiter_radius * math.cos(heading)
    return circle_course(gains.loiter_radius, lookahead(gains, seen), seen.north - north, seen.east - east)


def down_the_line(gains: Gains, state: State, heading: float, seen: Situation) -> tuple[State, Target]:
    """Altitude falls with the way to go; without a position straight down at the loop's greatest sink."""
    if state.flare or seen.altitude <= gains.flare_altitude:
        return state._replace(flare=1), Target(Stage.FLARE, 0.0, heading)
    if not seen.valid:
        return state, Target(Stage.APPROACH, -gains.approach_altitude, heading)
    to_go, cross = _to_go((state.touch_north, state.touch_east), heading, seen)
    length = state.slope_length or gains.approach_length
    altitude = clip(gains.approach_altitude * to_go / length, -gains.approach_altitude, gains.approach_altitude)
    course = wrap(heading - math.atan2(cross, lookahead(gains, seen)))
    return state, Target(Stage.APPROACH, altitude, course, abs(to_go), cross)
