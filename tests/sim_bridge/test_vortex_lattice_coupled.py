"""The lattice in the plant: what it keeps, how it follows its own steady and refined solutions, light wings."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from aerodynamics_bench import SLACK

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.vortex_lattice.geometry import lattice_of
from sim_bridge.aerodynamics.vortex_lattice.settings import VortexLatticeParameters
from sim_bridge.aerodynamics.vortex_lattice.shedding import move_pose, wake_of
from sim_bridge.aerodynamics.vortex_lattice.steady import SteadyFlow, solve_steady
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, with_model
from wingbeat.errors import InputError

SPEED, TICK = 6.8, 0.005
AROUND = k.Surroundings(0.0, 0.0, 0.0, 1.225, k.HELD, 0.0, 0.0, 0.0)


def raven(**changes: Any) -> SimulatedVehicle:
    bird = load_vehicle("robo_raven_ii_d")
    sections = dict(bird.sections)
    sections["vortex_lattice"] = sections["vortex_lattice"]._replace(**changes)
    return with_model(bird._replace(sections=sections), "vortex_lattice")


def stream(plant: Plant, alpha: float, beta: float = 0.0, height: float = 100.0) -> Floats:
    """Put a plant into a level stream; returns its velocity (3,) m/s, body axes."""
    y = plant.y
    y[2], y[3:7] = -height, (math.cos(alpha / 2), 0.0, math.sin(alpha / 2), 0.0)
    ahead = SPEED * math.cos(beta)
    y[7:10] = ahead * math.cos(alpha), SPEED * math.sin(beta), ahead * math.sin(alpha)
    return y[7:10].copy()


def constant(plant: Plant, alpha: float, flapping: float, seconds: float) -> Floats:
    """(ticks, 6) air loads of a plant that the launcher holds in the stream, its wings flapping by so many rad."""
    stream(plant, alpha)
    return stationary(plant, flapping, seconds)


def stationary(plant: Plant, flapping: float, seconds: float) -> Floats:
    """(ticks, 6) of a plant that is in a stream already."""
    loads = []
    for tick in range(round(seconds / TICK)):
        start, end = (0.2 + flapping * math.sin(8.0 * math.pi * TICK * (tick + i)) for i in (0, 1))
        plant.advance(k.Controls(start, end, start, end, 0.0, 0.0, 0.0, TICK, 1.0), AROUND)
        loads.append(plant.air_load())
    return np.array(loads)


def parameters_of(plant: Plant) -> VortexLatticeParameters:
    parameters: VortexLatticeParameters = plant.mechanism.aerodynamics
    return parameters


def surfaces_of(plant: Plant) -> dict[str, Floats]:
    """Nodes of the lattice at its last step, body axes."""
    p, grids = parameters_of(plant), {}
    for s, name in enumerate(("wing", "tailplane", "fin")):
        rows, columns, first = (int(column[s]) for column in (p.layout.rows, p.layout.columns, p.layout.first_node))
        nodes = p.workspace.nodes[:, first : first + (rows + 1) * (columns + 1)]
        grids[name] = nodes.T.reshape(rows + 1, columns + 1, 3).copy()
    return grids


def wing_and_tail(flow: SteadyFlow, plant: Plant) -> tuple[Floats, Floats]:
    """(6,) N, N m each."""
    wing = int(parameters_of(plant).layout.first_panel[1])
    both = np.concatenate((flow.loads.force, flow.loads.moment))
    return both[:, :wing].sum(axis=1), both[:, wing:].sum(axis=1)


def glide(beta: float = 0.0, height: float = 100.0) -> tuple[Plant, Floats, Floats]:
    """A plant after a long glide at 0.1 rad in an ideal flow, loads of its wings, and of its tail."""
    plant = Plant(raven(correction=0.0, wake_rows=60))
    stream(plant, 0.1, beta, height)
    stationary(plant, 0.0, 1.0)
    parts = plant.part_loads()
    return plant, parts[:4].sum(axis=0), parts[4]


def impulsive_start() -> dict[str, Any]:
    """Loads of three ticks from an impulsive start without correction, and those of the steady lattice."""
    plant = Plant(raven(correction=0.0))
    stream(plant, 0.1)
    loads = stationary(plant, 0.0, 3.0 * TICK)
    steady = solve_steady(lattice_of(surfaces_of(plant)), -plant.y[7:10], 1.225)
    rows = wake_of(parameters_of(plant), plant.y[plant.layout.aerodynamics :]).rows[0]
    return {
        "loads": loads.tolist(),
        "parts": plant.part_loads().sum(axis=0).tolist(),
        "steady_lift": float(sum(wing_and_tail(steady, plant))[2]),
        "rows": int(rows),
    }


def test_impulsive_start_is_symmetric_with_part_of_the_steady_lift() -> None:
    """Interpreted, in a process without the compiler: compiled, the lattice takes half a minute."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    code = f"import sys; sys.path[:0] = {paths!r}; import json, {Path(__file__).stem} as t; "
    code += "print(json.dumps(t.impulsive_start()))"
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert answer.returncode == 0, answer.stderr
    start = json.loads(answer.stdout)
    loads, steady = np.array(start["loads"]), start["steady_lift"]
    assert start["rows"] == len(loads) == 3
    assert start["parts"] == pytest.approx(loads[-1], abs=1e-12 * abs(steady))
    assert np.max(np.abs(loads[:, [1, 3, 5]])) < 1e-12 * abs(steady)
    # Half of the steady lift, by Wagner, of a rigid wing; the membranes oscillate about it.
    assert np.all((loads[:, 2] / steady > 0.25) & (loads[:, 2] / steady < 1.0))


