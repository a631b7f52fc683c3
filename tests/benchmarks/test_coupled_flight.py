"""Coupled flight a simulated second: ours beside MuJoCo's step and PteraSoftware's free flight (``make bench``).

Ours computes bodies, joints, drives, contact and the air on strips of the wings. MuJoCo is given bodies and joints
alone: no air, no drives, no membranes. PteraSoftware computes a vortex lattice with its wake around a pair of wings
that beat as told, and one rigid body; its steps are longer.
"""

from __future__ import annotations

import itertools
import math
import time
from functools import cache

import numpy as np
import pytest
from rows import Row, leave, peer

from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant
from sim_bridge.plant_kernel import STEP
from sim_bridge.vehicles import load_vehicle
from wingbeat.constants import STANDARD_GRAVITY

VEHICLE = "robo_raven_ii_d"
SECONDS, ROUNDS = 2.0, 8
FREQUENCY, AMPLITUDE, AIRSPEED = 4.0, 0.4, 7.0
"""Hz, rad, m/s"""
SEMISPAN, ROOT_CHORD, TIP_CHORD, MASS = 0.762, 0.432, 0.1, 0.359
"""m, m, m, kg; Robo Raven's, and a tip that the lattice can be made for"""
PANELS, STEPS_A_BEAT, LATTICE_SECONDS = (2, 4), 30, 0.5
"""along the chord and across a wing; -; s"""


@cache
def computed() -> float:
    """Processor time of a simulated second, the least of some rounds."""
    plant = Plant(load_vehicle(VEHICLE))
    start, around = plant.y.copy(), k.Surroundings(0.0, 0.0, 0.0, 1.225, k.FREE, 0.0, 0.0, 0.0)
    start[2], start[7] = -500.0, AIRSPEED
    count = round(200 * SECONDS)
    angles = [0.2 + AMPLITUDE * math.sin(2.0 * math.pi * FREQUENCY * tick / 200.0) for tick in range(count + 1)]
    ticks = [k.Controls(a, b, a, b, 0.5, 0.0, 0.0, 0.005, 1.0) for a, b in itertools.pairwise(angles)]
    plant.follow(ticks[:1], around)
    spent = []
    for _ in range(ROUNDS):
        plant.y[:] = start
        begun = time.process_time()
        plant.follow(ticks, around)
        spent.append(time.process_time() - begun)
    assert np.all(np.isfinite(plant.y))
    return min(spent) / SECONDS


@pytest.mark.bench
def test_beside_the_step_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco", reason="the package mujoco is not installed (extra `dev`)")
    from mujoco_bench import Engine

    p = Plant(load_vehicle(VEHICLE)).parameters
    engine = Engine(p.tree, p.joints.stiffness, p.joints.damping)
    engine.compile()
    engine.model.opt.timestep, engine.model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    spent = []
    for _ in range(ROUNDS):
        mujoco.mj_resetData(engine.model, engine.data)
        engine.data.qvel[0], engine.data.qvel[6:] = AIRSPEED, 1.0
        begun = time.process_time()
        for _ in range(round(SECONDS / STEP)):
            mujoco.mj_step(engine.model, engine.data)
        spent.append(time.process_time() - begun)
    fallen, expected = float(engine.data.qpos[2]), 0.5 * STANDARD_GRAVITY * SECONDS**2
    assert fallen == pytest.approx(expected, rel=0.1), "gravity acts along its z, and nothing else"
    told = f"{peer('mujoco')}, RK4 at the same step, {engine.model.nv} speeds, without air"
    leave(Row("coupled flight, strip theory, 1 kHz", 1.0 / computed(), SECONDS / min(spent), "times real time", told))


@pytest.mark.bench
def test_beside_the_free_flight_of_pterasoftware() -> None:
    ps = pytest.importorskip("pterasoftware", reason="the package pterasoftware is not installed (extra `bench`)")
    lattice(ps, 4)
    steps = round(LATTICE_SECONDS * FREQUENCY * STEPS_A_BEAT)
    begun = time.process_time()
    flown = lattice(ps, steps)
    spent = (time.process_time() - begun) / LATTICE_SECONDS
    assert np.all(np.isfinite(flown))
    told = (
        f"{peer('pterasoftware')}, free flight, {PANELS[0]} x {PANELS[1]} panels a wing, {STEPS_A_BEAT} steps a beat"
    )
    leave(Row("coupled flight, strip theory, 1 kHz", 1.0 / computed(), 1.0 / spent, "times real time", told))


def lattice(ps: object, steps: int) -> np.ndarray:
    """Fly the pair of wings so many steps, a beat's wake behind it; where it comes to, in m."""
    from flapping_pair import Flapping, Section, movement
    from pterasoftware.free_flight_unsteady_ring_vortex_lattice_method import (
        FreeFlightUnsteadyRingVortexLatticeMethodSolver as Solver,
    )
    from pterasoftware.movements.free_flight_movement import FreeFlightMovement
    from pterasoftware.movements.free_flight_operating_point_movement import FreeFlightOperatingPointMovement
    from pterasoftware.operating_point import OperatingPoint
    from pterasoftware.problems import FreeFlightUnsteadyProblem

    across = np.linspace(0.0, 1.0, PANELS[1] + 1)
    sections = [Section(SEMISPAN * s, 0.0, ROOT_CHORD + s * (TIP_CHORD - ROOT_CHORD)) for s in across.tolist()]
    beat = Flapping(0.0, AMPLITUDE, 1.0 / FREQUENCY)
    start = OperatingPoint(vCg__E=AIRSPEED, alpha=8.0, g_E=(0.0, 0.0, STANDARD_GRAVITY))
    flight = FreeFlightMovement(
        [movement(sections, beat, PANELS[0], MASS * STANDARD_GRAVITY)], FreeFlightOperatingPointMovement(start),
        1.0 / FREQUENCY / STEPS_A_BEAT, prescribed_num_steps=2, free_num_steps=steps, max_wake_rows=STEPS_A_BEAT,
    )  # fmt: skip
    problem = FreeFlightUnsteadyProblem(flight, MASS, np.diag([0.02, 0.01, 0.03]))
    Solver(problem).run(calculate_streamlines=False, show_progress=False)
    return np.array(flight.operating_point_movement.operating_points[-1].CgP1_E_Eo)
