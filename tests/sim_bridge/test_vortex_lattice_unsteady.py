"""The wake in time: Wagner, Theodorsen, momentum, truncation, mirror, free wakes, memory."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, History, NodeMotion, Scheme, run
from sim_bridge.validation.thin_aerofoil import heaving, pitching, started, wagner
from sim_bridge.vectors import Floats

SPEED, ALPHA = 10.0, 0.1
STILL = Air(1.2)


def wing(aspect: float = 4.0, columns: int = 6, left: float = -0.5) -> Lattice:
    ends = (Section((0.0, left * aspect, 0.0), 1.0), Section((0.0, 0.5 * aspect, 0.0), 1.0))
    return build_lattice([Surface("wing", ends, 4, (columns,))])


def gliding(lattice: Lattice) -> NodeMotion:
    way = -SPEED * np.array([[math.cos(ALPHA)], [0.0], [math.sin(ALPHA)]])
    return lambda t: lattice.nodes + t * way


def flapping(lattice: Lattice, side: float = 1.0, amplitude: float = 0.4, frequency: float = 2.0) -> NodeMotion:
    x, y, z = lattice.nodes

    def moved(t: float) -> Floats:
        angle = amplitude * math.sin(2.0 * math.pi * frequency * t)
        c, s = math.cos(angle), side * math.sin(angle)
        return np.stack((x - SPEED * t, c * y - s * z, c * z + s * y))

    return moved


def total(history: History) -> Floats:
    return np.asarray(history.force.sum(axis=1))


def test_an_impulsive_start_is_wagners() -> None:
    s, lift = started()
    late = s >= 0.5
    assert lift[late] == pytest.approx(wagner(s[late]), rel=0.02)


@pytest.mark.validate
def test_wagners_error_falls_with_panel_and_step() -> None:
    errors = []
    for rows in (10, 20, 40):
        s, lift = started(rows, half_chords=1.0)
        errors.append(abs(float(lift[rows // 2]) / float(wagner(s[[rows // 2]])[0]) - 1.0))
    assert errors[2] < 0.7 * errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    "k", [pytest.param(0.3, marks=pytest.mark.validate), 0.6, pytest.param(1.0, marks=pytest.mark.validate)]
)
def test_heave_and_pitch_are_theodorsens(k: float) -> None:
    for found in (heaving(k), pitching(k)):
        assert found.error < 0.02
        assert abs(found.pressures - found.theory) < 0.04 * abs(found.theory)


def test_a_long_glide_ends_in_steady_flow() -> None:
    lattice = wing()
    steady = solve_steady(lattice, SPEED * np.array([math.cos(ALPHA), 0.0, math.sin(ALPHA)]), 1.2)
    for wake in ("prescribed", "free"):
        history = run(lattice, gliding(lattice), Scheme(0.05, 60, wake, behind=1.0), STILL)
        assert total(history)[-1] == pytest.approx(steady.force, rel=0.02, abs=1e-6)


def test_a_wake_cut_off_goes_on_as_a_far_row() -> None:
    lattice = wing()
    whole, cut = (total(run(lattice, gliding(lattice), Scheme(0.05, 80, rows=rows), STILL)) for rows in (0, 10))
    assert cut[-1] == pytest.approx(whole[-1], rel=3e-3, abs=1e-6)


def test_a_short_wake_of_a_flapping_wing_is_nearly_the_whole_one() -> None:
    lattice = wing()
    moved = flapping(lattice)
    whole, cut = (total(run(lattice, moved, Scheme(0.02, 75, rows=rows), STILL)) for rows in (0, 25))
    assert cut[:26] == pytest.approx(whole[:26])
    assert np.max(np.abs(cut - whole)[:, 2]) < 0.01 * np.max(np.abs(whole[:, 2]))
    assert np.any(cut[30:] != whole[30:])


def test_half_a_flapping_wing_in_a_mirror_is_the_whole_one() -> None:
    half = wing(left=0.0, columns=3)
    mirrored = half.nodes * np.array([[1.0], [-1.0], [1.0]])
    grid = np.flip(mirrored.T.reshape(5, 4, 3), axis=1)
    both = np.concatenate((grid[:, :-1], half.nodes.T.reshape(5, 4, 3)), axis=1)
    whole = wing()._replace(nodes=np.ascontiguousarray(both.reshape(-1, 3).T))

    def moved(t: float) -> Floats:
        one = flapping(half)(t).T.reshape(5, 4, 3)
        other = np.flip(one * (1.0, -1.0, 1.0), axis=1)
        return np.ascontiguousarray(np.concatenate((other[:, :-1], one), axis=1).reshape(-1, 3).T)

    scheme = Scheme(0.03, 15, "free")
    one, two = run(half, flapping(half), scheme, Air(1.2, True)), run(whole, moved, scheme, STILL)
    assert total(two) == pytest.approx(total(one) * (2.0, 0.0, 2.0), rel=1e-7, abs=1e-7)


def test_the_air_gets_the_momentum_that_the_wing_has_lost() -> None:
    """In the mean over a stroke: the wake's downward impulse a second, rho G A of its rings, is the lift."""
    lattice = wing(6.0, 12)
    history = run(lattice, gliding(lattice), Scheme(0.05, 100), STILL)
    rows = int(history.wake.rows[0])
    last = history.wake.strengths[:rows]
    width = 6.0 / 12
    impulse_rate = 1.2 * SPEED * float(last[:10].mean(axis=0).sum()) * width
    lift = total(history)[-10:, 2].mean()
    assert lift == pytest.approx(impulse_rate, rel=0.02)


