"""A hawkmoth's stroke in the lattice: finite, periodic, mirror-symmetric, its parts, and the strips' own motion."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.aerodynamics.vortex_lattice.geometry import lattice_of
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, Scheme, run
from sim_bridge.flight_mechanics.hawkmoth import CASES, DENSITY, hawkmoth_kinematics, hawkmoth_strips, hawkmoth_stroke
from sim_bridge.flight_mechanics.prescribed import wing_points
from sim_bridge.validation import hawkmoth_refined
from sim_bridge.validation.hawkmoth_lattice import (
    COLUMNS,
    MESH,
    ROWS,
    STEPS,
    hawkmoth_rows,
    lattice_course,
    lattice_history,
    motion_of,
    quasi_steady_course,
    wing,
)
from sim_bridge.validation.hawkmoth_refined import VARIANTS, refined_rows
from sim_bridge.validation.row import COMPARED
from sim_bridge.vectors import Floats

SLOW, FAST = CASES
MIRROR = np.array([1.0, -1.0, 1.0])


def test_the_stroke_is_finite_and_periodic_after_the_first() -> None:
    history = lattice_history(FAST)
    assert all(np.all(np.isfinite(one)) for one in (history.force, history.moment, history.power))
    force = history.force.sum(axis=1)
    again, before = force[-STEPS:], force[-2 * STEPS : -STEPS]
    assert np.abs(again - before).max() < 0.002 * np.abs(again).max()
    assert np.abs(before - force[:STEPS]).max() > 0.02 * np.abs(again).max()


def test_two_wings_are_one_and_its_mirror_image() -> None:
    right, scheme = motion_of(FAST), Scheme(1.0 / FAST.frequency / STEPS, STEPS // 2)

    def both(t: float) -> Floats:
        grid = right(t).T.reshape(ROWS + 1, COLUMNS + 1, 3)
        return np.concatenate([(grid[:, ::-1] * MIRROR).reshape(-1, 3), grid.reshape(-1, 3)]).T.copy()

    left_grid, right_grid = both(0.0).T.reshape(2, ROWS + 1, COLUMNS + 1, 3)
    whole = run(lattice_of({"left": left_grid, "right": right_grid}), both, scheme, Air(DENSITY))
    half = run(lattice_of({"right": right_grid}), right, scheme, Air(DENSITY, True))
    scale = np.abs(half.surface_force(0)).max()
    assert whole.surface_force(1) == pytest.approx(half.surface_force(0), abs=1e-6 * scale)
    assert whole.surface_force(0) == pytest.approx(half.surface_force(0) * MIRROR, abs=1e-6 * scale)


def test_the_wing_never_meets_its_mirror_image() -> None:
    for case in CASES:
        motion = motion_of(case)
        nearest = min(float(motion(t)[1].min()) for t in np.linspace(0.0, 1.0 / case.frequency, STEPS))
        assert 0.0047 < nearest < 0.0049


def test_the_lattice_moves_as_the_strips_do() -> None:
    strips, stroke = hawkmoth_strips(), hawkmoth_stroke(SLOW)
    right = strips.wing == 1
    span, middle = strips.span[right], (0.5 - stroke.axis) * strips.chord[right]
    places = wing_points(stroke, np.arange(8) / 8, span, middle)
    for place, motion in zip(places, hawkmoth_kinematics(SLOW, 8).motions, strict=True):
        found = place.T
        assert found == pytest.approx(motion.place[:, right], abs=1e-12)
    assert wing().span.max() < span.max() + strips.width[0] / 2


def test_the_rates_bear_a_part_of_the_lift() -> None:
    course = lattice_course(lattice_history(FAST))
    assert 0.0 < np.abs(course.unsteady_lift).mean() < 0.5 * np.abs(course.lift).mean()
    assert abs(course.unsteady_lift.mean()) < 0.2 * course.lift.mean()


def test_no_model_pushes_with_more_than_it_takes() -> None:
    for case in CASES:
        for course in (lattice_course(lattice_history(case)), quasi_steady_course(case)):
            assert course.power.mean() > max(course.thrust.mean(), 0.0) * case.airspeed


def test_every_row_is_a_comparison_that_says_so() -> None:
    rows = hawkmoth_rows()
    assert len(rows) == 16
    for row in rows:
        assert row.outcome == COMPARED and row.limit is None and "leading-edge vortex" in row.why


@pytest.mark.validate
def test_a_variant_is_another_lattice_or_wake_of_the_same_stroke(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quickest one of each kind; the plain one differs from itself by nothing."""
    coarse, short = VARIANTS[0], next(one for one in VARIANTS if one.kept == 0.5)
    same = coarse._replace(title="the same", mesh=MESH)
    monkeypatch.setattr(hawkmoth_refined, "VARIANTS", (coarse, short, same))
    monkeypatch.setattr(hawkmoth_refined, "CASES", (FAST,))
    heard: list[tuple[float, str]] = []
    rows = refined_rows(lambda share, words: heard.append((share, words)))
    assert [share for share, _ in heard] == pytest.approx([0.0, 1 / 3, 2 / 3]) and heard[0][1] == coarse.title
    changes = [abs((row.computed or 0.0) / row.figure.low - 1.0) for row in rows]
    assert len(rows) == 6 and all(row.outcome == COMPARED for row in rows)
    assert 0.01 < changes[0] < 0.1 and 1e-5 < changes[2] < 0.02 and changes[4:] == [0.0, 0.0]
