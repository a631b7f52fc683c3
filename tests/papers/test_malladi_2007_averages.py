"""Malladi, Krashanitsa, Silin, Shkarayev 2007: Eq. 18 to 25 on the wing of the Arizona 100 cm ornithopter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from logs.identification.models.stroke_averaged import (
    Attitude,
    StrokeCoefficients,
    StrokeRecord,
    lift_regressors,
    mean_coefficients,
    mean_force,
    moment_regressors,
    stroke_matrix,
    stroke_record,
)
from sim_bridge.aerodynamics.blade_element import MODEL, BladeElement, BladeParameters, section_coefficients
from sim_bridge.aerodynamics.protocol import FORWARD, UPWARD, blank_loads
from sim_bridge.flight_mechanics.prescribed import (
    Stroke,
    WingMotion,
    elliptic_wing,
    protocol_motions,
    section_velocity,
    steady_flight,
    strips_of,
)
from sim_bridge.flight_mechanics.stroke_loads import prescribed_loads
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

AIRSPEED, DENSITY = 8.0, 1.225
WING = elliptic_wing(0.5, 0.2, 24, np.array([0.08, 0.02, -0.03]))
"""Table 1; the hinge is chosen"""
STROKE = Stroke(5.0, 0.7, -0.5, 0.25, 0.75)
"""chosen: the paper prints none"""
PAPER = BladeElement(2.0 * math.pi, 2.0 * math.pi, 7.0, 7.0, 0.0, 1.4)
"""section coefficients as printed, without a stall"""
MODEL_STRIPS = strips_of(WING)
TRUE = StrokeCoefficients(lift_up=0.35, lift_down=0.85, drag_up=0.09, drag_down=0.14)


def record_of(motion: WingMotion) -> StrokeRecord:
    """Of the right wing, at mid-chord."""
    velocity = section_velocity(WING, motion, 0.5)
    ways = np.stack([velocity.along, -velocity.down], axis=-1)
    return stroke_record(1.0 / motion.frequency, ways, WING.chord * WING.width, DENSITY, motion.flap_rate < 0.0)


def wing_force(settings: BladeElement, motion: WingMotion) -> Floats:
    """Force (N, 2) of the right wing along its chord and its normal, as the flying model gives it."""
    forces, strips = [], MODEL_STRIPS
    parameters = MODEL.build(settings, strips)
    out = blank_loads(len(MODEL.parts), strips, 0)
    for instant in protocol_motions(WING, motion):
        MODEL.loads(parameters, strips, instant, DENSITY, np.zeros(0), out)
        forces.append(out.parts[:, [FORWARD, UPWARD], len(WING.span) :].sum(axis=(0, 2)))
    return np.array(forces)


def attitudes(rng: np.random.Generator, strokes: int = 300) -> Attitude:
    return Attitude(*(rng.normal(size=(3, strokes)) * [[0.1], [0.5], [0.1]]))


def test_section_coefficients_are_those_printed() -> None:
    c = section_coefficients(0.1, 1e5, 1.0, BladeParameters(*PAPER))
    assert c.lift == pytest.approx(0.6283, abs=1e-4)
    assert c.drag == pytest.approx(0.02214, abs=1e-5)


def test_eq_18_of_a_gliding_wing_is_the_integral_over_its_ellipse() -> None:
    angle = 0.08
    glide = steady_flight(STROKE._replace(highest=0.0, lowest=0.0), 1, AIRSPEED, angle)
    force = prescribed_loads(MODEL, PAPER, WING, glide, DENSITY)[0]
    lift = force[0] * math.sin(angle) - force[2] * math.cos(angle)
    drag = -force[0] * math.cos(angle) - force[2] * math.sin(angle)
    pressure = 0.5 * DENSITY * AIRSPEED**2
    assert lift == pytest.approx(pressure * 0.1571 * 2.0 * math.pi * angle, rel=3e-3)
    # The integral of sqrt(c) over an elliptic semispan: b/2 sqrt(c_R) B(1/2, 5/4) / 2.
    beta = math.gamma(0.5) * math.gamma(1.25) / math.gamma(1.75)
    root_chord = 2.0 * 0.5 * math.sqrt(0.2) * beta / 2.0
    assert drag == pytest.approx(pressure * 7.0 * math.sqrt(1.46e-5 / AIRSPEED) * root_chord, rel=3e-3)


def test_eq_19_gives_back_the_coefficients_that_made_the_force() -> None:
    record = record_of(steady_flight(STROKE, 200, AIRSPEED, 0.1))
    lift = np.where(record.down, TRUE.lift_down, TRUE.lift_up)[:, None]
    drag = np.where(record.down, TRUE.drag_down, TRUE.drag_up)[:, None]
    force = lift * record.lift_pressure - drag * record.drag_pressure
    assert mean_coefficients(force, record) == pytest.approx(TRUE)
    assert mean_force(TRUE, record) == pytest.approx(force.mean(axis=0))


def test_eq_19_holds_half_the_density_once() -> None:
    motion = steady_flight(STROKE, 50, AIRSPEED, 0.1)
    thin = record_of(motion)
    velocity = section_velocity(WING, motion, 0.5)
    ways = np.stack([velocity.along, -velocity.down], axis=-1)
    dense = stroke_record(thin.period, ways, WING.chord * WING.width, 2.0 * DENSITY, thin.down)
    assert stroke_matrix(dense) == pytest.approx(2.0 * stroke_matrix(thin))


def test_the_stroke_averages_of_the_flying_model_return_its_mean_force() -> None:
    motion = steady_flight(STROKE, 200, AIRSPEED, 0.1)
    record, force = record_of(motion), wing_force(PAPER, motion)
    found = mean_coefficients(force, record)
    assert mean_force(found, record) == pytest.approx(force.mean(axis=0), rel=1e-9)
    assert found.lift_down > 0.0 > found.lift_up
    # Lift tilts forward most where it is greatest, at the tip: in the mean of a stroke that is negative drag.
    assert max(found.drag_up, found.drag_down) < 0.0


def test_the_profile_drag_of_eq_18_comes_out_of_eq_19_at_the_wings_reynolds_number() -> None:
    motion = steady_flight(STROKE, 200, AIRSPEED, 0.1)
    record = record_of(motion)
    with_drag, without = (
        mean_coefficients(wing_force(settings, motion), record)
        for settings in (PAPER, PAPER._replace(drag_factor_up=0.0, drag_factor_down=0.0))
    )
    low, high = (7.0 / math.sqrt(speed * 0.157 / 1.46e-5) for speed in (1.5 * AIRSPEED, AIRSPEED))
    assert low < with_drag.drag_up - without.drag_up < high
    assert low < with_drag.drag_down - without.drag_down < high


def test_other_section_coefficients_of_the_up_stroke_change_its_averages_alone() -> None:
    motion = steady_flight(STROKE, 200, AIRSPEED, 0.1)
    record = record_of(motion)
    same, other = (
        mean_coefficients(wing_force(settings, motion), record)
        for settings in (PAPER, PAPER._replace(lift_slope_up=0.5 * math.pi, drag_factor_up=14.0))
    )
    # What is left is the turn of the stroke, over which the coefficients are blended.
    assert other.lift_down == pytest.approx(same.lift_down, rel=0.02)
    assert abs(other.lift_up - same.lift_up) > 0.3


@pytest.mark.parametrize(("flapping", "airspeed", "message"), [(0.0, 8.0, "without"), (1.0, 0.0, "told apart")])
def test_what_no_coefficients_can_be_had_from_is_refused(flapping: float, airspeed: float, message: str) -> None:
    motion = steady_flight(STROKE, 20, airspeed)
    motion = motion._replace(flap_rate=np.zeros(20)) if flapping == 0.0 else motion
    still = record_of(motion)
    if airspeed == 0.0:
        still = still._replace(lift_pressure=np.zeros((20, 2)), drag_pressure=np.zeros((20, 2)))
    with pytest.raises(InputError, match=message):
        mean_coefficients(np.zeros((20, 2)), still)


@pytest.mark.parametrize("seed", [1, 2])
def test_eq_20_to_23_are_identified_within_their_confidence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, attitude = np.array([3.1, 0.2, 0.4, 0.05]), attitudes(rng)
    stiffness, noise = rng.normal(size=300), 0.02
    regressors = lift_regressors(attitude, stiffness)
    measured = regressors @ truth + noise * rng.normal(size=300)
    found = np.linalg.lstsq(regressors, measured, rcond=None)[0]
    deviation = noise * np.sqrt(np.diag(np.linalg.inv(regressors.T @ regressors)))
    assert np.all(np.abs(found - truth) < 4.0 * deviation) and np.all(deviation < 0.02)


def test_eq_25() -> None:
    attitude = Attitude(np.array([0.0, 0.1]), np.array([0.0, 0.5]), np.array([0.0, 0.2]))
    coefficient = moment_regressors(attitude) @ np.array([0.02, -0.8, -0.1, 0.6])
    assert coefficient == pytest.approx([0.02, 0.02 - 0.08 - 0.05 + 0.12])
