from __future__ import annotations

import math

import numpy as np
import pytest
from plant_bench import NAMES, VACUUM, air, hold, mirrored, rates, state, vehicle
from sim_bridge.multibody.flapper import SPEEDS, add_wing, clear

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.strip_theory import (
    StripParameters,
    frequency_domain_incidence,
    friction_coefficient,
    section_loads,
    stall_factor,
    strip_parameters,
)
from sim_bridge.aerodynamics.surfaces import body_drag, plate_normal_force, plate_pressure
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats

CHORD, DENSITY, SPEED = 0.3, 1.2, 8.0
INFINITE = 1e9
"""aspect ratio of a wing without downwash"""


def parameters(aspect_ratio: float = 5.0, camber: float = 0.0, stall: float = 0.4) -> StripParameters:
    return strip_parameters(aspect_ratio, camber, 1.0, stall)


def steady(p: StripParameters, angle: float, speed: float = SPEED, density: float = DENSITY) -> Floats:
    """Loads of a section in steady flow at an angle of attack, its wake settled."""
    along, down, out = speed * math.cos(angle), speed * math.sin(angle), np.zeros(6)
    section_loads(np.array([along, 0.0, down, down, 0.0]), CHORD, density, down, p, out)
    return out


def friction(along: float) -> float:
    reynolds = along * CHORD / 1.46e-5
    return 0.5 * DENSITY * CHORD * along * along * 0.89 / math.log10(reynolds) ** 2.58


def test_a_small_steady_angle_gives_the_lift_of_a_finite_thin_wing() -> None:
    out = steady(parameters(5.0), 0.02)
    slope = 2.0 * math.pi * 5.0 / 7.0
    assert out[0] == pytest.approx(0.5 * DENSITY * SPEED**2 * CHORD * slope * 0.02, rel=1e-3)
    assert out[1] == 0.0 and out[5] == 0.0


def test_across_the_flow_it_is_hoerners_plate_and_the_chordwise_force_is_gone() -> None:
    out = steady(parameters(), math.pi / 2)
    assert out[1] == pytest.approx(0.5 * DENSITY * SPEED**2 * CHORD * 1.98)
    assert out[0] == 0.0 and out[2] == 0.0 and out[5] == 1.0
    assert out[4] == pytest.approx(0.5 * DENSITY * math.pi * CHORD**2 / 4.0)


def test_suction_and_friction_are_delauriers() -> None:
    p = strip_parameters(6.0, 0.0, 0.7, 0.4)
    u, down, rate, out = 7.0, 0.5, 2.0, np.zeros(6)
    section_loads(np.array([u, down, down, down, rate]), CHORD, DENSITY, down, p, out)
    flow = 6.0 / 8.0 * down  # U (alpha' + theta)
    v = math.hypot(u, flow - 0.5 * CHORD * rate)
    suction = 0.7 * 2.0 * math.pi * (flow / u - CHORD * rate / (4.0 * u)) ** 2 * DENSITY * u * v / 2.0 * CHORD
    assert out[2] == pytest.approx(suction - friction(u), rel=1e-12)
    assert out[0] == pytest.approx(DENSITY * u * v / 2.0 * 2.0 * math.pi * flow / u * CHORD)
    assert out[5] == 0.0


def test_friction_of_a_plate() -> None:
    assert friction_coefficient(1e5) == pytest.approx(0.89 / 5.0**2.58)
    assert math.isfinite(friction_coefficient(0.0))


@pytest.mark.parametrize(
    "camber",
    [
        0.0,
        0.05,
    ],
)
def test_an_infinite_wing_in_ideal_flow_has_no_drag(camber: float) -> None:
    angle = 0.08
    out = steady(parameters(INFINITE, camber), angle)
    chordwise = out[2] + friction(SPEED * math.cos(angle))
    assert chordwise == pytest.approx(out[0] * math.tan(angle), rel=1e-6)


def test_a_steady_section_stalls_at_its_static_angle() -> None:
    assert steady(parameters(INFINITE, stall=0.3), 0.4)[5] == 1.0


@pytest.mark.parametrize("angle", [0.1, 0.5, 0.8, 1.2])
def test_an_uncambered_section_upside_down_gives_the_opposite_normal_force(angle: float) -> None:
    up, down = steady(parameters(), angle), steady(parameters(), -angle)
    assert (down[0], down[1], down[2]) == pytest.approx((-up[0], -up[1], up[2]))


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
    normal, stalled = rows[:, 0] + rows[:, 1], rows[:, 5]
    assert np.min(stalled[stalled > 0.0]) > 0.0 and np.all(np.diff(stalled) >= 0.0)
    assert np.max(np.abs(np.diff(normal))) < 0.03 * np.max(normal)


