"""Every line of the table of aerodynamic models on the wings of every vehicle, and motions to load them with."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.derivatives import Derivatives
from sim_bridge.aerodynamics.models import MODELS, loads
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Motion, SectionLoads, Strips, blank_loads
from sim_bridge.aerodynamics.regression import Regression
from sim_bridge.multibody.tree import Equations, assemble, move
from sim_bridge.multibody.wings import add_wings, wing_places
from sim_bridge.plant import Plant
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, with_model
from wingbeat.quaternions import quaternion_from_euler

NAMES = ("robo_raven_ii_d", "arizona_100cm")
DENSITY = 1.225
ALTITUDE = 500.0
"""m; nothing touches the ground"""
IDENTIFIED = Derivatives(
    forward=6.7, down=0.6, elevator=-0.02, force_x=0.9, force_z=-9.7,
    density=1.2, mass=0.36, center=(0.03, 0.0, -0.01), inertia=(0.009, 0.035, 0.043, 0.001),
    x_u=-0.2, x_w=0.4, x_q=0.1, x_delta=-0.3, z_u=-1.9, z_w=-6.0, z_q=-0.4, z_delta=-4.0,
    m_u=0.4, m_w=-5.0, m_q=-3.0, m_delta=-40.0, y_v=-0.6, y_p=0.1, y_r=0.2, y_rudder=1.5,
    l_v=-2.0, l_p=-12.0, l_r=2.0, l_rudder=-3.0, n_v=2.5, n_p=-0.5, n_r=-1.5, n_rudder=12.0,
    x_drive=2.0, z_drive=-1.0, m_drive=0.5, flap_rate=5.0, drive_lag=0.15,
)  # fmt: skip
"""of no vehicle, in the size of Robo Raven's"""
ELSEWHERE: dict[str, Any] = {"regression": Regression("time", 0.3, 0.25), "derivatives": IDENTIFIED}
"""settings of models that hold for none of the vehicles: of another aircraft, to keep the contract all the same"""
MIRROR = np.array([1.0, -1.0, 1.0])


class Case(NamedTuple):
    """A model with some of its settings changed."""

    model: str
    changes: dict[str, Any]

    def __str__(self) -> str:
        return " ".join((self.model, *(f"{key}={value}" for key, value in self.changes.items())))


CASES = [
    *(Case(name, {}) for name in MODELS),
    Case("strip_theory", {"wake_lag": 1.0}),
    Case("strip_theory", {"dynamic_stall": "fixed"}),
    Case("vortex_lattice", {"free_wake": True, "rate": 1000.0}),
]


def simulate(name: str, case: Case) -> SimulatedVehicle:
    """The vehicle with the model of ``case``."""
    bird = load_vehicle(name)
    sections = ELSEWHERE | bird.sections
    sections[case.model] = sections[case.model]._replace(**case.changes)
    return with_model(bird._replace(sections=sections), case.model)


@cache
def _plant(name: str, model: str, changes: tuple[tuple[str, Any], ...]) -> tuple[Plant, Floats]:
    """The plant, and its state in the hand."""
    plant = Plant(simulate(name, Case(model, dict(changes))))
    return plant, plant.y.copy()


def plant_of(name: str, case: Case) -> Plant:
    """The vehicle's plant in the launcher's hand; made once, shared by all tests."""
    plant, start = _plant(name, case.model, tuple(case.changes.items()))
    plant.y[:] = start
    # A model sets what it fills in and nothing else: what another test put there must not stay.
    plant.scratch.wings.loads.parts[:] = 0.0
    return plant


# --- states -----------------------------------------------------------------------------------------------------