@pytest.mark.validate
def test_a_long_glide_ends_with_the_loads_of_the_steady_lattice() -> None:
    """Force and moment of wings and tail; in a stream from the side the legs along bear a rolling moment."""
    for beta in (0.0, 0.15):
        plant, wing, tail = glide(beta)
        steady = solve_steady(lattice_of(surfaces_of(plant)), -plant.y[7:10], 1.225)
        steady_wing, steady_tail = wing_and_tail(steady, plant)
        lift = abs(steady_wing[2])
        assert wing[2] == pytest.approx(steady_wing[2], rel=0.01)
        assert wing[:2] == pytest.approx(steady_wing[:2], abs=0.005 * lift)
        assert wing[3:] == pytest.approx(steady_wing[3:], abs=0.0025 * lift)
        assert tail[2] == pytest.approx(steady_tail[2], rel=0.02)
        assert tail[[0, 1]] == pytest.approx(steady_tail[[0, 1]], abs=0.02 * abs(steady_tail[2]))
        assert tail[3:] == pytest.approx(steady_tail[3:], abs=0.02 * abs(steady_tail[4]))


@pytest.mark.validate
def test_the_ground_carries_as_in_the_steady_lattice_and_only_from_near_by() -> None:
    """A quarter of the span above it; a wing that would lie in it, or far from it, has loads all the same."""
    height = 0.3
    free, near = (glide(height=h)[1] for h in (100.0, height))
    plant = glide(height=height)[0]
    c, s = math.cos(0.1), math.sin(0.1)
    upright = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    grids = {name: grid @ upright.T for name, grid in surfaces_of(plant).items()}
    steady = solve_steady(lattice_of(grids), -upright @ plant.y[7:10], 1.225, ground=height)
    wing, _ = wing_and_tail(steady, plant)
    assert upright.T @ wing[:3] == pytest.approx(near[:3], abs=0.015 * abs(near[2]))
    # The membranes give way: they twist by more than the free ones, and take half of the gain.
    assert near[2] < 1.02 * free[2]
    alone, _ = wing_and_tail(solve_steady(lattice_of(grids), -upright @ plant.y[7:10], 1.225), plant)
    assert (upright @ near[:3])[2] < 1.04 * alone[2]
    reach = parameters_of(plant).ground_reach
    below, above = (glide(height=h)[1] for h in (0.99 * reach, 1.01 * reach))
    assert below == pytest.approx(above, abs=1e-3 * abs(above[2]))
    assert np.all(np.isfinite(glide(height=0.0)[1]))


