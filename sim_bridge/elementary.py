"""Arctangent, sine and cosine that are laid into the kernels: a call of the C library's costs three times as much.

Strip theory needs two arctangents and one sine and cosine a section, sixteen thousand times a second each: in the C
library they were a quarter of a flight's physics. Both are exact to two units in the last place.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from sim_bridge.compiled import inlined
from sim_bridge.vectors import Floats

STEEP = math.sqrt(2.0) - 1.0
"""-; tangent of 22.5 deg, above which an angle is taken from 45 deg on"""
_DEGREE = 12
"""of the arctangent's polynomial in the tangent squared: its rest is below 1e-17"""


def _arctangent_series(u: Floats) -> Floats:
    """``(atan(z) / z - 1) / z^2`` at ``u = z^2`` by its power series, which loses no digits near zero."""
    signs = np.array([(-1.0) ** n / (2.0 * n + 1.0) for n in range(1, 60)])
    return np.asarray(Polynomial(signs)(u))


def _arctangent_polynomial() -> tuple[float, ...]:
    """Coefficients of `_arctangent_series` from 0 to ``STEEP`` squared, lowest power first."""
    fit = Chebyshev.interpolate(_arctangent_series, _DEGREE, domain=[0.0, STEEP * STEEP])
    return tuple(float(c) for c in fit.convert(kind=Polynomial).coef)


ARCTANGENT = _arctangent_polynomial()
SINE = tuple((-1.0) ** n / math.factorial(2 * n + 1) for n in range(1, 9))
"""coefficients of ``(sin(x) / x - 1) / x^2``, lowest power of x^2 first; the rest is below 1e-18 up to 45 deg"""
COSINE = tuple((-1.0) ** n / math.factorial(2 * n) for n in range(1, 10))
"""coefficients of ``(cos(x) - 1) / x^2``, likewise"""
QUARTER = math.pi / 4.0
"""rad; up to which `small_sine_and_cosine` holds"""


@inlined
def arctangent(y: float, x: float) -> float:
    """Angle in rad, -pi to pi, of a vector ``(x, y)``: ``atan2`` but for the sign of a zero ``x``; 0 of (0, 0)."""
    a, b = abs(y), abs(x)
    # Written so that one of the two is no number where either is.
    low = a if a < b else b
    high = b if a < b else a
    steep = low > STEEP * high
    z = (low - high if steep else low) / (low + high if steep else high if high != 0.0 else 1.0)
    u = z * z
    c0, c1, c2, c3, c4, c5, c6, c7, c8, c9, c10, c11, c12 = ARCTANGENT
    # In halves and quarters, which the processor computes beside each other.
    u2 = u * u
    u4 = u2 * u2
    first = (c0 + c1 * u) + (c2 + c3 * u) * u2
    second = (c4 + c5 * u) + (c6 + c7 * u) * u2
    third = (c8 + c9 * u) + (c10 + c11 * u) * u2
    angle = z + z * u * (first + u4 * (second + u4 * (third + u4 * c12)))
    angle = QUARTER + angle if steep else angle
    angle = 2.0 * QUARTER - angle if a > b else angle
    angle = 4.0 * QUARTER - angle if x < 0.0 else angle
    return math.copysign(angle, y)


@inlined
def small_sine_and_cosine(angle: float) -> tuple[float, float]:
    """Of an ``angle`` of at most `QUARTER` rad: without a branch, for loops that take several at a time."""
    u = angle * angle
    s0, s1, s2, s3, s4, s5, s6, s7 = SINE
    c0, c1, c2, c3, c4, c5, c6, c7, c8 = COSINE
    u2 = u * u
    u4 = u2 * u2
    sine = ((s0 + s1 * u) + (s2 + s3 * u) * u2) + u4 * ((s4 + s5 * u) + (s6 + s7 * u) * u2)
    cosine = ((c0 + c1 * u) + (c2 + c3 * u) * u2) + u4 * ((c4 + c5 * u) + (c6 + c7 * u) * u2 + u4 * c8)
    return angle + angle * u * sine, 1.0 + u * cosine


@inlined
def sine_and_cosine(angle: float) -> tuple[float, float]:
    """Of an ``angle`` in rad; the C library's beyond 45 deg."""
    if abs(angle) > QUARTER:
        return math.sin(angle), math.cos(angle)
    return small_sine_and_cosine(angle)
