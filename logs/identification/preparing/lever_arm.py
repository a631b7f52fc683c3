"""What sensors away from the centre of mass would have told there.

Klein & Morelli, Aircraft System Identification, 2006, chapter 10 (data compatibility): a
point of a rigid body at r from the centre of mass moves with v + omega x r and accelerates with
a + omega_dot x r + omega x (omega x r). Every r is from the centre of mass to the sensor, in FRD.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from logs.identification.results import Array

ROUNDS = 50
SETTLED = 1e-13
NOWHERE = (0.0, 0.0, 0.0)
Place = tuple[float, float, float]


class AirData(NamedTuple):
    """Flow at a point, every array (N,)."""

    airspeed: Array
    """m/s; true"""
    alpha: Array
    """rad; atan2(w, u)"""
    beta: Array
    """rad; asin(v / V)"""


class AirDataPlaces(NamedTuple):
    """Where the flow is measured, from the centre of mass, FRD, m."""

    airspeed: Place = NOWHERE
    alpha: Place = NOWHERE
    beta: Place = NOWHERE


def acceleration_at_centre(measured: Array, omega: Array, omega_dot: Array, place: Place) -> Array:
    """Specific force (m/s^2; (N, 3), FRD) at the centre of mass from what was ``measured`` (N, 3) at ``place``.

    ``omega`` (rad/s) and ``omega_dot`` (rad/s^2) are (N, 3), FRD.
    """
    r = np.asarray(place, dtype=np.float64)
    moved: Array = measured - np.cross(omega_dot, r) - np.cross(omega, np.cross(omega, r))
    return moved


def velocity_of(air: AirData) -> Array:
    """Velocity through the air (m/s; (N, 3), FRD)."""
    along = air.airspeed * np.cos(air.beta)
    return np.column_stack((along * np.cos(air.alpha), air.airspeed * np.sin(air.beta), along * np.sin(air.alpha)))


def air_data_of(velocity: Array) -> AirData:
    """Flow of a ``velocity`` through the air (m/s; (N, 3), FRD)."""
    u, v, w = velocity.T
    airspeed = np.sqrt(u**2 + v**2 + w**2)
    return AirData(airspeed, np.arctan2(w, u), np.arcsin(np.clip(v / np.maximum(airspeed, 1e-9), -1, 1)))


def measured_air_data(velocity: Array, omega: Array, places: AirDataPlaces) -> AirData:
    """What sensors at ``places`` tell when the centre moves with ``velocity`` and the body turns with ``omega``."""
    at = [air_data_of(velocity + np.cross(omega, np.asarray(place, dtype=np.float64))) for place in places]
    return AirData(at[0].airspeed, at[1].alpha, at[2].beta)


def air_data_at_centre(measured: AirData, omega: Array, places: AirDataPlaces) -> AirData:
    """The flow at the centre of mass from that ``measured`` at ``places``, the body turning with ``omega`` (N, 3).

    Each sensor sees the flow of its own place: what the guess would have made them tell is corrected until it agrees.

    Raises:
        BadInput: it does not come to agree, as when the turn at the sensor's arm outruns the flight.
    """
    guess = measured
    for _ in range(ROUNDS):
        told = measured_air_data(velocity_of(guess), omega, places)
        changes = [have - would for have, would in zip(measured, told, strict=True)]
        guess = AirData(*(value + change for value, change in zip(guess, changes, strict=True)))
        if max(float(np.nanmax(np.abs(change), initial=0.0)) for change in changes) < SETTLED * (
            1 + float(np.nanmax(np.abs(measured.airspeed), initial=0.0))
        ):
            return guess
    raise BadInput("the flow at the centre of mass cannot be told from that at the vanes: too slow for how it turns")


def sideslip_of_flank(flank: Array, alpha: Array) -> Array:
    """Sideslip asin(v / V) (rad) from what a vane on a vertical axis tells, the ``flank`` angle atan2(v, u)."""
    across, along = np.tan(flank), np.tan(alpha)
    slip: Array = np.arcsin(across / np.sqrt(1 + across**2 + along**2))
    return slip
