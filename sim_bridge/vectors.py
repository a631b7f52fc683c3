"""Small vector kernels shared by the physics; quaternions are (w, x, y, z) of r_ned_from_frd."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_bridge.compiled import inlined, kernel, noalias

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Indices = NDArray[np.uint64]
"""a loop that starts at an unsigned index needs no test for an index that counts from the end of an array"""


@kernel
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """``out = a x b`` for arrays of three; ``out`` may not be ``a`` or ``b``."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@noalias
def add_scaled(a: Floats, factor: float, b: Floats, out: Floats) -> None:
    """``out = a + factor b``, each (n,)."""
    for i in range(a.shape[0]):
        out[i] = a[i] + factor * b[i]


@inlined
def rotation(w: float, x: float, y: float, z: float, out: Floats) -> None:
    """Fill ``out`` (3, 3) with r_ned_from_frd of a quaternion that need not be of unit length."""
    s = 2.0 / (w * w + x * x + y * y + z * z)
    out[0, 0] = 1.0 - s * (y * y + z * z)
    out[0, 1] = s * (x * y - z * w)
    out[0, 2] = s * (x * z + y * w)
    out[1, 0] = s * (x * y + z * w)
    out[1, 1] = 1.0 - s * (x * x + z * z)
    out[1, 2] = s * (y * z - x * w)
    out[2, 0] = s * (x * z - y * w)
    out[2, 1] = s * (y * z + x * w)
    out[2, 2] = 1.0 - s * (x * x + y * y)
