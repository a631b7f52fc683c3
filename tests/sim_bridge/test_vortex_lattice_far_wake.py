"""Induced drag in the Trefftz plane: closed forms, Munk's theorems, the near field, mirrors, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.vortex_lattice.far_wake import far_drag
from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, Section, Surface, build_lattice, lattice_of
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady
from sim_bridge.validation.straight_wing import straight_wing
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

ALPHA, DENSITY, SPEED = 0.08, 1.2, 10.0
BACK = np.array([1.0, 0.0, 0.0])
WIND = SPEED * np.array([math.cos(ALPHA), 0.0, math.sin(ALPHA)])


def flat(left: float, right: float, columns: int, name: str = "wing", x: float = 0.0, z: float = 0.0) -> Surface:
    ends = (Section((x, left, z), 1.0), Section((x, right, z), 1.0))
    return Surface(name, ends, 3, (columns,), "uniform", "cosine")


def elliptic(strips: int) -> tuple[Lattice, Floats]:
    """A wake of span 4 m and the mean over each strip of an elliptic circulation, 1 m^2/s in the middle."""
    lattice = build_lattice([flat(-2.0, 2.0, strips)])
    e = np.clip(lattice.nodes[1, : strips + 1] / 2.0, -1.0, 1.0)
    whole = 0.5 * (np.arcsin(e) + e * np.sqrt(1.0 - e * e))
    return lattice, np.tile(np.diff(whole) / np.diff(e), 3)


def test_one_horseshoe_has_its_closed_form() -> None:
    """Both filaments push the middle down by G / (pi l) each: the drag is rho G^2 / pi, whatever the span l."""
    for span in (0.5, 3.0):
        lattice = build_lattice([Surface("one", flat(-span / 2, span / 2, 1).sections, 1, (1,))])
        found = far_drag(lattice, np.array([2.0]), BACK, DENSITY)
        assert found == pytest.approx([DENSITY * 4.0 / math.pi], rel=1e-8)


def test_an_elliptic_wake_has_prandtls_drag() -> None:
    """pi / 8 rho G0^2; the strips' middles are off with the first order of their width, as they are near by."""
    exact = math.pi / 8.0 * DENSITY
    errors = [float(far_drag(*elliptic(n), BACK, DENSITY).sum()) / exact - 1.0 for n in (40, 80, 160)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)
    assert 2.0 * errors[2] - errors[1] == pytest.approx(0.0, abs=2e-4)


def test_where_along_the_wake_a_strip_lies_changes_no_drag() -> None:
    """Munk's theorem of stagger, and one that is trivial: turned, shifted, told from another origin."""
    lattice, strengths = elliptic(12)
    plain, y = far_drag(lattice, strengths, BACK, DENSITY), lattice.nodes[1]
    swept = lattice._replace(nodes=lattice.nodes + np.stack((0.7 * np.abs(y) + 3.0, 0.0 * y, 0.0 * y)))
    assert far_drag(swept, strengths, 5.0 * BACK, DENSITY) == pytest.approx(plain, rel=1e-9)
    c, s = math.cos(0.6), math.sin(0.6)
    turn = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    turned = swept._replace(nodes=turn @ swept.nodes + np.array([[1.0], [2.0], [3.0]]))
    assert far_drag(turned, strengths, turn @ BACK, DENSITY) == pytest.approx(plain, rel=1e-9)


def test_near_and_far_field_have_the_same_drag() -> None:
    """Of one wing, of a wing over the ground, and of a wing with a tail below its wake; there in the sum alone."""
    wing, tail = (
        Surface(one.name, one.sections, 3, one.columns)
        for one in (flat(-3.0, 3.0, 12), flat(-1.0, 1.0, 4, "tail", 4.0, -1.0))
    )
    c, s = math.cos(ALPHA), math.sin(ALPHA)
    for surfaces, ground in (([wing], None), ([wing], -1.0), ([wing, tail], None)):
        lattice = build_lattice(surfaces)
        pitched = lattice._replace(nodes=np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ lattice.nodes)
        flow = solve_steady(pitched, SPEED * BACK, DENSITY, ground=ground)
        far = far_drag(pitched, flow.strengths, BACK, DENSITY, ground=ground)
        assert far.sum() == pytest.approx(flow.force[0], rel=1e-3)


def test_half_a_wing_in_a_mirror_is_half_of_the_whole_one() -> None:
    grid = np.moveaxis(np.array(np.meshgrid(np.arange(3.0), np.linspace(0.0, 3.0, 7), [0.5], indexing="ij")), 0, -1)
    right = grid[:, :, 0]
    whole = np.concatenate((right[:, :0:-1] * (1.0, -1.0, 1.0), right), axis=1)
    half, both = lattice_of({"half": right}), lattice_of({"whole": whole})
    one, other = solve_steady(half, WIND, DENSITY, True), solve_steady(both, WIND, DENSITY)
    drag = far_drag(half, one.strengths, WIND, DENSITY, True)
    assert far_drag(both, other.strengths, WIND, DENSITY)[6:] == pytest.approx(drag, rel=1e-4)
    # The ground a span away takes some, one out of reach nothing.
    for height, share in ((-3.0, 0.95), (-3000.0, 1.0 + 1e-9)):
        near = far_drag(half, one.strengths, BACK, DENSITY, True, height).sum()
        assert 0.5 * drag.sum() < near < share * far_drag(half, one.strengths, BACK, DENSITY, True).sum()


def test_the_wing_of_xflr5_has_its_drag_in_its_plane() -> None:
    ours = straight_wing()
    assert ours.lift == pytest.approx(0.783705, rel=1e-3)
    assert ours.far_drag == pytest.approx(0.0193291, rel=1e-3)
    assert ours.pitch_moment == pytest.approx(-0.677641, rel=1e-3)


@pytest.mark.parametrize(
    ("along", "mirrors", "part"),
    [
        (np.zeros(3), {}, r"the wake has no direction: \[0.0, 0.0, 0.0\]"),
        (np.array([1.0, math.nan, 0.0]), {}, "no direction"),
        (WIND, {"ground": -1.0}, r"along \(0.997, 0, 0.0799\) leads through a plane that mirrors"),
        (np.array([1.0, 0.1, 0.0]), {"symmetric": True}, "leads through a plane that mirrors"),
    ],
)
def test_a_wake_without_direction_or_through_a_mirror_is_refused(
    along: Floats, mirrors: dict[str, float], part: str
) -> None:
    lattice, strengths = elliptic(4)
    with pytest.raises(InputError, match=part) as refused:
        far_drag(lattice, strengths, along, DENSITY, **mirrors)  # type: ignore[arg-type]
    assert "\n" not in str(refused.value)


def test_a_wake_direction_that_is_none_is_refused_near_by_too() -> None:
    with pytest.raises(InputError, match="the wake has no direction"):
        solve_steady(build_lattice([flat(-1.0, 1.0, 2)]), WIND, DENSITY, along=np.zeros(3))
