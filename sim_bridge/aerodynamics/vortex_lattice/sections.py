"""Mean lines of wing sections: flat, NACA's four and five digits, and tables of points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

FIVE_DIGITS = {"210": (0.0580, 361.4), "220": (0.1260, 51.64), "230": (0.2025, 15.957), "240": (0.2900, 6.643),
               "250": (0.3910, 3.230)}  # fmt: skip
"""m and k1 of the five-digit mean lines with a simple curve (Abbott and von Doenhoff 1959, 6.5)"""


class MeanLine(NamedTuple):
    """A mean line by points, linear between them."""

    x: Floats
    """(k,) -; chords behind the leading edge, growing from 0 to 1"""
    z: Floats
    """(k,) -; chords above the chord line"""

    def height(self, x: Floats) -> Floats:
        """Chords above the chord line at ``x`` chords behind the leading edge."""
        return np.interp(x, self.x, self.z)


FLAT = MeanLine(np.array([0.0, 1.0]), np.zeros(2))


def naca(digits: str, points: int = 401) -> MeanLine:
    """The mean line of ``naca("2412")`` or ``naca("23012")`` (Abbott and von Doenhoff 1959, Eq. 6.4 and 6.6).

    Raises:
        InputError: not four digits, nor five of a known mean line.
    """
    x = 0.5 * (1.0 - np.cos(np.linspace(0.0, math.pi, points)))
    if len(digits) == 4 and digits.isdigit():
        return MeanLine(x, _four(x, int(digits[0]) / 100.0, int(digits[1]) / 10.0))
    if len(digits) == 5 and digits.isdigit() and digits[:3] in FIVE_DIGITS:
        return MeanLine(x, _five(x, *FIVE_DIGITS[digits[:3]]))
    raise InputError(
        f"NACA {digits} is none of the four-digit sections, nor of {', '.join(FIVE_DIGITS)} with two more"
    )


def _four(x: Floats, m: float, p: float) -> Floats:
    if m == 0.0 or p == 0.0:
        return np.zeros_like(x)
    ahead = m / p**2 * (2.0 * p * x - x**2)
    behind = m / (1.0 - p) ** 2 * (1.0 - 2.0 * p + 2.0 * p * x - x**2)
    return np.where(x < p, ahead, behind)


def _five(x: Floats, m: float, k1: float) -> Floats:
    ahead = k1 / 6.0 * (x**3 - 3.0 * m * x**2 + m**2 * (3.0 - m) * x)
    return np.where(x < m, ahead, k1 * m**3 / 6.0 * (1.0 - x))


def tabled(x: Floats, z: Floats) -> MeanLine:
    """A mean line of points in chords, from the leading edge back.

    Raises:
        InputError: fewer than two points, not as many heights, or places that do not grow from 0 to 1.
    """
    x, z = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
    if x.ndim != 1 or x.shape != z.shape or len(x) < 2 or not np.all(np.isfinite(np.concatenate((x, z)))):
        raise InputError("a camber table needs two points or more, each with a place and a height in chords")
    if x[0] != 0.0 or x[-1] != 1.0 or np.any(np.diff(x) <= 0.0):
        raise InputError("a camber table's places must grow from 0 at the leading edge to 1 at the trailing edge")
    return MeanLine(x, z)
