from __future__ import annotations

import math

import numpy as np
import pytest
from plant_bench import (
    NAMES,
    air,
    equations,
    hold_position,
    joint_rates,
    mirrored,
    pitching,
    rates,
    slack,
    state,
    vehicle,
)

from sim_bridge import plant_kernel as k
from sim_bridge.actuators.linkage import drive
from sim_bridge.aerodynamics.protocol import aspect_ratio
from sim_bridge.mechanism import chord_shape, total_mass, wing_strips
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.quaternions import quaternion_from_euler


def gliding(name: str, elevator: float = 0.0, rudder: float = 0.0) -> Plant:
    """A plant in level flight with its wings held and its tail at these angles in rad."""
    plant = Plant(vehicle(name))
    plant.y[2], plant.y[3:7] = -100.0, (1.0, 0.0, 0.0, 0.0)
    plant.y[7] = 7.0
    plant.y[plant.layout.elevator], plant.y[plant.layout.rudder] = elevator, rudder
    return plant


def steered(plant: Plant) -> k.Controls:
    """Controls that leave wings and tail where they are."""
    layout = plant.layout
    return hold_position()._replace(elevator=plant.y[layout.elevator], rudder=plant.y[layout.rudder])


@pytest.mark.parametrize("name", NAMES)
def test_strips_add_up_to_the_wing(name: str) -> None:
    wing = vehicle(name).wing
    strips, membrane = wing_strips(wing)
    n = wing.strips
    assert strips.chord.shape == membrane.shape == (2 * n,)
    assert strips.width[:n].sum() == pytest.approx(wing.semispan)
    assert membrane[:n].sum() == membrane[n:].sum() == pytest.approx(wing.membrane_mass)
    assert strips.span == pytest.approx(strips.eta * wing.semispan)
    more, _ = wing_strips(wing._replace(strips=48))
    area = strips.chord @ strips.width
    assert area == pytest.approx(more.chord @ more.width, rel=1e-3)
    assert aspect_ratio(strips) == pytest.approx((2.0 * wing.semispan) ** 2 / area)


def test_chords_at_root_and_tip() -> None:
    assert chord_shape("raven", 0.2) == 1.0 and chord_shape("raven", 0.5) == 1.0
    assert chord_shape("raven", 0.75) == pytest.approx(0.75)
    assert chord_shape("ellipse", 0.6) == pytest.approx(0.8)
    assert chord_shape("raven", 1.0) == chord_shape("ellipse", 1.0) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_parts_weigh_what_the_vehicle_weighs(name: str) -> None:
    plant, bodies = Plant(vehicle(name)), vehicle(name).bodies
    parts = sum(bodies[body.mirror_of or key].mass for key, body in bodies.items())
    total = parts + 2.0 * vehicle(name).wing.membrane_mass
    assert total_mass(vehicle(name)) == pytest.approx(total)
    assert plant.parameters.weight == pytest.approx(total * STANDARD_GRAVITY)
    assert plant.parameters.tree.mass.sum() + plant.parameters.wings.membrane.sum() == pytest.approx(total)


def test_robo_raven_weighs_what_gerdes_weighed() -> None:
    """Gerdes Table 4: 0.359 kg with wing D."""
    assert total_mass(vehicle("robo_raven_ii_d")) == pytest.approx(0.359, abs=5e-4)


@pytest.mark.parametrize("name", NAMES)
def test_the_elevator_pitches_the_nose_up_and_the_rudder_yaws_it_right(name: str) -> None:
    plants = gliding(name), gliding(name, elevator=0.2), gliding(name, rudder=0.2)
    neutral, up, right = (plant.evaluate(steered(plant), air()) for plant in plants)
    assert up[11] > neutral[11] + 1.0
    assert right[12] > neutral[12] + 0.5


@pytest.mark.parametrize("name", NAMES)
def test_it_weathercocks_and_damps_its_turning(name: str) -> None:
    slipping, yawing, pitched = gliding(name), gliding(name), gliding(name)
    slipping.y[8], yawing.y[12], pitched.y[11] = 1.0, 1.0, 2.0
    base = gliding(name).evaluate(hold_position(), air())
    assert slipping.evaluate(hold_position(), air())[12] > 0.0
    assert yawing.evaluate(hold_position(), air())[12] < 0.0
    assert pitched.evaluate(hold_position(), air())[11] < base[11]


def test_tail_servos_reach_their_command_no_faster_than_they_can() -> None:
    plant = gliding("robo_raven_ii_d")
    command = hold_position(duration=0.01)._replace(elevator=0.6, rudder=-0.1)
    layout, limit, angles = plant.layout, plant.vehicle.tail_servo.rate_limit, [0.0]
    for _ in range(60):
        plant.advance(command, air(launcher=k.HELD))
        angles.append(float(plant.y[layout.elevator]))
        assert plant.y[layout.rate(layout.elevator)] <= limit * (1.0 + 1e-9)
    assert np.all(np.diff(angles) <= limit * 0.01 * (1.0 + 1e-9))
    assert np.max(np.diff(angles)) > 0.8 * limit * 0.01
    assert np.max(angles) <= 0.6 * 1.001
    assert angles[-1] == pytest.approx(0.6, abs=1e-6)
    assert plant.y[layout.rudder] == pytest.approx(-0.1, abs=1e-6)


