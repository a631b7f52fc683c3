"""Load-carrying vortex legs of the coupled lattice: positions, local flow, data stored between steps.

All legs of all rings but those in the wake and at the trailing edges, where the newest row of the wake cancels them.
Legs across come first, row by row, then legs along, of each surface. At a lattice step the air at every leg is known;
until the next one the response of the strengths adds the downwash of each strip alone. The rest is constant, and so
are the wing's legs, in the axes of the strip that bears them, with which they turn. The
legs across of both root strips reach over the fuselage: its lift between the wings is theirs.
"""

from __future__ import annotations

from sim_bridge.aerodynamics.protocol import Motion, Strips
from sim_bridge.aerodynamics.vortex_lattice.influence import induced
from sim_bridge.aerodynamics.vortex_lattice.lattice_motion import strip_of, surface_normal
from sim_bridge.aerodynamics.vortex_lattice.legs import set_bound_filaments
from sim_bridge.aerodynamics.vortex_lattice.settings import FIN, LEG_SIZE, TAILPLANE, VortexLatticeParameters
from sim_bridge.aerodynamics.vortex_lattice.wake import Core, Wake, set_wake_filaments
from sim_bridge.compiled import internal
from sim_bridge.vectors import Floats


@internal
def set_all_filaments(p: VortexLatticeParameters, wake: Wake, core: Core) -> int:
    """Fill the workspace's table with bound rings, the newest wake row and the wake."""
    workspace = p.workspace
    for k in range(workspace.full.shape[1]):
        workspace.full[0, k] = 0.0
    for k in range(p.panel_at.shape[0]):
        workspace.full[0, p.panel_at[k]] = workspace.solved[k]
    for s in range(p.trailing.shape[0]):
        workspace.full[0, p.wake_at[s]] = workspace.solved[p.trailing[s]]
    count = set_bound_filaments(p.legs, workspace.rings, workspace.full[0], workspace.cores, workspace.table)
    return int(set_wake_filaments(p.layout, wake, core, p.dt, workspace.table, count))


@internal
def sharer(edge: int, share: int, columns: int) -> int:
    """Column of the strip with the first or second ``share`` of a leg along the wing's ``edge``."""
    if edge == 0:
        return share
    return columns - 1 - share if edge == columns else edge - 1 + share


@internal
def weight(edge: int, share: int, columns: int) -> float:
    """Weight of a strip in a leg along the chord: its loads are extrapolated linearly at the tips."""
    if 0 < edge < columns:
        return 0.5
    return 1.5 if share == 0 else -0.5


@internal
def across_offset(p: VortexLatticeParameters, row: int, column: int) -> int:
    """State index of the stored data of a spanwise leg of the wing; `LEG_SIZE` numbers."""
    return int(p.memory.leg_data + LEG_SIZE * (row * 2 * p.half + column))


@internal
def along_offset(p: VortexLatticeParameters, row: int, edge: int, share: int) -> int:
    """State index of the stored data of a strip's share in a chordwise leg of the wing."""
    columns = 2 * p.half
    return int(p.memory.leg_data + LEG_SIZE * (p.rows * columns + 2 * (row * (columns + 1) + edge) + share))


@internal
def tail_offset(p: VortexLatticeParameters, leg: int) -> int:
    """State index of the stored data of a leg of tailplane or fin; three numbers."""
    columns = 2 * p.half
    wing = LEG_SIZE * p.rows * (columns + 2 * (columns + 1))
    return int(p.memory.leg_data + wing + 3 * (leg - p.first_leg[TAILPLANE]))


@internal
def _set_middles(p: VortexLatticeParameters) -> None:
    rings, out = p.workspace.rings, p.workspace.leg_points
    for s in range(p.layout.rows.shape[0]):
        rows, columns, node = p.layout.rows[s], p.layout.columns[s], p.wider.first_node[s]
        across = p.first_leg[s]
        along, width = across + rows * columns, columns + 1
        for c in range(3):
            for i in range(rows):
                at = node + i * width
                for j in range(columns):
                    out[c, across + i * columns + j] = 0.5 * (rings[c, at + j] + rings[c, at + j + 1])
                for j in range(width):
                    out[c, along + i * width + j] = 0.5 * (rings[c, at + j] + rings[c, at + width + j])


