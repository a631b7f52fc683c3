"""The hawkmoth's stroke at 2.9 and 5.0 m/s by the vortex lattice, beside the quasi-steady model: no measured loads.

Wings and motion are those of `sim_bridge.flight_mechanics.hawkmoth`, most of it chosen. The lattice is one wing whose
mirror image flaps with it; its hinge stands off the middle, so that the roots never meet. No wing turns, so that the
hinge's place changes none of the quasi-steady loads.

The two differ by what they are: the quasi-steady coefficients were fitted to wings that carry a leading-edge vortex
and are stalled without it, at 45 degrees of attack; the lattice's flow is attached at any angle, keeps the leading
edge's suction, and has the wake, through whose earlier strokes the wings go.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.protocol import FORWARD, NOSE_UP, UPWARD
from sim_bridge.aerodynamics.quasi_steady import PARTS
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, lattice_of
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, History, NodeMotion, Scheme, run
from sim_bridge.flight_mechanics.hawkmoth import (
    CASES,
    DENSITY,
    MEAN_CHORD,
    PITCHING_AXIS,
    ROOT,
    WING_LENGTH,
    HawkmothCase,
    hawkmoth_kinematics,
    hawkmoth_loads,
    hawkmoth_stroke,
)
from sim_bridge.flight_mechanics.prescribed import wing_points
from sim_bridge.flight_mechanics.stroke_loads import lift_and_thrust
from sim_bridge.validation.row import Row, compared, figure
from sim_bridge.vectors import Floats

ROWS, COLUMNS, STEPS, STROKES = 6, 10, 80, 3
OUTERMOST = 0.985
"""-; of the wing from root to tip: limit at which the ellipse has sufficient chord for panels"""
HINGE = (0.0, 0.012, 0.0)
"""m; chosen so that the root, which moves inboard during the sweep, stays 4.7 mm from the plane of symmetry. On the
moth's own hinges a rigid root chord would cross that plane
"""
UP = np.array([-1.0, 1.0, -1.0])
"""body axes (forward, right, down) to lattice axes (back, right, up), and back"""
ATTACHED = (
    "two models, neither measured: the lattice's flow is attached at 45 degrees of attack and has no leading-edge"
    " vortex; the coefficients have both vortex and stall in them, but no wake"
)


class Mesh(NamedTuple):
    """Resolution of lattice and stroke."""

    rows: int = ROWS
    columns: int = COLUMNS
    steps: int = STEPS
    """per stroke"""


MESH = Mesh()


class Course(NamedTuple):
    """One stroke of both wings at n equal steps, by one model."""

    lift: Floats
    """(n,) N; up"""
    thrust: Floats
    """(n,) N; forward"""
    unsteady_lift: Floats
    """(n,) N; part of ``lift``: apparent mass, for the lattice all terms with derivatives of the strengths"""
    power: Floats
    """(n,) W; power of the wing motion against the air"""


class Wing(NamedTuple):
    """Lattice nodes of the right wing."""

    span: Floats
    """(nodes,) m; from the hinge"""
    behind: Floats
    """(nodes,) m; behind the feathering axis"""


def wing(mesh: Mesh = MESH) -> Wing:
    """Return the nodes along the elliptic chord of the strips."""
    length = WING_LENGTH / (1.0 + ROOT)
    along = np.linspace(0.0, OUTERMOST, mesh.columns + 1)
    chord = MEAN_CHORD * 4.0 / math.pi * np.sqrt(1.0 - along**2)
    share = np.linspace(0.0, 1.0, mesh.rows + 1)[:, None] - PITCHING_AXIS
    span = np.broadcast_to((ROOT + along) * length, (mesh.rows + 1, mesh.columns + 1))
    return Wing(span.ravel().copy(), (share * chord).ravel())


def motion_of(case: HawkmothCase, mesh: Mesh = MESH) -> NodeMotion:
    """Return the nodes' motion in air at rest, x back, z up; the body is level."""
    stroke, nodes = hawkmoth_stroke(case)._replace(hinge=HINGE), wing(mesh)

    def moved(t: float) -> Floats:
        places = wing_points(stroke, np.array([t * case.frequency]), nodes.span, nodes.behind)[0]
        return np.asarray(((places + np.array([case.airspeed * t, 0.0, 0.0])) * UP).T)

    return moved


