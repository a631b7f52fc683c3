"""Section of a vehicle file, parameters and workspace of the coupled lattice."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import Strips, aspect_ratio
from sim_bridge.aerodynamics.strip_theory import STALL_FACTOR_BOUNDS, StripParameters, strip_parameters
from sim_bridge.aerodynamics.vortex_lattice.crossings import check_crossings
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, Layout, lattice_of, layout_of, panel_count
from sim_bridge.aerodynamics.vortex_lattice.legs import Legs, legs_of
from sim_bridge.aerodynamics.vortex_lattice.panels import Panels, blank_panels
from sim_bridge.aerodynamics.vortex_lattice.steady import trailing_panels, with_wake_row
from sim_bridge.aerodynamics.vortex_lattice.wake import blank_table, wake_filaments
from sim_bridge.vectors import Floats, Integers
from wingbeat.errors import InputError
from wingbeat.units import Quantity

WING, TAILPLANE, FIN = 0, 1, 2
"""surfaces"""
TAIL_SHAPE, FIN_SHAPE = (2, 4), (2, 2)
"""rows and columns of panels"""


class VortexLattice(NamedTuple):
    """Section ``[vortex_lattice]`` of a vehicle file."""

    rows: Annotated[int, Quantity("-", 1, 8)]
    """panels of the wing along its chord; along the span there is one a strip"""
    rate: Annotated[float, Quantity("Hz", 10.0, 2000.0)]
    """at which the lattice sheds a row and its influences are computed anew"""
    wake_rows: Annotated[int, Quantity("-", 2, 400)]
    """of the wake, before it goes on as a far row"""
    free_wake: bool
    """whether the wake is carried by what is induced in it, or stays in the air where it was shed"""
    core: Annotated[float, Quantity("-", 1e-4, 0.5)]
    """radius of the wake's cores at birth over the wing's mean chord"""
    correction: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of stall, friction and lost suction of the strip theory: 0 is the ideal flow"""
    zero_lift_angle: Annotated[float, Quantity("rad", -1.6, 1.6)]
    """of the wing's section, negated: the angle that camber adds to the angle of attack"""
    suction_efficiency: Annotated[float, Quantity("-", 0.0, 1.0)]
    """share of the leading-edge suction that is realised, with the correction"""
    stall_angle: Annotated[float, Quantity("rad", 0.05, 1.5)]
    """static; raised by Kim's factor with ``dynamic_stall``"""
    dynamic_stall: str
    """``kim`` or ``fixed``, see `sim_bridge.aerodynamics.strip_theory`"""
    tail_place: Annotated[tuple[float, float, float], Quantity("m", -10.0, 10.0)]
    """of the tailplane's hinge, at a quarter of its chord, body axes"""
    tail_span: Annotated[float, Quantity("m", 0.001, 10.0)]
    tail_chord: Annotated[float, Quantity("m", 0.001, 10.0)]
    tail_incidence: Annotated[float, Quantity("rad", -1.0, 1.0)]
    """leading edge up, with the elevator at zero"""
    fin_place: Annotated[tuple[float, float, float], Quantity("m", -10.0, 10.0)]
    """of the fin's foot at its hinge, at a quarter of its chord, body axes"""
    fin_height: Annotated[float, Quantity("m", 0.001, 10.0)]
    fin_chord: Annotated[float, Quantity("m", 0.001, 10.0)]


class Tail(NamedTuple):
    """Geometry of tailplane and fin, see `VortexLattice`."""

    x: float
    y: float
    z: float
    span: float
    chord: float
    incidence: float
    fin_x: float
    fin_y: float
    fin_z: float
    height: float
    fin_chord: float


class Memory(NamedTuple):
    """Indices into the model's state; N panels, S strips, E edge nodes, R rows of the wake."""

    clock: int
    """s since the last lattice step; then the number of rows; then whether there was a step"""
    pose: int
    """(7,) m, -; place of the body in its axes of the last step and quaternion to these"""
    response: int
    """(N, N) m; minus the strengths for a unit of flow through each panel"""
    downwash: int
    """(S, N) 1/m; along a strip's normal at its quarter chord, of unit strengths"""
    normals: int
    """(wing's panels, 3) -; in their strips' axes: right, forward, up"""
    by_wake: int
    """(N,) m/s; along each panel's normal by the wake, without its newest row"""
    leg_data: int
    """the legs that bear. (.., 7) of the wing, legs across, then legs along for both strips that share each, in these
    strips' axes (right, forward, up): m/s, induced but for the strip's downwash; m, length; m, ahead of mid-chord.
    Then (.., 3) m/s of tailplane and fin, likewise, in body axes"""
    strengths: int
    """(N,) m^2/s; at the last step"""
    last: int
    """(2, S) m/s, rad/s; `Motion.down` and pitch rate of the wing's strips at the last step"""
    residual: int
    """(2, S) m^3/s^2, m^4/s^2; force along the normal and moment, over the density, of the strengths' rates,
    less what the apparent mass has of them"""
    nodes: int
    """(3, R + 1, E) m; of the wake"""
    shed: int
    """(R, S) m^2/s"""
    far: int
    """(S,) m^2/s"""
    size: int


