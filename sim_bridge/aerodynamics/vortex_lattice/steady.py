"""The lattice in steady flow with a straight wake of the trailing edges' strength."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.crossings import check_crossings
from sim_bridge.aerodynamics.vortex_lattice.forces import Flow, Loads, blank_loads_of, middles, set_loads
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, Layout, grid_of, layout_of, panel_count
from sim_bridge.aerodynamics.vortex_lattice.influence import induced, reflections
from sim_bridge.aerodynamics.vortex_lattice.legs import legs_of, set_bound_filaments
from sim_bridge.aerodynamics.vortex_lattice.panels import (
    Panels,
    blank_panels,
    factorize,
    set_influence,
    set_panels,
    set_rings,
    substitute,
)
from sim_bridge.aerodynamics.vortex_lattice.wake import blank_table
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

WAKE_SPANS = 100.0
"""-; length of the wake over the greatest extent of the lattice"""
CORE = 1e-5
"""-; radius of the bound vortices' cores over the mean chord of their surface"""
SLOWEST = 1e-6
"""m/s; airspeed below which there is no direction for the wake"""


class SteadyFlow(NamedTuple):
    """Solution of a steady flow."""

    strengths: Floats
    """(N,) m^2/s"""
    loads: Loads
    areas: Floats
    """(N,) m^2"""

    @property
    def force(self) -> Floats:
        """Force (3,) in N of all panels given, without mirror images."""
        return np.asarray(self.loads.force.sum(axis=1))

    @property
    def moment(self) -> Floats:
        """Moment (3,) in N m about the origin, without mirror images."""
        return np.asarray(self.loads.moment.sum(axis=1))


def mean_chords(lattice: Lattice) -> Floats:
    """Mean chord (surfaces,) in m."""
    grids = [grid_of(lattice, lattice.nodes, i) for i in range(len(lattice.names))]
    return np.array([np.linalg.norm(grid[-1] - grid[0], axis=1).mean() for grid in grids])


def edge_nodes(layout: Layout, nodes: Floats) -> Floats:
    """Trailing edge nodes (3, E) in m."""
    last = layout.first_node + layout.rows * (layout.columns + 1)
    pieces = [nodes[:, a : a + n + 1] for a, n in zip(last, layout.columns, strict=True)]
    return np.ascontiguousarray(np.concatenate(pieces, axis=1))


def with_wake_row(layout: Layout) -> tuple[Layout, Floats, Floats]:
    """The layout with one more row of rings behind each surface, and where panels and strips lie in it.

    Returns:
        the layout, (N,) of each panel, (S,) of each ring of the wake's row.
    """
    wider = layout_of([(int(r) + 1, int(c)) for r, c in zip(layout.rows, layout.columns, strict=True)])
    panels, strips = [], []
    for rows, columns, first in zip(layout.rows, layout.columns, wider.first_panel, strict=True):
        panels.append(first + np.arange(rows * columns))
        strips.append(first + rows * columns + np.arange(columns))
    return wider, np.concatenate(panels), np.concatenate(strips)


def trailing_panels(layout: Layout) -> Floats:
    """Panel (S,) at the trailing edge of each strip."""
    pieces = zip(layout.rows, layout.columns, layout.first_panel, strict=True)
    return np.concatenate([first + (rows - 1) * columns + np.arange(columns) for rows, columns, first in pieces])


def direction(along: Floats) -> Floats:
    """Direction (3,) of a wake along ``along`` (3,) of any length.

    Raises:
        InputError: it has none.
    """
    length = float(np.linalg.norm(along))
    if not length > 0.0 or not math.isfinite(length):
        raise InputError(f"the wake has no direction: {np.asarray(along).tolist()}")
    return np.asarray(along, dtype=float) / length


def _with_row(layout: Layout, rings: Floats, far: Floats) -> Floats:
    """(3, nodes) of the layout with one more row, which ends at ``far`` (3, E)."""
    pieces = []
    for s in range(len(layout.rows)):
        width, first = int(layout.columns[s]) + 1, int(layout.first_node[s])
        edge = int(layout.first_edge[s])
        pieces += [rings[:, first : first + (int(layout.rows[s]) + 1) * width], far[:, edge : edge + width]]
    return np.ascontiguousarray(np.concatenate(pieces, axis=1))


