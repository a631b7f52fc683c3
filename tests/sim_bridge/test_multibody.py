from __future__ import annotations

import math

import numpy as np
import pytest
from plant_bench import (
    GRAVITY,
    MECHANISMS,
    VACUUM,
    Mechanism,
    air,
    driven,
    frictionless,
    integrate,
    joint_rates,
    joints,
    rates,
    slack,
    speeds,
    state,
    vehicle,
)

from sim_bridge import plant_kernel as k
from sim_bridge.multibody.tree import impose, solve
from sim_bridge.plant import Plant
from sim_bridge.vectors import rotation
from wingbeat.quaternions import quaternion_from_euler


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("seed", range(6))
def test_accelerations_are_those_of_the_same_mechanism_of_particles(name: str, seed: int) -> None:
    plant = frictionless(name)
    y = state(plant, np.random.default_rng(seed))
    ours = rates(plant, y, slack(), air(VACUUM * 1e-3))[speeds(plant)]
    independent = Mechanism(plant, y).accelerations()
    assert ours == pytest.approx(independent, rel=1e-6, abs=1e-6 * np.max(np.abs(independent)))


@pytest.mark.parametrize("name", MECHANISMS)
def test_momentum_and_energy_are_conserved_in_vacuum(name: str) -> None:
    plant = frictionless(name)
    start = state(plant, np.random.default_rng(11))
    before = Mechanism(plant, start)
    end = integrate(plant, start, 1.0, 10000, air(VACUUM))
    after = Mechanism(plant, end)
    # Gravity adds exactly m g t to the momentum and nothing to the spin about the centre of mass.
    expected = before.momentum()
    expected[:3] += before.masses.sum() * GRAVITY
    changed = (end - start)[joint_rates(plant)]
    assert np.max(np.abs(changed)) > 3.0
    assert after.momentum() == pytest.approx(expected, abs=2e-6 * np.max(np.abs(expected)))
    assert after.energy() == pytest.approx(before.energy(), abs=1e-6)


def test_a_membrane_with_damping_loses_energy() -> None:
    plant = Plant(vehicle("robo_raven_ii_d"))
    start = state(plant, np.random.default_rng(3))
    end = integrate(plant, start, 0.2, 1000, air(VACUUM))
    assert Mechanism(plant, end).energy() < Mechanism(plant, start).energy() - 0.01


@pytest.mark.parametrize("density", [VACUUM, 1.225])
def test_the_integrator_is_of_fourth_order(density: float) -> None:
    plant = frictionless("robo_raven_ii_d")
    layout, y = plant.layout, state(plant, np.random.default_rng(2), speed=8.0)
    steps = 200
    if density > VACUUM:
        # Gentle enough that no section reaches the stall, whose blend is smooth only once.
        steps, y[10:13] = 50, 0.2 * y[10:13]
        y[joints(plant)] = y[joint_rates(plant)] = 0.0
        for flap, twist in zip(layout.flap, layout.twist, strict=True):
            y[flap], y[twist], y[layout.rate(flap)], y[layout.rate(twist)] = 0.1, 0.02, 0.5, 0.2
        y[7:10] = 8.0, 0.1, 0.3
        y[layout.aerodynamics :] = 0.3
    coarse, middle, fine = (integrate(plant, y, 0.05, steps * n, air(density)) for n in (1, 2, 4))
    assert np.linalg.norm(coarse - middle) / np.linalg.norm(middle - fine) == pytest.approx(16.0, rel=0.15)


@pytest.mark.parametrize("resistance", [0.0, 0.06])
def test_halving_the_step_keeps_its_worth_with_saturated_drives(resistance: float) -> None:
    plant = Plant(vehicle("robo_raven_ii_d"))
    plant.parameters = plant.parameters._replace(battery=np.array([8.4, 7.2, 2664.0, resistance]))
    y = np.zeros_like(plant.y)
    y[2], y[3], y[7] = -100.0, 1.0, 7.0
    controls = k.Controls(0.6, 1.0, 0.6, 1.0, 0.0, 0.0, 0.0, 0.02, 1.0)
    coarse, fine = (driven(plant, y, controls, steps, air()) for steps in (20, 320))
    assert np.linalg.norm((coarse - fine)[: plant.layout.charge]) < 1e-5


def test_the_rates_are_a_function_of_the_state() -> None:
    plant = Plant(vehicle("robo_raven_ii_d"))
    y = np.zeros_like(plant.y)
    y[2], y[3], y[7] = -100.0, 1.0, 7.0
    controls = k.Controls(0.6, 1.0, 0.6, 1.0, 0.0, 0.0, 0.0, 0.02, 1.0)
    first = rates(plant, y, controls, air())
    assert rates(plant, y, controls, air()) == pytest.approx(first, rel=1e-9)


def test_imposed_rates_come_out_as_imposed_and_the_rest_obeys_newton() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(10, 10))
    full = root @ root.T + np.eye(10)
    load, imposed = rng.normal(size=10), rng.normal(size=10)
    held = np.array([1, 0, 0, 1, 1, 0, 0, 0, 1, 0])
    mass, x = np.triu(full), load.copy()
    impose(mass, x, held, imposed)
    solve(mass, x)
    assert x[held == 1] == pytest.approx(imposed[held == 1])
    assert (full @ x)[held == 0] == pytest.approx(load[held == 0])


def test_solve_is_the_inverse_of_multiplication() -> None:
    root = np.random.default_rng(8).normal(size=(10, 10))
    full, wanted = root @ root.T + 0.1 * np.eye(10), np.arange(10.0) - 4.0
    load = full @ wanted
    solve(np.triu(full), load)
    assert load == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize("angles", [(0.3, -0.7, 2.0), (-1.2, 0.4, -3.0), (0.0, 1.5, 0.1)])
def test_attitudes_turn_vectors_as_roll_pitch_yaw_say(angles: tuple[float, float, float]) -> None:
    q, r = quaternion_from_euler(*angles), np.zeros((3, 3))
    rotation(*(2.0 * part for part in q), r)
    assert r @ r.T == pytest.approx(np.eye(3))
    assert -r[2, 0] == pytest.approx(math.sin(angles[1]))
    assert math.atan2(r[1, 0], r[0, 0]) == pytest.approx(angles[2])
