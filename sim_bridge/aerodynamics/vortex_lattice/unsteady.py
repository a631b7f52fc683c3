"""A lattice with prescribed motion in air at rest, time step by time step.

All quantities are in axes that are at rest in the undisturbed air, so that flight, flapping and twist are one motion
of the lattice's nodes and the wake moves by what vortices induce alone. A step:

    carry the wake, shed what the trailing edges held a step ago  -->  influence of rings, of the wake, of the motion
    -->  strengths that let no air through the panels  -->  forces by `forces`, both ways  -->  the wake's velocity

A wake is *prescribed*, at rest in the air where it was shed, or *free*, carried by all that is induced there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.crossings import check_crossings
from sim_bridge.aerodynamics.vortex_lattice.forces import Flow, Loads, blank_loads_of, middles, ring_areas, set_loads
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, grid_of, panel_count
from sim_bridge.aerodynamics.vortex_lattice.influence import induced, reflections
from sim_bridge.aerodynamics.vortex_lattice.legs import Legs, legs_of, set_bound_filaments
from sim_bridge.aerodynamics.vortex_lattice.panels import (
    Panels,
    blank_panels,
    factorize,
    set_influence,
    set_panels,
    set_rings,
    substitute,
)
from sim_bridge.aerodynamics.vortex_lattice.steady import edge_nodes, mean_chords, trailing_panels
from sim_bridge.aerodynamics.vortex_lattice.wake import (
    Core,
    Wake,
    blank_table,
    blank_wake,
    carry,
    set_wake_filaments,
    shed,
    wake_filaments,
)
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

LONGEST_STEP = 5.0
"""-; way of a trailing edge in a step over the length of its panel: a longer wake ring resolves nothing of it"""
SLOWEST = 1e-9
"""m; way of the fastest node in a step below which nothing moves"""
WAKES = ("prescribed", "free")

NodeMotion = Callable[[float], Floats]
"""time in s to the lattice's nodes (3, nodes) in m, in axes at rest in the undisturbed air"""


class Scheme(NamedTuple):
    """Time steps of a motion and treatment of the wake."""

    dt: float
    """s"""
    steps: int
    wake: str = "prescribed"
    """or "free" """
    rows: int = 0
    """of the wake, before it is cut off and goes on as a far row; 0 for all that are shed"""
    bound_core: float = 1e-3
    """-; radius of the bound vortices' cores over the mean chord of all surfaces"""
    wake_core: float = 0.03
    """-; radius of the wake's cores at birth over the mean chord of all surfaces"""
    viscosity: float = 1.46e-5
    """m^2/s"""
    squire: float = 1e-4
    """-; growth of the wake's cores with their strength"""
    behind: float = 0.25
    """-; where the last rings end, in ways of the trailing edge in a step behind it (Katz and Plotkin: 0.2 to 0.3)"""
    backward: bool = False
    """velocities and rates by the difference to the step before, and the trailing edge's leg loaded, instead of
    velocities at the instant and rates of the second order"""


class Air(NamedTuple):
    """Properties of the air."""

    density: float = 1.225
    """kg/m^3"""
    symmetric: bool = False
    """the lattice is one half, its mirror image in the plane y = 0 moves with it"""
    ground: float | None = None
    """m; height z of a plane that no air crosses"""


class History(NamedTuple):
    """History of a run; n steps, N panels. Loads are those of the panels given, not of mirror images."""

    time: Floats
    """(n,) s"""
    strengths: Floats
    """(n, N) m^2/s"""
    force: Floats
    """(n, N, 3) N; by the unsteady Joukowski form"""
    moment: Floats
    """(n, N, 3) N m; about the axes' origin"""
    pressure_force: Floats
    """(n, N, 3) N; by Katz and Plotkin's pressures"""
    rate_force: Floats
    """(n, N, 3) N; of ``force`` what the strengths' rates bear: apparent mass and the rest of the unsteadiness"""
    power: Floats
    """(n, N) W"""
    wake: Wake
    """at the end"""
    lattice: Lattice
    """at the end"""

    def surface_force(self, surface: int) -> Floats:
        """Force (n, 3) in N of one surface."""
        return np.asarray(self.force[:, self._panels(surface)].sum(axis=1))

    def strip_force(self, surface: int) -> Floats:
        """Force (n, columns, 3) in N of the strips of one surface, left to right."""
        rows = int(self.lattice.layout.rows[surface])
        mine = self.force[:, self._panels(surface)]
        return np.asarray(mine.reshape(len(self.time), rows, -1, 3).sum(axis=1))

    def _panels(self, surface: int) -> slice:
        layout = self.lattice.layout
        first = int(layout.first_panel[surface])
        return slice(first, first + int(layout.rows[surface] * layout.columns[surface]))


