"""What truth and sensors need of the plant at one instant, turned into their axes once for both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, njit
from sim_bridge.observation import Vector
from sim_bridge.plant import Plant


class Instant(NamedTuple):
    """Vehicle state and velocities at the end of a step."""

    y: list[float]
    """the plant's state"""
    v_ned: Vector
    """m/s; velocity of the base's origin over ground"""
    v_air_frd: Vector
    """m/s; velocity of the base's origin relative to the air"""
    v_pitot_frd: Vector
    """m/s; velocity of the nose with the pitot tube relative to the air"""


class Look:
    """Observer of one plant."""

    def __init__(self, plant: Plant, nose: float) -> None:
        """Observe a plant whose pitot tube is ``nose`` m ahead of the base's origin."""
        self._plant, self._nose = plant, nose
        self._turned = np.zeros(9)
        self._bound = Bound((plant.y, plant.scratch.r, self._turned))

    def at(self, wind: Vector) -> Instant:
        """Return the present state of the plant in air that moves with ``wind`` in m/s, NED."""
        _turn(self._bound, wind, self._nose)
        a, b, c, d, e, f, g, h, i = self._turned.tolist()
        return Instant(self._plant.y.tolist(), (a, b, c), (d, e, f), (g, h, i))


@njit(cache=True)
def _turn(bound: Bound, wind: Vector, nose: float) -> None:
    """Compute the velocities of an `Instant` into ``out`` (9,) from the state and r_ned_from_frd (3, 3)."""
    y, r, out = bound_values(bound)
    north, east, down = wind
    for i in range(3):
        out[i] = r[i, 0] * y[7] + r[i, 1] * y[8] + r[i, 2] * y[9]
        out[3 + i] = y[7 + i] - (r[0, i] * north + r[1, i] * east + r[2, i] * down)
    out[6] = out[3]
    out[7] = y[8] + y[12] * nose - (r[0, 1] * north + r[1, 1] * east + r[2, 1] * down)
    out[8] = y[9] - y[11] * nose - (r[0, 2] * north + r[1, 2] * east + r[2, 2] * down)
