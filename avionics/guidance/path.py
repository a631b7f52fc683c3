"""Lines and circles over ground: where a place lies on them, and the course that leads onto them."""

from __future__ import annotations

import math
from typing import NamedTuple

from avionics.limits import wrap

Place = tuple[float, float]
"""m; north and east of home"""


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


def leg(start: Place, end: Place, place: Place) -> Leg:
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
    """Course (rad) that joins a circle from (``north``, ``east``) m of its centre.

    ``radius`` in m, positive to be flown clockwise, negative the other way, as MAVLink writes it.
    """
    outward = math.hypot(north, east) - abs(radius)
    turn = 0.5 * math.pi + math.atan2(outward, lookahead)
    return wrap(math.atan2(east, north) + math.copysign(turn, radius))