class Workspace(NamedTuple):
    """Scratch arrays; each is written before it is read in the same call."""

    nodes: Floats
    panels: Panels
    rings: Floats
    """(3, nodes of the layout with a wake row)"""
    normals: Floats
    """(3, S); of strips"""
    points: Floats
    """(3, S) m; quarter chords of strips"""
    full: Floats
    """(N, panels with a wake row)"""
    matrix: Floats
    """(N, N)"""
    pivots: Floats
    scratch: Floats
    table: Floats
    velocity: Floats
    """(3, (R + 1) E) or more"""
    unit: Floats
    """(N,)"""
    solved: Floats
    """(N,)"""
    edges: Floats
    """(3, E)"""
    cores: Floats
    """(3,)"""
    leg_points: Floats
    """(3, L) m; middles of the legs that bear, see `bearing`"""
    leg_air: Floats
    """(3, L) m/s; induced there"""
    wash: Floats
    """(S,) m/s"""
    images: Floats
    """(2, 4, 3); all there is, and its reflection in the ground"""


class VortexLatticeParameters(NamedTuple):
    """Kernel arguments."""

    rows: int
    half: int
    """strips of a wing"""
    dt: float
    """s; between lattice steps"""
    wake_rows: int
    free_wake: bool
    bound_core: float
    """m"""
    wake_core: float
    """m"""
    correction: float
    strip: StripParameters
    thickness: float
    """-; apparent mass over that of a plate of infinite span"""
    tail: Tail
    memory: Memory
    layout: Layout
    wider: Layout
    """with a row of the wake"""
    legs: Legs
    """of the wider layout"""
    panel_at: Integers
    """(N,); in the wider layout"""
    wake_at: Integers
    """(S,); likewise"""
    trailing: Integers
    """(S,); panel at each trailing edge"""
    first_leg: Integers
    """(3,); of each surface, among those that bear"""
    clearance: float
    """m; from the ground to the lattice's lowest node at least"""
    ground_reach: float
    """m; height above which the ground is left out"""
    workspace: Workspace


GROUND_SPANS = 3.0
"""-; height in spans above which the ground is left out: it would take 1e-4 of the induced drag"""
CLEARANCE = 0.25
"""-; in root chords, from the ground to the lattice's lowest node at least: it must not touch its own image"""
LEG_SIZE = 7
"""numbers held of a leg of the wing"""
BOUND_CORE = 0.01
"""-; radius of the bound vortices' cores over the wing's mean chord"""


def parameters_of(settings: VortexLattice, strips: Strips) -> VortexLatticeParameters:
    """Build the kernel arguments for the wings of a vehicle, left wing first, strips from root to tip.

    Raises:
        InputError: ``dynamic_stall`` is unknown, or the fin goes through the tailplane.
    """
    bound = STALL_FACTOR_BOUNDS.get(settings.dynamic_stall)
    if bound is None:
        known = " or ".join(STALL_FACTOR_BOUNDS)
        raise InputError(f'vortex_lattice.dynamic_stall = "{settings.dynamic_stall}" is unknown; it is {known}')
    check_crossings(tail_at_rest(settings))
    half, wing = len(strips.chord) // 2, aspect_ratio(strips)
    layout = layout_of([(settings.rows, 2 * half), TAIL_SHAPE, FIN_SHAPE])
    wider, panel_at, wake_at = with_wake_row(layout)
    chord = float(np.sum(strips.chord * strips.width) / np.sum(strips.width))
    return VortexLatticeParameters(
        rows=settings.rows,
        half=half,
        dt=1.0 / settings.rate,
        wake_rows=settings.wake_rows,
        free_wake=settings.free_wake,
        bound_core=BOUND_CORE * chord,
        wake_core=settings.core * chord,
        correction=settings.correction,
        strip=_strip(settings, wing, bound),
        thickness=wing / math.sqrt(wing * wing + 4.0),
        tail=Tail(*settings.tail_place, settings.tail_span, settings.tail_chord, settings.tail_incidence,
                  *settings.fin_place, settings.fin_height, settings.fin_chord),
        memory=_memory(layout, settings.wake_rows),
        layout=layout,
        wider=wider,
        legs=legs_of(wider),
        panel_at=panel_at.astype(np.int64),
        wake_at=wake_at.astype(np.int64),
        trailing=trailing_panels(layout).astype(np.int64),
        first_leg=np.concatenate(([0], np.cumsum(_bearing_legs(layout))[:-1])).astype(np.int64),
        clearance=CLEARANCE * float(strips.chord[0]),
        ground_reach=GROUND_SPANS * 2.0 * float(np.max(strips.span + 0.5 * strips.width)),
        workspace=_workspace(layout, wider, settings.wake_rows, BOUND_CORE * chord),
    )  # fmt: skip


