"""From a vehicle file to what the multibody kernels take: tree, wings, joints and plates."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge import plant_kernel as k
from sim_bridge.aerodynamics.models import find_model
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Strips, blank_loads, blank_motion
from sim_bridge.multibody.plates import Plates
from sim_bridge.multibody.tree import Body, Tree, build_tree, inertia_matrix, parents_first
from sim_bridge.multibody.wings import Wings, WingWork
from sim_bridge.vectors import Floats, Integers, quaternion_from_euler, rotation
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles.sections import BodyPart, Wing

CHANNELS = {
    "right_wing": (k.WING, k.RIGHT),
    "left_wing": (k.WING, k.LEFT),
    "elevator": (k.FOLLOWS, k.ELEVATOR),
    "rudder": (k.FOLLOWS, k.RUDDER),
    "stroke": (k.PRESCRIBED, 0),
    "": (k.PASSIVE, 0),
}
MIRRORED = {"right_wing": "left_wing"}


class Layout(NamedTuple):
    """Where in the plant's state vector things are; -1 for what a vehicle has not."""

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
    """A vehicle as the kernels take it."""

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
    """Chord over the greatest chord at the relative span ``eta`` (0 root, 1 tip).

    ``raven`` is Gerdes Eq. 1; ``ellipse`` an elliptic chord distribution.
    """
    if planform == "raven":
        return 1.0 if eta < 0.5 else 4.0 * eta * (1.0 - eta)
    return math.sqrt(max(1.0 - eta * eta, 0.0))


def wing_strips(wing: Wing) -> tuple[Strips, Floats]:
    """Strips of both wings, and the membrane's mass in kg at each, in proportion to area."""
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


def matrix_of(angles: tuple[float, float, float]) -> Floats:
    """(3, 3) r_parent_from_body of roll, pitch, yaw in rad."""
    out = np.zeros((3, 3))
    rotation(*quaternion_from_euler(*angles), out)
    return out


def mirrored(part: BodyPart, image: BodyPart) -> BodyPart:
    """``part`` reflected in the plane of symmetry, hanging where ``image`` says."""
    (px, py, pz), (roll, pitch, yaw), (ax, ay, az) = part.place, part.rotation, part.axis
    (cx, cy, cz), (xx, yy, zz, xy, xz, yz) = part.center, part.inertia
    # Both rudders turn the same way: not as in a mirror.
    way = -1.0 if part.moved_by == "rudder" else 1.0
    return part._replace(
        parent=image.parent,
        mirror_of=image.mirror_of,
        moved_by=MIRRORED.get(part.moved_by, part.moved_by),
        place=(px, -py, pz),
        rotation=(-roll, pitch, -yaw),
        # A turn is a pseudovector: its mirror image keeps the component across the plane.
        axis=(-ax * way, ay * way, -az * way),
        center=(cx, -cy, cz),
        inertia=(xx, yy, zz, -xy, xz, -yz),
        motion_by_rudder=-part.motion_by_rudder,
    )


def all_parts(vehicle: SimulatedVehicle) -> dict[str, BodyPart]:
    """The bodies of a vehicle file with the mirror images filled in.

    Raises:
        BadInput: a mirror image of a body that is not there, or is itself one, or is told more than its parent; a
            joint moved by nothing that is known, or without an axis, or by a wing's drive that moves another.
    """
    parts: dict[str, BodyPart] = {}
    for name, part in vehicle.bodies.items():
        try:
            if part.mirror_of:
                part = _image(vehicle, part)
            _check_joint(part, parts)
        except BadInput as error:
            raise BadInput(f"{vehicle.path}: bodies.{name}.{error}") from None
        parts[name] = part
    return parts


def _image(vehicle: SimulatedVehicle, part: BodyPart) -> BodyPart:
    model = vehicle.bodies.get(part.mirror_of)
    if model is None or model.mirror_of:
        raise BadInput(f'mirror_of = "{part.mirror_of}" must be a body told in full')
    _refuse(part, ("parent", "mirror_of"), f'is not told of a mirror image: it has that of "{part.mirror_of}"')
    return mirrored(model, part)


def _refuse(part: BodyPart, but: tuple[str, ...], why: str) -> None:
    """Raise BadInput where any key is told ``but`` these."""
    for key, default in part._field_defaults.items():
        if key not in but and getattr(part, key) != default:
            raise BadInput(f"{key} {why}")