class Snapshot(NamedTuple):
    """Lattice and wake at one step; R rows of the wake so far, E edge nodes, S strips, N panels."""

    time: float
    """s"""
    nodes: Floats
    """(3, nodes) m; of the lattice"""
    strengths: Floats
    """(N,) m^2/s"""
    wake_nodes: Floats
    """(3, R + 1, E) m; the newest row first"""
    wake_strengths: Floats
    """(R, S) m^2/s"""


class _Work(NamedTuple):
    panels: Panels
    legs: Legs
    images: Floats
    cores: Floats
    matrix: Floats
    pivots: Floats
    scratch: Floats
    table: Floats
    wake: Wake
    core: Core
    loads: Loads
    trailing: Floats


class _Instant(NamedTuple):
    """Nodes, their velocity and those of the trailing edges' last rings."""

    nodes: Floats
    motion: Floats
    behind: Floats
    behind_motion: Floats


def ignore_progress(share: float) -> None:
    """Default progress callback: does nothing."""


def ignore_snapshot(at: Snapshot) -> None:
    """Default snapshot callback: does nothing."""


def run(
    lattice: Lattice,
    motion: NodeMotion,
    scheme: Scheme,
    air: Air,
    progress: Callable[[float], None] = ignore_progress,
    watch: Callable[[Snapshot], None] = ignore_snapshot,
) -> History:
    """Move the ``lattice`` from time 0; ``progress`` gets the fraction done, ``watch`` every step.

    The nodes of ``lattice`` are those of ``motion(0)``.

    Raises:
        InputError: surfaces cross, nothing moves, the time step is too long for the panels, an unknown wake, or
            panels without a solution.
    """
    _check(lattice, motion, scheme)
    work = _work(lattice, scheme, air)
    rows, strengths = [], [np.zeros(panel_count(lattice.layout))]
    velocity = np.zeros((3, work.wake.nodes.shape[1] * work.wake.nodes.shape[2]))
    for step in range(scheme.steps):
        at = _instant(lattice, motion, scheme, step * scheme.dt)
        _place(lattice, work, at)
        _shed(work, at, velocity, strengths[-1] if step else None, scheme.dt)
        count = set_wake_filaments(lattice.layout, work.wake, work.core, scheme.dt, work.table, 0)
        met = _met(lattice, work, at, count)
        strengths = [*strengths[-2:], _solve(lattice, work, met[0] - met[1], step)]
        pushed = _load(lattice, work, at, met, strengths, (scheme, air.density, step))
        rows.append(_row(work, strengths[-1], pushed))
        if watch is not ignore_snapshot:
            watch(_snapshot(work.wake, at.nodes, strengths[-1], step * scheme.dt))
        if scheme.wake == "free" and step + 1 < scheme.steps:
            _carried(lattice, work, strengths[-1], scheme.dt, velocity)
        progress((step + 1) / scheme.steps)
    strength, force, moment, pressed, by_rate, power = (np.array(column) for column in zip(*rows, strict=True))
    time, end = np.asarray(np.arange(scheme.steps) * scheme.dt), lattice._replace(nodes=at.nodes)
    return History(time, strength, force, moment, pressed, by_rate, power, work.wake, end)


