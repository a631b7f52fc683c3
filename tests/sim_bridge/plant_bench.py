"""Plants in chosen states, and the same mechanism built a second time from point masses to compare with."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.compiled import Bound
from sim_bridge.mechanism import all_parts, wing_strips
from sim_bridge.multibody.tree import assemble, inertia_matrix
from sim_bridge.plant import Plant, scratch
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle
from sim_bridge.vehicles.sections import BodyPart
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.quaternions import quaternion_from_euler

NAMES = ("robo_raven_ii_d", "arizona_100cm")
VACUUM = 1e-9
"""kg/m^3; the air's apparent mass is part of the mass matrix, so that none at all would be a special case"""
GRAVITY = np.array([0.0, 0.0, STANDARD_GRAVITY])


MECHANISMS = (*NAMES, "slow_hawk", "insect")


@cache
def vehicle(name: str) -> SimulatedVehicle:
    return insect() if name == "insect" else load_vehicle(name)


def frictionless(name: str) -> Plant:
    """A plant whose joints have neither damping nor servos, only the springs of its vehicle."""
    return freed(Plant(vehicle(name)))


def freed(plant: Plant) -> Plant:
    """The plant with nothing on its joints but their springs."""
    joints = plant.parameters.joints
    nothing = np.zeros_like(joints.damping)
    free = joints._replace(kind=np.full_like(joints.kind, k.PASSIVE), damping=nothing)
    plant.parameters = plant.parameters._replace(joints=free)
    return plant


def air(density: float = 1.225, launcher: int = k.FREE, wind: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    return k.Surroundings(*wind, density, launcher, 0.0, 0.0, 0.0)


def hold_position(angle: float = 0.0, duration: float = 0.005, powered: float = 1.0) -> k.Controls:
    return k.Controls(angle, angle, angle, angle, 0.0, 0.0, 0.0, duration, powered)


def slack(duration: float = 0.005) -> k.Controls:
    return hold_position(0.0, duration, 0.0)


def joints(plant: Plant) -> slice:
    """Where the coordinates stand in the state."""
    return slice(k.COORDINATES, k.COORDINATES + len(plant.layout.coordinates))


def joint_rates(plant: Plant) -> slice:
    """Where the rates of the coordinates stand in the state."""
    n = len(plant.layout.coordinates)
    return slice(k.COORDINATES + n, k.COORDINATES + 2 * n)


def speeds(plant: Plant) -> list[int]:
    """Where the speeds stand in the state: the base's six, then the coordinates' rates."""
    found = joint_rates(plant)
    return [*range(7, 13), *range(found.start, found.stop)]


def state(plant: Plant, rng: np.random.Generator, speed: float = 0.0) -> Floats:
    """A random state high above the ground, flying forward at ``speed`` m/s."""
    y, layout = np.zeros_like(plant.y), plant.layout
    y[0:3] = (*rng.normal(size=2), -500.0)
    y[3:7] = quaternion_from_euler(*rng.uniform(-1.2, 1.2, 3))
    y[7:10] = rng.normal(size=3) + np.array([speed, 0.0, 0.0])
    y[10:13] = rng.normal(size=3) * 2.0
    y[joints(plant)] = rng.normal(size=len(layout.coordinates)) * 0.3
    y[joint_rates(plant)] = rng.normal(size=len(layout.coordinates)) * 8.0
    for tail in (layout.elevator, layout.rudder):
        y[[tail, layout.rate(tail)]] = rng.uniform(-0.3, 0.3, 2)
    y[layout.aerodynamics :] = rng.normal(size=layout.size - layout.aerodynamics)
    return y


def rates(plant: Plant, y: Floats, controls: k.Controls, around: k.Surroundings) -> Floats:
    plant.y[:] = y
    return plant.evaluate(controls, around)


def integrate(plant: Plant, y: Floats, duration: float, steps: int, around: k.Surroundings) -> Floats:
    """The state after ``duration`` s of slack wings in ``steps`` Runge-Kutta steps."""
    return driven(plant, y, slack(duration), steps, around)


def driven(plant: Plant, y: Floats, controls: k.Controls, steps: int, around: k.Surroundings) -> Floats:
    """The state after the interval of ``controls`` in ``steps`` Runge-Kutta steps."""
    end = y.copy()
    k.advance(end, steps, controls, around, Bound((plant.parameters, scratched(plant))))
    return end


def scratched(plant: Plant) -> k.Scratch:
    """Fresh work space."""
    return scratch(plant.mechanism)


def equations(plant: Plant, y: Floats, around: k.Surroundings) -> tuple[Floats, Floats]:
    """Mass matrix and load of tree, wings and air alone: without drives, springs, ground and launcher."""
    p, s = plant.parameters, scratched(plant)
    k.set_motion(y, around, p, s)
    k.add_air_loads(y, around.density, p, s)
    assemble(p.tree, s.tree, s.mass, s.load)
    return np.triu(s.mass) + np.triu(s.mass, 1).T, s.load


def swapped(name: str) -> str:
    """The name of a coordinate's mirror image."""
    if "left" in name:
        return name.replace("left", "right")
    return name.replace("right", "left")


def mirrored(plant: Plant, y: Floats) -> Floats:
    """The state, or its rates, seen in a mirror in the plane of symmetry."""
    m, names = y.copy(), plant.layout.coordinates
    m[[1, 4, 6, 8, 10, 12]] *= -1.0
    image = np.array([names.index(swapped(name)) for name in names])
    sign = np.array([-1.0 if name == "rudder" else 1.0 for name in names])
    for where in (joints(plant), joint_rates(plant)):
        m[where] = sign * y[where][image]
    wakes = y[plant.layout.aerodynamics :]
    m[plant.layout.aerodynamics :] = np.roll(wakes, len(wakes) // 2)
    return m


def _cross(v: Any) -> Any:
    a, b, c = v
    return np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])


