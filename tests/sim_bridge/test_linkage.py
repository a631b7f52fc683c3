"""The four-bar linkage closes, its slope is that of the closed loop, and no power is lost unnamed."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from sim_bridge.actuators.linkage import (
    BREAKAWAY,
    FourBar,
    Motor,
    checked,
    drive,
    flap_motion,
    stroke,
)
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

BIRD = FourBar(0.012, 0.050, 0.022, 0.030, 0.050, -1.2, False)
MOTOR = Motor(0.004, 0.12, 0.8, 40.0, 0.85, 2e-6)
INERTIA = 2e-3
TURN = np.linspace(0.0, 2.0 * math.pi, 721)


def random_links(rng: np.random.Generator) -> FourBar:
    crank, coupler, rocker = rng.uniform(0.005, 0.08, 3)
    out, up = rng.uniform(-0.08, 0.08, 2)
    return FourBar(crank, coupler, rocker, out, up, rng.uniform(-3.0, 3.0), bool(rng.integers(2)))


def turning(count: int) -> list[FourBar]:
    """Random linkages that turn through."""
    rng, found = np.random.default_rng(11), []
    while len(found) < count:
        candidate = random_links(rng)
        try:
            found.append(checked(candidate))
        except InputError:
            continue
    return found


def pins(b: FourBar, crank_angle: float) -> tuple[Floats, Floats]:
    """Crank pin and rocker pin (2,) in m, from the flap angle alone."""
    psi = flap_motion(b, crank_angle).angle + b.horn_angle
    crank = b.crank * np.array([math.cos(crank_angle), math.sin(crank_angle)])
    rocker = np.array([b.hinge_outboard, b.hinge_up]) + b.rocker * np.array([math.cos(psi), math.sin(psi)])
    return crank, rocker


def separation(a: float, b: float) -> float:
    """Difference of two angles in rad."""
    return math.remainder(a - b, 2.0 * math.pi)


def test_the_coupler_reaches_from_pin_to_pin_all_the_way_round() -> None:
    for b in turning(100):
        for angle in TURN[::30]:
            crank, rocker = pins(b, angle)
            assert math.dist(crank, rocker) == pytest.approx(b.coupler, abs=1e-12)


def test_the_rocker_stays_on_the_side_it_was_assembled_on() -> None:
    for b in turning(100):
        for angle in TURN[::30]:
            crank, rocker = pins(b, angle)
            to_hinge = np.array([b.hinge_outboard, b.hinge_up]) - crank
            arm = rocker - np.array([b.hinge_outboard, b.hinge_up])
            assert bool(to_hinge[0] * arm[1] - to_hinge[1] * arm[0] > 0.0) is b.upper_assembly


def test_the_slope_is_the_derivative() -> None:
    step = 1e-5
    for b in [BIRD, *turning(50)]:
        for angle in TURN[::60]:
            here, back, ahead = (flap_motion(b, angle + shift) for shift in (0.0, -step, step))
            size = 1.0 + abs(here.slope) + abs(ahead.slope - back.slope) / (2 * step)
            assert here.slope == pytest.approx(separation(ahead.angle, back.angle) / (2 * step), abs=1e-5 * size**3)


def test_the_birds_slope_to_six_digits() -> None:
    step = 1e-5
    for angle in TURN:
        here, back, ahead = (flap_motion(BIRD, angle + shift) for shift in (0.0, -step, step))
        assert here.slope == pytest.approx(separation(ahead.angle, back.angle) / (2 * step), abs=1e-8)


def test_a_turn_of_the_crank_sweeps_the_stroke_and_no_more() -> None:
    angles = [flap_motion(BIRD, angle).angle for angle in TURN]
    assert (min(angles), max(angles)) == pytest.approx(stroke(BIRD), abs=1e-4)
    assert stroke(BIRD)[1] - stroke(BIRD)[0] == pytest.approx(math.radians(71.1), abs=1e-3)


def test_the_wing_rests_at_the_ends_of_the_stroke() -> None:
    for index in (np.argmin, np.argmax):
        angle = TURN[index([flap_motion(BIRD, a).angle for a in TURN])]
        assert abs(flap_motion(BIRD, angle).slope) < 0.01


def test_the_stroke_is_skewed_as_of_every_linkage_of_which_hinge_and_ends_are_not_in_line() -> None:
    """Up- and downstroke take different shares of a turn (Grauer on the skewness of the stroke)."""
    up = float(np.mean([flap_motion(BIRD, a).slope > 0.0 for a in TURN[:-1]]))
    assert 0.02 < abs(up - 0.5) < 0.2


def test_a_tiny_crank_gives_a_sine() -> None:
    b = BIRD._replace(crank=1e-6, coupler=0.055)
    angles = np.array([flap_motion(b, a).angle for a in TURN[:-1]])
    harmonics = np.abs(np.fft.rfft(angles))
    assert harmonics[2] < 1e-3 * harmonics[1]


def test_the_other_side_is_the_mirror_image() -> None:
    """Left hinge, crank turning the other way, assembly mirrored: the same flap and rate."""
    for b in turning(50):
        left = b._replace(hinge_outboard=-b.hinge_outboard, upper_assembly=not b.upper_assembly, horn_angle=0.0)
        for angle in TURN[::60]:
            ours, theirs = flap_motion(b._replace(horn_angle=0.0), angle), flap_motion(left, math.pi - angle)
            assert separation(math.pi - theirs.angle, ours.angle) == pytest.approx(0.0, abs=1e-9)
            assert theirs.slope == pytest.approx(ours.slope, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("links", "stated"),
    [
        ({"crank": 0.0}, "linkage: crank 0 m is not a length"),
        ({"rocker": math.nan}, "linkage: rocker nan m is not a length"),
        ({"hinge_outboard": 0.0, "hinge_up": 0.0}, "linkage: hinge's distance 0 m is not a length"),
        ({"crank": 0.07}, "linkage: crank 0.07 m is not shorter than the 0.0583095 m to the hinge"),
        ({"coupler": 0.04}, "linkage: coupler 0.04 m is too short; it needs more than 0.0483095 m"),
        ({"coupler": 0.07}, "linkage: coupler 0.07 m is too long; it needs less than 0.0683095 m"),
        ({"rocker": 0.1, "coupler": 0.05}, "linkage: rocker 0.1 m is too long; it needs less than 0.0963095 m"),
    ],
)
def test_an_impossible_linkage_names_the_link(links: dict[str, float], stated: str) -> None:
    with pytest.raises(InputError, match=re.escape(stated)):
        checked(BIRD._replace(**links))


def turns_through(b: FourBar) -> bool:
    """By trying: the pins can be joined at every crank angle, and the rocker never goes round."""
    fine = np.linspace(0.0, 2.0 * math.pi, 2000)
    distance = np.hypot(b.hinge_outboard - b.crank * np.cos(fine), b.hinge_up - b.crank * np.sin(fine))
    if np.any(distance >= b.coupler + b.rocker) or np.any(distance <= abs(b.coupler - b.rocker)):
        return False
    angles = np.unwrap([flap_motion(b, a).angle for a in fine])
    return bool(abs(angles[-1] - angles[0]) < 1.0)


def test_what_is_refused_cannot_turn_and_what_is_not_can() -> None:
    rng, outcomes = np.random.default_rng(3), []
    for _ in range(300):
        b = random_links(rng)
        try:
            outcomes.append(checked(b) is b)
        except InputError:
            outcomes.append(False)
        assert outcomes[-1] is turns_through(b)
    assert 20 < sum(outcomes) < 280


def test_at_stall_only_the_winding_limits_the_current() -> None:
    stalled = drive(MOTOR, 7.4, 0.0)
    assert stalled.current == pytest.approx(7.4 / 0.12)
    assert stalled.torque == pytest.approx(40.0 * 0.85 * 0.004 * 7.4 / 0.12)


def test_without_a_load_it_takes_its_no_load_current() -> None:
    rate = (7.4 - 0.8 * 0.12) / (0.004 * 40.0)
    free = drive(MOTOR, 7.4, rate)
    assert free.torque == pytest.approx(0.0, abs=1e-12)
    assert free.current == pytest.approx(0.8)


def test_driven_by_the_wings_it_brakes_and_feeds_nothing_back() -> None:
    driven = drive(MOTOR, 2.0, 40.0)
    assert driven.current == 0.0
    assert driven.torque == pytest.approx(-40.0 * 0.004 * 0.8 / 0.85)


def test_at_rest_without_voltage_nothing_moves_it() -> None:
    assert drive(MOTOR, 0.0, 0.0) == (0.0, 0.0, 0.0, 0.0, 0.0)
    creeping = drive(MOTOR, 0.0, 0.5 * BREAKAWAY / MOTOR.gear_ratio)
    assert creeping.torque == pytest.approx(-40.0 * 0.5 * 0.004 * 0.8 / 0.85)


def test_electrical_power_is_crank_power_and_named_losses() -> None:
    rng = np.random.default_rng(7)
    for voltage, rate in zip(rng.uniform(0.0, 12.0, 500), rng.uniform(-20.0, 80.0, 500), strict=True):
        d = drive(MOTOR, voltage, rate)
        losses = (d.copper_loss, d.friction_loss, d.gear_loss)
        assert voltage * d.current == pytest.approx(d.torque * rate + sum(losses), abs=1e-9)
        assert min(losses) >= -1e-9
        assert d.current >= 0.0