@pytest.mark.parametrize("along", [0.0, 1e-9, -5.0])
def test_loads_stay_finite_without_airspeed_and_backwards(along: float) -> None:
    out = np.zeros(6)
    for down in (-10.0, 0.0, 3.0):
        section_loads(np.array([along, down, down, down, 4.0]), CHORD, DENSITY, 0.1, parameters(), out)
        assert np.all(np.isfinite(out))
        assert np.all(np.abs(out[:3]) < 200.0)


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
    dt, lag, out, total = 2.0 * math.pi / omega / steps, 0.0, np.zeros(6), 0.0 + 0.0j

    def loads(time: float, wake: float) -> None:
        down = SPEED * size * math.sin(omega * time)
        section_loads(np.array([SPEED, down, down, down, 0.0]), CHORD, DENSITY, wake, p, out)

    for i in range(strokes * steps):
        loads(i * dt, lag)
        if i >= (strokes - 1) * steps:
            total += out[0] * complex(math.cos(omega * i * dt), -math.sin(omega * i * dt)) * 2.0 / steps
        slope = out[3]
        loads((i + 0.5) * dt, lag + 0.5 * dt * slope)
        lag += dt * out[3]
    incidence = 1j * total / (0.5 * DENSITY * SPEED**2 * CHORD * 2.0 * math.pi)
    assert abs(incidence / frequency_domain_incidence(size, k_, p) - 1.0) < 0.01


def _wing(plant: Plant, y: Floats, side: float, density: float) -> tuple[Floats, Floats, Floats]:
    p, n = plant.parameters, plant.vehicle.wing.strips
    mass, load = np.zeros((SPEEDS, SPEEDS)), np.zeros(SPEEDS)
    clear(mass, load)
    frame = np.zeros((5, 3))
    frame[0] = p.hinge_position * (1.0, side, 1.0)
    frame[1], frame[2] = y[7:10], y[10:13]
    base, wake = (k.RIGHT, k.WAKE + n) if side > 0 else (k.LEFT, k.WAKE)
    loads = np.zeros((n, 6))
    add_wing(
        mass, load, y[base : base + 4], side, p.strips, p.hinge, frame, y[wake : wake + n], np.zeros(n),
        density, p.section, p.washout, np.zeros((8, 18)), loads,
    )  # fmt: skip
    return mass, load, loads


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_strips_sum_to_what_moves_the_body(name: str, side: float) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(4), speed=7.0)
    # Without turning the apparent mass has no bias, and the load is that of the strips alone.
    y[10:13] = 0.0
    for base in (k.LEFT, k.RIGHT):
        y[base + 2 : base + 4] = 0.0
    _, load, strips = _wing(plant, y, side, 1.225)
    total = strips.sum(axis=0)
    assert np.max(np.abs(total)) > 0.1
    assert load[:6] == pytest.approx(total, abs=1e-12 * np.max(np.abs(total)) + 1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_air_loads_and_apparent_mass_scale_with_density(name: str) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(6), speed=7.0)
    dry, once, thrice = (_wing(plant, y, 1.0, density) for density in (0.0, 0.8, 2.4))
    for nothing, one, three in zip(dry, once, thrice, strict=True):
        part = one - nothing
        assert np.max(np.abs(part)) > 0.001
        assert three - nothing == pytest.approx(3.0 * part, abs=1e-10 * np.max(np.abs(part)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_mirrored_motion_has_the_mirrored_rates(name: str, seed: int) -> None:
    plant = Plant(vehicle(name))
    n = plant.vehicle.wing.strips
    y = state(plant, np.random.default_rng(seed), speed=7.0)
    left = k.Controls(0.1, 0.12, -0.2, -0.19, 0.4, 0.1, 0.2, 0.005, 0.0)
    right = left._replace(left_start=-0.2, left_end=-0.19, right_start=0.1, right_end=0.12, rudder=-0.2)
    ours = rates(plant, y, left, air(wind=(2.0, 1.0, 0.3)))
    theirs = rates(plant, mirrored(y, n), right, air(wind=(2.0, -1.0, 0.3)))
    assert mirrored(theirs, n) == pytest.approx(ours, rel=1e-9, abs=1e-9 * np.max(np.abs(ours)))


def test_the_whole_vehicle_at_rest_in_still_air_feels_gravity_alone() -> None:
    plant = Plant(vehicle("robo_raven_ii_d"))
    y = np.zeros_like(plant.y)
    y[2], y[3] = -50.0, 1.0
    y_dot = rates(plant, y, hold(powered=0.0), air(VACUUM))
    assert y_dot[7:13] == pytest.approx([0.0, 0.0, k.GRAVITY, 0.0, 0.0, 0.0], abs=1e-6)
    y_dot = rates(plant, y, hold(powered=0.0), air())
    # In air the fuselage falls freely at first, but the wings have to push theirs aside.
    assert np.all(np.isfinite(y_dot)) and 5.0 < y_dot[9] < k.GRAVITY


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
