"""Modes of the stroke-averaged flight: logarithm of the stroke map's Jacobian (Floquet)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge.flight_mechanics.orbit import BODY_STATES, Orbit, StrokeMap
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle

LEAST_BODY_SHARE = 0.003
"""-; below it a mode is one of the wings or of the wake: a body's mode moves the wings much more than itself"""


class Mode(NamedTuple):
    """One mode of the stroke-averaged motion."""

    eigenvalue: complex
    """1/s; one of a conjugate pair (positive imaginary part), or a real one"""
    body_share: float
    """-; how much of the mode is motion of the body, 0 to 1"""
    pitching_share: float
    """-; share of angle of attack and pitch rate in the body's motion (the rest is speed and pitch)"""

    @property
    def natural_frequency(self) -> float:
        """rad/s."""
        return abs(self.eigenvalue)

    @property
    def damping(self) -> float:
        """Damping ratio."""
        return -self.eigenvalue.real / abs(self.eigenvalue)


def jacobian(vehicle: SimulatedVehicle, orbit: Orbit) -> Floats:
    """Monodromy matrix (n, n) of the stroke map about the orbit, by central differences."""
    stroke = StrokeMap(vehicle)
    columns = []
    for i in range(stroke.size):
        step = 1e-5 * max(1.0, abs(orbit.state[i]))
        ends = []
        for sign in (1.0, -1.0):
            moved = orbit.state.copy()
            moved[i] += sign * step
            ends.append(stroke(moved, orbit.inputs))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.array(columns).T


def modes(vehicle: SimulatedVehicle, orbit: Orbit) -> list[Mode]:
    """Every mode of the stroke map, slowest first; frequencies beyond half the flapping frequency alias."""
    multipliers, vectors = np.linalg.eig(jacobian(vehicle, orbit))
    memory = StrokeMap(vehicle).memory
    found = []
    for multiplier, vector in zip(multipliers, vectors.T, strict=True):
        if multiplier.imag < 0.0 or abs(multiplier) < 1e-9:
            continue
        eigenvalue = complex(np.log(multiplier)) * orbit.inputs.frequency
        found.append(Mode(eigenvalue, *_shares(vector, orbit, memory)))
    return sorted(found, key=lambda mode: abs(mode.eigenvalue))


def _shares(vector: Floats, orbit: Orbit, memory: int) -> tuple[float, float]:
    speed = orbit.means.airspeed
    scale = np.ones(vector.shape[0])
    scale[:2] = 1.0 / speed
    scale[2] = 0.2
    scale[memory:] = 1.0 / speed
    weight = np.abs(vector * scale) ** 2
    body = float(np.sum(weight[:BODY_STATES]))
    return body / float(np.sum(weight)), float(weight[1] + weight[2]) / max(body, 1e-300)


def short_period(found: list[Mode]) -> Mode:
    """The slowest mode in which the body moves mainly in angle of attack and pitch rate.

    Raises:
        BadInput: there is none.
    """
    for mode in found:
        if mode.body_share > LEAST_BODY_SHARE and mode.pitching_share > 0.5:
            return mode
    raise BadInput("this flight has no short-period mode")
