"""Loads of tailplane and fin of the coupled lattice, on the body."""

from __future__ import annotations

from sim_bridge.aerodynamics.protocol import Motion
from sim_bridge.aerodynamics.vortex_lattice.bearing import tail_offset
from sim_bridge.aerodynamics.vortex_lattice.lattice_motion import surface_normal, surface_point, swing
from sim_bridge.aerodynamics.vortex_lattice.settings import FIN, TAILPLANE, VortexLatticeParameters
from sim_bridge.compiled import internal, kernel
from sim_bridge.vectors import Floats


@kernel
def load_tail(
    p: VortexLatticeParameters, motion: Motion, density: float, state: Floats, strengths: Floats, out: Floats
) -> None:
    """Fill ``out`` (6,) N, N m about the origin of the body axes with the Joukowski forces of all legs."""
    out[:] = 0.0
    for surface in (TAILPLANE, FIN):
        surface_normal(p, motion, surface, p.workspace.scratch[2, 1])
        for j in range(p.layout.columns[surface]):
            _load_strip(p, motion, surface, j, density, state, strengths, out)
        _load_along(p, motion, surface, density, state, strengths, out)


@internal
def _load_strip(
    p: VortexLatticeParameters,
    motion: Motion,
    surface: int,
    j: int,
    density: float,
    state: Floats,
    strengths: Floats,
    out: Floats,
) -> None:
    """The legs across of a strip."""
    layout, n = p.layout, p.panel_at.shape[0]
    rows, columns, strip = layout.rows[surface], layout.columns[surface], layout.first_strip[surface] + j
    wash, row = 0.0, p.memory.downwash + strip * n
    for k in range(n):
        wash += state[row + k] * strengths[k]
    before = 0.0
    for i in range(rows):
        strength, back = strengths[layout.first_panel[surface] + i * columns + j], (i + 0.25) / rows
        start, end = p.workspace.scratch[3, 0], p.workspace.scratch[3, 1]
        surface_point(p, motion, surface, back, j / columns, start)
        surface_point(p, motion, surface, back, (j + 1.0) / columns, end)
        through = wash - swing(p, motion, surface, back)
        leg_data = state[tail_offset(p, p.first_leg[surface] + i * columns + j) :]
        _add(p, density * (strength - before), through, leg_data, motion, out)
        before = strength


@internal
def _load_along(
    p: VortexLatticeParameters,
    motion: Motion,
    surface: int,
    density: float,
    state: Floats,
    strengths: Floats,
    out: Floats,
) -> None:
    """The legs along; the last row's end at the trailing edge."""
    rows, columns, first = p.layout.rows[surface], p.layout.columns[surface], p.layout.first_panel[surface]
    start, end = p.workspace.scratch[3, 0], p.workspace.scratch[3, 1]
    for i in range(rows):
        front, back = (i + 0.25) / rows, min((i + 1.25) / rows, 1.0)
        through = -swing(p, motion, surface, 0.5 * (front + back))
        for j in range(columns + 1):
            left = strengths[first + i * columns + j - 1] if j > 0 else 0.0
            right = strengths[first + i * columns + j] if j < columns else 0.0
            surface_point(p, motion, surface, front, j / columns, start)
            surface_point(p, motion, surface, back, j / columns, end)
            leg_data = state[tail_offset(p, p.first_leg[surface] + rows * columns + i * (columns + 1) + j) :]
            _add(p, density * (left - right), through, leg_data, motion, out)


@internal
def _add(
    p: VortexLatticeParameters, push: float, through: float, leg_data: Floats, motion: Motion, out: Floats
) -> None:
    """Add the force of the leg between the workspace's two points, and its moment.

    It is in air that is ``leg_data`` (3,) m/s and goes ``through`` the surface, in m/s along its normal, besides.
    """
    start, end, normal, b = (
        p.workspace.scratch[3, 0],
        p.workspace.scratch[3, 1],
        p.workspace.scratch[2, 1],
        motion.body,
    )
    x, y, z = 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])
    lx, ly, lz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    u = leg_data[0] + through * normal[0] - (b[0] + b[4] * z - b[5] * y)
    v = leg_data[1] + through * normal[1] - (b[1] + b[5] * x - b[3] * z)
    w = leg_data[2] + through * normal[2] - (b[2] + b[3] * y - b[4] * x)
    f0, f1, f2 = push * (v * lz - w * ly), push * (w * lx - u * lz), push * (u * ly - v * lx)
    out[0] += f0
    out[1] += f1
    out[2] += f2
    out[3] += y * f2 - z * f1
    out[4] += z * f0 - x * f2
    out[5] += x * f1 - y * f0
