"""How far a loop is from instability: python-control's margins of its open loop, and the poles of the closed one."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_bridge.vectors import Floats

Complex = NDArray[np.complex128]

SLOWEST, FASTEST, POINTS = 0.01, 400.0, 1500
"""rad/s, rad/s, -: grid of the frequency responses"""


class Limits(NamedTuple):
    """Limits of a designed loop."""

    gain_margin_db: float = 6.0
    """dB; least gain margin, for an increase or a decrease"""
    phase_margin: float = math.radians(45.0)
    """rad"""
    sensitivity: float = 2.0
    """-; largest magnitude of 1/(1 + L): limits the distance of L to -1 between its crossings (Astrom and Murray)"""
    resonance: float = 1.3
    """-; largest magnitude of the closed loop from setpoint to controlled variable"""


LIMITS = Limits()
GUIDANCE = Limits(sensitivity=1.5)
"""Limits of the outer loops, which are more conservative because of gusts and of rate and thrust saturation; chosen:
1.4 to 2 is usual
"""


class Margins(NamedTuple):
    """Margins of an open loop."""

    gain_db: float
    """dB; smallest gain change, up or down, that makes the loop unstable; infinite without one"""
    phase: float
    """rad; smallest at any gain crossover; infinite without one"""
    crossover: float
    """rad/s; highest frequency of gain 1; 0 without one"""
    sensitivity: float
    """-; largest magnitude of 1/(1 + L)"""
    stable: bool
    """whether the closed loop is stable"""

    def keeps(self, limits: Limits) -> bool:
        """Return whether the loop is stable and meets the gain and phase margins."""
        return self.stable and self.gain_db >= limits.gain_margin_db and self.phase >= limits.phase_margin


def frequencies() -> Floats:
    """Return (POINTS,) rad/s, equally spaced in the logarithm."""
    return np.geomspace(SLOWEST, FASTEST, POINTS)


def response(system: Any, omega: Floats) -> Complex:
    """Compute the frequency response (outputs, inputs, n) at ``omega`` rad/s; (n,) for one input and output.

    All frequencies are computed in one call, because python-control without slycot computes them one by one.
    """
    resolvent = 1j * omega[:, None, None] * np.eye(system.nstates) - system.A
    found: Complex = np.moveaxis(system.C @ np.linalg.solve(resolvent, system.B) + system.D, 0, -1)
    return found[0, 0] if found.shape[:2] == (1, 1) else found


def margins(open_loop: Any) -> Margins:
    """Compute the margins of a single-input, single-output system with negative feedback."""
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
    """Return the frequency in rad/s up to which a closed-loop response (n,) stays above -3 dB of 1."""
    below = np.flatnonzero(np.abs(closed) < math.sqrt(0.5))
    if len(below) == 0 or below[0] == 0:
        return float(omega[-1]) if len(below) == 0 else 0.0
    i = int(below[0])
    (low, high), levels = np.log(omega[i - 1 : i + 1]), np.log(np.abs(closed[i - 1 : i + 1]))
    share = (levels[0] - 0.5 * math.log(0.5)) / (levels[0] - levels[1])
    return float(math.exp(low + share * (high - low)))
