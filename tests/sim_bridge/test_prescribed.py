from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest

from sim_bridge.aerodynamics import quasi_steady, regression
from sim_bridge.aerodynamics.protocol import UPWARD, AerodynamicModel, Motion, SectionLoads, Strips
from sim_bridge.aerodynamics.quasi_steady import QuasiSteady, build, elliptic_strips
from sim_bridge.aerodynamics.regression import COLUMNS, RegressionParameters
from sim_bridge.flight_mechanics.prescribed import (
    Harmonics,
    PrescribedStroke,
    StrokeKinematics,
    elliptic_wing,
    kinematics,
    series,
    strips_of,
)
from sim_bridge.flight_mechanics.stroke_loads import (
    APPARENT,
    body_loads,
    lift_and_thrust,
    stroke_loads,
)
from sim_bridge.vectors import Floats

WING = elliptic_strips(0.05, 0.02, 0.1, 6)
FREQUENCY = 25.0
BODY = np.array([2.0, 0.4, 0.3, 1.0, 2.0, 3.0])
HINGE = (0.01, 0.02, -0.01)
STROKE = PrescribedStroke(
    FREQUENCY,
    0.7,
    Harmonics(0.1, (0.9, 0.1), (0.05,)),
    Harmonics(0.05, (0.0, 0.2), (0.1,)),
    Harmonics(-0.1, (0.2,), (-0.7, 0.0, 0.1)),
    Harmonics(0.05, (), (0.3,)),
    0.3,
    HINGE,
)


def stacked(stroke: StrokeKinematics, name: str) -> Floats:
    return np.array([getattr(motion, name) for motion in stroke.motions])


def rate_of(values: Floats) -> Floats:
    """Derivative of a periodic array, exact to rounding for what 256 phases resolve."""
    spectrum = np.fft.rfft(values, axis=0)
    orders = np.arange(len(spectrum)).reshape(-1, *[1] * (values.ndim - 1))
    return np.fft.irfft(2j * math.pi * FREQUENCY * orders * spectrum, n=len(values), axis=0)


def assert_equal(computed: Floats, reference: Floats) -> None:
    assert computed == pytest.approx(reference, abs=1e-9 * float(np.max(np.abs(reference))))


@pytest.fixture(scope="module")
def general() -> StrokeKinematics:
    return kinematics(STROKE, WING, BODY, 256)


def test_a_series_and_its_derivatives() -> None:
    phases = np.arange(64) / 64
    angle, rate, acceleration = series(Harmonics(0.2, (0.3, 0.0, 0.1), (0.4, -0.2)), phases, FREQUENCY)
    turns = 2.0 * math.pi * phases
    assert angle == pytest.approx(
        0.2 + 0.3 * np.cos(turns) + 0.1 * np.cos(3 * turns) + 0.4 * np.sin(turns) - 0.2 * np.sin(2 * turns)
    )
    assert_equal(rate, rate_of(angle))
    assert_equal(acceleration, rate_of(rate))


def test_velocities_are_those_of_the_places(general: StrokeKinematics) -> None:
    place, axes = stacked(general, "place"), stacked(general, "axes")
    turning = np.cross(BODY[3:], place, axisb=1, axisc=1)
    velocity = rate_of(place) + turning + BODY[:3, None]
    assert_equal(stacked(general, "outward"), np.sum(velocity * axes[:, 0], axis=1))
    assert_equal(stacked(general, "along"), np.sum(velocity * axes[:, 1], axis=1))
    assert_equal(stacked(general, "down"), -np.sum(velocity * axes[:, 2], axis=1))


def test_accelerations_are_the_rates_of_the_sections_own_components(general: StrokeKinematics) -> None:
    assert_equal(general.normal_acceleration, -rate_of(stacked(general, "down")))
    assert_equal(general.pitch_acceleration, rate_of(stacked(general, "pitch_rate")))


def test_the_pitch_rate_is_that_of_the_chord(general: StrokeKinematics) -> None:
    axes = stacked(general, "axes")
    moving = rate_of(axes[:, 1]) + np.cross(BODY[3:], axes[:, 1], axisb=1, axisc=1)
    assert_equal(stacked(general, "pitch_rate"), np.sum(moving * axes[:, 2], axis=1))


