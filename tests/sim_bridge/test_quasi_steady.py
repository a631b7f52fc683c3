from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    INERTIA,
    MASS,
    NOSE_UP,
    UPWARD,
    Motion,
    SectionLoads,
    Strips,
    blank_loads,
    blank_motion,
)
from sim_bridge.aerodynamics.quasi_steady import (
    BORDER,
    MODEL,
    ROTATIONAL,
    QuasiSteady,
    QuasiSteadyParameters,
    advance_ratio,
    build,
    drag_coefficient,
    elliptic_strips,
    force_radius,
    lift_coefficient,
    moment_coefficient,
    speed_ratio,
)
from sim_bridge.flight_mechanics.prescribed import Harmonics, PrescribedStroke, kinematics
from sim_bridge.flight_mechanics.stroke_loads import mean_lift_and_thrust, stroke_loads
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

REACH, MEAN_CHORD, COUNT = 0.3, 0.08, 24
DENSITY = 1.2
WING = elliptic_strips(REACH, MEAN_CHORD, 0.2, COUNT)
AREA = float(np.sum(WING.chord * WING.width))
PARAMETERS = build(QuasiSteady(0.25), WING)
RIGHT = slice(COUNT, 2 * COUNT)
NOTHING = np.zeros(0)


def level(along: Floats | float, down: Floats | float, pitch_rate: float = 0.0) -> Motion:
    """Strips in level axes that move like this at the quarter chord."""
    motion = blank_motion(WING, 2)
    motion.along[:] = along
    motion.down[:] = down + 0.25 * WING.chord * pitch_rate
    motion.pitch_rate[:] = pitch_rate
    motion.axes[1, 0], motion.axes[2, 2] = 1.0, -1.0
    motion.axes[0, 1] = np.where(WING.wing == 1, 1.0, -1.0)
    return motion


def loads(motion: Motion, density: float = DENSITY, p: QuasiSteadyParameters = PARAMETERS) -> SectionLoads:
    out = blank_loads(len(MODEL.parts), WING, 0)
    MODEL.loads(p, WING, motion, density, NOTHING, out)
    return out


def total(motion: Motion, density: float = DENSITY) -> Floats:
    return np.sum(loads(motion, density).parts, axis=(0, 2))


def gliding(angle: float, speed: float = 5.0) -> Motion:
    return level(speed * math.cos(angle), speed * math.sin(angle))


def revolving(rate: float, angle: float, pitch_rate: float = 0.0) -> Motion:
    """About the hinges, strips at one angle of attack."""
    return level(rate * WING.span * math.cos(angle), rate * WING.span * math.sin(angle), pitch_rate)


def ratio(motion: Motion) -> float:
    return advance_ratio(PARAMETERS, WING, motion, COUNT, 2 * COUNT)


def swept(airspeed: float, phase: int, feathering: float = -0.8) -> Motion:
    """A horizontal stroke of 2 rad at 10 Hz through wind from ahead, at one of 8 phases; 2 is mid-downstroke."""
    stroke = PrescribedStroke(10.0, 0.0, Harmonics(0.0, (1.0,)), feathering=Harmonics(feathering))
    return kinematics(stroke, WING, np.array([airspeed, 0, 0, 0, 0, 0.0]), 8).motions[phase]


TIP = 2.0 * math.pi * 10.0 * REACH
"""m/s; of the tip of `swept` in mid-stroke"""


@pytest.mark.parametrize("angle_deg", [-5.0, 10.0, 45.0, 90.0])
def test_a_gliding_wing_has_the_coefficients_of_infinite_advance_ratio(angle_deg: float) -> None:
    angle = math.radians(angle_deg)
    found = total(gliding(angle))
    pressure = 0.5 * DENSITY * 25.0 * AREA
    side = math.copysign(1.0, angle)
    lift, drag = side * lift_coefficient(abs(angle), math.inf), drag_coefficient(abs(angle), math.inf)
    c, s = math.cos(angle), math.sin(angle)
    assert found[UPWARD] == pytest.approx(pressure * (lift * c + drag * s), rel=1e-6)
    assert found[FORWARD] == pytest.approx(pressure * (lift * s - drag * c), rel=1e-6, abs=1e-9)


