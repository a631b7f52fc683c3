"""Data that the coupled lattice stores between steps: response to motion, velocities induced by the wake.

At a step the rings' places are those of the instant. Between two steps they move on with the body, their influence on
one another unchanged, and each strength follows the motion of the moment: strengths = response (flow + by wake).
The newest row of the wake has the strength of the trailing edge at any moment, so that circulation that a step brings
on is not bound alone; the older rows have what they had when they were shed.
"""

from __future__ import annotations

from sim_bridge.aerodynamics.protocol import Motion, Strips
from sim_bridge.aerodynamics.vortex_lattice.influence import induced
from sim_bridge.aerodynamics.vortex_lattice.lattice_motion import set_flow, set_nodes, set_strips
from sim_bridge.aerodynamics.vortex_lattice.panels import (
    Panels,
    factorize,
    set_downwash,
    set_influence,
    set_panels,
    substitute,
)
from sim_bridge.aerodynamics.vortex_lattice.settings import FIN, TAILPLANE, VortexLatticeParameters
from sim_bridge.compiled import internal, kernel
from sim_bridge.vectors import Floats


@internal
def set_edges(p: VortexLatticeParameters, nodes: Floats, edges: Floats) -> None:
    """Fill ``edges`` (3, E) with the trailing edges of ``nodes`` (3, nodes)."""
    layout = p.layout
    for s in range(layout.rows.shape[0]):
        last = layout.first_node[s] + layout.rows[s] * (layout.columns[s] + 1)
        for j in range(layout.columns[s] + 1):
            for c in range(3):
                edges[c, layout.first_edge[s] + j] = nodes[c, last + j]


@internal
def place(p: VortexLatticeParameters, strips: Strips, motion: Motion) -> None:
    """Fill the workspace with the lattice of the instant, without the wake's row."""
    workspace = p.workspace
    set_nodes(p, strips, motion, workspace.nodes)
    set_panels(p.layout, workspace.nodes, workspace.panels)
    set_strips(p, strips, motion)
    set_edges(p, workspace.nodes, workspace.edges)


@internal
def set_wide_rings(p: VortexLatticeParameters, ends: Floats) -> None:
    """Fill the rings of the workspace, the last row between the trailing edges and ``ends`` (3, E)."""
    nodes, out = p.workspace.nodes, p.workspace.rings
    for s in range(p.layout.rows.shape[0]):
        rows, width = p.layout.rows[s], p.layout.columns[s] + 1
        first, to, edge = p.layout.first_node[s], p.wider.first_node[s], p.layout.first_edge[s]
        for c in range(3):
            for j in range(width):
                for i in range(rows):
                    here, there = nodes[c, first + i * width + j], nodes[c, first + (i + 1) * width + j]
                    out[c, to + i * width + j] = 0.75 * here + 0.25 * there
                out[c, to + rows * width + j] = nodes[c, first + rows * width + j]
                out[c, to + (rows + 1) * width + j] = ends[c, edge + j]


@internal
def respond(p: VortexLatticeParameters, images: Floats, state: Floats) -> None:
    """Store response and downwash of the workspace's rings; ``images`` do not enter the downwash."""
    workspace, m, n = p.workspace, p.memory, p.panel_at.shape[0]
    wide = Panels(workspace.rings, workspace.panels.collocation, workspace.panels.normal, workspace.panels.area)
    set_influence(p.wider, wide, images, workspace.cores, workspace.scratch, workspace.full)
    for k in range(n):
        _fold(p, workspace.full[k], workspace.matrix[k])
    solvable = factorize(workspace.matrix, workspace.pivots)
    for k in range(n):
        for i in range(n):
            workspace.unit[i] = -1.0 if i == k else 0.0
        if solvable:
            substitute(workspace.matrix, workspace.pivots, workspace.unit)
        for i in range(n):
            state[m.response + i * n + k] = workspace.unit[i]
    for s in range(workspace.points.shape[1]):
        for c in range(3):
            workspace.scratch[0, 0, c], workspace.scratch[0, 1, c] = workspace.points[c, s], workspace.normals[c, s]
        set_downwash(p.wider, _surface(p, s), workspace.rings, workspace.cores, workspace.scratch, workspace.full[0])
        _fold(p, workspace.full[0], state[m.downwash + s * n : m.downwash + (s + 1) * n])


@internal
def _surface(p: VortexLatticeParameters, strip: int) -> int:
    if strip >= p.layout.first_strip[FIN]:
        return FIN
    return TAILPLANE if strip >= p.layout.first_strip[TAILPLANE] else 0


@internal
def _fold(p: VortexLatticeParameters, wide: Floats, out: Floats) -> None:
    """The wake's newest row has the strength of the trailing edge."""
    for i in range(out.shape[0]):
        out[i] = wide[p.panel_at[i]]
    for s in range(p.wake_at.shape[0]):
        out[p.trailing[s]] += wide[p.wake_at[s]]


@internal
def feel_wake(p: VortexLatticeParameters, count: int, images: Floats, state: Floats) -> None:
    """Store the velocity induced on the panels by the first ``count`` filaments of the table."""
    points, normals, velocity, to = (
        p.workspace.panels.collocation,
        p.workspace.panels.normal,
        p.workspace.velocity,
        p.memory.by_wake,
    )
    n = p.panel_at.shape[0]
    for c in range(3):
        for k in range(n):
            velocity[c, k] = 0.0
    induced(p.workspace.table, count, images, points, velocity)
    for k in range(n):
        state[to + k] = (
            velocity[0, k] * normals[0, k] + velocity[1, k] * normals[1, k] + velocity[2, k] * normals[2, k]
        )


@internal
def near_ground(p: VortexLatticeParameters, motion: Motion) -> int:
    """Set the ground's reflection in the workspace; returns the number of images.

    The ground is left out above its reach, and lies below the lowest node where the lattice would touch it.
    """
    ground, images, nodes = motion.ground, p.workspace.images, p.workspace.nodes
    height = ground[0]
    if height > p.ground_reach:
        return 1
    for k in range(nodes.shape[1]):
        low = ground[1] * nodes[0, k] + ground[2] * nodes[1, k] + ground[3] * nodes[2, k]
        height = max(height, low + p.clearance)
    for i in range(3):
        images[1, 3, i] = 2.0 * height * ground[1 + i]
        for j in range(3):
            images[1, i, j] = (1.0 if i == j else 0.0) - 2.0 * ground[1 + i] * ground[1 + j]
    return 2


@kernel
def set_strengths(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats, solved: Floats) -> None:
    """Fill ``solved`` (N,) m^2/s, the ring strengths, for the motion of the instant."""
    m, n, flow = p.memory, p.panel_at.shape[0], p.workspace.unit
    set_flow(p, strips, motion, state, flow)
    for k in range(n):
        flow[k] += state[m.by_wake + k]
    for i in range(n):
        total, row = 0.0, m.response + i * n
        for k in range(n):
            total += state[row + k] * flow[k]
        solved[i] = total