@pytest.mark.validate
def test_an_elevator_that_moves_meets_the_air_of_its_own_motion() -> None:
    """Upwards behind its hinge: between a half, as at a start, and all of what the angle at 3/4 chord takes in time.

    Of a tailplane of aspect ratio 2, whose lift slope is pi.
    """
    plant = glide()[0]
    p, rate = parameters_of(plant), 2.0
    lifts = []
    for moving in (0.0, rate):
        plant.y[plant.layout.rate(plant.layout.elevator)] = moving
        plant.evaluate(SLACK, AROUND)
        lifts.append(-plant.part_loads()[4, 2])
    angle = 0.5 * p.tail.chord * rate / SPEED
    slope = math.pi * 0.5 * 1.225 * SPEED**2 * p.tail.span * p.tail.chord
    assert -slope * angle < lifts[1] - lifts[0] < -0.5 * slope * angle


@pytest.mark.validate
def test_a_stroke_hardly_depends_on_the_lattices_rate() -> None:
    slow, quick = (constant(Plant(raven(rate=rate)), 0.05, 0.3, 0.75)[-50:] for rate in (200.0, 400.0))
    assert np.max(np.abs(quick - slow)[:, 2]) < 0.05 * np.ptp(quick[:, 2])
    assert slow.mean(axis=0)[[0, 2]] == pytest.approx(quick.mean(axis=0)[[0, 2]], rel=0.03)


@pytest.mark.validate
def test_the_memory_is_as_long_after_a_flight_as_before() -> None:
    plant = Plant(raven(wake_rows=10))
    size, y = plant.layout.size, plant.y
    constant(plant, 0.05, 0.3, 0.5)
    assert plant.y is y and len(y) == size
    memory, p = y[plant.layout.aerodynamics :], parameters_of(plant)
    wake = wake_of.py_func(p, memory)  # type: ignore[attr-defined]
    assert int(wake.rows[0]) == 10 and np.all(np.isfinite(memory))
    assert np.any(wake.far != 0.0)


@pytest.mark.validate
def test_membranes_without_weight_stay_stable() -> None:
    """Their air is heavier than they are."""
    bird = raven()
    light = bird._replace(wing=bird.wing._replace(membrane_mass=1e-5))
    loads = constant(Plant(light), 0.1, 0.3, 0.5)
    assert np.all(np.isfinite(loads)) and np.max(np.abs(loads)) < 40.0


@pytest.mark.validate
def test_a_free_wake_flies_too_and_is_another() -> None:
    free, fixed = (constant(Plant(raven(free_wake=free, wake_rows=12)), 0.1, 0.3, 0.4) for free in (True, False))
    assert np.all(np.isfinite(free))
    assert 1e-4 < np.max(np.abs(free - fixed)) < 0.3 * np.max(np.abs(fixed))


@pytest.mark.validate
def test_the_correction_takes_suction_and_adds_friction() -> None:
    ideal, real = (constant(Plant(raven(correction=share)), 0.05, 0.0, 0.3)[-1] for share in (0.0, 1.0))
    assert real[0] < ideal[0] - 0.05
    assert real[2] == pytest.approx(ideal[2], rel=0.02)


def test_the_pose_of_a_circle_is_the_circle() -> None:
    """A body that flies and turns steadily: its way is an arc."""
    pose, body, dt, steps = np.zeros(7), np.array([5.0, 0.0, 0.0, 0.0, 0.0, 2.0]), 1e-3, 400
    pose[3] = 1.0
    for _ in range(steps):
        move_pose(body, pose, dt)
    turned = 2.0 * dt * steps
    assert pose[:3] == pytest.approx([2.5 * math.sin(turned), 2.5 * (1.0 - math.cos(turned)), 0.0], abs=1e-5)
    assert pose[3:] == pytest.approx([math.cos(turned / 2), 0.0, 0.0, math.sin(turned / 2)], abs=1e-6)


def test_an_unknown_stall_is_refused() -> None:
    with pytest.raises(InputError, match=r'vortex_lattice.dynamic_stall = "none" is unknown; it is fixed or kim$'):
        Plant(raven(dynamic_stall="none"))


def test_a_fin_through_the_tailplane_is_refused_with_the_place() -> None:
    with pytest.raises(
        InputError, match=r'robo_raven_ii_d.*surface ".*" crosses ".*" at \(-0\.\d+, 0, [-0-9.e]+\) m$'
    ):
        Plant(raven(fin_place=(-0.42, 0.0, 0.05)))


@pytest.mark.validate
def test_a_fin_beside_the_tailplane_is_accepted() -> None:
    assert parameters_of(Plant(raven(fin_place=(-0.42, 0.3, 0.05)))).tail.fin_y == 0.3
