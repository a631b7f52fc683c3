"""Malladi Eq. 18 to 25 backwards: stroke-averaged coefficients and their derivatives with intervals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from logs.identification.estimators.stroke_coefficients import (
    drag_polar,
    lift_derivatives,
    moment_derivatives,
    stroke_coefficients,
)
from logs.identification.models.stroke_averaged import (
    Attitude,
    StrokeCoefficients,
    StrokeRecord,
    lift_regressors,
    moment_regressors,
    stroke_record,
)
from logs.identification.results import Estimate
from wingbeat.errors import InputError

Floats = NDArray[np.float64]
TRUTH = StrokeCoefficients(lift_up=0.35, lift_down=0.95, drag_up=0.12, drag_down=0.21)
NAMED = {"C_L_up": 0.35, "C_L_down": 0.95, "C_D_up": 0.12, "C_D_down": 0.21}


def stroke(speed: float, samples: int = 120) -> StrokeRecord:
    """A wing of five sections that flaps at 6 Hz by 0.5 rad, up first."""
    phase = 2 * np.pi * np.arange(samples) / samples
    rate = 0.5 * 2 * np.pi * 6.0 * np.cos(phase)
    span, area = np.linspace(0.05, 0.45, 5), np.full(5, 0.0157)
    velocity = np.stack([np.full((samples, 5), speed), rate[:, None] * span], axis=2)
    return stroke_record(1 / 6.0, velocity, area, 1.225, rate < 0.0)


def measured(record: StrokeRecord, random: np.random.Generator, noise: float) -> Floats:
    """Force (N, 2) whose mean over each half is that of Eq. 19, varying within it, with noise of each stroke."""
    down = record.down[:, None]
    lift = np.where(down, TRUTH.lift_down, TRUTH.lift_up) * (1 + noise * random.normal())
    drag = np.where(down, TRUTH.drag_down, TRUTH.drag_up) * (1 + noise * random.normal())
    force = lift * record.lift_pressure - drag * record.drag_pressure
    return force + noise * random.normal(size=force.shape)


def simulated(seed: int, strokes: int = 12) -> tuple[tuple[StrokeRecord, ...], tuple[Floats, ...]]:
    random = np.random.default_rng(seed)
    records = tuple(stroke(7.0 + 0.5 * random.normal()) for _ in range(strokes))
    return records, tuple(measured(record, random, 0.05) for record in records)


def values(result: tuple[Estimate, ...]) -> dict[str, float]:
    return {one.name: one.value for one in result}


def test_exact_forces_give_the_exact_coefficients() -> None:
    records = tuple(stroke(speed) for speed in (6.0, 7.0, 8.0))
    forces = tuple(measured(record, np.random.default_rng(0), 0.0) for record in records)
    result, by_stroke = stroke_coefficients(records, forces)
    assert values(result.estimates) == pytest.approx(NAMED)
    assert by_stroke == pytest.approx(np.tile(TRUTH, (3, 1)))


@pytest.mark.validate
def test_intervals_cover_the_truth_as_often_as_they_promise() -> None:
    inside = [
        [one.contains(NAMED[one.name]) for one in stroke_coefficients(*simulated(seed))[0].estimates]
        for seed in range(150)
    ]
    assert np.shape(inside) == (150, 4)
    assert 0.89 < np.mean(inside) < 0.985


def test_a_wing_at_rest_and_strokes_without_a_half_tell_nothing() -> None:
    record = stroke(7.0)
    still = record._replace(lift_pressure=np.zeros((120, 2)), drag_pressure=np.zeros((120, 2)))
    result = stroke_coefficients((still,) * 3, (np.ones((120, 2)),) * 3)[0]
    assert not result.estimates
    assert "cannot be told apart" in result.withheld[0].text
    gliding = record._replace(down=np.ones(120, bool))
    half = stroke_coefficients((gliding,) * 3, (np.ones((120, 2)),) * 3)[0]
    assert {one.subject for one in half.withheld} == {"C_L_up", "C_D_up"}
    holed = np.ones((120, 2))
    holed[5] = np.nan
    assert "not a number" in stroke_coefficients((record,) * 3, (holed,) * 3)[0].withheld[0].text


def test_too_few_strokes_are_refused() -> None:
    records, forces = simulated(1, 2)
    with pytest.raises(InputError, match="3 strokes"):
        stroke_coefficients(records, forces)
    records, forces = simulated(1, 3)
    with pytest.raises(InputError, match="another shape"):
        stroke_coefficients(records, tuple(force[:50] for force in forces))


def attitudes(seed: int, count: int = 30) -> Attitude:
    random = np.random.default_rng(seed)
    return Attitude(*(scale * random.normal(size=count) for scale in (0.08, 0.5, 0.1)))


def test_derivatives_of_lift_drag_and_moment_lie_in_their_intervals() -> None:
    random = np.random.default_rng(3)
    attitude, stiffness = attitudes(2), random.uniform(0.5, 2.0, 30)
    lift = lift_regressors(attitude, stiffness) @ (2.4, 0.08, 0.3, 0.4) + 0.01 * random.normal(size=30)
    result = {one.name: one for one in lift_derivatives("up", lift, attitude, stiffness).estimates}
    for name, truth in {"alpha": 2.4, "alpha_rate": 0.08, "elevator": 0.3, "stiffness": 0.4}.items():
        assert abs(result[f"C_L_up_{name}"].value - truth) < 3 * result[f"C_L_up_{name}"].standard_error
    polar = {one.name: one for one in drag_polar("up", lift, 0.05 + 0.2 * lift**2).estimates}
    assert polar["C_D_up_min"].value == pytest.approx(0.05)
    assert polar["K_up"].value == pytest.approx(0.2)
    moment = moment_regressors(attitude) @ (0.02, -0.6, -0.05, 0.9)
    exact = values(moment_derivatives(moment, attitude).estimates)
    assert list(exact.values()) == pytest.approx([0.02, -0.6, -0.05, 0.9])


def test_what_did_not_vary_is_not_told() -> None:
    attitude = attitudes(4)._replace(elevator=np.zeros(30))
    outcome = moment_derivatives(0.02 - 0.6 * attitude.alpha, attitude)
    assert [one.subject for one in outcome.withheld] == ["C_m_elevator"]
    tied = attitude._replace(alpha_rate=2.0 * attitude.alpha)
    assert "varies as" in moment_derivatives(np.ones(30), tied).withheld[0].text
    few = Attitude(*(column[:3] for column in attitudes(5)))
    assert "too few" in moment_derivatives(np.ones(3), few).withheld[0].text


def test_an_angle_of_attack_that_never_changed_gives_no_slope() -> None:
    """GIVEN strokes at one angle THEN their lift is a constant, and C_L_alpha is not that over the angle."""
    lift, alpha = 0.8 + 0.01 * np.random.default_rng(1).normal(size=12), np.full(12, 0.12)
    result = lift_derivatives("up", lift, Attitude(alpha, np.zeros(12), np.zeros(12)))
    assert [one.name for one in result.estimates] == ["C_L_up_stiffness"]
    assert result.estimates[0].contains(0.8)
    refused = {one.subject: one.text for one in result.withheld}
    assert refused["C_L_up_alpha"] == "its regressor is the same in all strokes"
