"""A twisted, tapered wing of NACA 2412 in steady flow: the vortex lattice beside XFLR5's ring vortices (VLM2).

XFLR5's figures are those of its project file among PteraSoftware's tests (``testing references.xfl``), of which these
have three decimals. XFLR5 has the wake along the body's axis and takes the drag, the part along the wind, from it far
behind: so does this. Lengths are of the mean aerodynamic chord, moments about the root's leading edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.far_wake import far_drag
from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.sections import naca
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady

ROOT, TIP, SEMISPAN, SWEEP, TWIST = 1.0, 0.75, 5.0, 1.0, math.radians(5.0)
"""m, m, m, m, rad"""
AIRSPEED, ALPHA, DENSITY = 10.0, math.radians(5.0), 1.225
COLUMNS, ROWS = 20, 14
GRIDS = (8, 6), (16, 12), (32, 24)
"""columns and rows, refined by a factor of two each"""
BODY_AXIS = np.array([1.0, 0.0, 0.0])
AREA = 0.5 * (ROOT + TIP) * SEMISPAN
"""m^2; of one half"""
MEAN_CHORD = 2.0 / 3.0 * (ROOT + TIP - ROOT * TIP / (ROOT + TIP))
"""m; aerodynamic"""


class Coefficients(NamedTuple):
    """Aerodynamic coefficients."""

    lift: float
    near_drag: float
    """induced; from the forces on the panels"""
    far_drag: float
    """induced; from the wake in the Trefftz plane"""
    pitch_moment: float
    """nose up"""


@cache
def straight_wing(columns: int = COLUMNS, rows: int = ROWS, along_wind: bool = False) -> Coefficients:
    """Compute the lattice with cosine spacing on one half; the wake is along the body's axis or the wind."""
    line = naca("2412")
    sections = (Section((0.0, 0.0, 0.0), ROOT, 0.0, line), Section((SWEEP, SEMISPAN, 0.0), TIP, TWIST, line))
    lattice = build_lattice([Surface("wing", sections, rows, (columns,), "cosine", "cosine")])
    c, s = math.cos(ALPHA), math.sin(ALPHA)
    wind = np.array([c, 0.0, s])
    along = wind if along_wind else BODY_AXIS
    flow = solve_steady(lattice, AIRSPEED * wind, DENSITY, symmetric=True, along=along)
    x, _, z = flow.force.tolist()
    scale = 0.5 * DENSITY * AIRSPEED**2 * AREA
    far = (wind @ along) * float(far_drag(lattice, flow.strengths, along, DENSITY, symmetric=True).sum())
    # With x back and z up a moment about y that lifts the nose is positive.
    moment = float(flow.moment[1]) / (scale * MEAN_CHORD)
    return Coefficients((z * c - x * s) / scale, (x * c + z * s) / scale, far / scale, moment)


def orders(grids: Sequence[tuple[int, int]] = GRIDS) -> Coefficients:
    """Compute the order of convergence of each coefficient from three ``grids``, refined by a factor of two each."""
    coarse, middle, fine = (straight_wing(columns, rows) for columns, rows in grids)
    pairs = zip(coarse, middle, fine, strict=True)
    return Coefficients(*(math.log2(abs(two - one) / abs(three - two)) for one, two, three in pairs))
