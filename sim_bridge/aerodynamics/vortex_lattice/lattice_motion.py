"""Panel positions and velocities of the coupled lattice from the motion of the strips.

Body axes. The wings are one surface from tip to tip: the root strips of both meet at the plane of symmetry's side of
their hinges, so that no vortex leaves the gap which the fuselage fills.
"""

from __future__ import annotations

import math

from sim_bridge.aerodynamics.protocol import Motion, Strips
from sim_bridge.aerodynamics.vortex_lattice.settings import (
    FIN,
    FIN_SHAPE,
    TAIL_SHAPE,
    TAILPLANE,
    VortexLatticeParameters,
)
from sim_bridge.compiled import internal
from sim_bridge.vectors import Floats

TAIL_ROWS, TAIL_COLUMNS = TAIL_SHAPE
FIN_ROWS, FIN_COLUMNS = FIN_SHAPE


@internal
def strip_of(column: int, half: int) -> int:
    """Strip of the protocol in a column counted from the left tip to the right."""
    return half - 1 - column if column < half else column


@internal
def set_nodes(p: VortexLatticeParameters, strips: Strips, motion: Motion, nodes: Floats) -> None:
    """Fill ``nodes`` (3, nodes) m with the corners of all panels."""
    width = 2 * p.half + 1
    for edge in range(width):
        for c in range(3):
            front = back = count = 0.0
            for column in range(max(edge - 1, 0), min(edge + 1, 2 * p.half)):
                s = strip_of(column, p.half)
                side = 0.5 if (column < edge) == (column >= p.half) else -0.5
                middle = motion.place[c, s] + side * strips.width[s] * motion.axes[0, c, s]
                front += middle + 0.5 * strips.chord[s] * motion.axes[1, c, s]
                back += middle - 0.5 * strips.chord[s] * motion.axes[1, c, s]
                count += 1.0
            for row in range(p.rows + 1):
                share = row / p.rows
                nodes[c, row * width + edge] = ((1.0 - share) * front + share * back) / count
    _set_tail_nodes(p, motion, nodes)


@internal
def _set_tail_nodes(p: VortexLatticeParameters, motion: Motion, nodes: Floats) -> None:
    t, first = p.tail, p.layout.first_node[TAILPLANE]
    for row in range(TAIL_ROWS + 1):
        for j in range(TAIL_COLUMNS + 1):
            k = first + row * (TAIL_COLUMNS + 1) + j
            tail_point(p, motion, row / TAIL_ROWS, (j / TAIL_COLUMNS - 0.5) * t.span, nodes[:, k])
    first = p.layout.first_node[FIN]
    for row in range(FIN_ROWS + 1):
        for j in range(FIN_COLUMNS + 1):
            k = first + row * (FIN_COLUMNS + 1) + j
            fin_point(p, motion, row / FIN_ROWS, j / FIN_COLUMNS * t.height, nodes[:, k])


@internal
def tail_point(p: VortexLatticeParameters, motion: Motion, back: float, right: float, out: Floats) -> None:
    """A point of the tailplane, ``back`` chords behind its leading edge and ``right`` m of its middle."""
    t, angle = p.tail, p.tail.incidence - motion.tail[0]
    ahead = t.chord * (0.25 - back)
    out[0], out[1], out[2] = t.x + ahead * math.cos(angle), t.y + right, t.z - ahead * math.sin(angle)


@internal
def fin_point(p: VortexLatticeParameters, motion: Motion, back: float, above: float, out: Floats) -> None:
    """A point of the fin, ``back`` chords behind its leading edge and ``above`` m its foot."""
    t, angle = p.tail, motion.tail[1]
    ahead = t.fin_chord * (0.25 - back)
    out[0], out[1], out[2] = t.fin_x + ahead * math.cos(angle), t.fin_y - ahead * math.sin(angle), t.fin_z - above


@internal
def tail_normal(p: VortexLatticeParameters, motion: Motion, out: Floats) -> None:
    """Normal of the tailplane, up."""
    angle = p.tail.incidence - motion.tail[0]
    out[0], out[1], out[2] = -math.sin(angle), 0.0, -math.cos(angle)


@internal
def fin_normal(p: VortexLatticeParameters, motion: Motion, out: Floats) -> None:
    """Normal of the fin, to the left."""
    out[0], out[1], out[2] = -math.sin(motion.tail[1]), -math.cos(motion.tail[1]), 0.0


@internal
def surface_point(
    p: VortexLatticeParameters, motion: Motion, surface: int, back: float, along: float, out: Floats
) -> None:
    """A point of tailplane or fin, ``back`` chords behind its leading edge, ``along`` its span from 0 to 1."""
    if surface == TAILPLANE:
        tail_point(p, motion, back, (along - 0.5) * p.tail.span, out)
    else:
        fin_point(p, motion, back, along * p.tail.height, out)


