from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics import protocol
from sim_bridge.aerodynamics.models import find_model
from sim_bridge.aerodynamics.protocol import FORWARD, INERTIA, MASS, NOSE_UP, OUTWARD, UPWARD, SectionLoads, Strips
from sim_bridge.aerodynamics.strip_theory import (
    CAMBER,
    CIRCULATORY,
    COUPLE,
    FRICTION,
    SEPARATED,
    SUCTION,
    Section,
    SectionMotion,
    StripParameters,
    StripTheory,
    build,
    frequency_domain_incidence,
    friction_coefficient,
    initial,
    section_loads,
    stall_factor,
    strip_parameters,
)
from sim_bridge.aerodynamics.surfaces import body_drag, plate_normal_force, plate_pressure
from sim_bridge.vectors import Floats

MODEL = find_model("strip_theory")
CHORD, DENSITY, SPEED = 0.3, 1.2, 8.0
INFINITE = 1e9
"""aspect ratio of a wing without downwash"""
SETTINGS = StripTheory(0.05, 0.9, 0.3, 1.0, "kim")
COUNT = 8
"""strips of a wing"""


def parameters(aspect_ratio: float = 5.0, camber: float = 0.0, stall: float = 0.4) -> StripParameters:
    return strip_parameters(aspect_ratio, camber, 1.0, stall)


def moving(along: float, down: float, pitch_rate: float = 0.0) -> SectionMotion:
    """A section whose whole downward speed is its own flapping."""
    return SectionMotion(along, down, down, pitch_rate, CHORD)


def steady(p: StripParameters, angle: float, speed: float = SPEED, density: float = DENSITY) -> Section:
    """Loads of a section in steady flow at an angle of attack, its wake settled."""
    down = speed * math.sin(angle)
    return section_loads(SectionMotion(speed * math.cos(angle), 0.0, down, 0.0, CHORD), density, down, p)


def friction(along: float) -> float:
    reynolds = along * CHORD / 1.46e-5
    return 0.5 * DENSITY * CHORD * along * along * 0.89 / math.log10(reynolds) ** 2.58


def test_a_small_steady_angle_gives_the_lift_of_a_finite_thin_wing() -> None:
    out = steady(parameters(5.0), 0.02)
    slope = 2.0 * math.pi * 5.0 / 7.0
    assert out.circulatory == pytest.approx(0.5 * DENSITY * SPEED**2 * CHORD * slope * 0.02, rel=1e-3)
    assert out.separated == 0.0 and out.stalled == 0.0


def test_across_the_flow_it_is_hoerners_plate_and_the_chordwise_force_is_gone() -> None:
    out = steady(parameters(), math.pi / 2)
    assert out.separated == pytest.approx(0.5 * DENSITY * SPEED**2 * CHORD * 1.98)
    assert out.circulatory == out.suction == out.camber == out.friction == 0.0 and out.stalled == 1.0
    assert out.apparent == pytest.approx(0.5 * DENSITY * math.pi * CHORD**2 / 4.0)


def test_suction_and_friction_are_delauriers() -> None:
    p = strip_parameters(6.0, 0.0, 0.7, 0.4)
    u, down, rate = 7.0, 0.5, 2.0
    three_quarter = down + 0.25 * CHORD * rate
    out = section_loads(moving(u, down, rate), DENSITY, three_quarter, p)
    flow = 6.0 / 8.0 * three_quarter  # U (alpha' + theta)
    v = math.hypot(u, flow - 0.5 * CHORD * rate)
    suction = 0.7 * 2.0 * math.pi * (flow / u - CHORD * rate / (4.0 * u)) ** 2 * DENSITY * u * v / 2.0 * CHORD
    assert out.suction == pytest.approx(suction, rel=1e-12)
    assert out.friction == pytest.approx(-friction(u), rel=2e-5)
    assert out.circulatory == pytest.approx(DENSITY * u * v / 2.0 * 2.0 * math.pi * flow / u * CHORD)
    assert out.camber == 0.0 and out.stalled == 0.0


