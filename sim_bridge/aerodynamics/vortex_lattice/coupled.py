"""The vortex lattice as an aerodynamic model: wings, tail and wake of any vehicle in one flow.

It has a rate of its own below the integrator's. ``advance`` keeps account of how the body moves through the air and,
a lattice step having passed, carries the wake, sheds a row and computes the influences of the lattice's new shape.
``loads`` lets the strengths follow the motion of every stage by these (`response`), and returns

* *circulatory* and *suction*: along the normal, and forward and outward along chord and span, what all legs bear by
  Joukowski, in the air that their motion, the wake and the other legs let meet them (`bearing`);
* the air's apparent mass, which the mechanism solves for with the accelerations. What else the strengths' rates do,
  the wake's share above all, is a difference of two lattice steps, held to the next: light wings stay stable, because
  nothing in it answers to their acceleration at once;
* *separated* and *friction*: those of the strip theory, with its limits for the stall, by the share of
  ``correction``, and with its quasi-steady incidence, to which its limits apply;
* *tail*: tailplane and fin in the wings' wake, on the body.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    INERTIA,
    MASS,
    NOSE_UP,
    OUTWARD,
    UPWARD,
    AerodynamicModel,
    Motion,
    SectionLoads,
    Strips,
    ValidRange,
    blank_loads,
    blank_motion,
)
from sim_bridge.aerodynamics.strip_theory import (
    KINEMATIC_VISCOSITY,
    SLOWEST,
    SectionMotion,
    friction_coefficient,
    stalled_share,
)
from sim_bridge.aerodynamics.vortex_lattice.bearing import across_offset, along_offset, sharer, weight
from sim_bridge.aerodynamics.vortex_lattice.lattice_motion import strip_of
from sim_bridge.aerodynamics.vortex_lattice.response import set_strengths
from sim_bridge.aerodynamics.vortex_lattice.settings import (
    VortexLattice,
    VortexLatticeParameters,
    parameters_of,
)
from sim_bridge.aerodynamics.vortex_lattice.shedding import lattice_step, move_pose, set_level, start
from sim_bridge.aerodynamics.vortex_lattice.tail import load_tail
from sim_bridge.compiled import Bound, bound_values, far_kernel, internal, kernel, run_far
from sim_bridge.vectors import Floats

PARTS = ("circulatory", "suction", "separated", "friction", "tail")
STARTS = -1.0
"""s; the time step that begins a memory"""
CIRCULATORY, SUCTION, SEPARATED, FRICTION, TAIL = range(len(PARTS))
_built: dict[tuple[VortexLattice, bytes], VortexLatticeParameters] = {}
_bound: dict[int, tuple[VortexLatticeParameters, Bound]] = {}


class FarLattice(NamedTuple):
    """Addresses of the compiled lattice, so that only vehicles that use it compile it."""

    loads: int
    advance: int
    parameters: int

    @staticmethod
    def blank() -> FarLattice:
        """Return the blank of a vehicle without lattice."""
        return FarLattice(0, 0, 0)


def far_lattice(parameters: VortexLatticeParameters) -> FarLattice:
    """Compile the lattice of ``parameters`` and keep a reference to them."""
    bound, some = bound_parameters(parameters), np.zeros(2 * parameters.half)
    strips, state = Strips(some, some, some, some, some), np.zeros(parameters.memory.size)
    values = strips, blank_motion(strips, 2), state
    out = blank_loads(len(PARTS), strips, parameters.memory.size)
    return FarLattice(
        far_kernel(_loads_far, bound, Bound((*values, out))),
        far_kernel(_advance_far, bound, Bound(values)),
        bound.address,
    )


def bound_parameters(parameters: VortexLatticeParameters) -> Bound:
    """Return the parameters with an address; kept for the process."""
    if id(parameters) not in _bound:
        _bound[id(parameters)] = parameters, Bound((parameters,))
    return _bound[id(parameters)][1]


def _loads_far(parameters: Bound, values: Bound, density: float) -> None:
    (p,), (strips, motion, state, out) = bound_values(parameters), bound_values(values)
    loads(p, strips, motion, density, state, out)


def _advance_far(parameters: Bound, values: Bound, dt: float) -> None:
    (p,), (strips, motion, state) = bound_values(parameters), bound_values(values)
    advance(p, strips, motion, 0.0, state, dt)


def build(settings: VortexLattice, strips: Strips) -> VortexLatticeParameters:
    """Build the kernel arguments for the wings of a vehicle; equal wings share them and their workspace.

    Raises:
        InputError: see `parameters_of`.
    """
    key = settings, b"".join(column.tobytes() for column in strips)
    if key not in _built:
        _built[key] = parameters_of(settings, strips)
    return _built[key]


def initial(parameters: VortexLatticeParameters, strips: Strips) -> Floats:
    """Return the state of flat wings at rest with a straight wake of zero strength."""
    p, state = parameters, np.zeros(parameters.memory.size)
    motion = blank_motion(strips, 2)
    set_level(strips, motion)
    bound, values = bound_parameters(p), Bound((strips, motion, state))
    run_far(far_kernel(_advance_far, bound, values), bound, values, STARTS)
    return state


@kernel
def loads(
    parameters: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    """Fill ``out``, see `sim_bridge.aerodynamics.protocol`."""
    p, solved = parameters, parameters.workspace.solved
    set_strengths(p, strips, motion, state, solved)
    _load_wing(p, strips, motion, density, state, out)
    load_tail(p, motion, density, state, solved, out.body[TAIL])


@kernel
def _load_wing(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    for column in range(2 * p.half):
        p.workspace.wash[column] = _downwash(p, column, state, p.workspace.solved)
        _load_strip(p, strips, motion, column, density, state, out)
    for edge in range(2 * p.half + 1):
        _load_edge(p, strips, motion, edge, density, state, out)


@internal
def _downwash(p: VortexLatticeParameters, column: int, state: Floats, strengths: Floats) -> float:
    """m/s; along the normal at a strip's quarter chord by all legs but those across of its surface."""
    n, total = p.panel_at.shape[0], 0.0
    row = p.memory.downwash + column * n
    for k in range(n):
        total += state[row + k] * strengths[k]
    return float(total)