def test_the_moment_of_a_gliding_wing_is_about_its_quarter_chord() -> None:
    angle = 0.5
    parts = loads(gliding(angle)).parts
    normal = np.sum(parts[:, UPWARD], axis=0)
    about_quarter = np.sum(parts[:, NOSE_UP], axis=0) - 0.25 * WING.chord * normal
    area = WING.chord * WING.width
    expected = 0.5 * DENSITY * 25.0 * area * WING.chord * moment_coefficient(angle, math.inf)
    assert about_quarter == pytest.approx(expected, rel=1e-6)


def test_a_revolving_wing_is_borne_by_the_hover_coefficient_at_its_reference_point() -> None:
    """Eq. A.2: lift is that of the whole area at the speed of r_2 R, to what strips of finite width lose."""
    angle, rate = math.radians(40.0), 20.0
    found = total(revolving(rate, angle))
    pressure = 0.5 * DENSITY * (rate * REACH * force_radius(WING)) ** 2 * AREA
    lift = found[UPWARD] * math.cos(angle) + found[FORWARD] * math.sin(angle)
    assert lift == pytest.approx(pressure * lift_coefficient(angle, 0.0), rel=2e-3)


def test_the_advance_ratio_of_a_stroke_along_the_flow_is_the_papers() -> None:
    assert ratio(swept(0.0, 2)) == pytest.approx(0.0, abs=1e-9)
    assert ratio(swept(0.5 * TIP, 2)) == pytest.approx(0.5)
    assert ratio(swept(0.2 * TIP, 6, 0.8)) == pytest.approx(-0.2)
    assert ratio(swept(0.5 * TIP, 6, 0.8)) == BORDER


def test_flow_across_the_stroke_plane_raises_the_advance_ratio() -> None:
    """A bird that flaps while it flies: the paper's plane holds no such flow, yet it glides in the limit."""
    stroke = PrescribedStroke(10.0, math.pi / 2, Harmonics(0.0, (1.0,)))
    forward = np.array([2.0 * TIP, 0.0, 0.0, 0.0, 0.0, 0.0])
    radius = force_radius(WING)
    assert ratio(kinematics(stroke, WING, forward, 8).motions[2]) == pytest.approx(math.hypot(radius, 2.0) - radius)


def test_rolling_turns_the_flow_over_the_wings_as_flapping_does() -> None:
    still = PrescribedStroke(10.0, math.pi / 2, Harmonics())
    rolling = kinematics(still, WING, np.array([3.0, 0, 0, 6.0, 0, 0]), 4).motions[0]
    flapping = PrescribedStroke(10.0, math.pi / 2, Harmonics(0.0, (), (6.0 / (20.0 * math.pi),)))
    same = kinematics(flapping, WING, np.array([3.0, 0, 0, 0, 0, 0.0]), 4).motions[0]
    assert ratio(rolling) == pytest.approx(ratio(same))


def test_loads_converge_to_the_glide_as_flapping_dies_away() -> None:
    glide = total(gliding(0.3))
    gaps = []
    for rate in (1.0, 1e-2, 1e-4, 1e-6):
        motion = gliding(0.3)
        motion.down[:] += rate * WING.span
        gaps.append(float(np.max(np.abs(total(motion) - glide))))
    assert all(later < 0.2 * earlier for earlier, later in pairwise(gaps))
    assert gaps[-1] < 1e-3 * np.max(np.abs(glide))


def test_a_stroke_reversal_in_forward_flight_brings_no_jump() -> None:
    """With the sign of the stroke rate in J, drag would jump threefold here."""
    before, after = gliding(1.2), gliding(1.2)
    before.down[:] -= 1e-7 * WING.span
    after.down[:] += 1e-7 * WING.span
    assert total(after) == pytest.approx(total(before), rel=1e-3)


