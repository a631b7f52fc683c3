"""Shared parts of the Kalman filters: filterpy and constant matrices."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
