"""Kernel arguments of a vehicle file: tree, wings, joints and plates."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.models import find_model
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Strips, blank_loads, blank_motion
from sim_bridge.multibody.plates import Plates
from sim_bridge.multibody.tree import Tree, build_tree
from sim_bridge.multibody.wings import Wings, WingWork
from sim_bridge.vectors import Floats, Integers
from sim_bridge.vehicles import SimulatedVehicle, vehicle_bodies
from sim_bridge.vehicles.bodies import matrix_of, way_to_base
from sim_bridge.vehicles.sections import BodyPart, Wing
from wingbeat.errors import InputError

CHANNELS = {
    "right_wing": (k.WING, k.RIGHT),
    "left_wing": (k.WING, k.LEFT),
    "elevator": (k.FOLLOWS, k.ELEVATOR),
    "rudder": (k.FOLLOWS, k.RUDDER),
    "stroke": (k.PRESCRIBED, 0),
    "": (k.PASSIVE, 0),
}


class Layout(NamedTuple):
    """Indices into the plant's state vector; -1 for states that a vehicle lacks."""

    coordinates: tuple[str, ...]
    """names, in order: joints by their body, then the tip twists"""
    flap: tuple[int, int]
    """flap angle, left and right"""
    twist: tuple[int, int]
    """tip twist, left and right"""
    elevator: int
    rudder: int
    crank_phase: int
    crank_speed: int
    charge: int
    aerodynamics: int
    """where the aerodynamic model's state begins"""
    size: int

    def rate(self, coordinate: int) -> int:
        """Index of the rate of the coordinate at the index ``coordinate``."""
        return coordinate + len(self.coordinates)


class Mechanism(NamedTuple):
    """A vehicle as kernel arguments."""

    tree: Tree
    wings: Wings
    joints: k.Joints
    plates: Plates
    model: AerodynamicModel
    aerodynamics: Any
    """the model's parameters"""
    aerodynamic_state: Floats
    """(s,); of the model at rest"""
    layout: Layout


def chord_shape(planform: str, eta: float) -> float:
    """Chord over the maximum chord at the relative span ``eta`` (0 root, 1 tip).

    ``raven`` is Gerdes Eq. 1; ``ellipse`` an elliptic chord distribution.
    """
    if planform == "raven":
        return 1.0 if eta < 0.5 else 4.0 * eta * (1.0 - eta)
    return math.sqrt(max(1.0 - eta * eta, 0.0))


def wing_strips(wing: Wing) -> tuple[Strips, Floats]:
    """Strips of both wings and the membrane mass in kg of each, proportional to area."""
    width = 1.0 / wing.strips
    etas = [(i + 0.5) * width for i in range(wing.strips)]
    # A strip's chord is the mean over its width, so that the strips' areas add up to the planform's.
    fine = [(j + 0.5) / 40 - 0.5 for j in range(40)]
    shapes = np.array([sum(chord_shape(wing.planform, eta + f * width) for f in fine) / 40 for eta in etas])
    one = np.array(etas), shapes * wing.root_chord, np.full(wing.strips, width * wing.semispan)
    eta, chord, widths = (np.concatenate((column, column)) for column in one)
    index = np.repeat((0.0, 1.0), wing.strips)
    membrane = wing.membrane_mass * shapes / float(np.sum(shapes))
    return Strips(eta * wing.semispan, eta, chord, widths, index), np.concatenate((membrane, membrane))


def all_parts(vehicle: SimulatedVehicle) -> dict[str, BodyPart]:
    """Bodies of a vehicle including the mirrored ones.

    Raises:
        InputError: see `sim_bridge.vehicles.bodies.completed`.
    """
    return vehicle_bodies(vehicle)[0]


def build_mechanism(vehicle: SimulatedVehicle) -> Mechanism:
    """Build the mechanism of a vehicle.

    Raises:
        InputError: the bodies make no tree, or the aerodynamic model does not hold.
    """
    parts, bodies = vehicle_bodies(vehicle)
    tree, names = build_tree(bodies)
    order = {body.name: i for i, body in enumerate(bodies)}
    joints = [parts[name] for name in names]
    wings, coordinates = _wings(vehicle.wing, tree, order, names)
    strips, model = wings.strips, find_model(vehicle.aerodynamics.model)
    try:
        parameters = model.build(vehicle.sections[model.name], strips)
    except InputError as error:
        raise InputError(f"{vehicle.path}: {error}") from None
    state = model.initial(parameters, strips)
    return Mechanism(
        tree,
        wings,
        _joints(vehicle.wing, joints, len(coordinates)),
        _plates(vehicle, order),
        model,
        parameters,
        state,
        _layout(coordinates, joints, wings, state.shape[0]),
    )


def wing_work(mechanism: Mechanism) -> WingWork:
    """Allocate the workspace of the wing kernels."""
    strips, n = mechanism.wings.strips, mechanism.wings.strips.chord.shape[0]
    return WingWork(
        motion=blank_motion(strips, 2),
        loads=blank_loads(len(mechanism.model.parts), strips, mechanism.aerodynamic_state.shape[0]),
        total=np.zeros((4, n)),
        sine=np.zeros(n),
        cosine=np.zeros(n),
        frame=np.zeros((2, 5, 6)),
        twist_rate=np.zeros(2),
        inertia=np.zeros((6, 6)),
        wrench=np.zeros((2, 6)),
        column=np.zeros(6),
    )