@internal
def _load_strip(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    column: int,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    """The legs across of a strip and what it has besides; fills its loads."""
    s, columns, solved, before = strip_of(column, p.half), 2 * p.half, p.workspace.solved, 0.0
    chord = strips.chord[s]
    stalled = p.correction * stall_of(p, chord, motion, s)
    out.parts[:, :, s] = 0.0
    for row in range(p.rows):
        strength = solved[row * columns + column]
        leg_data = state[across_offset(p, row, column) :]
        _bear(p, motion, column, leg_data, density * (strength - before), stalled, out)
        before = strength
    _separate(p, strips, motion, s, density, stalled, out)
    residual = (1.0 - stalled) * density
    out.parts[CIRCULATORY, UPWARD, s] += residual * state[p.memory.residual + column]
    out.parts[CIRCULATORY, NOSE_UP, s] += residual * state[p.memory.residual + p.trailing.shape[0] + column]
    apparent = density * apparent_area(p, chord) * strips.width[s] * (1.0 - 0.5 * stalled)
    out.apparent[MASS, s] = apparent
    out.apparent[INERTIA, s] = apparent * chord * chord / 32.0


@internal
def _load_edge(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    edge: int,
    density: float,
    state: Floats,
    out: SectionLoads,
) -> None:
    """Add what the legs along one edge bear to the two strips that share them."""
    columns, solved = 2 * p.half, p.workspace.solved
    for share in range(2):
        column = sharer(edge, share, columns)
        s = strip_of(column, p.half)
        stalled = p.correction * stall_of(p, strips.chord[s], motion, s)
        for row in range(p.rows):
            left = solved[row * columns + edge - 1] if edge > 0 else 0.0
            right = solved[row * columns + edge] if edge < columns else 0.0
            push = weight(edge, share, columns) * density * (left - right)
            _bear(p, motion, column, state[along_offset(p, row, edge, share) :], push, stalled, out)


@internal
def _bear(
    p: VortexLatticeParameters,
    motion: Motion,
    column: int,
    leg_data: Floats,
    push: float,
    stalled: float,
    out: SectionLoads,
) -> None:
    """Add to a strip's loads what a leg that is ``leg_data`` (7,) bears by ``push``, density times net strength."""
    s, side, ahead = strip_of(column, p.half), -1.0 if column < p.half else 1.0, leg_data[6]
    right, forward = leg_data[0] - side * motion.outward[s], leg_data[1] - motion.along[s]
    up = leg_data[2] + p.workspace.wash[column] + motion.down[s] - ahead * motion.pitch_rate[s]
    attached = (1.0 - stalled) * push
    efficiency = attached * (1.0 - p.correction * (1.0 - p.strip.suction_efficiency))
    lifting = attached * (right * leg_data[4] - forward * leg_data[3])
    out.parts[CIRCULATORY, UPWARD, s] += lifting
    out.parts[CIRCULATORY, NOSE_UP, s] += ahead * lifting
    out.parts[SUCTION, FORWARD, s] += efficiency * (up * leg_data[3] - right * leg_data[5])
    out.parts[SUCTION, OUTWARD, s] += efficiency * side * (forward * leg_data[5] - up * leg_data[4])


@internal
def apparent_area(p: VortexLatticeParameters, chord: float) -> float:
    """Apparent mass per unit span over the density in m^2, corrected for finite span."""
    return 0.25 * math.pi * chord * chord * p.thickness


@internal
def stall_of(p: VortexLatticeParameters, chord: float, motion: Motion, s: int) -> float:
    """Stalled fraction, 0 to 1, of a section by strip theory's quasi-steady incidence and limits."""
    along, turn = motion.along[s], motion.pitch_rate[s]
    section = SectionMotion(along, motion.plunge[s], motion.down[s], turn, chord)
    across = p.strip.lift_factor * (motion.down[s] + 0.25 * chord * turn) - 0.75 * chord * turn
    return stalled_share(across, section, max(abs(along), SLOWEST), p.strip)


@internal
def _separate(
    p: VortexLatticeParameters,
    strips: Strips,
    motion: Motion,
    s: int,
    density: float,
    stalled: float,
    out: SectionLoads,
) -> None:
    """The loads that an ideal flow has not, as `strip_theory.section_loads` has them."""
    along, down, chord = motion.along[s], motion.down[s], strips.chord[s]
    pressure = 0.5 * density * chord * strips.width[s]
    skin = friction_coefficient(max(abs(along), SLOWEST) * chord / KINEMATIC_VISCOSITY)
    out.parts[SEPARATED, UPWARD, s] = stalled * 1.98 * pressure * math.sqrt(along * along + down * down) * down
    out.parts[FRICTION, FORWARD, s] = -p.correction * (1.0 - stalled) * pressure * skin * along * abs(along)


@kernel
def advance(
    parameters: VortexLatticeParameters, strips: Strips, motion: Motion, density: float, state: Floats, dt: float
) -> None:
    """Integrate the body's pose and take a lattice step if it is due; a negative ``dt`` starts."""
    p, m = parameters, parameters.memory
    if dt < 0.0:
        start(p, strips, motion, state)
        return
    move_pose(motion.body, state[m.pose : m.pose + 7], dt)
    state[m.clock] += dt
    if state[m.clock] > p.dt - 0.5 * dt:
        lattice_step(p, strips, motion, state)


RANGES = (
    ValidRange("advance_ratio", 1.0, math.inf, "hawkmoth: lift 8 % above the quasi-steady model at 1.1, 60 % at 0.6"),
    ValidRange("reynolds", 1e4, math.inf, "Yeo 2011: 18,000, the lowest that was compared"),
    ValidRange("reduced_frequency", 0.0, 1.0, "Theodorsen: within 1.9 % up to 1"),
)
MODEL = AerodynamicModel(
    name="vortex_lattice",
    title="Unsteady vortex lattice of wings and tail with a wake shed in time (Katz and Plotkin 2001)",
    settings=VortexLattice,
    parameters=VortexLatticeParameters,
    parts=PARTS,
    build=build,
    initial=initial,
    loads=loads,
    advance=advance,
    advances=True,
    with_tail=True,
    keeps_wake=True,
    ranges=RANGES,
)