def test_flying_in_steady_wind_is_flying_in_still_air_seen_from_a_balloon() -> None:
    still, windy = gliding("robo_raven_ii_d"), gliding("robo_raven_ii_d")
    heading = quaternion_from_euler(0.1, 0.15, 0.7)
    still.y[3:7] = windy.y[3:7] = heading
    wind = np.array([2.0, -1.5, 0.4])
    windy.advance(hold_position(duration=1e-9), air(launcher=k.HELD))
    windy.y[:] = still.y
    windy.y[7:10] += windy.scratch.r.T @ wind
    for _ in range(100):
        still.advance(hold_position(0.2, 0.01), air())
        windy.advance(hold_position(0.2, 0.01), air(wind=tuple(wind)))
    assert windy.y[0:3] - still.y[0:3] == pytest.approx(wind * 1.0, abs=1e-6)
    assert windy.y[10:] == pytest.approx(still.y[10:], abs=1e-6)


def test_the_imu_on_the_bench_feels_one_g_upwards_and_in_free_fall_nothing() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.y[7] = 0.0
    plant.y[3:7] = quaternion_from_euler(0.0, 0.2, 0.0)
    means = plant.advance(hold_position(), air(launcher=k.HELD))
    down = np.array([-math.sin(0.2), 0.0, math.cos(0.2)])
    assert means[4:7] == pytest.approx(tuple(-STANDARD_GRAVITY * down))
    means = gliding("robo_raven_ii_d").advance(hold_position(powered=0.0), air(1e-9))
    assert means[4:7] == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)


def test_the_imu_away_from_the_centre_feels_the_turning() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.parameters = plant.parameters._replace(imu=np.array([0.1, 0.0, 0.0]))
    plant.y[7] = 0.0
    plant.y[12] = 3.0
    means = plant.advance(hold_position(duration=0.001), air(1e-9, launcher=k.HELD))
    assert means.specific_force_x == pytest.approx(-9.0 * 0.1)


def test_the_drives_current_is_what_the_battery_loses() -> None:
    plant = gliding("robo_raven_ii_d")
    drawn = 0.0
    for i in range(100):
        start, end = (0.4 * math.sin(2.0 * math.pi * 4.0 * 0.005 * j) for j in (i, i + 1))
        command = k.Controls(start, end, start, end, 0.0, 0.0, 0.0, 0.005, 1.0)
        means = plant.advance(command, air(launcher=k.HELD, wind=(-7.0, 0.0, 0.0)))
        drawn += means.current * 0.005
        assert means.electrical_power <= means.current * 8.4
    assert plant.y[plant.layout.charge] == pytest.approx(drawn, rel=0.01)
    assert drawn > 0.5


def test_the_quaternion_stays_of_unit_length() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.y[10:13] = 5.0, -3.0, 4.0
    for _ in range(200):
        plant.advance(hold_position(0.2, 0.01), air())
    assert np.linalg.norm(plant.y[3:7]) == pytest.approx(1.0, abs=1e-6)
    assert abs(pitching(plant)) <= math.pi / 2


def without_turning(plant: Plant, y: Floats) -> Floats:
    """The state without any turning: then the apparent mass has no bias."""
    still = y.copy()
    still[10:13] = still[joint_rates(plant)] = 0.0
    return still


@pytest.mark.parametrize("name", NAMES)
def test_the_strips_sum_to_what_moves_the_body(name: str) -> None:
    plant = Plant(vehicle(name))
    y = without_turning(plant, state(plant, np.random.default_rng(4), speed=7.0))
    loads = []
    for density in (0.0, 1.225):
        rates(plant, y, slack(), air(density, launcher=k.HELD))
        loads.append(-plant.scratch.tree.force[0, [3, 4, 5, 0, 1, 2]])
    parts = plant.wing_loads().sum(axis=0) + plant.scratch.body_load + plant.scratch.plate_load
    assert np.max(np.abs(parts)) > 0.1
    assert loads[1] - loads[0] == pytest.approx(parts, abs=1e-12 * np.max(np.abs(parts)) + 1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_air_loads_and_apparent_mass_scale_with_density(name: str) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(6), speed=7.0)
    dry, once, thrice = (equations(plant, y, air(density)) for density in (0.0, 0.8, 2.4))
    for nothing, one, three in zip(dry, once, thrice, strict=True):
        part = one - nothing
        assert np.max(np.abs(part)) > 0.001
        assert three - nothing == pytest.approx(3.0 * part, abs=1e-10 * np.max(np.abs(part)))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_mirrored_motion_has_the_mirrored_rates(name: str, seed: int) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(seed), speed=7.0)
    left = k.Controls(0.1, 0.12, -0.2, -0.19, 0.4, 0.1, 0.2, 0.005, 1.0)
    right = left._replace(left_start=-0.2, left_end=-0.19, right_start=0.1, right_end=0.12, rudder=-0.2)
    turn, image = {"turn_x": 0.4, "turn_y": 0.3, "turn_z": -0.2}, {"turn_x": -0.4, "turn_y": 0.3, "turn_z": 0.2}
    ours = rates(plant, y, left, air(wind=(2.0, 1.0, 0.3))._replace(**turn))
    theirs = rates(plant, mirrored(plant, y), right, air(wind=(2.0, -1.0, 0.3))._replace(**image))
    assert mirrored(plant, theirs) == pytest.approx(ours, rel=1e-9, abs=1e-9 * np.max(np.abs(ours)))