@pytest.mark.parametrize("power", np.linspace(3.0, 7.0, 41))
def test_friction_of_a_plate(power: float) -> None:
    assert friction_coefficient(10.0**power) == pytest.approx(0.89 / power**2.58, rel=1e-5)


def test_friction_is_held_beyond_the_reynolds_numbers_of_wings() -> None:
    assert friction_coefficient(0.0) == friction_coefficient(1e3)
    assert friction_coefficient(1e9) == friction_coefficient(1e7)


@pytest.mark.parametrize("camber", [0.0, 0.05])
def test_an_infinite_wing_in_ideal_flow_has_no_drag(camber: float) -> None:
    angle = 0.08
    out = steady(parameters(INFINITE, camber), angle)
    assert out.suction + out.camber == pytest.approx(out.circulatory * math.tan(angle), rel=1e-6)
    assert out.friction == pytest.approx(-friction(SPEED * math.cos(angle)), rel=2e-5)


def test_a_steady_section_stalls_at_its_static_angle() -> None:
    assert steady(parameters(INFINITE, stall=0.3), 0.4).stalled == 1.0


@pytest.mark.parametrize("angle", [0.1, 0.5, 0.8, 1.2])
def test_an_uncambered_section_upside_down_gives_the_opposite_normal_force(angle: float) -> None:
    up, down = steady(parameters(), angle), steady(parameters(), -angle)
    assert (down.circulatory, down.separated) == pytest.approx((-up.circulatory, -up.separated))
    assert (down.suction, down.friction) == pytest.approx((up.suction, up.friction))


def test_stall_factor_by_hand_and_its_bounds() -> None:
    by_hand = 1.0 + 0.1 / 0.4 + 0.51 * math.sqrt(0.3 * 2.0 / 16.0) / 0.4
    assert stall_factor(0.1, 2.0, 0.3, 8.0, 0.4) == pytest.approx(by_hand)
    assert stall_factor(0.1, 0.0, 0.3, 8.0, 0.4) == pytest.approx(1.0 + 0.1 / 0.4)
    assert stall_factor(0.3, -1.0, 0.3, 8.0, 0.4) < stall_factor(0.3, 0.0, 0.3, 8.0, 0.4)
    assert stall_factor(1.5, 50.0, 0.3, 8.0, 0.4) == 2.0
    assert stall_factor(0.0, -50.0, 0.3, 8.0, 0.4) == 1.0


def test_the_stall_comes_without_a_jump() -> None:
    angles = np.linspace(0.0, 1.5, 3001)
    rows = np.array([steady(parameters(), angle) for angle in angles])
    normal, stalled = rows[:, 0] + rows[:, 1], rows[:, 7]
    assert np.min(stalled[stalled > 0.0]) > 0.0 and np.all(np.diff(stalled) >= 0.0)
    assert np.max(np.abs(np.diff(normal))) < 0.03 * np.max(normal)


@pytest.mark.parametrize("along", [0.0, 1e-9, -5.0])
def test_loads_stay_finite_without_airspeed_and_backwards(along: float) -> None:
    for down in (-10.0, 0.0, 3.0):
        out = section_loads(moving(along, down, 4.0), DENSITY, 0.1, parameters())
        assert np.all(np.isfinite(out))
        assert np.all(np.abs(out[:5]) < 200.0)


def test_the_printed_frequency_form() -> None:
    """DeLaurier: F' = 1 - C1 k^2/(k^2 + C2^2), G' = -C1 C2 k/(k^2 + C2^2)."""
    p, k_ = parameters(6.4), 0.3
    c1, c2 = 0.5 * 6.4 / (2.32 + 6.4), 0.181 + 0.772 / 6.4
    f = 1.0 - c1 * k_**2 / (k_**2 + c2**2)
    g = -c1 * c2 * k_ / (k_**2 + c2**2)
    assert frequency_domain_incidence(0.1 + 0.02j, k_, p) == pytest.approx(6.4 / 8.4 * (f + 1j * g) * (0.1 + 0.02j))