@internal
def store_legs(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    wake: Wake,
    core: Core,
    images: Floats,
    state: Floats,
) -> None:
    """Store the induced velocity at every leg, less the downwash of each strip."""
    air, m, n = p.workspace.leg_air, p.memory, p.panel_at.shape[0]
    _set_middles(p)
    air[:] = 0.0
    induced(p.workspace.table, set_all_filaments(p, wake, core), images, p.workspace.leg_points, air)
    for s in range(p.trailing.shape[0]):
        total = 0.0
        for k in range(n):
            total += state[m.downwash + s * n + k] * p.workspace.solved[k]
        p.workspace.wash[s] = total
    _store_wing(p, strips, motion, state)
    _store_tail(p, motion, TAILPLANE, state)
    _store_tail(p, motion, FIN, state)


@internal
def store_legs_in_still_air(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats) -> None:
    """Store the wing's legs without induced velocity."""
    p.workspace.leg_air[:] = 0.0
    p.workspace.wash[:] = 0.0
    _store_wing(p, strips, motion, state)


@internal
def _store_wing(p: VortexLatticeParameters, strips: Strips, motion: Motion, state: Floats) -> None:
    columns = 2 * p.half
    for row in range(p.rows):
        node = p.wider.first_node[0] + row * (columns + 1)
        for column in range(columns):
            leg, at = row * columns + column, node + column
            _turn(p, strips, motion, column, (leg, at, at + 1), state, across_offset(p, row, column))
        for edge in range(columns + 1):
            leg, at = p.rows * columns + row * (columns + 1) + edge, node + edge
            for share in range(2):
                column, to = sharer(edge, share, columns), along_offset(p, row, edge, share)
                _turn(p, strips, motion, column, (leg, at, at + columns + 1), state, to)


@internal
def _turn(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    column: int,
    leg: tuple[int, int, int],
    state: Floats,
    to: int,
) -> None:
    """Hold a ``leg``, its place among all and its nodes, in the axes of a strip: right, forward, up.

    The air at it, its length, and how far ahead of mid-chord its middle is.
    """
    s, (which, start, end), rings = strip_of(column, p.half), leg, p.workspace.rings
    side, ahead = -1.0 if column < p.half else 1.0, 0.0
    for i in range(6):
        state[to + i] = 0.0
    for c in range(3):
        air, length = p.workspace.leg_air[c, which], rings[c, end] - rings[c, start]
        forward = motion.axes[1, c, s]
        for i in range(3):
            axis = (side if i == 0 else 1.0) * motion.axes[i, c, s]
            state[to + i] += axis * air
            state[to + 3 + i] += axis * length
        ahead += forward * (0.5 * (rings[c, start] + rings[c, end]) - motion.place[c, s])
    state[to + 2] -= p.workspace.wash[column]
    state[to + 6] = ahead


@internal
def _store_tail(p: VortexLatticeParameters, motion: Motion, surface: int, state: Floats) -> None:
    """In body axes; the strips' downwash is taken off legs across, which follow from it between steps."""
    rows, columns, first = p.layout.rows[surface], p.layout.columns[surface], p.first_leg[surface]
    normal = p.workspace.scratch[2, 1]
    surface_normal(p, motion, surface, normal)
    for k in range(rows * columns + rows * (columns + 1)):
        wash = p.workspace.wash[p.layout.first_strip[surface] + k % columns] if k < rows * columns else 0.0
        to = tail_offset(p, first + k)
        for c in range(3):
            state[to + c] = p.workspace.leg_air[c, first + k] - wash * normal[c]
