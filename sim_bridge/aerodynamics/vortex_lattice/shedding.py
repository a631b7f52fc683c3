"""One step of the coupled lattice: pose of the body, convection and shedding of the wake, rates of strengths."""

from __future__ import annotations

import math

from sim_bridge.aerodynamics.protocol import Motion, Strips
from sim_bridge.aerodynamics.vortex_lattice.bearing import set_all_filaments, store_legs, store_legs_in_still_air
from sim_bridge.aerodynamics.vortex_lattice.influence import induced
from sim_bridge.aerodynamics.vortex_lattice.lattice_motion import store_normals, strip_of
from sim_bridge.aerodynamics.vortex_lattice.response import (
    feel_wake,
    near_ground,
    place,
    respond,
    set_strengths,
    set_wide_rings,
)
from sim_bridge.aerodynamics.vortex_lattice.settings import VortexLatticeParameters
from sim_bridge.aerodynamics.vortex_lattice.wake import Core, Wake, carry, set_wake_filaments, shed
from sim_bridge.compiled import internal, kernel
from sim_bridge.vectors import Floats, rotation

START_CHORDS = 10.0
"""-; length of the straight wake that the response begins with, in root chords"""
ROWS, STEPPED = 1, 2
"""behind the clock"""


def set_level(strips: Strips, motion: Motion) -> None:
    """Set ``motion`` to flat wings and a level tail at rest."""
    side = 2.0 * strips.wing - 1.0
    motion.place[0] = -0.5 * strips.chord
    motion.place[1] = side * strips.span
    motion.axes[0, 1], motion.axes[1, 0], motion.axes[2, 2] = side, 1.0, -1.0


@internal
def start(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats) -> None:
    """Fill ``state`` with a lattice at rest and a straight wake of zero strength."""
    state[:] = 0.0
    state[p.memory.pose + 3] = 1.0
    place(p, strips, motion)
    ends = p.workspace.velocity[:, : p.workspace.edges.shape[1]]
    for j in range(ends.shape[1]):
        for c in range(3):
            ends[c, j] = p.workspace.edges[c, j] - (START_CHORDS * strips.chord[0] if c == 0 else 0.0)
    set_wide_rings(p, ends)
    store_normals(p, motion, state)
    respond(p, p.workspace.images[:1], state)
    store_legs_in_still_air(p, strips, motion, state)


@kernel
def move_pose(body: Floats, pose: Floats, dt: float) -> None:
    """Move ``pose`` (7,), place m and quaternion in the axes of the last step, with the ``body``'s velocities."""
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    a, b, c = 0.5 * dt * body[3], 0.5 * dt * body[4], 0.5 * dt * body[5]
    # The velocity turned by the quaternion of the middle of the step.
    for half in range(2):
        if half == 1:
            _translate(body, pose, dt, w, x, y, z)
        nw, nx = w - 0.5 * (a * x + b * y + c * z), x + 0.5 * (a * w + c * y - b * z)
        ny, nz = y + 0.5 * (b * w + a * z - c * x), z + 0.5 * (c * w + b * x - a * y)
        size = math.sqrt(nw * nw + nx * nx + ny * ny + nz * nz)
        w, x, y, z = nw / size, nx / size, ny / size, nz / size
    pose[3], pose[4], pose[5], pose[6] = w, x, y, z


@internal
def _translate(body: Floats, pose: Floats, dt: float, w: float, x: float, y: float, z: float) -> None:
    vx, vy, vz = body[0], body[1], body[2]
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    pose[0] += dt * (vx + w * tx + y * tz - z * ty)
    pose[1] += dt * (vy + w * ty + z * tx - x * tz)
    pose[2] += dt * (vz + w * tz + x * ty - y * tx)


@internal
def wake_of(p: VortexLatticeParameters, state: Floats) -> Wake:
    """Return views of the wake in ``state``."""
    m, rows, strips = p.memory, p.wake_rows, p.trailing.shape[0]
    edges = strips + p.layout.columns.shape[0]
    nodes = state[m.nodes : m.nodes + 3 * (rows + 1) * edges].reshape((3, rows + 1, edges))
    strengths = state[m.shed : m.shed + rows * strips].reshape((rows, strips))
    return Wake(nodes, strengths, state[m.far : m.far + strips], state[m.clock + ROWS : m.clock + ROWS + 1])


@internal
def _turn_into_body(p: VortexLatticeParameters, wake: Wake, pose: Floats) -> None:
    """Transform the wake's nodes to the present body axes and reset the pose."""
    r, nodes = p.workspace.scratch[4], wake.nodes
    rotation(pose[3], pose[4], pose[5], pose[6], r)
    for i in range(int(wake.rows[0]) + 1):
        for j in range(nodes.shape[2]):
            x, y, z = nodes[0, i, j] - pose[0], nodes[1, i, j] - pose[1], nodes[2, i, j] - pose[2]
            for c in range(3):
                nodes[c, i, j] = r[0, c] * x + r[1, c] * y + r[2, c] * z
    for i in range(7):
        pose[i] = 1.0 if i == 3 else 0.0