@pytest.mark.parametrize("k_", [0.05, 0.2, 0.6, 1.5])
def test_the_wake_in_time_is_the_printed_one_in_frequency(k_: float) -> None:
    p, size, steps, strokes = parameters(6.4), 0.01, 2000, 12
    omega = 2.0 * SPEED * k_ / CHORD
    dt, lag, total = 2.0 * math.pi / omega / steps, 0.0, 0.0 + 0.0j

    def loads(time: float, wake: float) -> Section:
        return section_loads(moving(SPEED, SPEED * size * math.sin(omega * time)), DENSITY, wake, p)

    for i in range(strokes * steps):
        out = loads(i * dt, lag)
        if i >= (strokes - 1) * steps:
            turned = complex(math.cos(omega * i * dt), -math.sin(omega * i * dt))
            total += out.circulatory * turned * 2.0 / steps
        lag += dt * loads((i + 0.5) * dt, lag + 0.5 * dt * out.lag_rate).lag_rate
    incidence = 1j * total / (0.5 * DENSITY * SPEED**2 * CHORD * 2.0 * math.pi)
    assert abs(incidence / frequency_domain_incidence(size, k_, p) - 1.0) < 0.01


def strips() -> Strips:
    """Two wings of `COUNT` tapering strips."""
    eta = (np.arange(COUNT) + 0.5) / COUNT
    both = [np.tile(column, 2) for column in (0.6 * eta, eta, 0.3 - 0.2 * eta, np.full(COUNT, 0.6 / COUNT))]
    return Strips(*both, np.repeat((0.0, 1.0), COUNT))


def loaded(
    settings: StripTheory = SETTINGS, density: float = DENSITY, seed: int = 4
) -> tuple[protocol.Motion, SectionLoads, Floats]:
    """A random motion, its loads by the protocol's call, and the wake that they were taken with."""
    wing, rng = strips(), np.random.default_rng(seed)
    motion = protocol.blank_motion(wing, 2)
    motion.along[:], motion.down[:] = rng.uniform(-2.0, 9.0, 2 * COUNT), rng.normal(0.0, 3.0, 2 * COUNT)
    motion.plunge[:], motion.pitch_rate[:] = rng.normal(0.0, 3.0, (2, 2 * COUNT))
    p = build(settings, wing)
    wake = initial(p, wing)
    wake[:] = rng.normal(size=wake.shape[0])
    out = protocol.blank_loads(len(MODEL.parts), wing, wake.shape[0])
    MODEL.loads(p, wing, motion, density, wake, out)
    return motion, out, wake


def test_a_strip_bears_its_width_of_the_sections_loads_each_at_its_place() -> None:
    wing, p = strips(), build(SETTINGS, strips())
    motion, out, wake = loaded()
    for i in range(2 * COUNT):
        chord, width = float(wing.chord[i]), float(wing.width[i])
        turn = float(motion.pitch_rate[i])
        one = SectionMotion(motion.along[i], motion.plunge[i], motion.down[i], turn, chord)
        section = section_loads(one, DENSITY, wake[i], p)
        expected = np.zeros((len(MODEL.parts), 4))
        expected[CIRCULATORY, UPWARD] = section.circulatory * width
        expected[CIRCULATORY, NOSE_UP] = section.circulatory * width * chord / 4.0
        expected[SEPARATED, UPWARD] = section.separated * width
        for part, force in ((SUCTION, section.suction), (CAMBER, section.camber), (FRICTION, section.friction)):
            expected[part, FORWARD] = force * width
        # DeLaurier's dM_a less what is apparent inertia: -1/4 of the apparent mass times chord, speed and pitch rate.
        expected[COUPLE, NOSE_UP] = -0.25 * section.apparent * width * chord * abs(motion.along[i]) * turn
        assert out.parts[:, :, i] == pytest.approx(expected, rel=1e-12, abs=1e-15)
        assert out.apparent[MASS, i] == pytest.approx(section.apparent * width)
        assert out.apparent[INERTIA, i] == pytest.approx(section.apparent * width * chord**2 / 32.0)
        assert out.rates[i] == section.lag_rate
    assert np.all(out.parts[:, OUTWARD] == 0.0)
    assert {int(np.argmax(np.abs(out.parts[:, UPWARD, i]))) for i in range(2 * COUNT)} == {CIRCULATORY, SEPARATED}


