"""Mission items for takeoff, hold, waypoint and excitation.

Each function returns the target and whether the item is complete.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from avionics.guidance import circle
from avionics.guidance.mission import MissionItem
from avionics.guidance.path import course_to_leg, leg, reached
from avionics.guidance.route import Gains, Situation, State, Target, here, lookahead, turning_distance
from avionics.limits import wrap
from avionics.messages import Stage

Outcome = tuple[State, Target, bool]
ItemFunction = Callable[[Gains, State, float, MissionItem, Situation], Outcome]


def take_off(gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation) -> Outcome:
    """Climb straight ahead on the heading of the launch."""
    done = situation.altitude >= item.altitude - gains.capture_altitude
    return state, Target(Stage.CLIMB_OUT, item.altitude, state.heading), done


def hold_heading(gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation) -> Outcome:
    """Hold altitude and heading for a time that begins when both are captured."""
    captured = (
        state.elapsed > 0.0
        or state.waiting >= gains.capture_limit
        or (
            abs(item.altitude - situation.altitude) <= gains.capture_altitude
            and abs(wrap(item.heading - situation.heading)) <= gains.capture_heading
        )
    )
    state = state._replace(elapsed=state.elapsed + dt) if captured else state._replace(waiting=state.waiting + dt)
    return state, Target(Stage.EN_ROUTE, item.altitude, item.heading), state.elapsed >= item.duration


def waypoint(gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation) -> Outcome:
    """Fly the leg from the previous waypoint or from the start of the item.

    Without a valid position the vehicle keeps its heading. The turn into the next leg begins before the waypoint, by
    up to half the length of this leg. A waypoint with a hold time is circled for that time, which begins on the
    circle.
    """
    if item.duration > 0.0:
        return circle.item(gains, state, dt, item, situation)
    if not situation.valid:
        return state, Target(Stage.EN_ROUTE, item.altitude, state.heading), False
    line = leg((state.from_north, state.from_east), (item.north, item.east), here(situation))
    course = course_to_leg(line, lookahead(gains, situation))
    distance = math.hypot(item.north - situation.north, item.east - situation.east)
    target = Target(Stage.EN_ROUTE, item.altitude, course, distance, line.cross)
    early = min(turning_distance(gains, state, situation), 0.5 * line.length)
    return state._replace(heading=course), target, reached(line, max(gains.acceptance, early))


def excite(gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation) -> Outcome:
    """Hold altitude and heading until the excitation is finished or aborted."""
    done = situation.excitations > state.excitations
    asked = None if done else item.excitation
    return state, Target(Stage.EN_ROUTE, state.altitude, state.heading, excitation=asked), done
