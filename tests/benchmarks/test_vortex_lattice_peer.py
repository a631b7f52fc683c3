"""The vortex lattice beside PteraSoftware 5.1: the same flapping wings, lattice, steps and wake, in the same run.

Both have Katz and Plotkin's rings, backward differences and Scully's core of 3 % of the chord; ours is told to load
the trailing edge's leg as it does.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import numpy as np
import pytest
import rows
from rows import Row, leave

from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, Scheme, run
from sim_bridge.vectors import Floats

ps: Any = pytest.importorskip("pterasoftware", reason="needs the bench extra: pip install -e '.[bench]'")
pytestmark = pytest.mark.bench

AMPLITUDE, FREQUENCY, AIRSPEED, ALPHA = math.radians(15.0), 1.0, 10.0, math.radians(4.0)
ROWS, COLUMNS, CHORD, SPAN, HINGE = 5, 8, 1.0, 4.0, 0.5
DT, STEPS = 0.02, 100
DENSITY, VISCOSITY = 1.225, 1.46e-5
FORCE_WITHIN, TIMES_FASTER = 0.02, 5.0


def peer(prescribed: bool) -> tuple[Floats, float]:
    """Force (STEPS, 3) N in its wind axes, and seconds of its solver."""
    section, geometry, movements = ps.geometry.wing_cross_section.WingCrossSection, ps.geometry, ps.movements
    ends = [
        section(
            airfoil=geometry.airfoil.Airfoil(name="naca0012", resample=True, n_points_per_side=50),
            num_spanwise_panels=panels,
            chord=CHORD,
            Lp_Wcsp_Lpp=(0.0, place, 0.0),
            spanwise_spacing="uniform" if panels else None,
            control_surface_symmetry_type="symmetric",
        )
        for panels, place in ((COLUMNS, 0.0), (None, SPAN))
    ]
    wing = geometry.wing.Wing(
        wing_cross_sections=ends, name="wing", Ler_Gs_Cgs=(0.0, HINGE, 0.0), symmetric=True,
        symmetryNormal_G=(0.0, 1.0, 0.0), symmetryPoint_G_Cg=(0.0, 0.0, 0.0), num_chordwise_panels=ROWS,
        chordwise_spacing="uniform",
    )  # fmt: skip
    airplane = geometry.airplane.Airplane(wings=[wing], name="flapping")
    flapping = [
        movements.wing_movement.WingMovement(
            base_wing=one,
            wing_cross_section_movements=[
                movements.wing_cross_section_movement.WingCrossSectionMovement(base_wing_cross_section=end)
                for end in one.wing_cross_sections
            ],
            ampAngles_Gs_to_Wn_ixyz=(math.degrees(AMPLITUDE), 0.0, 0.0),
            periodAngles_Gs_to_Wn_ixyz=(1.0 / FREQUENCY, 0.0, 0.0),
        )
        for one in airplane.wings
    ]
    point = ps.operating_point.OperatingPoint(
        rho=DENSITY, vCg__E=AIRSPEED, alpha=math.degrees(ALPHA), beta=0.0, nu=VISCOSITY
    )
    movement = movements.movement.Movement(
        airplane_movements=[
            movements.airplane_movement.AirplaneMovement(base_airplane=airplane, wing_movements=flapping)
        ],
        operating_point_movement=movements.operating_point_movement.OperatingPointMovement(
            base_operating_point=point
        ),
        delta_time=DT,
        num_steps=STEPS,
    )
    problem = ps.problems.UnsteadyProblem(movement=movement, only_final_results=False)
    solver = ps.unsteady_ring_vortex_lattice_method.UnsteadyRingVortexLatticeMethodSolver(problem)
    begun = time.perf_counter()
    solver.run(prescribed_wake=prescribed, show_progress=False)
    took = time.perf_counter() - begun
    return np.array([step.airplanes[0].forces_W for step in solver.steady_problems]), took


def computed(prescribed: bool) -> tuple[Floats, float]:
    """The same of the lattice of both wings, without its mirror symmetry: as many panels as the peer has."""
    inner, outer = (HINGE, 0.0), (HINGE + SPAN, 0.0)
    right = Surface("right", tuple(Section((0.0, y, z), CHORD) for y, z in (inner, outer)), ROWS, (COLUMNS,))
    left = Surface("left", tuple(Section((0.0, -y, z), CHORD) for y, z in (outer, inner)), ROWS, (COLUMNS,))
    lattice = build_lattice([right, left])
    x, y, z = lattice.nodes
    c, s, reach = math.cos(ALPHA), math.sin(ALPHA), np.abs(y) - HINGE

    def moved(t: float) -> Floats:
        angle = AMPLITUDE * math.sin(2.0 * math.pi * FREQUENCY * t)
        across = np.sign(y) * (HINGE + reach * math.cos(angle))
        return np.stack((x - AIRSPEED * c * t, across, z + reach * math.sin(angle) - AIRSPEED * s * t))

    wake = "prescribed" if prescribed else "free"
    scheme = Scheme(DT, STEPS, wake, bound_core=0.03, wake_core=0.03, viscosity=VISCOSITY, backward=True)
    begun = time.perf_counter()
    history = run(lattice, moved, scheme, Air(DENSITY))
    took = time.perf_counter() - begun
    fx, fy, fz = history.force.sum(axis=1).T
    return np.stack((-(fx * c + fz * s), fy, -(fz * c - fx * s)), axis=1), took


@pytest.mark.parametrize("prescribed", [True, False], ids=["prescribed wake", "free wake"])
def test_the_peers_forces_in_a_fifth_of_its_time(prescribed: bool) -> None:
    for model in (peer, computed):
        model(prescribed)  # compiled
    (theirs, slow), (found, quick) = peer(prescribed), computed(prescribed)
    settled = slice(STEPS // 2, None)
    errors = [
        float(np.sqrt(np.mean((found - theirs)[settled, i] ** 2) / np.mean(theirs[settled, i] ** 2))) for i in (0, 2)
    ]
    sys.stdout.write(
        f"\nvortex lattice, {'prescribed' if prescribed else 'free'} wake: {quick:.3f} s, PteraSoftware {slow:.2f} s,"
        f" {slow / quick:.1f} times; force along {errors[0]:.2%}, across {errors[1]:.2%} off\n"
    )
    wake = "prescribed" if prescribed else "free"
    requested = f"at least {TIMES_FASTER:g} times as fast"
    leave(Row(f"vortex lattice, {wake} wake, {STEPS} steps", quick, slow, "s", rows.peer("pterasoftware"), requested))
    assert max(errors) < FORCE_WITHIN
    assert slow > TIMES_FASTER * quick
