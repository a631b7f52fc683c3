"""Check for intersecting surfaces, for which a lattice has no meaningful solution."""

from __future__ import annotations

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, grid_of
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

INSIDE = 1e-6
"""-; surfaces may touch: an edge crosses where it goes through by this share of itself, that far from the border"""


def check_crossings(lattice: Lattice) -> None:
    """Check that no surfaces intersect.

    Raises:
        InputError: two do; the message has their names and the place.
    """
    grids = [grid_of(lattice, lattice.nodes, i) for i in range(len(lattice.names))]
    for i, one in enumerate(grids):
        for j, other in enumerate(grids):
            if i == j or not _boxes_meet(one, other):
                continue
            where = _crossing(one, other)
            if where is not None:
                place = ", ".join(f"{x:.3g}" for x in where)
                raise InputError(f'surface "{lattice.names[i]}" crosses "{lattice.names[j]}" at ({place}) m')


def _boxes_meet(one: Floats, other: Floats) -> bool:
    a, b = one.reshape(-1, 3), other.reshape(-1, 3)
    return bool(np.all(a.min(axis=0) <= b.max(axis=0)) and np.all(b.min(axis=0) <= a.max(axis=0)))


def _edges(grid: Floats) -> tuple[Floats, Floats]:
    """Start and way of every panel's edge, (edges, 3) each."""
    across, along = grid[:, 1:] - grid[:, :-1], grid[1:] - grid[:-1]
    starts = np.concatenate((grid[:, :-1].reshape(-1, 3), grid[:-1].reshape(-1, 3)))
    return starts, np.concatenate((across.reshape(-1, 3), along.reshape(-1, 3)))


def _drawn_in(grid: Floats) -> Floats:
    """The grid a little smaller: what touches its border is not in it."""
    out = grid.copy()
    for border, inner in ((0, 1), (-1, -2)):
        out[border] += INSIDE * (out[inner] - out[border])
        out[:, border] += INSIDE * (out[:, inner] - out[:, border])
    return out


def _crossing(one: Floats, other: Floats) -> Floats | None:
    """Where an edge of ``one`` goes through a triangle of ``other`` (Moeller and Trumbore 1997)."""
    (start, way), other = _edges(one), _drawn_in(other)
    corners = other[:-1, :-1], other[:-1, 1:], other[1:, 1:], other[1:, :-1]
    a, b, c, d = (corner.reshape(-1, 3) for corner in corners)
    for p, q, r in ((a, b, c), (a, c, d)):
        u, v = q - p, r - p
        h = np.cross(way[:, None], v[None])
        size = np.einsum("nk,mnk->mn", u, h)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = start[:, None] - p[None]
            first = np.einsum("mnk,mnk->mn", s, h) / size
            w = np.cross(s, u[None])
            second = np.einsum("mk,mnk->mn", way, w) / size
            along = np.einsum("nk,mnk->mn", v, w) / size
            inside = (first >= 0.0) & (second >= 0.0) & (first + second <= 1.0)
            hits = np.argwhere(inside & (along > INSIDE) & (along < 1.0 - INSIDE))
        if len(hits):
            m, n = hits[0]
            return np.asarray(start[m] + along[m, n] * way[m])
    return None