@internal
def lattice_step(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats) -> None:
    """Carry the wake, shed a row, find the new shape's response and the rates of the strengths."""
    m, workspace, n = p.memory, p.workspace, p.panel_at.shape[0]
    dt = state[m.clock]
    state[m.clock] = 0.0
    set_strengths(p, strips, motion, state, workspace.solved)
    wake, first = wake_of(p, state), state[m.clock + STEPPED] == 0.0
    _turn_into_body(p, wake, state[m.pose : m.pose + 7])
    place(p, strips, motion)
    images = workspace.images[: near_ground(p, motion)]
    core = Core(p.bound_core, 1, p.wake_core, 1.46e-5, 1e-4)
    if first:
        _begin(p, motion, wake, dt)
    else:
        for s in range(p.trailing.shape[0]):
            wake.strengths[0, s] = workspace.solved[p.trailing[s]]
    if p.free_wake and not first:
        _free(p, wake, core, images, dt)
    _shed(p, wake)
    set_wide_rings(p, wake.nodes[:, 1])
    store_normals(p, motion, state)
    respond(p, images, state)
    feel_wake(p, set_wake_filaments(p.layout, wake, core, p.dt, workspace.table, 0), images, state)
    set_strengths(p, strips, motion, state, workspace.solved)
    store_legs(p, strips, motion, wake, core, images, state)
    _set_residual(p, strips, motion, state, 0.0 if first else 1.0 / dt)
    for k in range(n):
        state[m.strengths + k] = workspace.solved[k]
    state[m.clock + STEPPED] = 1.0


@internal
def _begin(p: VortexLatticeParameters, motion: Motion, wake: Wake, dt: float) -> None:
    """Trailing edges a step ago, as if the body had gone on as now."""
    b, edges = motion.body, p.workspace.edges
    for j in range(edges.shape[1]):
        for c in range(3):
            d, e = (c + 1) % 3, (c + 2) % 3
            wake.nodes[c, 0, j] = edges[c, j] - dt * (b[c] + b[3 + d] * edges[e, j] - b[3 + e] * edges[d, j])


@internal
def _shed(p: VortexLatticeParameters, wake: Wake) -> None:
    """Begin another row, whose strength is the trailing edge's of any moment: it is no part of the wake's own."""
    shed(wake, p.workspace.edges, p.workspace.unit[: p.trailing.shape[0]])
    for s in range(p.trailing.shape[0]):
        wake.strengths[0, s] = 0.0


@internal
def _free(p: VortexLatticeParameters, wake: Wake, core: Core, images: Floats, dt: float) -> None:
    """Carry the wake with what wake and bound vortices induce; the rings are those of the step before."""
    workspace, edges = p.workspace, wake.nodes.shape[2]
    used = (int(wake.rows[0]) + 1) * edges
    set_wide_rings(p, wake.nodes[:, 0])
    count = set_all_filaments(p, wake, core)
    for c in range(3):
        for k in range(used):
            workspace.velocity[c, k] = 0.0
    points = wake.nodes.reshape((3, wake.nodes.shape[1] * edges))[:, :used]
    induced(workspace.table, count, images, points, workspace.velocity)
    carry(wake, workspace.velocity, dt)


@internal
def _set_residual(
    p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats, per_second: float
) -> None:
    """Force and moment of the strengths' rates over the last step, less what the apparent mass has of them."""
    m, columns, solved, total = p.memory, 2 * p.half, p.workspace.solved, p.trailing.shape[0]
    for column in range(columns):
        s = strip_of(column, p.half)
        chord, width = strips.chord[s], strips.width[s]
        upward = nose_up = 0.0
        for row in range(p.rows):
            k = row * columns + column
            # A ring reaches from a quarter of its panel to that of the next, the last one to the trailing edge.
            length = (1.0 if row < p.rows - 1 else 0.75) * chord / p.rows
            ahead = 0.5 * chord - (row + 0.25) / p.rows * chord - 0.5 * length
            rate = (solved[k] - state[m.strengths + k]) * per_second * length * width
            upward += rate
            nose_up += ahead * rate
        mass = 0.25 * math.pi * chord * chord * p.thickness * width
        down, turn = motion.down[s], motion.pitch_rate[s]
        upward -= mass * (down - state[m.last + column]) * per_second
        nose_up += mass * chord * chord / 32.0 * (turn - state[m.last + total + column]) * per_second
        state[m.residual + column], state[m.residual + total + column] = upward, nose_up
        state[m.last + column], state[m.last + total + column] = down, turn
