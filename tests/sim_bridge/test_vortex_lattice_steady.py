"""The lattice in steady flow: published coefficients, theory, symmetry, ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.influence import induced, reflections, set_filament
from sim_bridge.aerodynamics.vortex_lattice.steady import SteadyFlow, solve_steady
from sim_bridge.aerodynamics.vortex_lattice.wake import blank_table
from sim_bridge.validation.straight_wing import orders, straight_wing
from sim_bridge.vectors import Floats

ALPHA = 0.05
WIND = 10.0 * np.array([math.cos(ALPHA), 0.0, math.sin(ALPHA)])


def wing(semispan: float, left: float, columns: int, height: float = 0.0) -> Surface:
    ends = (Section((0.0, left, height), 1.0), Section((0.0, semispan, height), 1.0))
    return Surface("wing", ends, 4, (columns,), "uniform", "cosine")


def lift_coefficient(flow: SteadyFlow) -> float:
    lift = flow.force[2] * math.cos(ALPHA) - flow.force[0] * math.sin(ALPHA)
    return float(lift / (0.5 * 1.2 * 100.0 * flow.areas.sum()))


def test_the_wing_of_xflr5_has_its_coefficients() -> None:
    """Near by; its drag far behind is in `test_vortex_lattice_far_wake`."""
    for found in (straight_wing(), straight_wing(along_wind=True)):
        assert found.lift == pytest.approx(0.783705, rel=0.005)
        assert found.pitch_moment == pytest.approx(-0.677641, rel=0.005)
        assert found.near_drag == pytest.approx(0.0193291, rel=0.01)


def test_the_drag_converges_with_the_first_order_of_the_panels_size() -> None:
    """From grid to grid, each with half the panels' size, it changes by a half each time."""
    found = orders(((4, 3), (8, 6), (16, 12)))
    assert found.far_drag == pytest.approx(1.0, abs=0.2) and found.near_drag == pytest.approx(1.0, abs=0.2)
    assert 0.7 < found.lift < 2.3


def test_a_long_flat_wing_has_the_lift_of_thin_aerofoil_theory() -> None:
    flow = solve_steady(build_lattice([wing(1000.0, 0.0, 1)]), WIND, 1.2, symmetric=True)
    assert lift_coefficient(flow) == pytest.approx(2.0 * math.pi * math.sin(ALPHA), rel=5e-3)
    assert flow.moment[1] / flow.force[2] == pytest.approx(-0.25, rel=1e-3)


def test_an_elliptic_wings_lift_and_drag_are_prandtls() -> None:
    """Twelve tapered pieces, aspect ratio 12.7: lift slope 2 pi A / (A + 2), drag C_L^2 / (pi A)."""
    y = 5.0 * np.sin(np.linspace(0.0, 0.5 * math.pi, 13))
    chords = np.maximum(np.sqrt(1.0 - (y / 5.0) ** 2), 0.02)
    sections = tuple(Section((0.25 * (1.0 - c), float(a), 0.0), float(c)) for a, c in zip(y, chords, strict=True))
    flow = solve_steady(build_lattice([Surface("ellipse", sections, 3, (2,) * 12)]), WIND, 1.2, symmetric=True)
    aspect, cl = 50.0 / float(flow.areas.sum()), lift_coefficient(flow)
    assert cl == pytest.approx(2.0 * math.pi * ALPHA * aspect / (aspect + 2.0), rel=0.03)
    drag = flow.force[0] * math.cos(ALPHA) + flow.force[2] * math.sin(ALPHA)
    assert drag / (60.0 * flow.areas.sum()) == pytest.approx(cl**2 / (math.pi * aspect), rel=0.04)


def test_half_a_wing_in_a_mirror_is_the_whole_one() -> None:
    half = solve_steady(build_lattice([wing(3.0, 0.0, 4)]), WIND, 1.2, symmetric=True)
    ends = (Section((0.0, -3.0, 0.0), 1.0), Section((0.0, 0.0, 0.0), 1.0), Section((0.0, 3.0, 0.0), 1.0))
    both = Surface("wing", ends, 4, (4, 4), "uniform", "cosine")
    whole = solve_steady(build_lattice([both]), WIND, 1.2)
    assert whole.force == pytest.approx([2.0 * half.force[0], 0.0, 2.0 * half.force[2]], rel=2e-5, abs=1e-9)
    # The wake's length is that of a hundred of what is told: its end is felt.
    assert whole.strengths.reshape(4, 8)[:, 4:].ravel() == pytest.approx(half.strengths, rel=2e-5)


def test_loads_grow_with_density_and_the_square_of_the_speed() -> None:
    lattice = build_lattice([wing(3.0, 0.0, 4)])
    one = solve_steady(lattice, WIND, 1.2, True)
    other = solve_steady(lattice, 2.0 * WIND, 3.6, True)
    assert other.force == pytest.approx(12.0 * one.force)


def test_ground_adds_lift_and_takes_drag() -> None:
    lattice = build_lattice([wing(3.0, 0.0, 6, height=0.5)])
    level = 10.0 * np.array([1.0, 0.0, 0.0])
    tilted = lattice._replace(nodes=_turned(lattice.nodes))
    free, near = (solve_steady(tilted, level, 1.2, True, ground) for ground in (None, 0.0))
    far = solve_steady(tilted, level, 1.2, True, -500.0)
    assert near.force[2] > 1.1 * free.force[2]
    assert near.force[0] / near.force[2] ** 2 < 0.7 * free.force[0] / free.force[2] ** 2
    assert far.force == pytest.approx(free.force, rel=1e-4)


def _turned(nodes: Floats) -> Floats:
    x, y, z = nodes
    c, s = math.cos(ALPHA), math.sin(ALPHA)
    return np.stack((c * x, y, z - s * x))


def test_no_air_crosses_a_plane_that_mirrors() -> None:
    table, points = blank_table(1), np.array([[0.3, -1.0], [0.0, 0.0], [2.0, 2.0]])
    set_filament(table, 0, np.array([0.0, 1.0, 3.0]), np.array([1.0, 0.4, 2.5]), 2.0, 0.1)
    found = np.zeros((3, 2))
    induced(table, 1, reflections(True, 2.0), points, found)
    assert found[1:] == pytest.approx(np.zeros((2, 2)), abs=1e-15)
    assert np.all(np.abs(found[0]) > 1e-3)


def test_a_long_straight_filament_turns_the_air_as_in_a_plane() -> None:
    table = blank_table(1)
    set_filament(table, 0, np.array([-1e4, 0.0, 0.0]), np.array([1e4, 0.0, 0.0]), 3.0, 0.1)
    for h in (0.05, 0.1, 1.0):
        found = np.zeros((3, 1))
        induced(table, 1, reflections(False, None), np.array([[0.0], [h], [0.0]]), found)
        assert found[:, 0] == pytest.approx([0.0, 0.0, 3.0 / (2.0 * math.pi) * h / (h * h + 0.01)], rel=1e-6)
