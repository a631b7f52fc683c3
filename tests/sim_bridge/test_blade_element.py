from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.blade_element import (
    MODEL,
    PARTS,
    STALL_BLEND,
    BladeElement,
    BladeParameters,
    down_stroke_share,
    section_coefficients,
)
from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    NOSE_UP,
    OUTWARD,
    UPWARD,
    SectionLoads,
    Strips,
    blank_loads,
    blank_motion,
)
from sim_bridge.flight_mechanics.prescribed import Stroke, elliptic_wing, protocol_motions, steady_flight
from sim_bridge.flight_mechanics.stroke_loads import body_loads, prescribed_loads
from sim_bridge.vectors import Floats

CHORD, WIDTH, DENSITY, SPEED = 0.2, 0.05, 1.2, 8.0
PAPER = BladeElement(2.0 * math.pi, 2.0 * math.pi, 7.0, 7.0, 0.0, 0.35)
UNEQUAL = BladeElement(4.0, 6.0, 9.0, 7.0, 0.05, 0.35)
STRIPS = Strips(*[np.array([value]) for value in (0.3, 0.6, CHORD, WIDTH, 0.0)])
AREA = CHORD * WIDTH
ANGLES = np.linspace(-math.pi, math.pi, 721)
REYNOLDS = SPEED * CHORD / 1.46e-5
WING = elliptic_wing(0.5, 0.2, 12, np.array([0.05, 0.02, -0.03]))
STROKE = Stroke(5.0, 0.7, -0.5, 0.25, 0.75)


def simulate(
    settings: BladeElement, along: float, down: float, flap_rate: float = 0.0, density: float = DENSITY
) -> Floats:
    """Parts (parts, 4) of the loads of one strip."""
    motion, out = blank_motion(STRIPS, 1), blank_loads(len(PARTS), STRIPS, 0)
    motion.along[0], motion.down[0], motion.wings[0, 1] = along, down, flap_rate
    fill(settings, density, motion, out)
    return out.parts[:, :, 0]


def fill(settings: BladeElement, density: float, motion: object, out: SectionLoads) -> None:
    MODEL.loads(MODEL.build(settings, STRIPS), STRIPS, motion, density, np.zeros(0), out)


def at_angle(settings: BladeElement, angle: float, flap_rate: float = 0.0) -> Floats:
    return simulate(settings, SPEED * math.cos(angle), SPEED * math.sin(angle), flap_rate)


@pytest.mark.parametrize("angle", [-0.2, 0.02, 0.2])
def test_the_force_across_and_against_the_flow_is_that_of_the_paper(angle: float) -> None:
    force = at_angle(PAPER, angle)[:, [FORWARD, UPWARD]].sum(axis=0)
    pressure = 0.5 * DENSITY * SPEED**2 * AREA
    across = force @ (math.sin(angle), math.cos(angle))
    against = force @ (-math.cos(angle), math.sin(angle))
    assert across == pytest.approx(pressure * 2.0 * math.pi * angle, rel=1e-12)
    assert against == pytest.approx(pressure * 7.0 / math.sqrt(REYNOLDS), rel=1e-12)


def test_the_polar_adds_the_square_of_the_lift_coefficient() -> None:
    angle, factor = 0.15, 0.07
    extra = at_angle(PAPER._replace(polar=factor), angle)[2]
    induced = factor * (2.0 * math.pi * angle) ** 2 * 0.5 * DENSITY * SPEED**2 * AREA
    assert extra[FORWARD] == pytest.approx(-induced * math.cos(angle))
    assert extra[UPWARD] == pytest.approx(induced * math.sin(angle))


@pytest.mark.parametrize("rate", [-20.0, 0.0, 20.0])
def test_lift_does_no_work_and_all_else_takes_some_at_every_angle(rate: float) -> None:
    for angle in ANGLES:
        power = at_angle(UNEQUAL, angle, rate)[:, [FORWARD, UPWARD]] @ (math.cos(angle), -math.sin(angle))
        assert power[0] == pytest.approx(0.0, abs=1e-9)
        assert np.all(power[1:] <= 1e-9) and power[1] < 0.0


def test_the_loads_change_smoothly_around_the_whole_circle() -> None:
    loads = np.array([at_angle(UNEQUAL, angle).sum(axis=0) for angle in ANGLES])
    pressure = 0.5 * DENSITY * SPEED**2 * AREA
    assert np.allclose(loads[0], loads[-1], atol=1e-9)
    steepest = np.abs(np.diff(loads[:, [FORWARD, UPWARD]], axis=0)).max() / np.diff(ANGLES)[0]
    assert steepest < 2.0 * math.pi * pressure + 2.0 * pressure / STALL_BLEND


def test_a_flow_from_behind_is_the_mirror_image_of_one_from_ahead() -> None:
    for angle in (0.1, 0.5, 1.2):
        ahead = simulate(PAPER, SPEED * math.cos(angle), SPEED * math.sin(angle)).sum(axis=0)
        behind = simulate(PAPER, -SPEED * math.cos(angle), SPEED * math.sin(angle)).sum(axis=0)
        assert behind == pytest.approx(ahead * (-1.0, 1.0, 1.0, -1.0), abs=1e-12)


def test_a_flow_from_above_is_the_mirror_image_of_one_from_below() -> None:
    for angle in (0.1, 0.5, 2.0):
        below, above = at_angle(PAPER, angle).sum(axis=0), at_angle(PAPER, -angle).sum(axis=0)
        assert above == pytest.approx(below * (1.0, -1.0, 1.0, -1.0), abs=1e-12)