def turned(axis: Any, angle: Any) -> Any:
    """Rotation by ``angle``, which may be complex, about the unit vector ``axis``."""
    cross = _cross(axis)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _exponential(phi: Any) -> Any:
    """Rotation of a small rotation vector; exact in its first four derivatives at zero."""
    cross = _cross(phi)
    square = cross @ cross
    return np.eye(3) + cross + square / 2 + square @ cross / 6 + square @ square / 24


def from_euler(angles: tuple[float, float, float]) -> Floats:
    """(3, 3) of roll, pitch, yaw: yaw first, then pitch about the new y, then roll about the new x."""
    roll, pitch, yaw = (turned(axis, angle) for axis, angle in zip(np.eye(3), angles, strict=True))
    out: Floats = yaw @ pitch @ roll
    return out


def particles(part: BodyPart) -> tuple[Floats, Floats]:
    """Point masses (some may be negative), (n, 3) and (n,), of the body's mass, centre of mass and inertia."""
    tensor = inertia_matrix(part.inertia)
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    values, axes = np.linalg.eigh(second)
    arm, center = 0.1, np.array(part.center)
    points = [center + sign * arm * axes[:, i] for i in range(3) for sign in (1, -1)]
    masses = [values[i] / (2 * arm**2) for i in range(3) for _ in (1, -1)]
    return np.array([*points, center]), np.array([*masses, part.mass - sum(masses)])