@pytest.mark.parametrize("name", NAMES)
def test_the_launcher_holds_and_throws_what_it_has_in_hand(name: str) -> None:
    plant = Plant(vehicle(name))
    y = state(plant, np.random.default_rng(9), speed=3.0)
    held = rates(plant, y, slack(), air(launcher=k.HELD))
    assert np.all(held[7:13] == 0.0)
    thrown = rates(plant, y, slack(), air(launcher=k.THROWN)._replace(throw_x=20.0, throw_y=1.0, throw_z=-3.0))
    assert thrown[7:13].tolist() == [20.0, 1.0, -3.0, 0.0, 0.0, 0.0]
    # What it does not hold follows: the throw's acceleration moves the joints.
    assert np.max(np.abs((thrown - held)[joint_rates(plant)])) > 1.0


def test_a_prescribed_joint_is_where_the_phase_of_the_stroke_says() -> None:
    bird = vehicle("arizona_100cm")
    motion = (0.05, 0.2, -0.1, 0.03, 0.04)
    elevator = bird.bodies["elevator"]._replace(moved_by="stroke", motion=motion)
    plant = Plant(bird._replace(bodies=bird.bodies | {"elevator": elevator}))
    at, layout = k.COORDINATES + plant.layout.coordinates.index("elevator"), plant.layout

    def series(phase: float) -> tuple[float, float]:
        terms = [(h, *motion[2 * h - 1 : 2 * h + 1]) for h in (1, 2)]
        angle = motion[0] + sum(a * math.cos(h * phase) + b * math.sin(h * phase) for h, a, b in terms)
        slope = sum(h * (b * math.cos(h * phase) - a * math.sin(h * phase)) for h, a, b in terms)
        return angle, slope

    plant.y[2], plant.y[3:7], plant.y[7] = -100.0, (1.0, 0.0, 0.0, 0.0), 7.0
    plant.y[layout.crank_speed] = 2.0
    plant.y[at], plant.y[layout.rate(at)] = series(0.0)[0], series(0.0)[1] * 2.0 * math.pi * 2.0
    # The crank gathers speed meanwhile: its own acceleration is part of what is imposed.
    for _ in range(100):
        plant.advance(hold_position(duration=0.004)._replace(throttle=0.7), air())
        angle, slope = series(plant.y[layout.crank_phase])
        assert plant.y[at] == pytest.approx(angle, abs=1e-5)
        rate = slope * 2.0 * math.pi * plant.y[layout.crank_speed]
        assert plant.y[layout.rate(at)] == pytest.approx(rate, abs=1e-3)
    assert plant.y[layout.crank_speed] > 3.0


@pytest.mark.parametrize("throttle", [0.3, 0.77, 1.0])
def test_a_motor_draws_what_the_voltage_that_its_current_leaves_drives(throttle: float) -> None:
    plant = Plant(vehicle("slow_hawk"))
    battery, layout = plant.parameters.battery, plant.layout
    plant.y[2], plant.y[7] = -100.0, 9.0
    plant.y[layout.crank_phase], plant.y[layout.crank_speed] = 2.0, 5.9 * throttle
    rates(plant, plant.y, hold_position()._replace(throttle=throttle), air())
    _, _, current, voltage = plant.scratch.drive[:4].tolist()
    crank_rate = 2.0 * math.pi * float(plant.y[layout.crank_speed])
    assert voltage == pytest.approx(battery[0] - battery[3] * current, abs=1e-9)
    assert current == pytest.approx(throttle * drive(plant.parameters.motor, throttle * voltage, crank_rate).current)
    assert current > 1.0


def test_following_commands_is_advancing_through_them_one_by_one() -> None:
    one, other = Plant(vehicle("robo_raven_ii_d")), Plant(vehicle("robo_raven_ii_d"))
    controls = [hold_position(0.4 * math.sin(0.13 * i), 0.005 + 0.001 * (i % 3)) for i in range(30)]
    states, means = one.follow(controls, air())
    for i, wanted in enumerate(controls):
        assert np.array_equal(other.advance(wanted, air()), means[i])
        assert np.array_equal(other.y, states[i])
    assert np.array_equal(one.y, other.y)