@pytest.mark.parametrize("speed", [0.0, 1e-200, 1e-12, 1e3])
@pytest.mark.parametrize("rate", [0.0, 1e-200, 1e-12, 40.0])
def test_loads_are_finite_at_any_speed_and_rate(speed: float, rate: float) -> None:
    for angle in (0.0, 1.0, math.pi / 2, math.pi, -1.0):
        motion = level(speed * math.cos(angle), speed * math.sin(angle), rate)
        motion.along[:] += rate * WING.span
        for array in loads(motion):
            assert np.all(np.isfinite(array))
    assert math.isfinite(speed_ratio(0.0, 1.0, 0.5))


def test_still_air_gives_no_load() -> None:
    assert np.all(loads(level(0.0, 0.0)).parts == 0.0)


@pytest.mark.parametrize("angle", [0.2, 0.9, 1.5, 2.0, 3.0])
def test_upside_down_the_load_turns_over(angle: float) -> None:
    up = total(revolving(20.0, angle, 8.0))
    over = total(revolving(20.0, -angle, -8.0))
    assert over == pytest.approx(up * [1.0, -1.0, 1.0, -1.0])


@pytest.mark.parametrize("angle", [0.1, 0.7, 1.2])
def test_flow_from_behind_meets_the_same_plate(angle: float) -> None:
    ahead, behind = total(gliding(angle)), total(gliding(math.pi - angle))
    assert behind == pytest.approx(ahead * [-1.0, 1.0, 1.0, -1.0])


def test_no_angle_of_attack_makes_the_load_jump() -> None:
    angles = np.linspace(-math.pi, math.pi, 3601)
    rows = np.array([total(gliding(angle)) for angle in angles])
    assert np.all(np.abs(np.diff(rows, axis=0)) < 0.02 * np.max(np.abs(rows), axis=0) + 1e-12)


@pytest.mark.parametrize("angle", [0.05, 0.5, 1.2, 2.0, 3.0, -0.7])
def test_translation_takes_power_from_the_wing(angle: float) -> None:
    for motion in (gliding(angle), revolving(20.0, angle)):
        parts = np.sum(loads(motion).parts[:ROTATIONAL], axis=0)
        assert np.sum(parts[FORWARD] * motion.along - parts[UPWARD] * motion.down) < 0.0


def test_a_nose_up_rotation_pushes_the_wing_up_by_kutta_joukowski() -> None:
    parts = loads(level(5.0, 0.0, 3.0)).parts
    expected = math.pi * 0.5 * DENSITY * 3.0 * 5.0 * WING.chord**2 * WING.width
    assert parts[ROTATIONAL, UPWARD] == pytest.approx(expected)
    assert np.sum(loads(level(5.0, 0.0, -3.0)).parts[ROTATIONAL, UPWARD]) < 0.0


def test_rotation_about_the_three_quarter_chord_gives_no_circulation() -> None:
    p = build(QuasiSteady(0.75), WING)
    assert np.all(loads(level(5.0, 1.0, 3.0), p=p).parts[ROTATIONAL] == 0.0)


def test_the_section_moves_as_its_pitching_axis_does() -> None:
    """Pure rotation about the axis is no translation."""
    p = build(QuasiSteady(0.4), WING)
    motion = level(0.0, 0.0)
    motion.pitch_rate[:], motion.down[:] = 5.0, 0.1 * WING.chord * 5.0
    assert loads(motion, p=p).parts == pytest.approx(np.zeros((4, 4, 2 * COUNT)), abs=1e-15)


def test_the_apparent_mass_is_half_of_an_ideal_plates() -> None:
    apparent = loads(gliding(0.3)).apparent
    assert apparent[MASS] == pytest.approx(math.pi / 8.0 * DENSITY * WING.chord**2 * WING.width)
    assert np.all(apparent[INERTIA] == 0.0)


