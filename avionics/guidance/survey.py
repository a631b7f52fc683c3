"""Survey of an area by parallel legs in alternating directions."""

from __future__ import annotations

import math
from itertools import pairwise

from avionics.guidance.path import Place


def legs(corners: tuple[Place, ...], spacing: float, course: float, overshoot: float) -> list[tuple[Place, Place]]:
    """Return legs that cover a polygon, in flight order.

    Args:
        corners: m; north and east of the corners of the polygon, in order; it may be concave.
        spacing: m; distance between adjacent legs; the first leg is half of it inside the border.
        course: rad; course of the first leg; the directions alternate.
        overshoot: m; extension of each leg beyond the border at both ends, for the turns.
    """
    c, s = math.cos(course), math.sin(course)
    turned = tuple((n * c + e * s, e * c - n * s) for n, e in corners)
    sides = [side for _, side in turned]
    count = max(1, math.ceil((max(sides) - min(sides)) / spacing - 1e-9))
    first = 0.5 * (min(sides) + max(sides) - (count - 1) * spacing)
    flown: list[tuple[Place, Place]] = []
    for number in range(count):
        side = first + number * spacing
        pieces = [(begin - overshoot, end + overshoot) for begin, end in _inside(turned, side)]
        if number % 2:
            pieces = [(end, begin) for begin, end in reversed(pieces)]
        flown += [(_back(begin, side, c, s), _back(end, side, c, s)) for begin, end in pieces]
    return flown


def _inside(turned: tuple[Place, ...], side: float) -> list[tuple[float, float]]:
    """Return begin and end (m) of the segments of a line inside the polygon."""
    met: list[float] = []
    for (a_along, a_side), (b_along, b_side) in pairwise((*turned, turned[0])):
        if (a_side > side) != (b_side > side):
            met.append(a_along + (side - a_side) / (b_side - a_side) * (b_along - a_along))
    met.sort()
    return list(zip(met[::2], met[1::2], strict=True))


def _back(along: float, side: float, c: float, s: float) -> Place:
    return along * c - side * s, along * s + side * c