def _joints(wing: Wing, parts: list[BodyPart], coordinates: int) -> k.Joints:
    twists = coordinates - len(parts)
    kinds = [CHANNELS[part.moved_by] for part in parts] + [CHANNELS[""]] * twists
    return k.Joints(
        kind=np.array([kind for kind, _ in kinds], dtype=np.int64),
        channel=np.array([channel for _, channel in kinds], dtype=np.int64),
        stiffness=np.array([part.stiffness for part in parts] + [wing.twist_stiffness] * twists),
        damping=np.array([part.damping for part in parts] + [wing.twist_damping] * twists),
        motion=_motions([part.motion for part in parts] + [()] * twists),
        steered=np.array(
            [(part.motion_by_elevator, part.motion_by_rudder) for part in parts] + [(0.0, 0.0)] * twists
        ).reshape(-1, 2),
    )


def _motions(series: list[tuple[float, ...]]) -> Floats:
    """The prescribed motions, filled up with harmonics of no amplitude."""
    out = np.zeros((len(series), max([1, *(len(one) for one in series)])))
    for row, one in zip(out, series, strict=True):
        row[: len(one)] = one
    return out


def _wings(wing: Wing, tree: Tree, order: dict[str, int], names: list[str]) -> tuple[Wings, tuple[str, ...]]:
    strips, membrane = wing_strips(wing)
    bodies = np.array([order[wing.left], order[wing.right]], dtype=np.int64)
    twist: Integers = np.array([-1, -1], dtype=np.int64)
    coordinates = list(names)
    if wing.twists:
        twist = np.array([len(names), len(names) + 1], dtype=np.int64)
        coordinates += [f"{wing.left}.twist", f"{wing.right}.twist"]
    built = Wings(
        strips=strips,
        body=bodies,
        twist=twist,
        flap=np.array([_first_joint(tree, int(body)) for body in bodies], dtype=np.int64),
        first=np.array([0, wing.strips, 2 * wing.strips], dtype=np.uint64),
        side=np.array([-1.0, 1.0]),
        washout=np.array([wing.washout, wing.washout]),
        membrane=membrane,
    )
    return built, tuple(coordinates)


def _first_joint(tree: Tree, body: int) -> int:
    """The coordinate nearest to the base on the way to ``body``; -1 where nothing moves."""
    found = -1
    while body > 0:
        if tree.coordinate[body] >= 0:
            found = int(tree.coordinate[body])
        body = int(tree.parent[body])
    return found


def _plates(vehicle: SimulatedVehicle, order: dict[str, int]) -> Plates:
    plates = list(vehicle.plates.values())
    normals = np.array([plate.normal for plate in plates], dtype=np.float64).reshape(-1, 3)
    return Plates(
        body=np.array([order[plate.body] for plate in plates], dtype=np.int64),
        place=np.array([plate.place for plate in plates], dtype=np.float64).reshape(-1, 3),
        chord=np.tile((1.0, 0.0, 0.0), (len(plates), 1)),
        normal=normals / np.linalg.norm(normals, axis=1, keepdims=True) if plates else normals,
        area=np.array([plate.area for plate in plates], dtype=np.float64),
        lift_slope=np.array([plate.lift_slope for plate in plates], dtype=np.float64),
    )


def _layout(coordinates: tuple[str, ...], joints: list[BodyPart], wings: Wings, states: int) -> Layout:
    n = len(coordinates)
    first = k.COORDINATES + 2 * n

    def moved_by(channel: str) -> int:
        return next((k.COORDINATES + i for i, part in enumerate(joints) if part.moved_by == channel), -1)

    def place(coordinate: int) -> int:
        return k.COORDINATES + coordinate if coordinate >= 0 else -1

    return Layout(
        coordinates=coordinates,
        flap=(place(int(wings.flap[0])), place(int(wings.flap[1]))),
        twist=(place(int(wings.twist[0])), place(int(wings.twist[1]))),
        elevator=moved_by("elevator"),
        rudder=moved_by("rudder"),
        crank_phase=first,
        crank_speed=first + 1,
        charge=first + 2,
        aerodynamics=first + 3,
        size=first + 3 + states,
    )


def place_of(
    vehicle: SimulatedVehicle, body: str, point: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[float, float, float]:
    """Position in m of a ``point`` of a body in the base's axes, all joints at zero."""
    parts = all_parts(vehicle)
    place = np.array(point)
    for name in way_to_base(parts, body):
        place = np.array(parts[name].place) + matrix_of(parts[name].rotation) @ place
    x, y, z = place.tolist()
    return x, y, z


def total_mass(vehicle: SimulatedVehicle) -> float:
    """Total mass in kg."""
    return sum(part.mass for part in all_parts(vehicle).values()) + 2.0 * vehicle.wing.membrane_mass