def _check(lattice: Lattice, motion: NodeMotion, scheme: Scheme) -> None:
    if not (scheme.dt > 0.0 and math.isfinite(scheme.dt)) or scheme.steps < 1:
        raise InputError(f"dt = {scheme.dt:g} s and steps = {scheme.steps} must be above 0")
    if scheme.wake not in WAKES:
        raise InputError(f'wake "{scheme.wake}" is unknown; it is {" or ".join(WAKES)}')
    check_crossings(lattice)
    times = scheme.dt * np.linspace(0.0, scheme.steps, min(scheme.steps, 40) + 1)
    ways = [motion(time + scheme.dt) - motion(time) for time in times.tolist()]
    if not max(float(np.max(np.abs(way))) for way in ways) > SLOWEST:
        raise InputError("zero airspeed: no node of the lattice moves through the air")
    for i, name in enumerate(lattice.names):
        grid = grid_of(lattice, lattice.nodes, i)
        panel = float(np.linalg.norm(grid[-1] - grid[-2], axis=1).max())
        way = max(float(np.linalg.norm(grid_of(lattice, way, i)[-1], axis=1).max()) for way in ways)
        if way > LONGEST_STEP * panel:
            raise InputError(
                f'time step {scheme.dt:g} s is too long for surface "{name}": its trailing edge goes {way:.3g} m in'
                f" it, more than {LONGEST_STEP:g} of its panels' {panel:.3g} m"
            )


def _work(lattice: Lattice, scheme: Scheme, air: Air) -> _Work:
    layout, legs = lattice.layout, legs_of(lattice.layout)
    kept = min(scheme.rows or scheme.steps, scheme.steps)
    n, chords = panel_count(layout), mean_chords(lattice)
    mean = float(chords.mean())
    return _Work(
        panels=blank_panels(layout),
        legs=legs,
        images=reflections(air.symmetric, air.ground),
        cores=np.full(len(chords), scheme.bound_core * mean),
        matrix=np.zeros((n, n)),
        pivots=np.zeros(n),
        scratch=np.zeros((5, 3, int(layout.columns.max()) + 3)),
        table=blank_table(wake_filaments(layout, kept) + len(legs.start)),
        wake=blank_wake(layout, kept),
        core=Core(scheme.bound_core * mean, 0, scheme.wake_core * mean, scheme.viscosity, scheme.squire),
        loads=blank_loads_of(n),
        trailing=trailing_panels(layout),
    )


def _instant(lattice: Lattice, motion: NodeMotion, scheme: Scheme, time: float) -> _Instant:
    nodes, dt = motion(time), scheme.dt
    before = motion(time - dt)
    if scheme.backward:
        velocity = (nodes - before) / dt
    else:
        velocity = (motion(time + 1e-3 * dt) - motion(time - 1e-3 * dt)) / (2e-3 * dt)
    edges, way = edge_nodes(lattice.layout, nodes), edge_nodes(lattice.layout, nodes - before)
    return _Instant(nodes, velocity, edges - scheme.behind * way, edge_nodes(lattice.layout, velocity))


def _place(lattice: Lattice, work: _Work, at: _Instant) -> None:
    set_rings(lattice.layout, at.nodes, at.behind, work.panels.rings)
    set_panels(lattice.layout, at.nodes, work.panels)


def _shed(work: _Work, at: _Instant, velocity: Floats, strengths: Floats | None, dt: float) -> None:
    """Carry the wake and begin its next row; there is none at the first step."""
    if strengths is None:
        work.wake.nodes[:, 0] = at.behind
    else:
        carry(work.wake, velocity, dt)
        shed(work.wake, at.behind, strengths[work.trailing])


def _snapshot(wake: Wake, nodes: Floats, strengths: Floats, time: float) -> Snapshot:
    rows = int(wake.rows[0])
    return Snapshot(time, nodes, strengths, wake.nodes[:, : rows + 1].copy(), wake.strengths[:rows].copy())


def _row(work: _Work, strengths: Floats, pushed: Floats) -> tuple[Floats, ...]:
    """What `History` keeps of a step; ``pushed`` (N,) N, along the normals, by the strengths' rates."""
    loads, normal = work.loads, work.panels.normal
    pressed = loads.pressure * work.panels.area * normal
    return strengths, loads.force.T.copy(), loads.moment.T.copy(), pressed.T, (pushed * normal).T, loads.power.copy()


