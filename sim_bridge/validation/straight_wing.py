"""A twisted, tapered wing of NACA 2412 in steady flow: the vortex lattice beside XFLR5's ring vortices (VLM2).

XFLR5's figures are those that the validation of PteraSoftware tells, to three decimals. Lengths are of the mean
aerodynamic chord, moments about the root's leading edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.sections import naca
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady

ROOT, TIP, SEMISPAN, SWEEP, TWIST = 1.0, 0.75, 5.0, 1.0, math.radians(5.0)
"""m, m, m, m, rad"""
AIRSPEED, ALPHA, DENSITY = 10.0, math.radians(5.0), 1.225
COLUMNS, ROWS = 20, 14
AREA = 0.5 * (ROOT + TIP) * SEMISPAN
"""m^2; of one half"""
MEAN_CHORD = 2.0 / 3.0 * (ROOT + TIP - ROOT * TIP / (ROOT + TIP))
"""m; aerodynamic"""


class Coefficients(NamedTuple):
    """Dimensionless."""

    lift: float
    induced_drag: float
    pitch_moment: float
    """nose up"""


def straight_wing(columns: int = COLUMNS, rows: int = ROWS) -> Coefficients:
    """Of the lattice with so many panels on a half, spaced as cosines."""
    line = naca("2412")
    sections = (Section((0.0, 0.0, 0.0), ROOT, 0.0, line), Section((SWEEP, SEMISPAN, 0.0), TIP, TWIST, line))
    lattice = build_lattice([Surface("wing", sections, rows, (columns,), "cosine", "cosine")])
    c, s = math.cos(ALPHA), math.sin(ALPHA)
    flow = solve_steady(lattice, AIRSPEED * np.array([c, 0.0, s]), DENSITY, symmetric=True)
    x, _, z = flow.force.tolist()
    scale = 0.5 * DENSITY * AIRSPEED**2 * AREA
    # With x back and z up a moment about y that lifts the nose is positive.
    return Coefficients(
        (z * c - x * s) / scale, (x * c + z * s) / scale, float(flow.moment[1]) / (scale * MEAN_CHORD)
    )