@pytest.mark.parametrize("phase", [1, 2, 6])
def test_loads_scale_with_density(phase: int) -> None:
    one, two = loads(swept(2.0, phase), 1.0), loads(swept(2.0, phase), 2.5)
    assert two.parts == pytest.approx(2.5 * one.parts)
    assert two.apparent == pytest.approx(2.5 * one.apparent)


def test_loads_scale_with_the_square_of_speed() -> None:
    slow, fast = revolving(10.0, 0.6, 4.0), revolving(30.0, 0.6, 12.0)
    assert total(fast) == pytest.approx(9.0 * total(slow))


def test_mirrored_wings_bear_mirrored_loads() -> None:
    stroke = PrescribedStroke(10.0, 0.8, Harmonics(0.1, (0.9,)), Harmonics(0.1), Harmonics(0.1, (), (-0.6,)))
    strips, body = WING, np.array([3.0, 0.7, 0.4, 1.0, -2.0, 3.0])
    mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    here, there = (
        stroke_loads(MODEL, PARAMETERS, strips, kinematics(stroke, strips, b, 16), DENSITY)
        for b in (body, body * mirror)
    )
    assert there.force == pytest.approx(here.force * mirror[:3])
    assert there.moment == pytest.approx(-here.moment * mirror[:3])
    assert np.max(np.abs(here.force[..., 1])) > 1e-3


def test_each_wing_has_its_own_advance_ratio() -> None:
    motion = gliding(0.5)
    alone = np.sum(loads(motion).parts[:, :, RIGHT], axis=2)
    motion.along[:COUNT] += 30.0 * WING.span[:COUNT]
    assert np.sum(loads(motion).parts[:, :, RIGHT], axis=2) == pytest.approx(alone)


def test_lift_of_a_hovering_stroke_is_symmetric_over_its_halves() -> None:
    feathering = Harmonics(0.0, (), (-0.8,))
    stroke = PrescribedStroke(10.0, 0.0, Harmonics(0.0, (1.0,)), feathering=feathering)
    found = stroke_loads(MODEL, PARAMETERS, WING, kinematics(stroke, WING, np.zeros(6), 40), DENSITY)
    force = np.sum(found.force, axis=1)
    assert force[:20, 2] == pytest.approx(force[20:, 2])
    assert force[:20, 0] == pytest.approx(-force[20:, 0])
    mean = mean_lift_and_thrust(found)
    assert float(np.sum(mean.lift)) > 0.0 and float(np.sum(mean.thrust)) == pytest.approx(0.0, abs=1e-12)


def test_more_strips_change_little() -> None:
    angle, rate, lift = 0.7, 20.0, []
    for count in (12, 96):
        strips = elliptic_strips(REACH, MEAN_CHORD, 0.2, count)
        motion, out = blank_motion(strips, 2), blank_loads(len(MODEL.parts), strips, 0)
        motion.along[:], motion.down[:] = rate * strips.span * math.cos(angle), rate * strips.span * math.sin(angle)
        motion.axes[1, 0], motion.axes[2, 2] = 1.0, -1.0
        MODEL.loads(build(QuasiSteady(0.25), strips), strips, motion, DENSITY, NOTHING, out)
        lift.append(float(np.sum(out.parts[:, UPWARD])))
    assert lift[0] == pytest.approx(lift[1], rel=0.01)


def test_a_wing_of_one_strip_is_refused() -> None:
    with pytest.raises(InputError, match="two strips a wing"):
        build(QuasiSteady(0.25), elliptic_strips(0.3, 0.08, 0.2, 1))


def test_a_wing_with_its_area_at_the_root_is_refused() -> None:
    strips = Strips(
        np.tile([0.05, 0.55], 2),
        np.tile([0.05, 0.55], 2),
        np.tile([1.0, 1e-3], 2),
        np.tile([0.1, 0.9], 2),
        np.repeat([0.0, 1.0], 2),
    )
    with pytest.raises(InputError, match="needs a wing with r_2 above"):
        build(QuasiSteady(0.25), strips)
