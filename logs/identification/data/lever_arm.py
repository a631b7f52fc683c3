"""What accelerometers away from the centre of mass would have told there, and the flow of a velocity.

Klein & Morelli, Aircraft System Identification, 2006, chapter 10 (data compatibility): a
point of a rigid body at r from the centre of mass moves with v + omega x r and accelerates with
a + omega_dot x r + omega x (omega x r). Every r is from the centre of mass to the sensor, in FRD. Vanes and pitot off
the centre are corrected where the motion is fitted to all sensors at once (`estimators.flight_path`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

Place = tuple[float, float, float]


class AirData(NamedTuple):
    """Flow at a point, every array (N,)."""

    airspeed: Array
    """m/s; true"""
    alpha: Array
    """rad; atan2(w, u)"""
    beta: Array
    """rad; asin(v / V)"""


def acceleration_at_centre(measured: Array, omega: Array, omega_dot: Array, place: Place) -> Array:
    """Specific force (m/s^2; (N, 3), FRD) at the centre of mass from what was ``measured`` (N, 3) at ``place``.

    ``omega`` (rad/s) and ``omega_dot`` (rad/s^2) are (N, 3), FRD.
    """
    r = np.asarray(place, dtype=np.float64)
    moved: Array = measured - np.cross(omega_dot, r) - np.cross(omega, np.cross(omega, r))
    return moved


def air_data_of(velocity: Array) -> AirData:
    """Flow of a ``velocity`` through the air (m/s; (N, 3), FRD)."""
    u, v, w = velocity.T
    airspeed = np.sqrt(u**2 + v**2 + w**2)
    return AirData(airspeed, np.arctan2(w, u), np.arcsin(np.clip(v / np.maximum(airspeed, 1e-9), -1, 1)))
