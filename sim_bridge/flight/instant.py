"""What truth and sensors need of the plant at one instant, turned into their axes once for both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.observation import Vector, new
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats, njit


class Instant(NamedTuple):
    """The vehicle at the end of a step."""

    y: list[float]
    """the plant's state"""
    v_ned: Vector
    """m/s; of the base's origin over ground"""
    v_air_frd: Vector
    """m/s; of the base's origin through the air"""
    v_pitot_frd: Vector
    """m/s; of the nose, where the pitot is, through the air"""


class Look:
    """Looks at one plant."""

    def __init__(self, plant: Plant, nose: float) -> None:
        """``nose`` in m is how far ahead of the base's origin the pitot is."""
        self._plant, self._nose = plant, nose
        self._turned = np.zeros(9)

    def at(self, wind: Vector) -> Instant:
        """The plant as it is now, in air that moves with ``wind`` in m/s, NED."""
        plant, turned = self._plant, self._turned
        _turn(plant.y, plant.scratch.r, wind[0], wind[1], wind[2], self._nose, turned)
        a, b, c, d, e, f, g, h, i = turned.tolist()
        return new(Instant, (plant.y.tolist(), (a, b, c), (d, e, f), (g, h, i)))


@njit(cache=True)
def _turn(y: Floats, r: Floats, north: float, east: float, down: float, nose: float, out: Floats) -> None:
    """Fill ``out`` (9,) with the velocities of an `Instant`; ``r`` (3, 3) is r_ned_from_frd."""
    for i in range(3):
        out[i] = r[i, 0] * y[7] + r[i, 1] * y[8] + r[i, 2] * y[9]
        out[3 + i] = y[7 + i] - (r[0, i] * north + r[1, i] * east + r[2, i] * down)
    out[6] = out[3]
    out[7] = y[8] + y[12] * nose - (r[0, 1] * north + r[1, 1] * east + r[2, 1] * down)
    out[8] = y[9] - y[11] * nose - (r[0, 2] * north + r[1, 2] * east + r[2, 2] * down)
