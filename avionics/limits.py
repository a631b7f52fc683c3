"""Functions shared by the loops: limits, low-pass filters, interpolation."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

TWO_PI: Final = 2.0 * math.pi


def clip(value: float, low: float, high: float) -> float:
    """Limit ``value`` to the range from ``low`` to ``high``; a NaN gives ``low``."""
    if value > high:
        return high
    return value if value > low else low


def slew(previous: float, target: float, rate: float, dt: float) -> float:
    """Move from ``previous`` toward ``target`` within a rate limit.

    The change is at most ``rate`` per second over ``dt`` (s).
    """
    step = rate * dt
    low, high = previous - step, previous + step
    if target > high:
        return high
    return target if target > low else low


def wrap(angle: float) -> float:
    """Return the equivalent angle (rad) between -pi and pi."""
    if -math.pi <= angle <= math.pi:
        return angle
    return (angle + math.pi) % TWO_PI - math.pi


def low_pass(previous: float, value: float, time_constant: float, dt: float) -> float:
    """Return a first-order low-pass with ``time_constant`` (s) after ``dt`` (s).

    The discretization is backward Euler, which is stable for every ``dt``.
    """
    return previous + (value - previous) * dt / (time_constant + dt)


def fade_out(value: float, time_constant: float, dt: float) -> float:
    """Return ``value`` after an exponential decay of ``dt`` (s).

    The result is zero once it is below a millionth.
    """
    left = value * time_constant / (time_constant + dt)
    return left if abs(left) > 1e-6 else 0.0


def between_points(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """Interpolate (``xs`` rising, ``ys``) linearly, constant outside the range."""
    i = bisect_left(xs, x)
    if i == 0:
        return ys[0]
    if i == len(xs):
        return ys[-1]
    return ys[i - 1] + (ys[i] - ys[i - 1]) * (x - xs[i - 1]) / (xs[i] - xs[i - 1])