def test_the_sum_over_the_strips_is_that_of_its_parts() -> None:
    _, out, _ = loaded()
    total = out.parts.sum(axis=(0, 2))
    assert np.max(np.abs(total)) > 0.1
    by_part = np.array([out.parts[part].sum(axis=1) for part in range(len(MODEL.parts))])
    assert by_part.sum(axis=0) == pytest.approx(total, abs=1e-12 * np.max(np.abs(total)))


def test_air_loads_and_apparent_mass_scale_with_density_and_the_wake_does_not() -> None:
    (_, once, _), (_, thrice, _) = loaded(density=0.8), loaded(density=2.4)
    assert np.max(np.abs(once.parts)) > 0.01 and np.min(once.apparent) > 0.0
    assert thrice.parts == pytest.approx(3.0 * once.parts, rel=1e-12, abs=1e-15)
    assert thrice.apparent == pytest.approx(3.0 * once.apparent, rel=1e-12)
    assert np.array_equal(once.rates, thrice.rates)


def test_without_a_wakes_lag_there_is_no_state_and_the_loads_are_those_of_a_settled_wake() -> None:
    quasi_steady = SETTINGS._replace(wake_lag=0.0)
    assert initial(build(quasi_steady, strips()), strips()).shape == (0,)
    motion, out, _ = loaded(quasi_steady)
    wing, p = strips(), build(SETTINGS, strips())
    settled = protocol.blank_loads(len(MODEL.parts), wing, 2 * COUNT)
    wake = motion.down + 0.25 * wing.chord * motion.pitch_rate
    MODEL.loads(p, wing, motion, DENSITY, wake, settled)
    assert settled.parts == pytest.approx(out.parts, rel=1e-12, abs=1e-15)
    assert settled.rates == pytest.approx(np.zeros(2 * COUNT), abs=1e-9)


def test_a_plate_at_small_and_right_angles() -> None:
    assert plate_normal_force(0.05, 3.0) == pytest.approx(0.15, rel=0.01)
    assert plate_normal_force(math.pi / 2, 3.0) == pytest.approx(1.98)
    assert plate_normal_force(-0.6, 3.0) == -plate_normal_force(0.6, 3.0)


def test_plate_pressure_opposes_sinking_and_follows_the_deflection() -> None:
    assert plate_pressure(7.0, -1.0, 0.0, 3.0, 1.2) > 0.0 > plate_pressure(7.0, 1.0, 0.0, 3.0, 1.2)
    assert plate_pressure(7.0, 0.0, 0.1, 3.0, 1.2) == pytest.approx(0.5 * 1.2 * 49.0 * 0.3, rel=0.02)
    assert plate_pressure(0.0, 0.0, 0.1, 3.0, 1.2) == 0.0


def test_body_drag_takes_power_whichever_way_it_moves() -> None:
    force = np.zeros(3)
    for speeds in np.random.default_rng(1).normal(size=(20, 3)) * 6.0:
        body_drag(speeds, 0.012, 0.03, 1.2, force)
        assert force @ speeds < 0.0
    body_drag(np.array([6.0, 0.0, 0.0]), 0.012, 0.03, 1.2, force)
    assert force == pytest.approx([-0.5 * 1.2 * 36.0 * 0.012, 0.0, 0.0])
