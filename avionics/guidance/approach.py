"""Landing: to the head of a straight line down, down the line, flare.

The line ends before the landing place by the distance that the flare covers (the aim point of ArduPlane's landing).
Both lengths are those of still air times the ratio of ground speed to airspeed in the mean wind, so that sink and
flare take the same time in any wind.
"""

from __future__ import annotations

import math

from avionics.guidance.mission import MissionItem
from avionics.guidance.path import Place, circle_course, course_to_leg, leg, reached
from avionics.guidance.route import Gains, Situation, State, Target, here, lookahead
from avionics.limits import clip, wrap
from avionics.messages import Stage

FUNNEL = 0.25
"""-; half width per way to go of the funnel in which an approach is joined, 14 degrees to each side"""
JOINING_TURN = 0.5
"""rad; greatest turn with which it is joined"""
SHORTEST, LONGEST = 0.5, 1.6
"""-; of the line, in units of its length in still air: in the strongest wind against and from behind"""


def drift(gains: Gains, state: State, heading: float) -> float:
    """Ratio of ground speed to airspeed on the line down at ``heading`` (rad), in the mean wind."""
    along = state.wind_north * math.cos(heading) + state.wind_east * math.sin(heading)
    return clip(1.0 + along / gains.approach_airspeed, SHORTEST, LONGEST)


def slope_length(gains: Gains, state: State, heading: float) -> float:
    """Length (m) of the line down at ``heading`` (rad)."""
    return gains.approach_length * drift(gains, state, heading)


def aim_point(gains: Gains, state: State, item: MissionItem) -> Place:
    """End of the line down (north and east in m), from where the flare reaches the landing place of ``item``."""
    reach = gains.flare_reach * drift(gains, state, item.heading)
    return item.north - reach * math.cos(item.heading), item.east - reach * math.sin(item.heading)


def land(
    gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation
) -> tuple[State, Target, bool]:
    """Fly to the head of the approach, then down its line; the touchdown ends it (`modes`)."""
    if not state.final:
        state, target = _to_approach(gains, state, item, situation)
    else:
        state, target = down_the_line(gains, state, item.heading, situation)
    return state, target, False


def land_ahead(gains: Gains, state: State, situation: Situation) -> State:
    """Begin the line down here, on the present course, at the usual angle."""
    length = slope_length(gains, state, situation.heading)
    reach = length * max(situation.altitude, 0.0) / gains.approach_altitude
    return state._replace(
        final=1,
        flare=0,
        slope_length=length,
        heading=situation.heading,
        touch_north=situation.north + reach * math.cos(situation.heading),
        touch_east=situation.east + reach * math.sin(situation.heading),
    )


def _to_approach(gains: Gains, state: State, item: MissionItem, situation: Situation) -> tuple[State, Target]:
    """To the head of the line, then around a circle there until the line can be joined, from above or from aside."""
    length, aim = slope_length(gains, state, item.heading), aim_point(gains, state, item)
    head = (aim[0] - length * math.cos(item.heading), aim[1] - length * math.sin(item.heading))
    line = leg((state.from_north, state.from_east), head, here(situation))
    joined, low = (
        in_funnel(gains, aim, length, item.heading, situation),
        _low(gains, aim, length, item.heading, situation),
    )
    if state.arrived:
        course = _circle_at_head(gains, head, item.heading, situation)
    else:
        course = course_to_leg(line, lookahead(gains, situation))
        state = state._replace(arrived=int(joined or reached(line, gains.acceptance)))
    if not situation.valid or (low and joined):
        state = state._replace(final=1, slope_length=length, touch_north=aim[0], touch_east=aim[1])
    course = course if situation.valid else state.heading
    distance = math.hypot(item.north - situation.north, item.east - situation.east)
    return state, Target(Stage.APPROACH, gains.approach_altitude, course, distance, line.cross)


def in_funnel(gains: Gains, aim: Place, length: float, heading: float, now: Situation) -> bool:
    """Whether the line of ``length`` m down to ``aim`` at ``heading`` (rad) can be joined from here.

    The funnel opens backward from the end of the line to a lookahead before its head, by `FUNNEL` to each side;
    inside it the course must be within `JOINING_TURN` of the line's.
    """
    to_go, cross = _remaining(aim, heading, now)
    along = 0.0 < to_go <= length + gains.lookahead and abs(cross) <= FUNNEL * to_go
    return along and abs(wrap(heading - now.heading)) <= JOINING_TURN


def _low(gains: Gains, aim: Place, length: float, heading: float, now: Situation) -> bool:
    """Whether the altitude is that of the line here, or above it by no more than the margin."""
    to_go, _ = _remaining(aim, heading, now)
    return now.altitude <= gains.approach_altitude * clip(to_go / length, 0.0, 1.0) + gains.approach_margin


def _remaining(place: Place, heading: float, situation: Situation) -> tuple[float, float]:
    """Way to go (m) along the line that reaches ``place`` at ``heading``, and distance (m) to the right of it."""
    c, s = math.cos(heading), math.sin(heading)
    dn, de = situation.north - place[0], situation.east - place[1]
    return -(dn * c + de * s), de * c - dn * s


def _circle_at_head(gains: Gains, head: Place, heading: float, situation: Situation) -> float:
    """Course of a clockwise circle that touches the approach line at its head: to lose altitude on."""
    north = head[0] - gains.loiter_radius * math.sin(heading)
    east = head[1] + gains.loiter_radius * math.cos(heading)
    return circle_course(
        gains.loiter_radius, lookahead(gains, situation), situation.north - north, situation.east - east
    )


def down_the_line(gains: Gains, state: State, heading: float, situation: Situation) -> tuple[State, Target]:
    """Altitude falls with the way to go; without a position straight down at the loop's greatest sink."""
    if state.flare or situation.altitude - situation.terrain <= gains.flare_altitude:
        return state._replace(flare=1), Target(Stage.FLARE, 0.0, heading)
    if not situation.valid:
        return state, Target(Stage.APPROACH, -gains.approach_altitude, heading)
    to_go, cross = _remaining((state.touch_north, state.touch_east), heading, situation)
    length = state.slope_length or gains.approach_length
    altitude = clip(gains.approach_altitude * to_go / length, -gains.approach_altitude, gains.approach_altitude)
    course = wrap(heading - math.atan2(cross, lookahead(gains, situation)))
    return state, Target(Stage.APPROACH, altitude, course, abs(to_go), cross)
