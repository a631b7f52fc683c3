"""Loads of tailplane and fin of the coupled lattice, on the body."""

from __future__ import annotations

from sim_bridge.aerodynamics.protocol import Motion
from sim_bridge.aerodynamics.vortex_lattice.placing import fin_normal, fin_point, tail_normal, tail_point
from sim_bridge.aerodynamics.vortex_lattice.settings import (
    FIN,
    FIN_SHAPE,
    TAIL_SHAPE,
    TAILPLANE,
    VortexLatticeParameters,
)
from sim_bridge.vectors import Floats, inner, kernel

TAIL_ROWS, TAIL_COLUMNS = TAIL_SHAPE
FIN_ROWS, FIN_COLUMNS = FIN_SHAPE


@kernel
def load_tail(
    p: VortexLatticeParameters, motion: Motion, density: float, state: Floats, strengths: Floats, out: Floats
) -> None:
    """Fill ``out`` (6,) N, N m about the origin of the body axes: what the legs across bear by Joukowski."""
    out[:] = 0.0
    for j in range(TAIL_COLUMNS):
        _load_strip(p, motion, TAILPLANE, j, density, state, strengths, out)
    for j in range(FIN_COLUMNS):
        _load_strip(p, motion, FIN, j, density, state, strengths, out)


@inner
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
    layout, m, n = p.layout, p.memory, p.panel_at.shape[0]
    rows, columns, strip = layout.rows[surface], layout.columns[surface], layout.first_strip[surface] + j
    point, normal, air, span = p.room.scratch[2, 0], p.room.scratch[2, 1], p.room.scratch[3, 0], p.room.scratch[3, 1]
    wash, row = state[m.strip_wake + strip], m.downwash + strip * n
    for k in range(n):
        wash += state[row + k] * strengths[k]
    wide = surface == TAILPLANE
    span[0], span[1], span[2] = 0.0, p.tail.span / columns if wide else 0.0, 0.0 if wide else -p.tail.height / columns
    before = 0.0
    for i in range(rows):
        strength = strengths[layout.first_panel[surface] + i * columns + j]
        if wide:
            tail_point(p, motion, (i + 0.25) / rows, ((j + 0.5) / columns - 0.5) * p.tail.span, point)
            tail_normal(p, motion, normal)
        else:
            fin_point(p, motion, (i + 0.25) / rows, (j + 0.5) / columns * p.tail.height, point)
            fin_normal(p, motion, normal)
        b = motion.body
        for a in range(3):
            c, d = (a + 1) % 3, (a + 2) % 3
            air[a] = wash * normal[a] - (b[a] + b[3 + c] * point[d] - b[3 + d] * point[c])
        _add(density * (strength - before), air, span, point, out)
        before = strength


@inner
def _add(push: float, air: Floats, span: Floats, point: Floats, out: Floats) -> None:
    """Add the force of a leg ``span`` (3,) m at ``point`` in ``air`` (3,) m/s, and its moment."""
    f0 = push * (air[1] * span[2] - air[2] * span[1])
    f1 = push * (air[2] * span[0] - air[0] * span[2])
    f2 = push * (air[0] * span[1] - air[1] * span[0])
    out[0] += f0
    out[1] += f1
    out[2] += f2
    out[3] += point[1] * f2 - point[2] * f1
    out[4] += point[2] * f0 - point[0] * f2
    out[5] += point[0] * f1 - point[1] * f0
