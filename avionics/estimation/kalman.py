"""Shared parts of the Kalman filters: filterpy, and its frequent cases written out.

The written-out cases are faster than small NumPy arrays, and do not depend on the kernel that a BLAS has for the
processor, which may round products differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import cast

Pair = tuple[float, float]
Symmetric2 = tuple[float, float, float]
"""upper triangle of a (2, 2) matrix, row by row"""
Vector3 = tuple[float, float, float]
Rows3 = Sequence[Sequence[float]]
"""(3, 3)"""


@cache
def filterpy() -> ModuleType:
    """Import filterpy at the first call.

    The import takes about a second and is not required to read parameters.
    """
    import filterpy.kalman as functions

    return cast(ModuleType, functions)


def update_first(x: Sequence[float], p: Rows3, measured: float, variance: float) -> tuple[Vector3, Rows3]:
    """Return state and covariance after a measurement of the first of three states.

    The Joseph form (I - K H) P (I - K H)' + K R K' with H = (1, 0, 0), in the order of the sums of
    ``filterpy.kalman.update``, whose result it has to the bit.
    """
    x0, x1, x2 = x
    (a, b, c), (d, e, f), (g, h, i) = p
    inverse, innovation = 1.0 / (a + variance), measured - x0
    k0, k1, k2 = a * inverse, d * inverse, g * inverse
    rest = 1.0 - k0
    d, e, f = d - k1 * a, e - k1 * b, f - k1 * c
    g, h, i = g - k2 * a, h - k2 * b, i - k2 * c
    a, b, c = rest * a, rest * b, rest * c
    r0, r1, r2 = k0 * variance, k1 * variance, k2 * variance
    return (x0 + k0 * innovation, x1 + k1 * innovation, x2 + k2 * innovation), (
        (a * rest + r0 * k0, b - a * k1 + r0 * k1, c - a * k2 + r0 * k2),
        (d * rest + r1 * k0, e - d * k1 + r1 * k1, f - d * k2 + r1 * k2),
        (g * rest + r2 * k0, h - g * k1 + r2 * k1, i - g * k2 + r2 * k2),
    )


def update_pair(x: Pair, p: Symmetric2, measured: Pair, variances: Pair) -> tuple[Pair, Symmetric2]:
    """Return state and covariance after measurements of both of two states, with independent errors.

    The Joseph form for one after the other, which has the result of ``filterpy.kalman.update`` with H = I.
    """
    (x0, x1), (a, b, c), (z0, z1), (r0, r1) = x, p, measured, variances
    x0, x1, a, b, c = _update_one(x0, x1, a, b, c, z0, r0)
    x1, x0, c, b, a = _update_one(x1, x0, c, b, a, z1, r1)
    return (x0, x1), (a, b, c)


def _update_one(
    x0: float, x1: float, a: float, b: float, c: float, measured: float, variance: float
) -> tuple[float, float, float, float, float]:
    """Return two states and the upper triangle of their covariance after a measurement of the first."""
    inverse, innovation = 1.0 / (a + variance), measured - x0
    k0, k1 = a * inverse, b * inverse
    rest, shared = 1.0 - k0, b - k1 * a
    return (
        x0 + k0 * innovation,
        x1 + k1 * innovation,
        rest * a * rest + k0 * variance * k0,
        rest * shared + k0 * variance * k1,
        c - k1 * b - k1 * shared + k1 * variance * k1,
    )