def _check_joint(part: BodyPart, others: dict[str, BodyPart]) -> None:
    channel = part.moved_by
    if channel not in CHANNELS:
        known = ", ".join(channel for channel in CHANNELS if channel)
        raise BadInput(f'moved_by = "{channel}" must be one of {known}')
    if channel == "stroke" and len(part.motion) % 2 == 0:
        raise BadInput(f"motion must be a mean and then pairs of cosine and sine, not {len(part.motion)} numbers")
    if channel and not any(part.axis):
        raise BadInput(f'moved_by = "{channel}" needs an axis')
    rival = next((name for name, other in others.items() if other.moved_by == channel), "")
    if rival and CHANNELS[channel][0] == k.WING:
        raise BadInput(f'moved_by = "{channel}" moves "{rival}" already')


def build_mechanism(vehicle: SimulatedVehicle) -> Mechanism:
    """The mechanism of a vehicle.

    Raises:
        BadInput: the bodies make no tree, or the aerodynamic model does not hold.
    """
    parts = all_parts(vehicle)
    try:
        bodies = parents_first([_body(name, part) for name, part in parts.items()])
        _check_base(bodies[0].name, parts[bodies[0].name])
        _check_wings(vehicle.wing, bodies)
    except BadInput as error:
        raise BadInput(f"{vehicle.path}: {error}") from None
    tree, names = build_tree(bodies)
    order = {body.name: i for i, body in enumerate(bodies)}
    joints = [parts[name] for name in names]
    wings, coordinates = _wings(vehicle.wing, tree, order, names)
    strips, model = wings.strips, find_model(vehicle.aerodynamics.model)
    try:
        parameters = model.build(vehicle.sections[model.name], strips)
    except BadInput as error:
        raise BadInput(f"{vehicle.path}: {error}") from None
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
    """Scratch of the wings' kernels."""
    strips, n = mechanism.wings.strips, mechanism.wings.strips.chord.shape[0]
    return WingWork(
        motion=blank_motion(strips, 2),
        loads=blank_loads(len(mechanism.model.parts), strips, mechanism.aerodynamic_state.shape[0]),
        total=np.zeros((4, n)),
        sine=np.zeros(n),
        cosine=np.zeros(n),
        frame=np.zeros((5, 6)),
        inertia=np.zeros((6, 6)),
        turned=np.zeros((6, 6)),
        wrench=np.zeros((2, 6)),
        column=np.zeros(6),
    )


def _body(name: str, part: BodyPart) -> Body:
    return Body(
        name, part.parent, part.place, matrix_of(part.rotation), part.axis, part.mass, part.center, part.inertia
    )


def _check_base(name: str, part: BodyPart) -> None:
    try:
        _refuse(part, ("mass", "center", "inertia"), "is not told of the base: it hangs on no joint")
    except BadInput as error:
        raise BadInput(f"bodies.{name}.{error}") from None


def _check_wings(wing: Wing, bodies: list[Body]) -> None:
    if wing.left == wing.right:
        raise BadInput(f'wing.left = "{wing.left}" is the right wing already')
    named = {body.name: body for body in bodies}
    for key, name in (("right", wing.right), ("left", wing.left)):
        if not _moves(named, name):
            raise BadInput(f'wing.{key} = "{name}" flaps about no joint')
    if wing.twists and wing.membrane_mass <= 0.0:
        raise BadInput("wing.membrane_mass must exceed 0 kg where the membrane twists: it would follow without bound")
    parents = {body.parent for body in bodies} | {wing.left, wing.right}
    for body in bodies:
        length = float(np.linalg.norm(body.axis))
        if body.name in parents or length == 0.0:
            continue
        turning = np.array(body.axis) / length
        arm = np.cross(turning, body.center)
        if turning @ inertia_matrix(body.inertia) @ turning + body.mass * (arm @ arm) <= 0.0:
            raise BadInput(f'body "{body.name}" has no inertia about the axis of its joint')


def _moves(bodies: dict[str, Body], name: str) -> bool:
    """Whether a joint lies between the body and the base."""
    while bodies[name].parent:
        if any(bodies[name].axis):
            return True
        name = bodies[name].parent
    return False


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
        first=np.array([0, wing.strips, 2 * wing.strips], dtype=np.int64),
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
    """Place in m of a ``point`` of a body in the base's axes, with all joints at zero."""
    parts = all_parts(vehicle)
    place = np.array(point)
    while parts[body].parent:
        place = np.array(parts[body].place) + matrix_of(parts[body].rotation) @ place
        body = parts[body].parent
    x, y, z = place.tolist()
    return x, y, z


def total_mass(vehicle: SimulatedVehicle) -> float:
    """kg; of everything."""
    return sum(part.mass for part in all_parts(vehicle).values()) + 2.0 * vehicle.wing.membrane_mass