def solve_steady(
    lattice: Lattice,
    wind: Floats,
    density: float,
    symmetric: bool = False,
    ground: float | None = None,
    along: Floats | None = None,
) -> SteadyFlow:
    """Solve the lattice at rest in a ``wind`` (3,) m/s.

    With ``symmetric`` the lattice is one half: its mirror image in the plane y = 0 is there too, and its loads are
    not in the result. ``ground`` is the height z in m of a plane that no air crosses. The wake leaves in the
    direction ``along`` (3,), of any length, the wind's by default.

    Raises:
        InputError: there is no wind, the wake has no direction, surfaces cross, or the panels allow no solution.
    """
    speed = float(np.linalg.norm(wind))
    if not speed > SLOWEST or not math.isfinite(speed):
        raise InputError(f"zero airspeed: a steady lattice needs wind, and not {speed:g} m/s")
    check_crossings(lattice)
    layout, images = lattice.layout, reflections(symmetric, ground)
    panels, ends = blank_panels(layout), edge_nodes(layout, lattice.nodes)
    set_panels(layout, lattice.nodes, panels)
    set_rings(layout, lattice.nodes, ends, panels.rings)
    extent = float(np.max(np.ptp(lattice.nodes, axis=1)))
    far = ends + WAKE_SPANS * extent * direction(wind if along is None else along)[:, None]
    wider, at, wake = with_wake_row(layout)
    wide = panels._replace(rings=_with_row(layout, panels.rings, far))
    cores = CORE * mean_chords(lattice)
    strengths = _strengths(wider, wide, (at, wake, trailing_panels(layout)), images, cores, wind)
    loads = _loads(lattice, panels, (wider, wide, at, wake), strengths, images, cores, (wind, density))
    return SteadyFlow(strengths, loads, panels.area)


def _strengths(
    wider: Layout, wide: Panels, places: tuple[Floats, Floats, Floats], images: Floats, cores: Floats, wind: Floats
) -> Floats:
    at, wake, trailing = places
    full = np.zeros((len(at), panel_count(wider)))
    set_influence(wider, wide, images, cores, np.zeros((5, 3, int(wider.columns.max()) + 3)), full)
    matrix = np.ascontiguousarray(full[:, at])
    matrix[:, trailing] += full[:, wake]
    x, pivots = -(np.asarray(wind) @ wide.normal), np.zeros(len(at))
    if not factorize(matrix, pivots):
        raise InputError("the lattice has no solution: two of its panels lie in the same place")
    substitute(matrix, pivots, x)
    return x


def _loads(
    lattice: Lattice,
    panels: Panels,
    wider: tuple[Layout, Panels, Floats, Floats],
    strengths: Floats,
    images: Floats,
    cores: Floats,
    air: tuple[Floats, float],
) -> Loads:
    layout, legs, (wide_layout, wide, at, wake) = lattice.layout, legs_of(lattice.layout), wider
    wind, density = np.asarray(air[0])[:, None], air[1]
    trailing = strengths[trailing_panels(layout)]
    both = np.zeros(panel_count(wide_layout))
    both[at], both[wake] = strengths, trailing
    wide_legs = legs_of(wide_layout)
    table = blank_table(len(wide_legs.start))
    count = set_bound_filaments(wide_legs, wide.rings, both, cores, table)
    places, flow = np.zeros((3, len(legs.start))), np.zeros((3, len(legs.start)))
    middles(legs, panels.rings, places)
    induced(table, count, images, places, flow)
    behind = np.zeros(panel_count(wide_layout))
    behind[wake] = trailing
    count = set_bound_filaments(wide_legs, wide.rings, behind, cores, table)
    by_wake, still = np.zeros_like(panels.collocation), np.zeros_like(panels.collocation)
    induced(table, count, images, panels.collocation, by_wake)
    met = Flow(flow + wind, 0.0 * flow, by_wake + wind, still, trailing, np.zeros(len(strengths)), panels.area)
    loads = blank_loads_of(len(strengths))
    set_loads(layout, legs, panels, strengths, met, density, loads)
    return loads
