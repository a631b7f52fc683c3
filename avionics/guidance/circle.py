"""Circles: intercept from any position, end after turns, time or at an altitude.

Without a valid position the vehicle flies at a constant bank.
"""

from __future__ import annotations

import math
from typing import Final

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.guidance.path import Place, circle_course
from avionics.guidance.route import Gains, Situation, State, Target, lookahead
from avionics.limits import clip, wrap
from avionics.messages import Stage

JOINED: Final = 0.4
"""-; fraction of the radius within which the circle counts as intercepted"""
BLIND_TURN: Final = 0.4
"""rad; heading error applied without a valid position: constant bank, drift with the wind"""


def tangent_circle_center(state: State, radius: float, situation: Situation) -> State:
    """Start a circle tangent to the present course.

    The circle is to the right if ``radius`` (m) is positive, else to the left.
    """
    return centre_at(state, *tangent_center(radius, situation), radius, situation)


def tangent_center(radius: float, situation: Situation) -> Place:
    """Return the center (m, north and east) of a circle tangent to the course."""
    heading = situation.heading
    return situation.north - radius * math.sin(heading), situation.east + radius * math.cos(heading)


def centre_at(state: State, north: float, east: float, radius: float, situation: Situation) -> State:
    """Start a circle about a center (m), not yet intercepted."""
    bearing = math.atan2(situation.east - east, situation.north - north)
    return state._replace(
        centre_north=north, centre_east=east, radius=radius, bearing=bearing, swept=0.0, arrived=0, elapsed=0.0
    )


def around(gains: Gains, state: State, dt: float, altitude: float, situation: Situation) -> tuple[State, Target]:
    """Advance the circle of ``state`` by one step.

    Turns and time count from the intercept.
    """
    if not situation.valid:
        heading = wrap(situation.heading + math.copysign(BLIND_TURN, state.radius))
        return state, Target(Stage.EN_ROUTE, altitude, heading)
    north, east = situation.north - state.centre_north, situation.east - state.centre_east
    distance, size = math.hypot(north, east), abs(state.radius)
    outside, bearing = distance - size, math.atan2(east, north)
    joined = state.arrived or abs(outside) <= max(JOINED * size, gains.acceptance)
    if joined:
        moved = wrap(bearing - state.bearing) if state.arrived else 0.0
        swept = state.swept + math.copysign(1.0, state.radius) * moved
        state = state._replace(arrived=1, elapsed=state.elapsed + dt, swept=swept)
    ahead = lookahead(gains, situation)
    course = circle_course(state.radius, ahead, north, east)
    on_it = clip(1.0 - abs(outside) / ahead, 0.0, 1.0)
    target = Target(Stage.EN_ROUTE, altitude, course, distance, outside, on_it / state.radius)
    return state._replace(bearing=bearing, heading=course), target


def item(
    gains: Gains, state: State, dt: float, requested: MissionItem, situation: Situation
) -> tuple[State, Target, bool]:
    """Fly a CIRCLE, a LOITER or a waypoint with a hold time.

    ``state.radius`` is 0 until the circle begins.
    """
    if state.radius == 0.0:
        state = centre_at(state, requested.north, requested.east, requested.radius or gains.loiter_radius, situation)
    state, target = around(gains, state, dt, requested.altitude, situation)
    return state, target, requested.kind != ItemKind.LOITER and _is_complete(gains, state, requested, situation)


def _is_complete(gains: Gains, state: State, requested: MissionItem, situation: Situation) -> bool:
    if not state.arrived:
        return False
    if requested.turns > 0.0:
        return state.swept >= math.tau * requested.turns
    if requested.duration > 0.0:
        return state.elapsed >= requested.duration
    return abs(requested.altitude - situation.altitude) <= gains.capture_altitude
