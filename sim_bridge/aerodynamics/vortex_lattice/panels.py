"""Rings, collocation points and normals of a lattice, and the influence matrix.

A ring's front leg lies a quarter of its panel behind the panel's front edge, its back leg is the next panel's front
leg; at the trailing edge it lies in the wake. The flow is tangent to the panel at three quarters of it (Katz and
Plotkin 2001, 12.3). Circulation is positive where the front leg runs from left to right, which lifts.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Layout
from sim_bridge.aerodynamics.vortex_lattice.influence import row_influence
from sim_bridge.compiled import kernel
from sim_bridge.vectors import Floats


class Panels(NamedTuple):
    """The panels of a lattice at one instant; N panels, S trailing edge panels, E trailing edge nodes."""

    rings: Floats
    """(3, nodes) m; corners of the rings, the last row of each surface behind its trailing edge"""
    collocation: Floats
    """(3, N) m"""
    normal: Floats
    """(3, N) -"""
    area: Floats
    """(N,) m^2"""


def blank_panels(layout: Layout) -> Panels:
    """Allocate panels for `set_panels`."""
    nodes = int(np.sum((layout.rows + 1) * (layout.columns + 1)))
    panels = int(np.sum(layout.rows * layout.columns))
    return Panels(np.zeros((3, nodes)), np.zeros((3, panels)), np.zeros((3, panels)), np.zeros(panels))


@kernel
def set_rings(layout: Layout, nodes: Floats, behind: Floats, rings: Floats) -> None:
    """Fill ``rings`` (3, nodes) for panels with corners ``nodes``; ``behind`` (3, E) is where each last row lies."""
    for s in range(layout.rows.shape[0]):
        rows, width, first = layout.rows[s], layout.columns[s] + 1, layout.first_node[s]
        for c in range(3):
            for j in range(width):
                for i in range(rows):
                    here, there = nodes[c, first + i * width + j], nodes[c, first + (i + 1) * width + j]
                    rings[c, first + i * width + j] = 0.75 * here + 0.25 * there
                rings[c, first + rows * width + j] = behind[c, layout.first_edge[s] + j]


@kernel
def set_panels(layout: Layout, nodes: Floats, panels: Panels) -> None:
    """Fill collocation points, normals and areas for panels with corners ``nodes`` (3, nodes)."""
    for s in range(layout.rows.shape[0]):
        columns = layout.columns[s]
        for i in range(layout.rows[s]):
            for j in range(columns):
                front = layout.first_node[s] + i * (columns + 1) + j
                _set_panel(nodes, front, front + columns + 1, layout.first_panel[s] + i * columns + j, panels)


@kernel
def _set_panel(nodes: Floats, front: int, back: int, k: int, p: Panels) -> None:
    """Panel ``k`` between the nodes front, front + 1, back and back + 1: normal is the product of its diagonals."""
    for c in range(3):
        ahead, behind = nodes[c, front] + nodes[c, front + 1], nodes[c, back] + nodes[c, back + 1]
        p.collocation[c, k] = 0.125 * ahead + 0.375 * behind
    d0, e0 = nodes[0, back + 1] - nodes[0, front], nodes[0, front + 1] - nodes[0, back]
    d1, e1 = nodes[1, back + 1] - nodes[1, front], nodes[1, front + 1] - nodes[1, back]
    d2, e2 = nodes[2, back + 1] - nodes[2, front], nodes[2, front + 1] - nodes[2, back]
    n0, n1, n2 = d1 * e2 - d2 * e1, d2 * e0 - d0 * e2, d0 * e1 - d1 * e0
    size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    p.normal[0, k], p.normal[1, k], p.normal[2, k] = n0 / size, n1 / size, n2 / size
    p.area[k] = 0.5 * size


@kernel
def set_influence(
    layout: Layout, panels: Panels, images: Floats, cores: Floats, work: Floats, matrix: Floats
) -> None:
    """Fill ``matrix`` (N, N) 1/m: normal velocity at each collocation point by each ring of unit strength.

    Args:
        cores: (surfaces,) m; core radius of a surface's rings.
        work: (5, 3, w) scratch, w not less than the greatest number of columns plus 1.
    """
    for k in range(matrix.shape[0]):
        for n in range(matrix.shape[1]):
            matrix[k, n] = 0.0
        for image in range(images.shape[0]):
            _image(images[image], panels, k, work[0, 0], work[0, 1])
            for s in range(layout.rows.shape[0]):
                _surface_influence(layout, s, panels.rings, cores[s], work, matrix[k], True)


@kernel
def _image(r: Floats, panels: Panels, k: int, point: Floats, normal: Floats) -> None:
    """Panel ``k``'s collocation point and normal as the image sees them."""
    for i in range(3):
        place, along = r[3, i], 0.0
        for j in range(3):
            place += r[i, j] * panels.collocation[j, k]
            along += r[i, j] * panels.normal[j, k]
        point[i], normal[i] = place, along


