"""Surfaces, mean lines and what a lattice refuses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.vortex_lattice.crossings import check_crossings
from sim_bridge.aerodynamics.vortex_lattice.geometry import (
    Section,
    Surface,
    build_lattice,
    grid_of,
    lattice_of,
    panel_count,
)
from sim_bridge.aerodynamics.vortex_lattice.legs import NONE, legs_of
from sim_bridge.aerodynamics.vortex_lattice.panels import blank_panels, set_panels
from sim_bridge.aerodynamics.vortex_lattice.sections import naca, tabled
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, Scheme, run
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

WIND = np.array([10.0, 0.0, 1.0])


def flat(name: str = "wing", at: tuple[float, float, float] = (0.0, 0.0, 0.0), rows: int = 2) -> Surface:
    x, y, z = at
    return Surface(name, (Section((x, y - 1.0, z), 1.0), Section((x, y + 1.0, z), 1.0)), rows, (4,))


def upright(y: float, low: float, high: float) -> Surface:
    return Surface("fin", (Section((0.2, y, low), 0.5), Section((0.2, y, high), 0.5)), 2, (2,))


def test_twist_taper_sweep_dihedral_and_camber_are_where_they_were_told() -> None:
    twist, line = 0.1, tabled(np.array([0.0, 0.5, 1.0]), np.array([0.0, 0.04, 0.0]))
    sections = (Section((0.0, 0.0, 0.0), 1.0, 0.0, line), Section((0.3, 2.0, 0.4), 0.5, twist, line))
    lattice = build_lattice([Surface("wing", sections, 4, (3,))])
    grid = grid_of(lattice, lattice.nodes, 0)
    assert grid.shape == (5, 4, 3) and panel_count(lattice.layout) == 12
    assert grid[2, 0] == pytest.approx([0.5, 0.0, 0.04])
    middle = np.array(
        [0.25 * math.cos(twist) + 0.02 * math.sin(twist), 0.0, 0.02 * math.cos(twist) - 0.25 * math.sin(twist)]
    )
    assert grid[2, 3] == pytest.approx(np.array([0.3, 2.0, 0.4]) + middle)
    assert grid[:, 1] == pytest.approx(2.0 / 3.0 * grid[:, 0] + grid[:, 3] / 3.0)


def test_normals_point_up_and_panels_cover_the_wing() -> None:
    lattice = build_lattice([flat()])
    panels = blank_panels(lattice.layout)
    set_panels(lattice.layout, lattice.nodes, panels)
    assert panels.normal == pytest.approx(np.tile([[0.0], [0.0], [1.0]], 8))
    assert panels.area.sum() == pytest.approx(2.0)
    assert panels.collocation[:, 0] == pytest.approx([0.375, -0.75, 0.0])


def test_a_leg_is_shared_by_the_rings_on_either_side() -> None:
    layout = build_lattice([flat(), flat("tail", (3.0, 0.0, 0.0), 1)]).layout
    legs = legs_of(layout)
    for panel in range(panel_count(layout)):
        assert np.sum(legs.with_it == panel) == np.sum(legs.against == panel) == 2
    assert np.sum(legs.edge != NONE) == 8
    # Rows of legs across, and columns of legs along, of each surface.
    assert len(legs.start) == (3 * 4 + 2 * 5) + (2 * 4 + 1 * 5)


@pytest.mark.parametrize(
    ("digits", "place", "height"), [("2412", 0.4, 0.02), ("23012", 0.15, 0.0184), ("0012", 0.3, 0.0)]
)
def test_naca_mean_lines_have_their_greatest_height_where_published(digits: str, place: float, height: float) -> None:
    line = naca(digits)
    assert float(np.max(line.z)) == pytest.approx(height, abs=1e-4)
    assert line.height(np.array([place]))[0] == pytest.approx(height, abs=2e-4)
    assert line.z[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("digits", ["241", "24x2", "99912"])
def test_a_section_that_naca_has_not_is_refused(digits: str) -> None:
    with pytest.raises(InputError, match=f"NACA {digits}"):
        naca(digits)


@pytest.mark.parametrize("x", [[0.0, 0.5], [0.1, 1.0], [0.0, 0.7, 0.7, 1.0]])
def test_a_camber_table_that_does_not_cover_the_chord_is_refused(x: list[float]) -> None:
    with pytest.raises(InputError, match="camber table"):
        tabled(np.array(x), np.zeros(len(x)))


def test_a_panel_without_area_is_told_by_surface_row_and_column() -> None:
    grid = np.moveaxis(np.array(np.meshgrid(np.arange(3.0), np.arange(4.0), [0.0], indexing="ij"))[..., 0], 0, 2)
    grid[:, 2] = grid[:, 1]
    with pytest.raises(InputError, match=r'^surface "wing": panel 0, 1 at \(0, 1, 0\) m has no area$'):
        lattice_of({"wing": grid})


def test_a_node_that_is_no_place_is_refused() -> None:
    grid = np.full((2, 2, 3), np.nan)
    with pytest.raises(InputError, match="node 0, 0 is no place"):
        lattice_of({"wing": grid})


def test_surfaces_that_cross_are_told_with_the_place() -> None:
    with pytest.raises(InputError, match=r"crosses .* at \(0\.\d+, 0\.2, [-0-9.e]+\) m$"):
        check_crossings(build_lattice([flat(), upright(0.2, -0.3, 0.5)]))
    check_crossings(build_lattice([flat(), upright(0.2, 0.0, 0.5)]))
    check_crossings(build_lattice([flat(), upright(0.2, 0.1, 0.5)]))
    with pytest.raises(InputError, match="crosses"):
        solve_steady(build_lattice([flat(), upright(0.5, -0.3, 0.5)]), WIND, 1.2)


def test_no_wind_is_refused() -> None:
    with pytest.raises(InputError, match=r"^zero airspeed"):
        solve_steady(build_lattice([flat()]), np.zeros(3), 1.2)


def test_a_motion_is_refused_that_stands_still_or_outruns_its_panels() -> None:
    lattice = build_lattice([flat()])

    def moved(speed: float) -> Floats:
        return np.array([[speed], [0.0], [0.0]])

    with pytest.raises(InputError, match=r"^zero airspeed"):
        run(lattice, lambda t: lattice.nodes, Scheme(0.1, 5), Air())
    with pytest.raises(
        InputError, match=r'^time step 1 s is too long for surface "wing": its trailing edge goes 3 m'
    ):
        run(lattice, lambda t: lattice.nodes + t * moved(-3.0), Scheme(1.0, 5), Air())
    with pytest.raises(InputError, match='wake "rigid" is unknown'):
        run(lattice, lambda t: lattice.nodes + t * moved(-3.0), Scheme(0.1, 5, "rigid"), Air())
    with pytest.raises(InputError, match="must be above 0"):
        run(lattice, lambda t: lattice.nodes + t * moved(-3.0), Scheme(0.0, 5), Air())
