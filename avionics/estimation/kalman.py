"""What the Kalman filters share: filterpy, and matrices that many steps have in common."""

from __future__ import annotations

from functools import cache
from types import ModuleType
from typing import cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@cache
def filterpy() -> ModuleType:
    """filterpy's functions, imported at the first call: it takes a second, which a reader of gains is spared."""
    import filterpy.kalman as functions

    return cast(ModuleType, functions)


def constant(rows: object) -> Array:
    """An array of numbers that steps share, so that none of them may write to it."""
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array