@kernel
def _surface_influence(
    layout: Layout, s: int, rings: Floats, core: float, work: Floats, row: Floats, whole: bool
) -> None:
    """Add one surface's rings to a ``row`` of the matrix, leg by leg: each is shared by two rings.

    The legs across are left out unless ``whole`` is set.
    """
    columns, rows = layout.columns[s], layout.rows[s]
    width, point, normal = columns + 1, work[0, 0], work[0, 1]
    first, panel = layout.first_node[s], layout.first_panel[s]
    for i in range(rows + 1):
        at = first + i * width
        across = work[1, 0, :columns]
        across[:] = 0.0
        if whole:
            row_influence(rings[:, at : at + columns], rings[:, at + 1 : at + width], core, point, normal, across)
        for j in range(columns):
            if i < rows:
                row[panel + i * columns + j] += across[j]
            if i > 0:
                row[panel + (i - 1) * columns + j] -= across[j]
        if i < rows:
            along = work[1, 1, :width]
            along[:] = 0.0
            end = at + width
            row_influence(rings[:, at:end], rings[:, end : end + width], core, point, normal, along)
            for j in range(columns):
                row[panel + i * columns + j] += along[j + 1] - along[j]


@kernel
def set_downwash(layout: Layout, target: int, rings: Floats, cores: Floats, work: Floats, row: Floats) -> None:
    """Fill a ``row`` of normal velocities by each ring of unit strength at a point on the surface ``target``.

    Without the legs across of the surface itself, which act on each other alone. ``work`` as in `set_influence`, the
    point in ``work[0, 0, :3]``, the normal in ``work[0, 1, :3]``.
    """
    for n in range(row.shape[0]):
        row[n] = 0.0
    for s in range(layout.rows.shape[0]):
        _surface_influence(layout, s, rings, cores[s], work, row, s != target)


@kernel
def factorize(matrix: Floats, pivots: Floats) -> bool:
    """Decompose ``matrix`` (N, N) in place into L and U, rows swapped by ``pivots`` (N,).

    Returns:
        whether it has an inverse.
    """
    n = matrix.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        pivots[k] = best
        if matrix[best, k] == 0.0:
            return False
        if best != k:
            for j in range(n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, n):
            share = matrix[i, k] / matrix[k, k]
            matrix[i, k] = share
            for j in range(k + 1, n):
                matrix[i, j] -= share * matrix[k, j]
    return True


@kernel
def substitute(matrix: Floats, pivots: Floats, x: Floats) -> None:
    """Solve with what `factorize` left; ``x`` (N,) is the right-hand side, then the solution."""
    n = matrix.shape[0]
    for k in range(n):
        other = int(pivots[k])
        x[k], x[other] = x[other], x[k]
        for i in range(k):
            x[k] -= matrix[k, i] * x[i]
    for k in range(n - 1, -1, -1):
        for i in range(k + 1, n):
            x[k] -= matrix[k, i] * x[i]
        x[k] /= matrix[k, k]