def test_axes_are_orthonormal_with_the_normal_up_on_both_wings(general: StrokeKinematics) -> None:
    axes = stacked(general, "axes")
    products = np.einsum("paks,pbks->pabs", axes, axes)
    assert products == pytest.approx(np.broadcast_to(np.eye(3)[:, :, None], products.shape), abs=1e-12)
    span = np.cross(axes[:, 1], axes[:, 2], axis=1) * np.where(WING.wing == 1, 1.0, -1.0)
    assert span == pytest.approx(axes[:, 0])


def test_the_left_wing_mirrors_the_right(general: StrokeKinematics) -> None:
    place = stacked(general, "place")
    assert place[:, :, :6] * [[1.0], [-1.0], [1.0]] == pytest.approx(place[:, :, 6:])


def test_a_bird_flaps_up_and_an_insect_aft() -> None:
    raised = Harmonics(0.5)
    bird, insect = (
        kinematics(PrescribedStroke(5.0, plane, raised), WING, np.zeros(6), 4).motions[0]
        for plane in (math.pi / 2, 0.0)
    )
    assert np.all(bird.place[2] < 0.0) and np.all(insect.place[0] < 0.0)
    assert bird.axes[1, :, 0] == pytest.approx([1.0, 0.0, 0.0])
    assert insect.axes[1, :, 0] == pytest.approx([0.0, 0.0, -1.0])
    assert bird.wings[:, 0] == pytest.approx([0.5, 0.5])


def test_deviation_lifts_the_wings_out_of_the_stroke_plane() -> None:
    stroke = PrescribedStroke(5.0, 0.0, Harmonics(), Harmonics(0.3))
    assert np.all(kinematics(stroke, WING, np.zeros(6), 4).motions[0].axes[0, 2] < 0.0)


def test_plunge_is_of_the_joints_alone() -> None:
    stroke = STROKE._replace(twist=Harmonics(), feathering=Harmonics(0.4), deviation=Harmonics())
    motion = kinematics(stroke, WING, BODY, 8).motions[1]
    rate = motion.wings[0, 1]
    assert motion.plunge == pytest.approx(-rate * WING.span * math.cos(0.4))


def test_the_apparent_mass_resists_the_acceleration_of_a_plain_stroke() -> None:
    """Plates that flap in still air without feathering: F = -m r phi'', normal to them."""
    strips, stroke = WING, PrescribedStroke(FREQUENCY, math.pi / 2, Harmonics(0.0, (0.6,)), axis=0.5)
    moving = kinematics(stroke, strips, np.zeros(6), 32)
    p = build(QuasiSteady(0.5), strips)
    found = stroke_loads(quasi_steady.MODEL, p, strips, moving, 1.2)
    part = found.parts.index(APPARENT)
    acceleration = series(stroke.stroke, np.arange(32) / 32, FREQUENCY)[2]
    mass = math.pi / 8.0 * 1.2 * strips.chord**2 * strips.width
    assert_equal(found.sections[:, part, UPWARD], -acceleration[:, None] * mass * strips.span)


def test_forces_and_moments_are_those_of_the_sections(general: StrokeKinematics) -> None:
    p = build(QuasiSteady(0.3), WING)
    found = stroke_loads(quasi_steady.MODEL, p, WING, general, 1.2)
    motion, sections = general.motions[17], found.sections[17]
    span, chord, normal = motion.axes
    force, moment = np.zeros(3), np.zeros(3)
    for part in range(len(found.parts)):
        for i in range(len(WING.chord)):
            forward, up, out, couple = sections[part, :, i]
            push = forward * chord[:, i] + up * normal[:, i] + out * span[:, i]
            force += push
            moment += np.cross(motion.place[:, i], push) + couple * np.cross(chord[:, i], normal[:, i])
    assert np.sum(found.force[17], axis=0) == pytest.approx(force, rel=1e-12)
    assert np.sum(found.moment[17], axis=0) == pytest.approx(moment, rel=1e-12)