def test_across_the_flow_it_is_hoerners_plate_about_mid_chord() -> None:
    loads = at_angle(PAPER, 0.5 * math.pi)
    assert loads[3, UPWARD] == pytest.approx(0.5 * DENSITY * SPEED**2 * AREA * 1.98)
    assert np.allclose(loads[0], 0.0, atol=1e-12) and np.allclose(loads[:, NOSE_UP], 0.0, atol=1e-12)


def test_attached_flow_has_no_moment_about_a_quarter_chord() -> None:
    for angle in (-0.2, 0.1, math.pi - 0.1):
        loads = at_angle(UNEQUAL, angle).sum(axis=0)
        ahead = 0.25 * CHORD * math.copysign(1.0, math.cos(angle))
        assert loads[NOSE_UP] == pytest.approx(ahead * loads[UPWARD])


def test_each_half_of_the_stroke_has_its_own_coefficients() -> None:
    p = BladeParameters(*UNEQUAL)
    up, down = (section_coefficients(0.1, REYNOLDS, down_stroke_share(rate), p) for rate in (5.0, -5.0))
    assert (up.lift, down.lift) == pytest.approx((0.4, 0.6))
    assert up.drag / down.drag == pytest.approx(9.0 / 7.0)
    halfway = section_coefficients(0.1, REYNOLDS, down_stroke_share(0.0), p)
    assert halfway.lift == pytest.approx(0.5)


def test_the_turn_of_the_stroke_is_no_jump() -> None:
    rates = np.linspace(-2.0, 2.0, 401)
    lift = np.array([at_angle(UNEQUAL, 0.1, rate).sum(axis=0)[UPWARD] for rate in rates])
    assert np.all(np.diff(lift) <= 1e-12) and np.abs(np.diff(lift)).max() < 0.02 * (lift[0] - lift[-1])


def test_loads_scale_with_density() -> None:
    assert simulate(UNEQUAL, 6.0, 1.0, density=2.4) == pytest.approx(2.0 * simulate(UNEQUAL, 6.0, 1.0, density=1.2))


def test_a_section_at_rest_bears_nothing_and_one_almost_at_rest_almost_nothing() -> None:
    assert np.array_equal(simulate(UNEQUAL, 0.0, 0.0), np.zeros((len(PARTS), 4)))
    assert np.abs(simulate(UNEQUAL, 1e-6, -1e-6)).max() < 1e-10


def test_the_parts_sum_to_the_force_of_eq_18() -> None:
    rng = np.random.default_rng(3)
    for along, down, rate in rng.normal(size=(50, 3)) * (8.0, 8.0, 10.0):
        speed = math.hypot(along, down)
        share = down_stroke_share(rate)
        c = section_coefficients(math.atan2(down, along), speed * CHORD / 1.46e-5, share, BladeParameters(*UNEQUAL))
        lift_way, drag_way = np.array([down, along]) / speed, np.array([-along, down]) / speed
        whole = c.lift * lift_way + (c.drag + c.induced) * drag_way + np.array([0.0, c.separated])
        force = simulate(UNEQUAL, along, down, rate).sum(axis=0)
        assert force[[FORWARD, UPWARD]] == pytest.approx(0.5 * DENSITY * speed**2 * AREA * whole, abs=1e-12)
        assert force[OUTWARD] == 0.0


def test_a_stroke_of_both_wings_pushes_neither_aside_nor_around() -> None:
    total = prescribed_loads(MODEL, UNEQUAL, WING, steady_flight(STROKE, 40, 8.0, 0.1))
    assert np.abs(total[:, [1, 3, 5]]).max() < 1e-12 * np.abs(total).max()


def test_a_sideslip_mirrored_gives_the_mirrored_load() -> None:
    motion = steady_flight(STROKE, 16, 8.0, 0.1)
    slip = np.array([0.0, 1.5, 0.0])
    turn = np.tile([0.4, -0.3, 0.2], (16, 1))
    right = prescribed_loads(MODEL, UNEQUAL, WING, motion._replace(velocity=motion.velocity + slip, omega=turn))
    left = prescribed_loads(
        MODEL, UNEQUAL, WING, motion._replace(velocity=motion.velocity - slip, omega=turn * (-1.0, 1.0, -1.0))
    )
    assert np.abs(right[:, 3]).max() > 1e-3
    assert left == pytest.approx(right * (1.0, -1.0, 1.0, -1.0, 1.0, -1.0), abs=1e-10)


def test_flapping_gives_thrust_and_a_faster_flow_from_below_gives_lift() -> None:
    level = prescribed_loads(MODEL, PAPER._replace(stall_angle=1.4), WING, steady_flight(STROKE, 80, 8.0))
    raised = prescribed_loads(MODEL, PAPER._replace(stall_angle=1.4), WING, steady_flight(STROKE, 80, 8.0, 0.1))
    assert level[:, 0].mean() > 0.0
    assert raised[:, 2].mean() < level[:, 2].mean() - 1.0


def test_section_loads_move_to_the_body_with_force_and_moment_conserved() -> None:
    instant = protocol_motions(WING, steady_flight(STROKE, 8, 8.0))[1]
    strips = len(instant.along)
    lift = np.zeros((4, strips))
    lift[UPWARD] = 1.0
    force = body_loads(instant, lift)
    place, normal = instant.place, instant.axes[2]
    assert force[:3] == pytest.approx(normal.sum(axis=1))
    assert force[4] == pytest.approx(float(np.sum(place[2] * normal[0] - place[0] * normal[2])))
    couple = np.zeros((4, strips))
    couple[NOSE_UP] = 0.5
    turned = body_loads(instant, couple)
    assert turned[4] == pytest.approx(0.5 * float(np.abs(instant.axes[0, 1]).sum())) and turned[4] > 0.0
