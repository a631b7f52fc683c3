"""Wagner and Theodorsen: a thin aerofoil started at once, and heaving and pitching, beside the vortex lattice.

The lattice is one column of panels of a wing so long that nothing comes around its tips. Its wake's cores are as thin
as its bound vortices', as theirs are: a thick core takes from the newest row, a panel's length behind the edge, what
it does to the last panel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import hankel2

from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, History, NodeMotion, Scheme, run
from sim_bridge.vectors import Floats

ASPECT = 1000.0
"""-; chords per half span"""
ROWS = 20
"""panels along the chord; a time step is the passage of one panel"""
START_ANGLE = math.radians(2.0)
AMPLITUDE = 0.02
"""chords of heave, rad of pitch"""
PITCH_AXIS = 0.25
"""-; chords behind the leading edge"""
CYCLES = 3


class Oscillation(NamedTuple):
    """Complex lift amplitudes of a harmonic motion, over half the density, chord and airspeed squared."""

    lattice: complex
    """by the Joukowski form"""
    pressures: complex
    theory: complex

    @property
    def error(self) -> float:
        """-; of the Joukowski form: complex difference over the magnitude of the theory."""
        return abs(self.lattice - self.theory) / abs(self.theory)


def thin_aerofoil(rows: int = ROWS) -> Lattice:
    """Return one half of a flat wing of chord 1 m."""
    sections = (Section((0.0, 0.0, 0.0), 1.0), Section((0.0, ASPECT, 0.0), 1.0))
    return build_lattice([Surface("aerofoil", sections, rows, (1,))])


def theodorsen(k: Floats | float) -> Floats:
    """Compute C(k) of the reduced frequency k = omega c / 2U."""
    one, none = hankel2(1, k), hankel2(0, k)
    return np.asarray(one / (one + 1j * none))


def wagner(s: Floats) -> Floats:
    """Compute the lift ratio after ``s`` half chords, by Garrick's integral over Theodorsen's function."""
    k = np.concatenate((np.linspace(1e-6, 1.0, 20001), np.linspace(1.0, 400.0, 400001)[1:]))
    course = (theodorsen(k).real - 0.5) / k
    return np.array([0.5 + 2.0 / math.pi * np.trapezoid(course * np.sin(k * one), k) for one in s])


def started(rows: int = ROWS, half_chords: float = 20.0) -> tuple[Floats, Floats]:
    """Compute half chords traveled and lift ratio of the lattice after an impulsive start."""
    lattice, dt = thin_aerofoil(rows), 1.0 / rows
    c, s = math.cos(START_ANGLE), math.sin(START_ANGLE)
    way = -np.array([c, 0.0, s])[:, None]
    scheme = _scheme(dt, math.ceil(0.5 * half_chords * rows) + 1)
    history = run(lattice, lambda t: lattice.nodes + t * way, scheme, Air(1.0, True))
    force = history.force.sum(axis=1)
    lift = (force[:, 2] * c - force[:, 0] * s) / (0.5 * ASPECT)
    return np.asarray(2.0 * history.time), np.asarray(lift / (2.0 * math.pi * s))


def heaving(k: float, rows: int = ROWS) -> Oscillation:
    """Compute an airfoil in heave at the reduced frequency ``k``."""
    lattice, omega = thin_aerofoil(rows), 2.0 * k

    def moved(t: float) -> Floats:
        return np.asarray(lattice.nodes + np.array([[-t], [0.0], [AMPLITUDE * math.cos(omega * t)]]))

    return _oscillation(lattice, moved, k, _theory(k, -AMPLITUDE, 0.0))


def pitching(k: float, rows: int = ROWS) -> Oscillation:
    """Compute an airfoil in pitch about `PITCH_AXIS` at the reduced frequency ``k``."""
    lattice, omega = thin_aerofoil(rows), 2.0 * k
    arm = lattice.nodes[0] - PITCH_AXIS

    def moved(t: float) -> Floats:
        angle = AMPLITUDE * math.cos(omega * t)
        x = PITCH_AXIS + arm * math.cos(angle) - t
        return np.stack((x, lattice.nodes[1], -arm * math.sin(angle)))

    return _oscillation(lattice, moved, k, _theory(k, 0.0, AMPLITUDE))


def _theory(k: float, heave: float, pitch: float) -> complex:
    """Compute the lift per unit span (Theodorsen 1935, Eq. 18) of heave (m, down) and pitch (rad)."""
    b, a, omega = 0.5, 2.0 * PITCH_AXIS - 1.0, 2.0 * k
    rate = 1j * omega
    lag = complex(theodorsen(k))
    apparent = math.pi * b * b * (rate * rate * heave + rate * pitch - b * a * rate * rate * pitch)
    return apparent + 2.0 * math.pi * b * lag * (rate * heave + pitch + b * (0.5 - a) * rate * pitch)


def _scheme(dt: float, steps: int) -> Scheme:
    return Scheme(dt, steps, wake_core=1e-3, squire=0.0)


def _oscillation(lattice: Lattice, moved: NodeMotion, k: float, theory: complex) -> Oscillation:
    omega, rows = 2.0 * k, int(lattice.layout.rows[0])
    period = math.ceil(2.0 * math.pi / omega * rows)
    dt = 2.0 * math.pi / omega / period
    history = run(lattice, moved, _scheme(dt, CYCLES * period), Air(1.0, True))
    forces = history.force, history.pressure_force
    found = [_amplitude(history, force.sum(axis=1)[:, 2], omega, period) / ASPECT for force in forces]
    return Oscillation(found[0], found[1], theory)


def _amplitude(history: History, values: Floats, omega: float, period: int) -> complex:
    """Return the first harmonic of the last period."""
    turning = np.exp(-1j * omega * history.time[-period:])
    return complex(2.0 * np.mean(values[-period:] * turning))