def tail_at_rest(settings: VortexLattice) -> Lattice:
    """Tailplane and fin with no deflection, body axes.

    Raises:
        InputError: a panel has no area.
    """
    s = settings
    (x, y, z), (fin_x, fin_y, fin_z) = s.tail_place, s.fin_place
    ahead = s.tail_chord * (0.25 - np.linspace(0.0, 1.0, TAIL_SHAPE[0] + 1))[:, None]
    right = s.tail_span * np.linspace(-0.5, 0.5, TAIL_SHAPE[1] + 1)[None]
    c, i = math.cos(s.tail_incidence), math.sin(s.tail_incidence)
    tail = np.stack((x + c * ahead + 0.0 * right, y + right + 0.0 * ahead, z - i * ahead + 0.0 * right), axis=2)
    fore = s.fin_chord * (0.25 - np.linspace(0.0, 1.0, FIN_SHAPE[0] + 1))[:, None]
    above = s.fin_height * np.linspace(0.0, 1.0, FIN_SHAPE[1] + 1)[None]
    fin = np.stack((fin_x + fore + 0.0 * above, fin_y + 0.0 * fore + 0.0 * above, fin_z - above + 0.0 * fore), axis=2)
    return lattice_of({"tailplane": tail, "fin": fin})


def _strip(settings: VortexLattice, aspect: float, bound: float) -> StripParameters:
    s = settings
    return strip_parameters(aspect, s.zero_lift_angle, s.suction_efficiency, s.stall_angle, bound)


def _memory(layout: Layout, rows: int) -> Memory:
    n, s = panel_count(layout), int(np.sum(layout.columns))
    edges, along = s + len(layout.columns), int(layout.rows[WING] * (layout.columns[WING] + 1))
    wing, *tail = _bearing_legs(layout).tolist()
    leg_data = LEG_SIZE * (wing + along) + 3 * sum(tail)
    panels = 3 * int(layout.rows[WING] * layout.columns[WING])
    sizes = (3, 7, n * n, s * n, panels, n, leg_data, n, 2 * s, 2 * s, 3 * (rows + 1) * edges, rows * s, s)
    starts = np.concatenate(([0], np.cumsum(sizes))).tolist()
    return Memory(*starts)


def _bearing_legs(layout: Layout) -> Integers:
    """(surfaces,) legs of each that bear loads: all but those at the trailing edges."""
    return np.asarray(layout.rows * (2 * layout.columns + 1))


def _workspace(layout: Layout, wider: Layout, rows: int, core: float) -> Workspace:
    n, s = panel_count(layout), int(np.sum(layout.columns))
    edges, nodes = s + len(layout.columns), int(np.sum((layout.rows + 1) * (layout.columns + 1)))
    return Workspace(
        nodes=np.zeros((3, nodes)),
        panels=blank_panels(layout),
        rings=np.zeros((3, nodes + edges)),
        normals=np.zeros((3, s)),
        points=np.zeros((3, s)),
        full=np.zeros((n, panel_count(wider))),
        matrix=np.zeros((n, n)),
        pivots=np.zeros(n),
        scratch=np.zeros((5, 3, int(layout.columns.max()) + 3)),
        table=blank_table(wake_filaments(layout, rows) + len(legs_of(wider).start)),
        velocity=np.zeros((3, max((rows + 1) * edges, n))),
        unit=np.zeros(n),
        solved=np.zeros(n),
        edges=np.zeros((3, edges)),
        cores=np.full(len(layout.rows), core),
        leg_points=np.zeros((3, int(_bearing_legs(layout).sum()))),
        leg_air=np.zeros((3, int(_bearing_legs(layout).sum()))),
        wash=np.zeros(s),
        images=np.stack([np.vstack((np.eye(3), np.zeros(3)))] * 2),
    )
