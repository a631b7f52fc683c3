"""Equations of motion against an independent engine, MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
from mujoco_bench import Engine, Motion, random_motion, random_tree, tree_equations
from plant_bench import MECHANISMS, air, freed, joint_rates, joints, rates, slack, speeds, state, vehicle
from scipy.spatial.transform import Rotation

from sim_bridge.multibody.tree import BASE, Tree, impose, solve
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats


class Case:
    """A random tree in a random motion, some of its joints sprung and damped, here and in MuJoCo."""

    def __init__(self, seed: int, chain: bool) -> None:
        self.rng = np.random.default_rng(seed)
        self.tree: Tree = random_tree(self.rng, chain)
        n = int(np.max(self.tree.coordinate)) + 1
        sprung = self.rng.random(n) < 0.5
        self.stiffness, self.damping = sprung * self.rng.uniform(0.0, 5.0, n), sprung * self.rng.uniform(0.0, 0.05, n)
        self.engine = Engine(self.tree, self.stiffness, self.damping)
        self.engine.compile()
        self.motion: Motion = random_motion(self.rng, n)

    def equations(self) -> tuple[Floats, Floats]:
        return tree_equations(self.tree, self.motion, self.stiffness, self.damping)

    def accelerations(self) -> Floats:
        mass, load = self.equations()
        solve(mass, load)
        return load


def assert_same(computed: Floats, reference: Floats) -> None:
    assert np.all(np.isfinite(reference))
    assert computed == pytest.approx(reference, rel=1e-6, abs=1e-9 * np.max(np.abs(reference)))


@pytest.mark.parametrize("chain", [False, True])
@pytest.mark.parametrize("seed", range(40))
def test_random_trees_accelerate_as_in_mujoco(seed: int, chain: bool) -> None:
    case = Case(seed, chain)
    assert_same(case.accelerations(), case.engine.forward(case.motion))


def whole(plant: Plant) -> Engine:
    """A vehicle in MuJoCo: its tree, and every strip of membrane a particle of its own on a hinge of its own."""
    p = plant.parameters
    engine = Engine(p.tree, p.joints.stiffness, p.joints.damping)
    strips, wings = p.wings.strips, p.wings
    for i in range(strips.chord.shape[0]):
        j = int(strips.wing[i])
        place = (0.0, wings.side[j] * strips.span[i], 0.0)
        tie = (int(wings.twist[j]), strips.eta[i], strips.eta[i] * wings.washout[j])
        engine.add_follower(int(wings.body[j]), place, (-0.5 * strips.chord[i], 0.0, 0.0), wings.membrane[i], tie)
    engine.compile()
    return engine


@pytest.mark.parametrize("name", MECHANISMS)
@pytest.mark.parametrize("seed", range(10))
def test_whole_vehicles_accelerate_as_in_mujoco(name: str, seed: int) -> None:
    plant = freed(Plant(vehicle(name)))
    y = state(plant, np.random.default_rng(seed))
    computed = rates(plant, y, slack(), air(0.0))[speeds(plant)]
    attitude = Rotation.from_quat(np.roll(y[3:7], -1)).as_matrix()
    # The membrane's springs are of the tied coordinates, which MuJoCo does not know.
    joint = plant.parameters.joints.stiffness * y[joints(plant)]
    joint[: len(plant.vehicle.bodies) - 1] = 0.0
    motion = Motion(attitude, y[7:13], y[joints(plant)], y[joint_rates(plant)], -joint)
    assert_same(computed, whole(plant).accelerations(motion))


@pytest.mark.parametrize("seed", range(12))
def test_imposed_joints_move_as_told_and_take_the_torque_that_mujoco_says(seed: int) -> None:
    case = Case(seed, chain=seed % 2 == 0)
    mass, load = case.equations()
    held = (case.rng.random(load.shape[0]) < 0.5).astype(np.int64)
    held[:BASE], held[-1] = 0, 1
    imposed = case.rng.normal(size=load.shape[0]) * 20.0
    impose(mass, load, held, imposed)
    solve(mass, load)
    assert load[held == 1].tolist() == imposed[held == 1].tolist()
    taken = case.engine.inverse(case.motion, load)[BASE:]
    given, joint = case.motion.torque, held[BASE:] == 1
    scale = np.max(np.abs(taken))
    assert taken[~joint] == pytest.approx(given[~joint], abs=1e-9 * scale)
    # The same torques on free joints give the motion that was imposed.
    case.motion = case.motion._replace(torque=np.where(joint, taken, given))
    assert_same(case.accelerations(), load)
