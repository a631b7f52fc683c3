from __future__ import annotations

import math

import numpy as np
import pytest
from plant_bench import NAMES, air, hold, pitching, vehicle

from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant, aspect_ratio, chord_shape, plant_parameters, wing_strips
from sim_bridge.vectors import quaternion_from_euler


def gliding(name: str, **changes: float) -> Plant:
    """A plant in level flight with its wings held, its state changed by index name."""
    plant = Plant(vehicle(name))
    plant.y[2], plant.y[3:7] = -100.0, (1.0, 0.0, 0.0, 0.0)
    plant.y[7] = 7.0
    for key, value in changes.items():
        plant.y[getattr(k, key)] = value
    return plant


@pytest.mark.parametrize("name", NAMES)
def test_strips_add_up_to_the_wing(name: str) -> None:
    wing = vehicle(name).wing
    strips = wing_strips(wing)
    assert strips[:, 3].sum() == pytest.approx(wing.semispan)
    assert strips[:, 4:6].sum() == pytest.approx(wing.mass)
    assert strips[:, 4].sum() == pytest.approx(wing.mass * wing.spar_fraction)
    more = wing_strips(wing._replace(strips=48))
    assert strips[:, 2] @ strips[:, 3] == pytest.approx(more[:, 2] @ more[:, 3], rel=1e-3)
    assert aspect_ratio(wing, strips) == pytest.approx(2 * wing.semispan**2 / (strips[:, 2] @ strips[:, 3]))


def test_chords_at_root_and_tip() -> None:
    assert chord_shape("raven", 0.2) == 1.0 and chord_shape("raven", 0.5) == 1.0
    assert chord_shape("raven", 0.75) == pytest.approx(0.75)
    assert chord_shape("ellipse", 0.6) == pytest.approx(0.8)
    assert chord_shape("raven", 1.0) == chord_shape("ellipse", 1.0) == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_parts_weigh_what_the_vehicle_weighs(name: str) -> None:
    p = plant_parameters(vehicle(name))
    total = p.fuselage_mass + 2.0 * p.strips[:, 4:6].sum()
    assert total == pytest.approx(vehicle(name).body.mass)
    assert p.weight == pytest.approx(total * k.GRAVITY)


@pytest.mark.parametrize("name", NAMES)
def test_the_elevator_pitches_the_nose_up_and_the_rudder_yaws_it_right(name: str) -> None:
    neutral, up = gliding(name), gliding(name, ELEVATOR=0.2)
    rates = [plant.evaluate(hold(), air()) for plant in (neutral, up, gliding(name, RUDDER=0.2))]
    assert rates[1][11] > rates[0][11] + 1.0
    assert rates[2][12] > rates[0][12] + 0.5


@pytest.mark.parametrize("name", NAMES)
def test_it_weathercocks_and_damps_its_turning(name: str) -> None:
    slipping, yawing, pitched = gliding(name), gliding(name), gliding(name)
    slipping.y[8], yawing.y[12], pitched.y[11] = 1.0, 1.0, 2.0
    base = gliding(name).evaluate(hold(), air())
    assert slipping.evaluate(hold(), air())[12] > 0.0
    assert yawing.evaluate(hold(), air())[12] < 0.0
    assert pitched.evaluate(hold(), air())[11] < base[11]


def test_tail_servos_reach_their_command_no_faster_than_they_can() -> None:
    plant = gliding("robo_raven_ii_d")
    command = hold(duration=0.01)._replace(elevator=0.6, rudder=-0.1)
    tail, before = plant.vehicle.tail, 0.0
    for _ in range(60):
        plant.advance(command, air(launcher=k.HELD))
        assert plant.y[k.ELEVATOR] - before <= tail.servo_rate_limit * 0.01 + 1e-12
        before = float(plant.y[k.ELEVATOR])
    assert plant.y[k.ELEVATOR] == pytest.approx(0.6, abs=1e-6)
    assert plant.y[k.RUDDER] == pytest.approx(-0.1, abs=1e-6)


def test_flying_in_steady_wind_is_flying_in_still_air_seen_from_a_balloon() -> None:
    still, windy = gliding("robo_raven_ii_d"), gliding("robo_raven_ii_d")
    heading = quaternion_from_euler(0.1, 0.15, 0.7)
    still.y[3:7] = windy.y[3:7] = heading
    still.y[k.WAKE :] = windy.y[k.WAKE :] = 0.0
    wind = np.array([2.0, -1.5, 0.4])
    windy.advance(hold(duration=1e-9), air(launcher=k.HELD))
    windy.y[:] = still.y
    windy.y[7:10] += windy.scratch.r.T @ wind
    for _ in range(100):
        still.advance(hold(0.2, 0.01), air())
        windy.advance(hold(0.2, 0.01), air(wind=tuple(wind)))
    assert windy.y[0:3] - still.y[0:3] == pytest.approx(wind * 1.0, abs=1e-6)
    assert windy.y[10:] == pytest.approx(still.y[10:], abs=1e-6)


def test_the_imu_on_the_bench_feels_one_g_upwards_and_in_free_fall_nothing() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.y[7] = 0.0
    plant.y[3:7] = quaternion_from_euler(0.0, 0.2, 0.0)
    means = plant.advance(hold(), air(launcher=k.HELD))
    down = np.array([-math.sin(0.2), 0.0, math.cos(0.2)])
    assert means[4:7] == pytest.approx(tuple(-k.GRAVITY * down))
    means = gliding("robo_raven_ii_d").advance(hold(powered=0.0), air(1e-9))
    assert means[4:7] == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)


def test_the_imu_away_from_the_centre_feels_the_turning() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.parameters = plant.parameters._replace(imu=np.array([0.1, 0.0, 0.0]))
    plant.y[7] = 0.0
    plant.y[12] = 3.0
    means = plant.advance(hold(duration=0.001), air(1e-9, launcher=k.HELD))
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
    assert plant.y[k.CHARGE] == pytest.approx(drawn, rel=0.01)
    assert drawn > 0.5


def test_the_quaternion_stays_of_unit_length() -> None:
    plant = gliding("robo_raven_ii_d")
    plant.y[10:13] = 5.0, -3.0, 4.0
    for _ in range(200):
        plant.advance(hold(0.2, 0.01), air())
    assert np.linalg.norm(plant.y[3:7]) == pytest.approx(1.0, abs=1e-6)
    assert abs(pitching(plant)) <= math.pi / 2
