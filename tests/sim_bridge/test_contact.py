from __future__ import annotations

import math

import numpy as np
import pytest
from plant_bench import NAMES, air, hold_position, vehicle

from sim_bridge.multibody.contact import FRICTION, PENETRATION, ground_force
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from wingbeat.quaternions import quaternion_from_euler

WEIGHT = 3.5


def pushed(depth: float, velocity: tuple[float, float, float]) -> Floats:
    force = np.zeros(3)
    ground_force(depth, np.array(velocity), WEIGHT, force)
    return force


def test_above_the_ground_there_is_no_force() -> None:
    force = np.ones(3)
    assert not ground_force(-1e-9, np.array([3.0, 0.0, 5.0]), WEIGHT, force)
    assert force == pytest.approx([0.0, 0.0, 0.0])


def test_its_weight_presses_one_point_in_by_a_centimetre() -> None:
    assert pushed(PENETRATION, (0.0, 0.0, 0.0)) == pytest.approx([0.0, 0.0, -WEIGHT])


def test_the_ground_never_pulls() -> None:
    for depth in (1e-4, 0.01, 0.05):
        assert pushed(depth, (1.0, 0.0, -20.0))[2] <= 0.0


def test_friction_opposes_sliding_by_coulombs_share() -> None:
    force = pushed(PENETRATION, (3.0, 4.0, 0.0))
    assert force[:2] == pytest.approx([-0.6 * FRICTION * WEIGHT, -0.8 * FRICTION * WEIGHT])
    slow = pushed(PENETRATION, (0.01, 0.0, 0.0))
    assert 0.0 < -slow[0] < FRICTION * WEIGHT


def test_a_bouncing_point_never_gains_energy() -> None:
    mass, stiffness, dt = WEIGHT / 9.80665, WEIGHT / PENETRATION, 1e-5
    z, v, energies, x_speed = -0.5, 0.0, [], 2.0
    force = np.zeros(3)
    for _ in range(150000):
        ground_force(z, np.array([x_speed, 0.0, v]), WEIGHT, force)
        v += dt * (9.80665 + force[2] / mass)
        z += dt * v
        x_speed += dt * force[0] / mass
        spring = 0.5 * stiffness * max(z, 0.0) ** 2
        energies.append(0.5 * mass * (v * v + x_speed**2) - WEIGHT * z + spring)
    # Symplectic Euler wobbles by v g dt / 2 around the true energy.
    assert np.max(np.diff(energies)) < 1e-3 * WEIGHT * 0.5
    assert np.max(energies) <= energies[0] * (1.0 + 1e-3)
    assert abs(v) < 1e-3 and abs(x_speed) < 0.05
    assert z == pytest.approx(PENETRATION, rel=0.01)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("roll", [0.0, 0.3])
def test_a_dropped_vehicle_comes_to_rest(name: str, roll: float) -> None:
    plant = Plant(vehicle(name))
    plant.y[2] = -0.5
    plant.y[3:7] = quaternion_from_euler(roll, 0.1, 0.4)
    plant.y[7] = 3.0
    speeds, touched = [], False
    for _ in range(600):
        plant.advance(hold_position(0.2, duration=0.01), air())
        touched = touched or plant.touching
        speeds.append(math.hypot(*plant.y[7:10]))
    assert touched and plant.touching
    assert max(speeds) < math.sqrt(3.0**2 + 2.0 * 9.80665 * 0.5) * 1.02
    assert speeds[-1] < 0.01
    assert np.max(np.abs(plant.y[10:13])) < 0.02
    below = plant.vehicle.fuselage.contact_below
    assert plant.y[2] == pytest.approx(-below, abs=PENETRATION)
    slide = math.hypot(plant.y[0], plant.y[1])
    assert 0.2 < slide < 5.0
