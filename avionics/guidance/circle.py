"""Circles: joined from anywhere, flown for turns, a time, or to an altitude; without a position at a steady bank."""

from __future__ import annotations

import math

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.guidance.path import Place, circle_course
from avionics.guidance.route import Gains, Situation, State, Target, lookahead
from avionics.limits import clip, wrap
from avionics.messages import Stage

JOINED = 0.4
"""-; share of the radius within which the circle counts as joined"""
BLIND_TURN = 0.4
"""rad; heading asked ahead of the present one to circle without a position: a steady bank, drifting with the wind"""


def centre_beside(state: State, radius: float, seen: Situation) -> State:
    """A circle that the present course touches: to the right for a positive ``radius`` (m), else to the left."""
    return centre_at(state, *tangent_center(radius, seen), radius, seen)


def tangent_center(radius: float, situation: Situation) -> Place:
    """North and east (m) of the center of that circle."""
    heading = situation.heading
    return situation.north - radius * math.sin(heading), situation.east + radius * math.cos(heading)


def centre_at(state: State, north: float, east: float, radius: float, seen: Situation) -> State:
    """A circle about a place in m, not joined yet."""
    bearing = math.atan2(seen.east - east, seen.north - north)
    return state._replace(
        centre_north=north, centre_east=east, radius=radius, bearing=bearing, swept=0.0, arrived=0, elapsed=0.0
    )


def around(gains: Gains, state: State, dt: float, altitude: float, seen: Situation) -> tuple[State, Target]:
    """One step on the circle of ``state``: turns and time count from where it is joined."""
    if not seen.valid:
        heading = wrap(seen.heading + math.copysign(BLIND_TURN, state.radius))
        return state, Target(Stage.EN_ROUTE, altitude, heading)
    north, east = seen.north - state.centre_north, seen.east - state.centre_east
    distance, size = math.hypot(north, east), abs(state.radius)
    outside, bearing = distance - size, math.atan2(east, north)
    joined = state.arrived or abs(outside) <= max(JOINED * size, gains.acceptance)
    if joined:
        moved = wrap(bearing - state.bearing) if state.arrived else 0.0
        swept = state.swept + math.copysign(1.0, state.radius) * moved
        state = state._replace(arrived=1, elapsed=state.elapsed + dt, swept=swept)
    ahead = lookahead(gains, seen)
    course = circle_course(state.radius, ahead, north, east)
    on_it = clip(1.0 - abs(outside) / ahead, 0.0, 1.0)
    target = Target(Stage.EN_ROUTE, altitude, course, distance, outside, on_it / state.radius)
    return state._replace(bearing=bearing, heading=course), target


def item(gains: Gains, state: State, dt: float, wanted: MissionItem, seen: Situation) -> tuple[State, Target, bool]:
    """A CIRCLE, a LOITER or a waypoint with a hold time; ``state.radius`` is 0 until it begins."""
    if state.radius == 0.0:
        state = centre_at(state, wanted.north, wanted.east, wanted.radius or gains.loiter_radius, seen)
    state, target = around(gains, state, dt, wanted.altitude, seen)
    return state, target, wanted.kind != ItemKind.LOITER and _flown(gains, state, wanted, seen)


def _flown(gains: Gains, state: State, wanted: MissionItem, seen: Situation) -> bool:
    if not state.arrived:
        return False
    if wanted.turns > 0.0:
        return state.swept >= math.tau * wanted.turns
    if wanted.duration > 0.0:
        return state.elapsed >= wanted.duration
    return abs(wanted.altitude - seen.altitude) <= gains.capture_altitude
