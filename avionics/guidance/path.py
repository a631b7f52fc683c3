"""Lines and circles over ground: relative position and intercept course."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.limits import wrap

Place = tuple[float, float]
"""m; north and east of home"""


class Leg(NamedTuple):
    """Straight line over ground and a position relative to it."""

    course: float
    """rad; course of the leg"""
    length: float
    """m"""
    along: float
    """m; distance of the position along the leg"""
    cross: float
    """m; distance of the position to the right of the leg"""


def leg(start: Place, end: Place, place: Place) -> Leg:
    """Return the leg from ``start`` to ``end`` (m) relative to ``place``."""
    north, east = end[0] - start[0], end[1] - start[1]
    length = math.hypot(north, east)
    course = math.atan2(east, north)
    c, s = math.cos(course), math.sin(course)
    dn, de = place[0] - start[0], place[1] - start[1]
    return Leg(course, length, dn * c + de * s, de * c - dn * s)


def course_to_leg(line: Leg, lookahead: float) -> float:
    """Return the course (rad) toward a point on the leg ``lookahead`` m ahead."""
    return wrap(line.course - math.atan2(line.cross, lookahead))


def reached(line: Leg, acceptance: float) -> bool:
    """Return whether the end of the leg is within ``acceptance`` (m) or was passed."""
    return math.hypot(line.length - line.along, line.cross) <= acceptance or line.along >= line.length


def circle_course(radius: float, lookahead: float, north: float, east: float) -> float:
    """Return the course (rad) that intercepts a circle.

    The position is (``north``, ``east``) m from the center. ``radius`` in m is positive clockwise and negative
    counterclockwise, as in MAVLink.
    """
    outward = math.hypot(north, east) - abs(radius)
    turn = 0.5 * math.pi + math.atan2(outward, lookahead)
    return wrap(math.atan2(east, north) + math.copysign(turn, radius))
