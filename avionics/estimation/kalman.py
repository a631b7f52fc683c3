"""Shared parts of the Kalman filters: filterpy, its frequent cases written out, and constant matrices."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from types import ModuleType
from typing import cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
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


def constant(rows: object) -> Array:
    """Return a read-only array that steps share."""
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array


def predict(x: Array, p: Array, transition: Array, noise: Array, control: Array) -> tuple[Array, Array]:
    """Return state and covariance after one step, those of ``filterpy.kalman.predict`` to the bit.

    Args:
        x: (n,) state.
        p: (n, n) covariance.
        transition: (n, n).
        noise: (n, n) covariance of the process noise.
        control: (n,) effect of the input on the state.
    """
    return transition.dot(x) + control, transition.dot(p).dot(transition.T) + noise


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