def test_the_power_is_what_drag_and_flapping_take() -> None:
    lattice = wing()
    glide = run(lattice, gliding(lattice), Scheme(0.05, 20), STILL)
    way = -SPEED * np.array([math.cos(ALPHA), 0.0, math.sin(ALPHA)])
    assert glide.power.sum(axis=1) == pytest.approx(-total(glide) @ way, rel=1e-9)
    flap = run(lattice, flapping(lattice), Scheme(0.02, 75), STILL)
    assert flap.power.sum(axis=1)[25:].mean() > 0.0


def test_parts_add_up_to_surfaces_and_strips() -> None:
    lattice = wing()
    history = run(lattice, flapping(lattice), Scheme(0.02, 10), STILL)
    assert history.strip_force(0).sum(axis=1) == pytest.approx(history.surface_force(0))
    assert history.surface_force(0) == pytest.approx(total(history))


def test_both_ways_give_the_force_across_the_wing() -> None:
    lattice = wing(left=0.0)
    history = run(lattice, flapping(lattice), Scheme(0.01, 100), Air(1.2, True))
    one, other = total(history)[10:, 2], history.pressure_force.sum(axis=1)[10:, 2]
    assert np.max(np.abs(one - other)) < 0.06 * np.max(np.abs(one))


def test_loads_scale_with_density_and_the_inverse_square_of_time() -> None:
    lattice = wing()
    slow = run(lattice, flapping(lattice), Scheme(0.02, 20, viscosity=0.0), STILL)

    def quick(t: float) -> Floats:
        return flapping(lattice)(2.0 * t)

    fast = run(lattice, quick, Scheme(0.01, 20, viscosity=0.0), Air(2.4))
    assert total(fast) == pytest.approx(8.0 * total(slow), rel=1e-6, abs=1e-6)


def test_ground_carries_a_wing_that_glides_along_it() -> None:
    lattice = wing()
    history = [
        total(run(lattice, flapping(lattice, amplitude=0.0), Scheme(0.05, 30, "free"), Air(1.2, ground=ground)))
        for ground in (None, -0.5)
    ]
    assert np.all(history[0] == pytest.approx(0.0, abs=1e-9))
    pitched = lattice._replace(nodes=lattice.nodes - np.array([[0.0], [0.0], [ALPHA]]) * lattice.nodes[0])
    free, near = (
        total(run(pitched, flapping(pitched, amplitude=0.0), Scheme(0.05, 30), Air(1.2, ground=ground)))[-1]
        for ground in (None, -0.5)
    )
    assert near[2] > 1.1 * free[2]


def test_a_run_says_how_far_it_is() -> None:
    lattice, heard = wing(), list[float]()
    run(lattice, gliding(lattice), Scheme(0.05, 4), STILL, heard.append)
    assert heard == [0.25, 0.5, 0.75, 1.0]