class Mechanism:
    """A vehicle as particles, by differentiating their positions; knows nothing of the kernels.

    Coordinates: displacement (NED), rotation vector from the present attitude, then those of the plant.
    """

    STEP = 1e-30

    def __init__(self, plant: Plant, y: Floats) -> None:
        self.parts, self.wing, self.y = all_parts(plant.vehicle), plant.vehicle.wing, y
        self.names, self.stiffness = plant.layout.coordinates, plant.parameters.joints.stiffness
        strips, membrane = wing_strips(self.wing)
        self.strip_shapes = np.stack((strips.span, strips.eta, strips.chord), axis=1)[: self.wing.strips]
        self.bodies = {name: particles(part) for name, part in self.parts.items()}
        self.masses = np.concatenate([masses for _, masses in self.bodies.values()] + [membrane])
        w, *axis = y[3:7] / np.linalg.norm(y[3:7])
        cross = _cross(axis)
        self.r = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        self.q = np.concatenate((np.zeros(6), y[joints(plant)]))
        self.qd = np.concatenate((self.r @ y[7:10], y[10:13], y[joint_rates(plant)]))

    def angle(self, q: Any, name: str) -> Any:
        return q[6 + self.names.index(name)] if name in self.names else 0.0

    def frame(self, q: Any, name: str) -> tuple[Any, Any]:
        """Place and axes of a body, in the base's axes."""
        part = self.parts[name]
        if not part.parent:
            return np.zeros(3), np.eye(3)
        place, axes = self.frame(q, part.parent)
        axis = np.array(part.axis) / (np.linalg.norm(part.axis) or 1.0)
        turn = from_euler(part.rotation) @ turned(axis, self.angle(q, name))
        return place + axes @ np.array(part.place), axes @ turn

    def membrane(self, q: Any, name: str, side: int) -> list[Any]:
        place, axes = self.frame(q, name)
        rows = []
        for (span, _, chord), twist in zip(self.strip_shapes, self.twists(q, name), strict=True):
            back = twist @ np.array([-0.5 * chord, 0.0, 0.0])
            rows.append(place + axes @ (np.array([0.0, side * span, 0.0]) + back))
        return rows

    def twists(self, q: Any, name: str) -> list[Any]:
        """Turn of each section of a wing against the wing's body."""
        tip = self.angle(q, f"{name}.twist") + self.wing.washout
        return [turned((0.0, 1.0, 0.0), tip * eta) for _, eta, _ in self.strip_shapes]

    def attitude(self, q: Any) -> Any:
        """r_ned_from_frd."""
        return self.r @ _exponential(q[3:6])

    def positions(self, q: Any) -> Any:
        """(n, 3) NED from the present place of the base; q may be complex."""
        rows = []
        for name, (points, _) in self.bodies.items():
            place, axes = self.frame(q, name)
            rows += [place + axes @ point for point in points]
        rows += self.membrane(q, self.wing.left, -1) + self.membrane(q, self.wing.right, 1)
        return q[0:3] + np.array(rows) @ self.attitude(q).T

    def _along(self, direction: Floats, at: float = 0.0) -> Floats:
        q = self.q + (at + 1j * self.STEP) * direction
        return np.imag(self.positions(q)) / self.STEP

    def accelerations(self) -> Floats:
        """Rates of the speeds in the kernel's order: gravity and springs, no air, no drive."""
        jacobian = np.stack([self._along(e) for e in np.eye(self.q.shape[0])], axis=2)
        d = 2e-4
        near, far = (self._along(self.qd, s * d) - self._along(self.qd, -s * d) for s in (1, 2))
        bias = (8 * near - far) / (12 * d)
        mass = np.einsum("nij,n,nik->jk", jacobian, self.masses, jacobian)
        load = np.einsum("nij,n,ni->j", jacobian, self.masses, GRAVITY - bias)
        load[6:] -= self.stiffness * self.q[6:]
        qdd = np.linalg.solve(mass, load)
        v, omega = self.y[7:10], self.y[10:13]
        return np.concatenate((self.r.T @ qdd[:3] - np.cross(omega, v), qdd[3:]))

    def momentum(self) -> Floats:
        """(6,) linear momentum and angular momentum about the centre of mass, NED."""
        v, r = self._along(self.qd), np.real(self.positions(self.q))
        linear = self.masses @ v
        centre = self.masses @ r / self.masses.sum()
        return np.concatenate((linear, np.cross(r - centre, self.masses[:, None] * v).sum(axis=0)))

    def energy(self) -> float:
        """J; kinetic, of gravity and of the springs."""
        v, r = self._along(self.qd), np.real(self.positions(self.q)) + self.y[:3]
        kinetic = 0.5 * float(self.masses @ np.sum(v * v, axis=1))
        spring = 0.5 * float(self.stiffness @ self.q[6:] ** 2)
        return kinetic - float(self.masses @ r @ GRAVITY) + spring


def pitching(plant: Plant) -> float:
    """rad; pitch of the plant."""
    y = plant.y
    return math.asin(2 * (y[3] * y[5] - y[6] * y[4]))


def insect() -> SimulatedVehicle:
    """Robo Raven's wings on two joints each (flap, lead-lag) at raised hinges, its tail on two joints in a row."""
    raven = vehicle("robo_raven_ii_d")
    b = dict(raven.bodies)
    root = b["right_wing"]
    hinge = root._replace(mass=0.0, center=(0.0, 0.0, 0.0), inertia=(0.0,) * 6, rotation=(0.1, 0.05, 0.2))
    lag = root._replace(
        parent="right_hinge", moved_by="", place=(0.01, 0.02, 0.0), axis=(0.1, 0.2, 1.0), stiffness=0.8
    )
    image = b["left_wing"]
    bodies = {
        "right_wing": lag,
        "left_wing": image._replace(parent="left_hinge"),
        "rudder": b["rudder"]._replace(parent="elevator", place=(-0.01, 0.0, -0.03), center=(-0.02, 0.0, -0.04)),
        "right_hinge": hinge,
        "left_hinge": image._replace(mirror_of="right_hinge"),
        "elevator": b["elevator"]._replace(mass=0.0, inertia=(0.0,) * 6, rotation=(0.0, -0.12, 0.0)),
        "fuselage": b["fuselage"],
    }
    return raven._replace(bodies=bodies, wing=raven.wing._replace(washout=0.15))
