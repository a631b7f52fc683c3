"""Wing twist as Gerdes 2017 models it: a spring, a mass and a damper that ring after each stroke reversal.

The functions carry the corrections that the printed equations need: Eq. 14 divides a torsional stiffness by a mass,
so that a moment of inertia stands here; in Eq. 16 the first theta_0 of the second term must be its rate.
"""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.aerodynamics.protocol import Strips
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError


def twist_stiffness(flexural_rigidity: float, chord: float, proportion: float) -> float:
    """Compute the torsional stiffness in N m/rad, Gerdes Eq. 13: ``proportion`` (B, m^2/rad) times 3 E I / L^3.

    The spars of rigidity E I in N m^2 are cantilevered over the ``chord`` in m, so the stiffness of wings of one spar
    material decreases with the cube of the chord.
    """
    return 3.0 * flexural_rigidity / chord**3 * proportion


def scaled_stiffness(stiffness: float, chord: float, other_chord: float) -> float:
    """Scale the stiffness in N m/rad from ``chord`` to ``other_chord`` for equal spars (Eq. 13)."""
    return stiffness * (chord / other_chord) ** 3


def twist_inertia(strips: Strips, membrane: Floats, density: float) -> float:
    """Compute the moment of inertia in kg m^2 of one wing's tip twist: membrane and apparent mass.

    ``strips`` are one wing's; ``membrane`` (n,) in kg at mid-chord; ``density`` of the air in kg/m^3. The twist is
    linear from root to tip, about the leading edge.
    """
    apparent = density * math.pi * strips.chord**2 / 4.0 * strips.width
    own = (membrane + apparent) * strips.chord**2 / 4.0 + apparent * strips.chord**2 / 32.0
    return float(np.sum(strips.eta**2 * own))


def natural_frequency(stiffness: float, inertia: float) -> float:
    """Compute the natural frequency in rad/s, Gerdes Eq. 14 with the moment of inertia in kg m^2 for the mass."""
    return math.sqrt(stiffness / inertia)


def damped_frequency(natural: float, damping_ratio: float) -> float:
    """Compute the damped frequency in rad/s, Gerdes Eq. 15.

    Raises:
        InputError: the damping ratio is not between 0 and 1: there is no oscillation.
    """
    if not 0.0 <= damping_ratio < 1.0:
        raise InputError(f"damping_ratio = {damping_ratio:g} is outside 0 to 1: the twist does not oscillate")
    return natural * math.sqrt(1.0 - damping_ratio**2)


def twist_damping(damping_ratio: float, stiffness: float, inertia: float) -> float:
    """Compute the damping in N m s/rad of a damping ratio: 2 zeta omega_n J."""
    return 2.0 * damping_ratio * natural_frequency(stiffness, inertia) * inertia


def free_twist(time: Floats, start: float, start_rate: float, natural: float, damping_ratio: float) -> Floats:
    """Compute the free twist in rad at ``time`` (n,) s from ``start`` rad with ``start_rate`` rad/s, Gerdes Eq. 16.

    Raises:
        InputError: see `damped_frequency`.
    """
    damped, decay = damped_frequency(natural, damping_ratio), damping_ratio * natural
    swing = start * np.cos(damped * time) + (start_rate + decay * start) / damped * np.sin(damped * time)
    return np.asarray(np.exp(-decay * time) * swing)


def damping_ratio(overshoot: float) -> float:
    """Compute the damping ratio of a second-order step response from its relative overshoot, Gerdes Eq. 17.

    Raises:
        InputError: the overshoot is not between 0 and 1.
    """
    if not 0.0 < overshoot < 1.0:
        raise InputError(f"overshoot = {overshoot:g} is outside 0 to 1")
    log = math.log(overshoot)
    return abs(log) / math.hypot(math.pi, log)


def overshoot(damping_ratio: float) -> float:
    """Compute the relative overshoot of a second-order step response: the inverse of Eq. 17.

    Raises:
        InputError: see `damped_frequency`.
    """
    return math.exp(-math.pi * damping_ratio / damped_frequency(1.0, damping_ratio))
