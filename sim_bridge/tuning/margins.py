"""How far a loop is from instability: python-control's margins of its open loop, and the poles of the closed one."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_bridge.vectors import Floats

Complex = NDArray[np.complex128]

SLOWEST, FASTEST, POINTS = 0.01, 400.0, 1500
"""rad/s, rad/s, -: where frequency responses are looked at"""


class Limits(NamedTuple):
    """What a designed loop keeps."""

    gain_margin_db: float = 6.0
    """dB; change of the loop's gain, up or down, that it stands"""
    phase_margin: float = math.radians(45.0)
    """rad"""
    sensitivity: float = 2.0
    """-; greatest magnitude of 1/(1 + L): keeps L from passing by -1 between its crossings (Astrom and Murray)"""
    resonance: float = 1.3
    """-; greatest magnitude of the closed loop from setpoint to what follows it"""


LIMITS = Limits()
GUIDANCE = Limits(sensitivity=1.5)
"""of the outer loops, calmer: they meet gusts, and rates and thrust that saturate; chosen: 1.4 to 2 is usual"""


class Margins(NamedTuple):
    """Of one open loop."""

    gain_db: float
    """dB; smallest change of the gain, up or down, at which the loop turns unstable; infinite where none does"""
    phase: float
    """rad; smallest at any gain crossover; infinite without one"""
    crossover: float
    """rad/s; highest frequency of gain 1; 0 without one"""
    sensitivity: float
    """-; greatest magnitude of 1/(1 + L)"""
    stable: bool
    """whether the closed loop is"""

    def keeps(self, limits: Limits) -> bool:
        """Whether the loop is stable and has the gain and phase margin asked for."""
        return self.stable and self.gain_db >= limits.gain_margin_db and self.phase >= limits.phase_margin


def frequencies() -> Floats:
    """(POINTS,) rad/s, equally spaced in the logarithm."""
    return np.geomspace(SLOWEST, FASTEST, POINTS)


def response(system: Any, omega: Floats) -> Complex:
    """Frequency response (outputs, inputs, n) of a python-control system at ``omega`` rad/s; (n,) of a single one.

    All frequencies in one call: python-control, without slycot, solves for one after the other.
    """
    resolvent = 1j * omega[:, None, None] * np.eye(system.nstates) - system.A
    found: Complex = np.moveaxis(system.C @ np.linalg.solve(resolvent, system.B) + system.D, 0, -1)
    return found[0, 0] if found.shape[:2] == (1, 1) else found


def margins(open_loop: Any) -> Margins:
    """Margins of a single-input, single-output system that negative feedback closes."""
    import control

    omega = frequencies()
    loop = response(open_loop, omega)
    gains, phases, _, _, crossovers, _ = control.stability_margins(control.frd(loop, omega), returnall=True)
    levels = [abs(20.0 * math.log10(gain)) for gain in gains if gain > 0.0]
    angles = [abs(math.radians(angle)) for angle in phases]
    distance = float(np.min(np.abs(1.0 + loop)))
    stable = bool(np.all(control.feedback(open_loop, 1).poles().real < 0.0))
    nearest = min(levels, default=math.inf), min(angles, default=math.inf)
    return Margins(*nearest, float(max(crossovers, default=0.0)), 1.0 / distance, stable)


def bandwidth(omega: Floats, closed: Complex) -> float:
    """rad/s; up to which a closed loop's response (n,) stays above -3 dB of its steady one, taken as 1."""
    below = np.flatnonzero(np.abs(closed) < math.sqrt(0.5))
    if len(below) == 0 or below[0] == 0:
        return float(omega[-1]) if len(below) == 0 else 0.0
    i = int(below[0])
    (low, high), levels = np.log(omega[i - 1 : i + 1]), np.log(np.abs(closed[i - 1 : i + 1]))
    share = (levels[0] - 0.5 * math.log(0.5)) / (levels[0] - levels[1])
    return float(math.exp(low + share * (high - low)))