def test_lift_and_thrust_of_a_pitched_body() -> None:
    up = lift_and_thrust(np.array([math.sin(0.3), 0.0, -math.cos(0.3)]), pitch=0.3)
    assert float(up.lift) == pytest.approx(1.0) and float(up.thrust) == pytest.approx(0.0, abs=1e-12)


class Lag(NamedTuple):
    """A model that remembers: each strip's lift follows the downward speed late; and it counts its steps."""

    time: float


def _initial(lag: Lag, strips: Strips) -> Floats:
    return np.zeros(len(strips.chord) + 1)


def _loads(lag: Lag, strips: Strips, motion: Motion, density: float, state: Floats, out: SectionLoads) -> None:
    out.parts[0, UPWARD] = state[:-1]
    out.rates[:-1] = (motion.down - state[:-1]) / lag.time
    out.body[0] = [1.0, 2.0, 3.0, 4.0, 5.0, state[-1]]


def _advance(lag: Lag, strips: Strips, motion: Motion, density: float, state: Floats, dt: float) -> None:
    state[-1] += dt


LAG = AerodynamicModel(
    "lag",
    "first-order lag",
    Lag,
    Lag,
    ("late",),
    lambda settings, strips: settings,
    _initial,
    _loads,
    _advance,
)


FLAPPING = PrescribedStroke(FREQUENCY, math.pi / 2, Harmonics(0.0, (0.6,)), axis=0.5)


def _late(phases: int) -> tuple[Floats, Any]:
    """Lift of the outermost strip minus the exact periodic solution, and all loads."""
    time, omega = 0.01, 2.0 * math.pi * FREQUENCY
    found = stroke_loads(LAG, Lag(time), WING, kinematics(FLAPPING, WING, np.zeros(6), phases), 1.2, 10)
    at = np.arange(phases) / phases
    exact = np.real(np.exp(2j * math.pi * at) * -1j * omega * 0.6 / (1.0 + 1j * omega * time)) * WING.span[-1]
    return found.sections[:, 0, UPWARD, -1] - exact, found


def test_a_model_with_memory_settles_to_its_periodic_answer_to_second_order() -> None:
    coarse, fine = (float(np.max(np.abs(_late(phases)[0]))) for phases in (50, 100))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)
    assert fine < 0.01


def test_the_clock_of_a_model_runs_once_a_step_and_its_load_on_the_body_is_in_the_part() -> None:
    found = _late(50)[1]
    assert found.parts == ("late", APPARENT)
    instant = kinematics(FLAPPING, WING, np.zeros(6), 50).motions[7]
    on_body = np.concatenate((found.force[7], found.moment[7]), axis=-1) - body_loads(instant, found.sections[7])
    assert on_body[0] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, (9 * 50 + 7) / (50 * FREQUENCY)])
    assert on_body[1] == pytest.approx(np.zeros(6))


def test_the_parts_of_table_1_are_parts_of_a_strokes_loads() -> None:
    strips, parameters = (
        strips_of(elliptic_wing(0.6, 0.3, 6, np.array(HINGE))),
        RegressionParameters(COLUMNS["time"], 0.3, 0.25),
    )
    stroke = kinematics(STROKE, strips, np.array([9.2, 0.0, 0.3, 0.0, 0.5, 0.0]), 20)
    found = stroke_loads(regression.MODEL, parameters, strips, stroke, 1.2)
    lift, thrust, moment = (found.parts.index(part) for part in ("lift", "thrust", "moment"))
    assert np.all(found.force[:, lift, :2] == 0.0) and np.all(found.force[:, thrust, 1:] == 0.0)
    assert np.all(found.force[:, moment] == 0.0) and np.all(found.moment[:, [lift, thrust]] == 0.0)
    for i, motion in enumerate(stroke.motions):
        whole = regression.wing_loads(parameters, strips, motion, 1.2)
        assert found.force[i].sum(axis=0) == pytest.approx((whole.thrust, 0.0, -whole.lift), rel=1e-12)
        assert found.moment[i].sum(axis=0) == pytest.approx((0.0, whole.moment, 0.0), rel=1e-12)
    assert np.all(np.ptp(found.force[:, [lift, thrust]], axis=0).max(axis=1) > 1.0)