@internal
def surface_normal(p: VortexLatticeParameters, motion: Motion, surface: int, out: Floats) -> None:
    """Normal of tailplane or fin."""
    if surface == TAILPLANE:
        tail_normal(p, motion, out)
    else:
        fin_normal(p, motion, out)


@internal
def swing(p: VortexLatticeParameters, motion: Motion, surface: int, back: float) -> float:
    """m/s; along the normal, of a point ``back`` chords behind the leading edge, by elevator's or rudder's rate."""
    if surface == TAILPLANE:
        return float(-motion.tail_rate[0] * p.tail.chord * (0.25 - back))
    return float(motion.tail_rate[1] * p.tail.fin_chord * (0.25 - back))


@internal
def _through(motion: Motion, point: Floats, normal: Floats) -> float:
    """m/s; of the air along ``normal`` at a ``point`` that moves with the fuselage."""
    b, total = motion.body, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        total -= (b[i] + b[3 + j] * point[k] - b[3 + k] * point[j]) * normal[i]
    return float(total)


@internal
def store_normals(p: VortexLatticeParameters, motion: Motion, state: Floats) -> None:
    """Store the panel normals of the wing in their strips' axes, with which they rotate until the next step.

    Where the wing twists they are not the strips': what blows along the span goes through the panels too.
    """
    columns = 2 * p.half
    for k in range(p.rows * columns):
        column = k % columns
        s, to = strip_of(column, p.half), p.memory.normals + 3 * k
        for i in range(3):
            total = 0.0
            for c in range(3):
                total += motion.axes[i, c, s] * p.workspace.panels.normal[c, k]
            state[to + i] = -total if i == 0 and column < p.half else total


@internal
def set_flow(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats, flow: Floats) -> None:
    """Fill ``flow`` (N,) m/s with the normal velocity at each panel due to its motion."""
    columns, work = 2 * p.half, p.workspace.scratch
    for row in range(p.rows):
        for column in range(columns):
            s = strip_of(column, p.half)
            behind = ((row + 0.75) / p.rows - 0.5) * strips.chord[s]
            k, right = row * columns + column, -motion.outward[s] if column < p.half else motion.outward[s]
            at = p.memory.normals + 3 * k
            flow[k] = (motion.down[s] + behind * motion.pitch_rate[s]) * state[at + 2]
            flow[k] += (p.strip.zero_lift_angle - state[at + 1]) * motion.along[s] - right * state[at]
    point, normal = work[2, 0], work[2, 1]
    tail_normal(p, motion, normal)
    for row in range(TAIL_ROWS):
        for j in range(TAIL_COLUMNS):
            right = ((j + 0.5) / TAIL_COLUMNS - 0.5) * p.tail.span
            tail_point(p, motion, (row + 0.75) / TAIL_ROWS, right, point)
            flow[p.layout.first_panel[TAILPLANE] + row * TAIL_COLUMNS + j] = _through(motion, point, normal) - swing(
                p, motion, TAILPLANE, (row + 0.75) / TAIL_ROWS
            )
    fin_normal(p, motion, normal)
    for row in range(FIN_ROWS):
        for j in range(FIN_COLUMNS):
            fin_point(p, motion, (row + 0.75) / FIN_ROWS, (j + 0.5) / FIN_COLUMNS * p.tail.height, point)
            flow[p.layout.first_panel[FIN] + row * FIN_COLUMNS + j] = _through(motion, point, normal) - swing(
                p, motion, FIN, (row + 0.75) / FIN_ROWS
            )


@internal
def set_strips(p: VortexLatticeParameters, strips: Strips, motion: Motion) -> None:
    """Fill the workspace's quarter-chord points and normals (3, S) of the strips."""
    points, normals, columns, work = p.workspace.points, p.workspace.normals, 2 * p.half, p.workspace.scratch
    for column in range(columns):
        s = strip_of(column, p.half)
        for c in range(3):
            points[c, column] = motion.place[c, s] + 0.25 * strips.chord[s] * motion.axes[1, c, s]
            normals[c, column] = motion.axes[2, c, s]
    for j in range(TAIL_COLUMNS):
        k = columns + j
        tail_point(p, motion, 0.25, ((j + 0.5) / TAIL_COLUMNS - 0.5) * p.tail.span, work[2, 0])
        tail_normal(p, motion, work[2, 1])
        for c in range(3):
            points[c, k], normals[c, k] = work[2, 0, c], work[2, 1, c]
    for j in range(FIN_COLUMNS):
        k = columns + TAIL_COLUMNS + j
        fin_point(p, motion, 0.25, (j + 0.5) / FIN_COLUMNS * p.tail.height, work[2, 0])
        fin_normal(p, motion, work[2, 1])
        for c in range(3):
            points[c, k], normals[c, k] = work[2, 0, c], work[2, 1, c]
