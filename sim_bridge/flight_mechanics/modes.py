"""Modes of free flight about a trimmed orbit: logarithms of the stroke map's Floquet multipliers, and their names.

A multiplier mu of the map over a period T is an exponent log(mu)/T, which holds its frequency up to half the flapping
rate alone: what swings faster comes out slower (aliases).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.free_map import BODY, LATERAL, LONGITUDINAL, PITCH, FreeMap, Q, U, W
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError

LEAST_BODY_SHARE = 0.05
"""-; body fraction below which a mode belongs to the wings or the wake"""
TURNING = 0.2
"""s; weight of angular rates against attitudes, about the period of a short period over 2 pi"""
GONE = 1e-7
"""-; a multiplier below it is round-off"""
SHORT_PERIOD, PHUGOID = "short period", "phugoid"
LED_BY = {"speed": (U,), "heave": (W,), "pitch": (Q, PITCH)}
"""states of the body's longitudinal motion by their leading quantity"""
DUTCH_ROLL, SPIRAL, ROLL_SUBSIDENCE = "dutch roll", "spiral", "roll subsidence"


class Mode(NamedTuple):
    """One mode of free flight."""

    eigenvalue: complex
    """1/s; one of a conjugate pair (positive imaginary part), or a real one"""
    body_share: float
    """-; fraction of the mode that is motion of the body, 0 to 1; the rest is wings and wake"""
    pitching_share: float
    """-; fraction of angle of attack and pitch rate in the body's longitudinal motion (the rest is speed and pitch)
    """
    lateral_share: float = 0.0
    """-; fraction of sideslip, roll and yaw in the body's motion: 0 or 1 about a symmetric orbit"""
    name: str = ""
    """one of those above, or leading quantity and type ("pitch oscillation"), or empty for wings and wake"""
    led_by: str = ""
    """quantity with the largest fraction of the body's longitudinal motion, of `LED_BY`"""

    @property
    def natural_frequency(self) -> float:
        """rad/s."""
        return abs(self.eigenvalue)

    @property
    def damping(self) -> float:
        """Damping ratio; 1 or -1 for a real eigenvalue."""
        return -self.eigenvalue.real / abs(self.eigenvalue)

    @property
    def period(self) -> float:
        """s; infinite without an oscillation."""
        return 2.0 * math.pi / self.eigenvalue.imag if self.eigenvalue.imag else math.inf

    @property
    def time_to_half(self) -> float:
        """s; negative: time to double."""
        return -math.log(2.0) / self.eigenvalue.real if self.eigenvalue.real else math.inf

    @property
    def lateral(self) -> bool:
        """Whether it is lateral motion."""
        return self.lateral_share > 0.5


def modes(vehicle: SimulatedVehicle, orbit: Orbit) -> list[Mode]:
    """Compute every mode of the stroke map, slowest first, and name those of the body; see `aliases`."""
    free = FreeMap(vehicle, orbit)
    multipliers, vectors = np.linalg.eig(free.jacobian())
    solutions = []
    for multiplier, vector in zip(multipliers, vectors.T, strict=True):
        if multiplier.imag < 0.0 or abs(multiplier) < GONE:
            continue
        eigenvalue = complex(np.log(complex(multiplier))) * orbit.inputs.frequency
        shares, led_by = _shares(vector, orbit, free.coordinates)
        solutions.append(Mode(eigenvalue, *shares, led_by=led_by))
    return named(sorted(solutions, key=lambda mode: abs(mode.eigenvalue)))


def aliases(mode: Mode, frequency: float) -> bool:
    """Return whether a mode is faster than half the flapping ``frequency`` in Hz and may be aliased."""
    return mode.eigenvalue.imag != 0.0 and mode.natural_frequency > math.pi * frequency


def named(solutions: list[Mode]) -> list[Mode]:
    """Name the body's modes among ``solutions``, slowest first.

    Longitudinal: the slowest mode that is mainly speed and pitch, and the slowest that is mainly angle of attack and
    pitch rate, unless that oscillation is unstable, as for an insect, which has no short period. Those and other body
    modes are named after their leading quantity. Lateral: the slowest oscillation, the slowest and the next aperiodic
    one.
    """
    body = [i for i, mode in enumerate(solutions) if mode.body_share > LEAST_BODY_SHARE]
    along = [i for i in body if not solutions[i].lateral]
    across = [i for i in body if solutions[i].lateral]
    pitching = [i for i in along if solutions[i].pitching_share > 0.5]
    swings_up = any(solutions[i].eigenvalue.imag and solutions[i].eigenvalue.real > 0.0 for i in pitching)
    aperiodic = [i for i in across if solutions[i].eigenvalue.imag == 0.0]
    chosen = {
        PHUGOID: [i for i in along if solutions[i].pitching_share <= 0.5][:1],
        SHORT_PERIOD: [] if swings_up else pitching[:1],
        DUTCH_ROLL: [i for i in across if solutions[i].eigenvalue.imag > 0.0][:1],
        SPIRAL: aperiodic[:1],
        ROLL_SUBSIDENCE: aperiodic[1:2],
    }
    names = {i: _led(solutions[i]) for i in along if solutions[i].body_share > 0.5}
    names |= {i: name for name, places in chosen.items() for i in places}
    return [mode._replace(name=names.get(i, "")) for i, mode in enumerate(solutions)]


def _led(mode: Mode) -> str:
    if mode.eigenvalue.imag:
        return f"{mode.led_by} oscillation"
    return f"{mode.led_by} {'divergence' if mode.eigenvalue.real > 0.0 else 'subsidence'}"


def _shares(vector: Floats, orbit: Orbit, coordinates: int) -> tuple[tuple[float, float, float], str]:
    rates = slice(BODY + coordinates, BODY + 2 * coordinates)
    scale = np.ones(vector.shape[0])
    scale[:3] = scale[rates.stop :] = 1.0 / orbit.means.airspeed
    scale[3:6] = TURNING
    scale[rates] = 1.0 / (2.0 * math.pi * orbit.inputs.frequency)
    weight = np.abs(vector * scale) ** 2
    body, lateral = float(np.sum(weight[:BODY])), float(np.sum(weight[list(LATERAL)]))
    along = float(np.sum(weight[list(LONGITUDINAL)]))
    pitching = float(weight[W] + weight[Q]) / max(along, 1e-300)
    led_by = max(LED_BY, key=lambda name: float(np.sum(weight[list(LED_BY[name])])))
    return (body / float(np.sum(weight)), pitching, lateral / max(body, 1e-300)), led_by


def short_period(solutions: list[Mode]) -> Mode:
    """Return the short-period mode.

    Raises:
        InputError: there is none.
    """
    for mode in solutions:
        if mode.name == SHORT_PERIOD:
            return mode
    raise InputError("this flight has no short-period mode")
