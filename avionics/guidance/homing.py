"""Return flight: climb to a safe altitude, flight to the goal, circle, landing.

The goal is home or a rally point.
"""

from __future__ import annotations

import math
from typing import Final

from avionics.guidance import approach, circle
from avionics.guidance.mission import ItemKind, MissionItem
from avionics.guidance.path import Leg, Place, course_to_leg, leg
from avionics.guidance.route import (
    Gains,
    Situation,
    State,
    Target,
    climb_ahead,
    here,
    least_altitude,
    lookahead,
)
from avionics.messages import Stage

CALM: Final = 1.0
"""m/s; mean wind below which the landing keeps the present course"""


def begin(gains: Gains, state: State, situation: Situation) -> State:
    """Select the goal of the return: the nearest rally point, else home."""
    goal = min(situation.rally, key=lambda point: math.dist((point.north, point.east), here(situation)), default=None)
    north, east, altitude = (0.0, 0.0, gains.return_altitude) if goal is None else goal
    return state._replace(goal_north=north, goal_east=east, goal_altitude=altitude)


def return_home(
    gains: Gains, state: State, dt: float, item: MissionItem, situation: Situation
) -> tuple[State, Target, bool]:
    """Climb straight ahead if too low, fly to the goal and circle there.

    Without a valid position the vehicle keeps its heading.
    """
    altitude = gains.return_altitude
    if not situation.valid:
        return state, Target(Stage.EN_ROUTE, altitude, state.heading), False
    if state.arrived:
        state, target = circle.around(gains, state, dt, state.goal_altitude, situation)
        return state, target, state.elapsed >= gains.loiter_time
    if situation.altitude < least_altitude(gains, situation.ceiling) and not state.via:
        return state, climb_ahead(gains, state, altitude, situation), False
    goal = (state.goal_north, state.goal_east)
    state, line = _straight_home(state, goal, situation)
    distance = math.dist(goal, here(situation))
    if distance <= max(gains.acceptance, gains.loiter_radius):
        state = circle.centre_at(state, *goal, gains.loiter_radius, situation)._replace(arrived=1)
        state, target = circle.around(gains, state, dt, state.goal_altitude, situation)
        return state, target, state.elapsed >= gains.loiter_time
    course = course_to_leg(line, lookahead(gains, situation))
    return state._replace(heading=course), Target(Stage.EN_ROUTE, altitude, course, distance, line.cross), False


def _straight_home(state: State, goal: Place, situation: Situation) -> tuple[State, Leg]:
    """Return the line to the goal.

    If the wind has carried the vehicle past the goal, a new line starts at the present position.
    """
    line = leg((state.from_north, state.from_east), goal, here(situation))
    if state.via and line.along < line.length:
        return state, line
    state = state._replace(via=1, from_north=situation.north, from_east=situation.east, radius=0.0)
    return state, leg(here(situation), goal, here(situation))


def begin_landing(state: State, now: Situation) -> State:
    """Plan a landing into the mean wind at the goal of the return.

    The vehicle flies from the circle at the goal to the circle at the start of the approach.
    """
    wind = math.hypot(state.wind_north, state.wind_east)
    heading = math.atan2(-state.wind_east, -state.wind_north) if wind >= CALM else now.heading
    return state._replace(started=1, landing=1, final=0, flare=0, arrived=1, heading=heading)


def land(gains: Gains, state: State, dt: float, now: Situation) -> tuple[State, Target]:
    """Land at the goal of the return."""
    item = MissionItem(ItemKind.LAND, state.goal_north, state.goal_east, heading=state.heading)
    state, target, _ = approach.land(gains, state, dt, item, now)
    return state, target
