"""Kalman filter of a few states in NumPy, and constant matrices.

The operations and their order are those of ``filterpy.kalman``, so the results are bit-identical (see the tests).
Importing filterpy loads ``scipy.stats``, which takes the flight computer as long as everything else together.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def predict(x: Array, p: Array, f: Array, q: Array, u: float | Array, b: Array) -> tuple[Array, Array]:
    """Propagate the state and its covariance by one step.

    Args:
        x: state of n elements.
        p: covariance (n, n).
        f: transition matrix (n, n).
        q: process noise covariance (n, n).
        u: control input, a scalar or m elements.
        b: effect of the input, n elements or (n, m).
    """
    return f.dot(x) + b.dot(u), f.dot(p).dot(f.T) + q


def update(x: Array, p: Array, z: Array, r: Array, h: Array) -> tuple[Array, Array]:
    """Correct the state and its covariance with a measurement, in the Joseph form.

    Args:
        x: state of n elements.
        p: covariance (n, n).
        z: measurement of m elements.
        r: measurement noise covariance (m, m).
        h: measurement matrix (m, n).
    """
    s = h.dot(p).dot(h.T) + r
    k = p.dot(h.T).dot(np.linalg.inv(s))
    remainder = np.eye(len(x)) - k.dot(h)
    return x + k.dot(z - h.dot(x)), remainder.dot(p).dot(remainder.T) + k.dot(r).dot(k.T)


def constant(rows: object) -> Array:
    """Return a read-only array that steps share."""
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array