def lattice_at(motion: NodeMotion, mesh: Mesh = MESH) -> Lattice:
    """Return the lattice at the start of the ``motion``."""
    return lattice_of({"wing": motion(0.0).T.reshape(mesh.rows + 1, mesh.columns + 1, 3)})


@cache
def lattice_history(
    case: HawkmothCase, wake: str = "prescribed", mesh: Mesh = MESH, kept: float = 2.0, core: float = 0.03
) -> History:
    """Simulate `STROKES` strokes of the right wing with its mirror image.

    Args:
        kept: strokes of wake before truncation.
        core: see `Scheme.wake_core`.
    """
    motion, steps = motion_of(case, mesh), mesh.steps
    rows = round(kept * steps)
    scheme = Scheme(1.0 / case.frequency / steps, STROKES * steps, wake, rows=rows, wake_core=core)
    return run(lattice_at(motion, mesh), motion, scheme, Air(DENSITY, True))


def lattice_course(history: History) -> Course:
    """Return the last stroke."""
    last = slice(-(len(history.time) // STROKES), None)
    force, by_rate = (2.0 * one.sum(axis=1)[last] for one in (history.force, history.rate_force))
    return Course(force[:, 2], -force[:, 0], by_rate[:, 2], 2.0 * history.power.sum(axis=1)[last])


def quasi_steady_course(case: HawkmothCase) -> Course:
    """Compute the stroke by `quasi_steady`."""
    loads, stroke = hawkmoth_loads(case, STEPS), hawkmoth_kinematics(case, STEPS)
    found, sections = lift_and_thrust(loads.force), loads.sections.sum(axis=1)
    work = [
        f[FORWARD] @ m.along - f[UPWARD] @ m.down + f[NOSE_UP] @ m.pitch_rate
        for f, m in zip(sections, stroke.motions, strict=True)
    ]
    return Course(found.lift.sum(axis=1), found.thrust.sum(axis=1), found.lift[:, len(PARTS)], -np.array(work))


def hawkmoth_rows() -> list[Row]:
    """Compare the means of a stroke and the difference of the time histories, at both speeds."""
    return [row for case in CASES for row in _case_rows(case)]


def _case_rows(case: HawkmothCase) -> list[Row]:
    reference, computed = quasi_steady_course(case), lattice_course(lattice_history(case))
    pairs = (
        ("mean lift", "N", reference.lift, computed.lift),
        (
            "mean lift by circulation",
            "N",
            reference.lift - reference.unsteady_lift,
            computed.lift - computed.unsteady_lift,
        ),
        ("mean lift by apparent mass and rates", "N", reference.unsteady_lift, computed.unsteady_lift),
        ("mean thrust", "N", reference.thrust, computed.thrust),
        ("mean power", "W", reference.power, computed.power),
    )
    rows = [_row(case, name, unit, float(one.mean()), float(other.mean())) for name, unit, one, other in pairs]
    rms = [
        math.sqrt(float(np.mean(lift**2))) for lift in (reference.lift, computed.lift, computed.lift - reference.lift)
    ]
    pressed = 2.0 * float(lattice_history(case).pressure_force[-STEPS:, :, 2].sum(axis=1).mean())
    return [
        *rows,
        _row(
            case, "mean lift, the lattice's without suction at its edge", "N", float(reference.lift.mean()), pressed
        ),
        _row(case, "RMS lift", "N", rms[0], rms[1]),
        _row(case, "RMS difference of the lift's history from it", "N", 0.0, rms[2]),
    ]


def _row(case: HawkmothCase, name: str, unit: str, reference: float, computed: float) -> Row:
    named = figure("quasi_steady", f"hawkmoth at {case.airspeed:g} m/s: {name}", unit, reference)
    return compared(named, computed, ATTACHED)
