"""The lattice in the plant: what it keeps, how it follows its own steady and refined solutions, light wings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from avionics.quantities import BadInput
from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.vortex_lattice.geometry import lattice_of
from sim_bridge.aerodynamics.vortex_lattice.settings import VortexLatticeParameters
from sim_bridge.aerodynamics.vortex_lattice.shedding import move_pose, wake_of
from sim_bridge.aerodynamics.vortex_lattice.steady import solve_steady
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, with_model

SPEED, TICK = 6.8, 0.005
AROUND = k.Surroundings(0.0, 0.0, 0.0, 1.225, k.HELD, 0.0, 0.0, 0.0)


def raven(**changes: Any) -> SimulatedVehicle:
    bird = load_vehicle("robo_raven_ii_d")
    sections = dict(bird.sections)
    sections["vortex_lattice"] = sections["vortex_lattice"]._replace(**changes)
    return with_model(bird._replace(sections=sections), "vortex_lattice")


def held(plant: Plant, alpha: float, flapping: float, seconds: float) -> Floats:
    """(ticks, 6) air loads of a plant that the launcher holds in the stream, its wings flapping by so many rad."""
    y = plant.y
    y[2], y[3:7] = -100.0, (math.cos(alpha / 2), 0.0, math.sin(alpha / 2), 0.0)
    y[7], y[9] = SPEED * math.cos(alpha), SPEED * math.sin(alpha)
    loads = []
    for tick in range(round(seconds / TICK)):
        start, end = (0.2 + flapping * math.sin(8.0 * math.pi * TICK * (tick + i)) for i in (0, 1))
        plant.advance(k.Controls(start, end, start, end, 0.0, 0.0, 0.0, TICK, 1.0), AROUND)
        loads.append(plant.air_load())
    return np.array(loads)


def parameters_of(plant: Plant) -> VortexLatticeParameters:
    parameters: VortexLatticeParameters = plant.mechanism.aerodynamics
    return parameters


def test_a_long_glide_ends_with_the_loads_of_the_steady_lattice() -> None:
    """Nearly: a strip's legs across alone bear loads, and the lattice's shape is the last step's."""
    alpha = 0.1
    plant = Plant(raven(correction=0.0, wake_rows=80))
    held(plant, alpha, 0.0, 1.5)
    p, parts, grids = parameters_of(plant), plant.part_loads(), {}
    for s, name in enumerate(("wing", "tailplane", "fin")):
        rows, columns, first = (int(column[s]) for column in (p.layout.rows, p.layout.columns, p.layout.first_node))
        nodes = p.room.nodes[:, first : first + (rows + 1) * (columns + 1)]
        grids[name] = nodes.T.reshape(rows + 1, columns + 1, 3).copy()
    wind = -SPEED * np.array([math.cos(alpha), 0.0, math.sin(alpha)])
    steady, wing = solve_steady(lattice_of(grids), wind, 1.225).loads.force, int(p.layout.first_panel[1])
    assert parts[:4, 2].sum() == pytest.approx(steady[2, :wing].sum(), rel=0.04)
    assert parts[:4, 0].sum() == pytest.approx(steady[0, :wing].sum(), abs=0.02 * abs(steady[2, :wing].sum()))
    assert parts[4, 2] == pytest.approx(steady[2, wing:].sum(), rel=0.1)


def test_a_stroke_hardly_depends_on_the_lattices_rate() -> None:
    slow, quick = (held(Plant(raven(rate=rate)), 0.05, 0.3, 0.75)[-50:] for rate in (200.0, 400.0))
    assert np.max(np.abs(quick - slow)[:, 2]) < 0.05 * np.ptp(quick[:, 2])
    assert slow.mean(axis=0)[[0, 2]] == pytest.approx(quick.mean(axis=0)[[0, 2]], rel=0.03)


def test_the_memory_is_as_long_after_a_flight_as_before() -> None:
    plant = Plant(raven(wake_rows=10))
    size, y = plant.layout.size, plant.y
    held(plant, 0.05, 0.3, 0.5)
    assert plant.y is y and len(y) == size
    memory, p = y[plant.layout.aerodynamics :], parameters_of(plant)
    wake = wake_of.py_func(p, memory)  # type: ignore[attr-defined]
    assert int(wake.rows[0]) == 10 and np.all(np.isfinite(memory))
    assert np.any(wake.far != 0.0)


def test_membranes_without_weight_stay_stable() -> None:
    """Their air is heavier than they are."""
    bird = raven()
    light = bird._replace(wing=bird.wing._replace(membrane_mass=1e-5))
    loads = held(Plant(light), 0.1, 0.3, 0.5)
    assert np.all(np.isfinite(loads)) and np.max(np.abs(loads)) < 40.0


def test_a_free_wake_flies_too_and_is_another() -> None:
    free, fixed = (held(Plant(raven(free_wake=free, wake_rows=12)), 0.1, 0.3, 0.4) for free in (True, False))
    assert np.all(np.isfinite(free))
    assert 1e-4 < np.max(np.abs(free - fixed)) < 0.3 * np.max(np.abs(fixed))


def test_the_correction_takes_suction_and_adds_friction() -> None:
    ideal, real = (held(Plant(raven(correction=share)), 0.05, 0.0, 0.3)[-1] for share in (0.0, 1.0))
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
    with pytest.raises(BadInput, match=r'vortex_lattice.dynamic_stall = "none" is unknown; it is fixed or kim$'):
        Plant(raven(dynamic_stall="none"))