def _met(lattice: Lattice, work: _Work, at: _Instant, count: int) -> tuple[Floats, Floats]:
    """What the wake induces at the collocation points and how these move, (3, N) m/s each."""
    by_wake, moved = np.zeros_like(work.panels.collocation), blank_panels(lattice.layout)
    induced(work.table, count, work.images, work.panels.collocation, by_wake)
    set_panels(lattice.layout, at.motion, moved)
    return by_wake, moved.collocation


def _solve(lattice: Lattice, work: _Work, flow: Floats, step: int) -> Floats:
    """(N,) m^2/s; strengths that stop the ``flow`` (3, N) through the panels."""
    set_influence(lattice.layout, work.panels, work.images, work.cores, work.scratch, work.matrix)
    x = -np.einsum("in,in->n", flow, work.panels.normal)
    if not factorize(work.matrix, work.pivots):
        raise InputError(f"step {step}: the lattice has no solution: two of its panels lie in the same place")
    substitute(work.matrix, work.pivots, x)
    if not np.all(np.isfinite(x)):
        raise InputError(f"step {step}: the strengths have no finite value; a panel lost its area, or the wake burst")
    return np.asarray(x)


def _load(
    lattice: Lattice,
    work: _Work,
    at: _Instant,
    panels: tuple[Floats, Floats],
    strengths: list[Floats],
    how: tuple[Scheme, float, int],
) -> Floats:
    """Fill ``work.loads``; ``strengths`` are those of up to three steps, the last one now.

    Returns what their rates push along the normals, (N,) N.
    """
    (scheme, density, step), layout = how, lattice.layout
    trailing = work.trailing
    places, flow = np.zeros((3, len(work.legs.start))), np.zeros((3, len(work.legs.start)))
    middles(work.legs, work.panels.rings, places)
    count = _all_filaments(lattice, work, strengths[-1], scheme.dt)
    induced(work.table, count, work.images, places, flow)
    moved, motion = np.zeros_like(work.panels.rings), np.zeros_like(places)
    set_rings(layout, at.motion, at.behind_motion, moved)
    middles(work.legs, moved, motion)
    shed_now = strengths[-2][trailing] if scheme.backward else strengths[-1][trailing]
    rates = _rates(strengths, scheme, step)
    areas = work.panels.area.copy()
    if not scheme.backward:
        ring_areas(layout, work.panels.area, areas)
    met = Flow(flow, motion, *panels, shed_now, rates, areas)
    set_loads(layout, work.legs, work.panels, strengths[-1], met, density, work.loads)
    return np.asarray(density * rates * areas)


def _rates(strengths: list[Floats], scheme: Scheme, step: int) -> Floats:
    """(N,) m^2/s^2; an impulsive start is left out."""
    if scheme.backward or step == 1:
        return np.asarray((strengths[-1] - strengths[-2]) / scheme.dt)
    if step == 0:
        return np.zeros_like(strengths[-1])
    return np.asarray((1.5 * strengths[-1] - 2.0 * strengths[-2] + 0.5 * strengths[-3]) / scheme.dt)


def _all_filaments(lattice: Lattice, work: _Work, strengths: Floats, dt: float) -> int:
    """Put bound vortices and wake into the table."""
    count = set_bound_filaments(work.legs, work.panels.rings, strengths, work.cores, work.table)
    return int(set_wake_filaments(lattice.layout, work.wake, work.core, dt, work.table, count))


def _carried(lattice: Lattice, work: _Work, strengths: Floats, dt: float, velocity: Floats) -> None:
    """Fill ``velocity`` (3, (R + 1) E) m/s of the wake's nodes that there are."""
    used = (int(work.wake.rows[0]) + 1) * work.wake.nodes.shape[2]
    points, solved = work.wake.nodes.reshape(3, -1)[:, :used].copy(), np.zeros((3, used))
    count = _all_filaments(lattice, work, strengths, dt)
    induced(work.table, count, work.images, points, solved)
    velocity[:, :used] = solved
