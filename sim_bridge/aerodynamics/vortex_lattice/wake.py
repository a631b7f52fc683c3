"""The wake: rows of rings shed at the trailing edges, convected, truncated at a length.

The newest row comes first. What is cut off goes on as one far row: filaments in the direction of the wake, of the
mean strength that left it, so that the last row ends no lift. The cores grow with age (Ramasamy and Leishman 2007,
Eq. 3): ``core^2 = core_0^2 + 4 a (nu + s |G|) age`` with Lamb's a = 1.25643 and Squire's s.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Layout
from sim_bridge.aerodynamics.vortex_lattice.influence import FILAMENT, set_filament
from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats

LAMB = 1.25643
FAR = 10.0
"""-; length of the far row over that of the wake before it"""


class Wake(NamedTuple):
    """Rings behind all trailing edges; R rows at most, E edge nodes, S strips."""

    nodes: Floats
    """(3, R + 1, E) m; corners of the rings, the newest row first"""
    strengths: Floats
    """(R, S) m^2/s"""
    far: Floats
    """(S,) m^2/s; of the far row, mean of what was cut off"""
    rows: Floats
    """(1,); how many rows there are"""


class Core(NamedTuple):
    """Core radii of the wake vortices."""

    bound: float
    """m; of the front legs of the row ``newest``, which cancel the bound vortices where these end"""
    newest: int
    """0 where the bound vortices end at the trailing edge, 1 where the newest row is counted among them"""
    radius: float
    """m; at birth"""
    viscosity: float
    """m^2/s"""
    squire: float
    """-; turbulent viscosity over circulation"""


def blank_wake(layout: Layout, rows: int) -> Wake:
    """Allocate an empty wake."""
    strips = int(np.sum(layout.columns))
    edges = strips + len(layout.columns)
    return Wake(np.zeros((3, rows + 1, edges)), np.zeros((rows, strips)), np.zeros(strips), np.zeros(1))


def wake_filaments(layout: Layout, rows: int) -> int:
    """Number of filaments of a full wake, including the far row."""
    strips = int(np.sum(layout.columns))
    return (rows + 2) * (2 * strips + len(layout.columns))


def blank_table(filaments: int) -> Floats:
    """Allocate a table for `set_filament`."""
    return np.zeros((FILAMENT, filaments))


@kernel
def shed(wake: Wake, edges: Floats, strengths: Floats) -> None:
    """Start a new row at ``edges`` (3, E) m of ``strengths`` (S,) m^2/s; the first has no length yet.

    After the wake was carried along: its first nodes were at the edges a step ago.
    """
    kept, rows = wake.strengths.shape[0], int(wake.rows[0])
    if rows == kept:
        for j in range(strengths.shape[0]):
            wake.far[j] += (wake.strengths[kept - 1, j] - wake.far[j]) / kept
    rows = min(rows + 1, kept)
    for i in range(rows, 0, -1):
        for c in range(3):
            for j in range(edges.shape[1]):
                wake.nodes[c, i, j] = wake.nodes[c, i - 1, j]
    for i in range(rows - 1, 0, -1):
        for j in range(strengths.shape[0]):
            wake.strengths[i, j] = wake.strengths[i - 1, j]
    for c in range(3):
        for j in range(edges.shape[1]):
            wake.nodes[c, 0, j] = edges[c, j]
    for j in range(strengths.shape[0]):
        wake.strengths[0, j] = strengths[j]
    wake.rows[0] = rows


@kernel
def _core(strength: float, age: float, core: Core) -> float:
    """m^2"""
    return core.radius * core.radius + 4.0 * LAMB * (core.viscosity + core.squire * abs(strength)) * age


@kernel
def _set(table: Floats, k: int, start: Floats, end: Floats, strength: float, square: float) -> None:
    set_filament(table, k, start, end, strength, 1.0)
    table[7, k] *= square


@kernel
def set_wake_filaments(layout: Layout, wake: Wake, core: Core, dt: float, table: Floats, first: int) -> int:
    """Put the wake's filaments into ``table`` from column ``first`` on; returns the column after the last.

    ``dt`` s is what a row is older than the one before.
    """
    rows, k = int(wake.rows[0]), first
    if rows == 0:
        return k
    for s in range(layout.columns.shape[0]):
        for i in range(rows):
            k = _across(layout, wake, core, dt, table, k, s, i)
            k = _along(layout, wake, core, dt, table, k, s, i)
        k = _end(layout, wake, core, dt, table, k, s)
        if rows == wake.strengths.shape[0]:
            k = _far(layout, wake, core, dt, table, k, s)
    return k


@kernel
def _across(layout: Layout, wake: Wake, core: Core, dt: float, table: Floats, k: int, s: int, i: int) -> int:
    edge, strip = layout.first_edge[s], layout.first_strip[s]
    for j in range(layout.columns[s]):
        here = wake.strengths[i, strip + j]
        ahead = wake.strengths[i - 1, strip + j] if i > 0 else 0.0
        square = _core(max(abs(here), abs(ahead)), i * dt, core) if i > core.newest else core.bound * core.bound
        _set(table, k, wake.nodes[:, i, edge + j], wake.nodes[:, i, edge + j + 1], here - ahead, square)
        k += 1
    return k


@kernel
def _along(layout: Layout, wake: Wake, core: Core, dt: float, table: Floats, k: int, s: int, i: int) -> int:
    edge, strip, columns = layout.first_edge[s], layout.first_strip[s], layout.columns[s]
    for j in range(columns + 1):
        left = wake.strengths[i, strip + j - 1] if j > 0 else 0.0
        right = wake.strengths[i, strip + j] if j < columns else 0.0
        square = _core(max(abs(left), abs(right)), (i + 1.0) * dt, core)
        _set(table, k, wake.nodes[:, i, edge + j], wake.nodes[:, i + 1, edge + j], left - right, square)
        k += 1
    return k


@kernel
def _end(layout: Layout, wake: Wake, core: Core, dt: float, table: Floats, k: int, s: int) -> int:
    """The last row's back legs, less the far row's front legs where the wake is full."""
    edge, strip, rows = layout.first_edge[s], layout.first_strip[s], int(wake.rows[0])
    full = 1.0 if rows == wake.strengths.shape[0] else 0.0
    for j in range(layout.columns[s]):
        last = wake.strengths[rows - 1, strip + j]
        strength = full * wake.far[strip + j] - last
        square = _core(last, rows * dt, core)
        _set(table, k, wake.nodes[:, rows, edge + j], wake.nodes[:, rows, edge + j + 1], strength, square)
        k += 1
    return k


@kernel
def _far(layout: Layout, wake: Wake, core: Core, dt: float, table: Floats, k: int, s: int) -> int:
    """Filaments from the last row on, as long as `FAR` wakes, in the direction from the newest to the last row."""
    edge, strip, rows, columns = layout.first_edge[s], layout.first_strip[s], int(wake.rows[0]), layout.columns[s]
    for j in range(columns + 1):
        left = wake.far[strip + j - 1] if j > 0 else 0.0
        right = wake.far[strip + j] if j < columns else 0.0
        square = _core(max(abs(left), abs(right)), (rows + 1.0) * dt, core)
        last = wake.nodes[:, rows, edge + j]
        _set(table, k, last, last, left - right, 1.0)
        length = 0.0
        for c in range(3):
            way = 0.0
            for n in range(columns + 1):
                way += wake.nodes[c, rows, edge + n] - wake.nodes[c, 0, edge + n]
            way *= FAR / (columns + 1)
            table[3 + c, k] += way
            length += way * way
        table[7, k] = square * length
        k += 1
    return k


@kernel
def carry(wake: Wake, velocity: Floats, dt: float) -> None:
    """Convect the wake's nodes with ``velocity`` (3, (R + 1) E) m/s, row after row, over ``dt`` s."""
    edges = wake.nodes.shape[2]
    for c in range(3):
        for i in range(int(wake.rows[0]) + 1):
            for j in range(edges):
                wake.nodes[c, i, j] += dt * velocity[c, i * edges + j]
