"""Landing approach: straight glide path and flare.

The glide path ends before the landing point by the distance that the flare covers (the aim point of ArduPlane's
landing). Both lengths are those in still air times the ratio of ground speed to airspeed in the mean wind, so that
descent and flare take the same time in any wind.
"""

from __future__ import annotations

import math
from typing import Final

from avionics.guidance.mission import MissionItem
from avionics.guidance.path import Place, circle_course, course_to_leg, leg, reached
from avionics.guidance.route import Gains, Situation, State, Target, here, lookahead
from avionics.limits import clip, wrap
from avionics.messages import Stage

FUNNEL: Final = 0.25
"""-; half width of the approach funnel per remaining distance: 14 degrees to each side"""
JOINING_TURN: Final = 0.5
"""rad; maximum course change at the intercept of the glide path"""
SHORTEST, LONGEST = 0.5, 1.6
"""-; limits of the glide path length relative to still air, for the strongest headwind and tailwind"""


def drift(gains: Gains, state: State, heading: float) -> float:
    """Return the ratio of ground speed to airspeed on the glide path in the mean wind.

    ``heading`` (rad) is the course of the glide path.
    """
    along = state.wind_north * math.cos(heading) + state.wind_east * math.sin(heading)
    return clip(1.0 + along / gains.approach_airspeed, SHORTEST, LONGEST)


def slope_length(gains: Gains, state: State, heading: float) -> float:
    """Return the length (m) of the glide path at ``heading`` (rad)."""
    return gains.approach_length * drift(gains, state, heading)


def aim_point(gains: Gains, state: State, item: MissionItem) -> Place:
    """Return the end of the glide path (m, north and east).

    The flare covers the distance from this point to the landing point of ``item``.
    """
    reach = gains.flare_reach * drift(gains, state, item.heading)
    return item.north - reach * math.cos(item.heading), item.east - reach * math.sin(item.heading)


def land(
    gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation
) -> tuple[State, Target, bool]:
    """Fly to the start of the approach, then descend along the glide path.

    The item ends at touchdown, which `modes` detects.
    """
    if not state.final:
        state, target = _to_approach(gains, state, item, situation)
    else:
        state, target = down_the_line(gains, state, item.heading, situation)
    return state, target, False


def land_ahead(gains: Gains, state: State, situation: Situation) -> State:
    """Begin the descent at the present position and course, at the usual angle."""
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
    """Fly to the start of the glide path and circle there until the intercept."""
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
    """Return whether the glide path can be intercepted from the present position.

    The path of ``length`` (m) ends at ``aim`` with the course ``heading`` (rad). The funnel extends from the end of
    the path to one lookahead distance before its start, with the half width `FUNNEL`. Inside the funnel the course
    must be within `JOINING_TURN` of the course of the path.
    """
    to_go, cross = _remaining(aim, heading, now)
    along = 0.0 < to_go <= length + gains.lookahead and abs(cross) <= FUNNEL * to_go
    return along and abs(wrap(heading - now.heading)) <= JOINING_TURN


def _low(gains: Gains, aim: Place, length: float, heading: float, now: Situation) -> bool:
    """Return whether the altitude is at most the margin above the glide path."""
    to_go, _ = _remaining(aim, heading, now)
    return now.altitude <= gains.approach_altitude * clip(to_go / length, 0.0, 1.0) + gains.approach_margin


def _remaining(place: Place, heading: float, situation: Situation) -> tuple[float, float]:
    """Return the distance (m) to ``place`` along the line, and to the right of it.

    The line ends at ``place`` with the course ``heading`` (rad).
    """
    c, s = math.cos(heading), math.sin(heading)
    dn, de = situation.north - place[0], situation.east - place[1]
    return -(dn * c + de * s), de * c - dn * s


def _circle_at_head(gains: Gains, head: Place, heading: float, situation: Situation) -> float:
    """Return the course of a circle for altitude loss at the start of the glide path.

    The circle is clockwise and tangent to the glide path.
    """
    north = head[0] - gains.loiter_radius * math.sin(heading)
    east = head[1] + gains.loiter_radius * math.cos(heading)
    return circle_course(
        gains.loiter_radius, lookahead(gains, situation), situation.north - north, situation.east - east
    )


def down_the_line(gains: Gains, state: State, heading: float, situation: Situation) -> tuple[State, Target]:
    """Descend along the glide path.

    The altitude setpoint falls with the remaining distance. Without a valid position the vehicle descends on
    ``heading`` at the maximum sink of the altitude loop.
    """
    if state.flare or situation.altitude - situation.terrain <= gains.flare_altitude:
        return state._replace(flare=1), Target(Stage.FLARE, 0.0, heading)
    if not situation.valid:
        return state, Target(Stage.APPROACH, -gains.approach_altitude, heading)
    to_go, cross = _remaining((state.touch_north, state.touch_east), heading, situation)
    length = state.slope_length or gains.approach_length
    altitude = clip(gains.approach_altitude * to_go / length, -gains.approach_altitude, gains.approach_altitude)
    course = wrap(heading - math.atan2(cross, lookahead(gains, situation)))
    return state, Target(Stage.APPROACH, altitude, course, abs(to_go), cross)