def moving(
    plant: Plant, velocity: tuple[float, float, float], flap_rates: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """A state high above the ground: velocity in body axes, flap rates left and right; the air's memory at rest."""
    y = np.zeros_like(plant.y)
    y[2], y[3] = -ALTITUDE, 1.0
    y[7:10] = velocity
    for flap, rate in zip(plant.layout.flap, flap_rates, strict=True):
        y[flap], y[plant.layout.rate(flap)] = 0.2, rate
    y[plant.layout.aerodynamics :] = plant.mechanism.aerodynamic_state
    return y


def tumbling(plant: Plant, seed: int, speed: float = 7.0) -> Floats:
    """A random state without symmetry, flying forward at ``speed`` m/s."""
    rng = np.random.default_rng(seed)
    y = moving(plant, (speed, 0.0, 0.0))
    y[3:7] = quaternion_from_euler(*rng.uniform(-1.2, 1.2, 3))
    y[7:10] += rng.normal(size=3)
    y[10:13] = rng.normal(size=3) * 2.0
    for at, angle, rate in ((plant.layout.flap, 0.5, 8.0), (plant.layout.twist, 0.3, 8.0)):
        for place in at:
            y[place], y[plant.layout.rate(place)] = rng.normal() * angle, rng.normal() * rate
    for place in (plant.layout.elevator, plant.layout.rudder):
        y[place], y[plant.layout.rate(place)] = rng.uniform(-0.3, 0.3, 2)
    return y


STATES: dict[str, Callable[[Plant], Floats]] = {
    "at rest": lambda plant: moving(plant, (0.0, 0.0, 0.0)),
    "flapping in hover": lambda plant: moving(plant, (0.0, 0.0, 0.0), (15.0, 15.0)),
    "flapping down in hover": lambda plant: moving(plant, (0.0, 0.0, 0.0), (-15.0, -15.0)),
    "backwards": lambda plant: moving(plant, (-8.0, 0.0, 0.0), (6.0, -6.0)),
    "at 20 m/s": lambda plant: moving(plant, (20.0, 0.5, 2.0), (15.0, 12.0)),
    "falling flat": lambda plant: moving(plant, (0.0, 0.0, 10.0)),
    "sideways": lambda plant: moving(plant, (0.0, 6.0, 0.0)),
    "tumbling": lambda plant: tumbling(plant, 5),
}


def mirrored(plant: Plant, y: Floats) -> Floats:
    """The state, or its rates, seen in a mirror in the plane of symmetry, but for the air's memory."""
    m, layout = y.copy(), plant.layout
    across = [1, 4, 6, 8, 10, 12, layout.rudder, layout.rate(layout.rudder)]
    m[across] = -y[across]
    for left, right in (layout.flap, layout.twist):
        for a, b in ((left, right), (layout.rate(left), layout.rate(right))):
            m[a], m[b] = y[b], y[a]
    return m


def mirrored_strips(plant: Plant) -> Any:
    """For each strip the index of its mirror image."""
    n = int(plant.mechanism.wings.first[1])
    return np.concatenate((np.arange(n, 2 * n), np.arange(n)))


# --- loads ------------------------------------------------------------------------------------------------------


SLACK = k.Controls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.005, 0.0)


def air(wind: Any = (0.0, 0.0, 0.0), density: float = DENSITY, launcher: int = k.FREE) -> k.Surroundings:
    return k.Surroundings(*(float(part) for part in wind), density, launcher, 0.0, 0.0, 0.0)


def evaluated(plant: Plant, y: Floats, around: k.Surroundings | None = None) -> Floats:
    """Rates of the state with slack drives; what acted is left in the plant's scratch."""
    plant.y[:] = y
    return plant.evaluate(SLACK, around or air())


def motion_of(plant: Plant, y: Floats) -> Motion:
    """Of the wings in still air, places and axes of the strips too, whether or not the model needs them."""
    evaluated(plant, y)
    wing_places(plant.scratch.tree, plant.mechanism.wings, plant.scratch.wings)
    return Motion(*(column.copy() for column in plant.scratch.wings.motion))


def blank(plant: Plant) -> SectionLoads:
    """Loads of the plant's model, to be filled."""
    mechanism = plant.mechanism
    return blank_loads(len(mechanism.model.parts), mechanism.wings.strips, mechanism.aerodynamic_state.shape[0])


def loaded(plant: Plant, motion: Motion, density: float = DENSITY, state: Floats | None = None) -> SectionLoads:
    """What the plant's model makes of a motion."""
    out = blank(plant)
    memory = plant.mechanism.aerodynamic_state.copy() if state is None else state
    loads(plant.parameters.air, plant.mechanism.wings.strips, motion, density, memory, out)
    return out


def numbers(out: SectionLoads) -> Floats:
    """All of the loads in one row."""
    return np.concatenate([np.ravel(column) for column in out])


def near(result: Floats, target: Floats, rel: float, least: float) -> bool:
    """Whether each of many numbers is the wanted one within ``rel`` of it or ``least``: `approx` takes a while."""
    return bool(np.all(np.abs(result - target) <= np.maximum(rel * np.abs(target), least)))


def model_of_case(case: Case) -> AerodynamicModel:
    return MODELS[case.model]


def strips_of(plant: Plant) -> Strips:
    return plant.mechanism.wings.strips


def inertia_and_load(plant: Plant, parts: Floats) -> tuple[Floats, Floats]:
    """Mass matrix and load of tree, membrane, apparent mass and ``parts``, at the state that was evaluated last.

    Neither tail nor fuselage, joints nor drives: of the air there are the strips' loads alone.
    """
    s, p, c = plant.scratch, plant.parameters, len(plant.layout.coordinates)
    q, rates = plant.y[k.COORDINATES : k.COORDINATES + c], plant.y[k.COORDINATES + c : k.COORDINATES + 2 * c]
    mass, load = np.zeros_like(s.mass), np.zeros_like(s.load)
    s.wings.loads.parts[:] = parts
    move(p.tree, q, rates, s.base, s.outside[0:3], s.tree)
    add_wings(p.tree, s.tree, p.wings, s.wings, Equations(mass, load))
    assemble(p.tree, s.tree, mass, load)
    return np.triu(mass) + np.triu(mass, 1).T, load
