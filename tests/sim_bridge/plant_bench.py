"""Plants in chosen states, and the same mechanism built a second time from point masses to compare with."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from sim_bridge import plant_kernel as k
from sim_bridge.plant import Plant, wing_strips
from sim_bridge.vectors import Floats, quaternion_from_euler
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle

NAMES = ("robo_raven_ii_d", "arizona_100cm")
VACUUM = 1e-9
"""kg/m^3; the air's apparent mass is part of the mass matrix, so that none at all would be a special case"""
GRAVITY = np.array([0.0, 0.0, k.GRAVITY])


@cache
def vehicle(name: str) -> SimulatedVehicle:
    return load_vehicle(name)


def frictionless(name: str) -> Plant:
    """A plant without damping in hinge and membrane."""
    plant = Plant(vehicle(name))
    twist = np.array([plant.parameters.twist[0], 0.0])
    plant.parameters = plant.parameters._replace(twist=twist, flap_damping=0.0)
    return plant


def air(density: float = 1.225, launcher: int = k.FREE, wind: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Any:
    return k.Surroundings(*wind, density, launcher, 0.0, 0.0, 0.0)


def hold(angle: float = 0.0, duration: float = 0.005, powered: float = 1.0) -> k.Controls:
    return k.Controls(angle, angle, angle, angle, 0.0, 0.0, 0.0, duration, powered)


def slack(duration: float = 0.005) -> k.Controls:
    return hold(0.0, duration, 0.0)


def state(plant: Plant, rng: np.random.Generator, speed: float = 0.0) -> Floats:
    """A random state high above the ground, flying forward at ``speed`` m/s."""
    y = np.zeros_like(plant.y)
    y[0:3] = (*rng.normal(size=2), -500.0)
    y[3:7] = quaternion_from_euler(*rng.uniform(-1.2, 1.2, 3))
    y[7:10] = rng.normal(size=3) + np.array([speed, 0.0, 0.0])
    y[10:13] = rng.normal(size=3) * 2.0
    for base in (k.LEFT, k.RIGHT):
        y[base : base + 4] = rng.normal(size=4) * (0.5, 0.3, 8.0, 8.0)
    y[k.ELEVATOR], y[k.RUDDER] = rng.uniform(-0.3, 0.3, 2)
    y[k.WAKE :] = rng.normal(size=y.shape[0] - k.WAKE)
    return y


def rates(plant: Plant, y: Floats, controls: k.Controls, around: k.Surroundings) -> Floats:
    plant.y[:] = y
    return plant.evaluate(controls, around)


def integrate(plant: Plant, y: Floats, duration: float, steps: int, around: k.Surroundings) -> Floats:
    """The state after ``duration`` s of slack wings in ``steps`` Runge-Kutta steps."""
    return _advance(plant, y, slack(duration), steps, around)


def _advance(plant: Plant, y: Floats, controls: k.Controls, steps: int, around: k.Surroundings) -> Floats:
    end = y.copy()
    work = k.Scratch(*[np.zeros_like(part) for part in plant.scratch])
    work.drive[3] = plant.vehicle.battery.full_voltage
    k.advance(end, steps, controls, around, plant.parameters, work, np.zeros((6, end.shape[0])), np.zeros(7))
    return end


def driven(plant: Plant, y: Floats, controls: k.Controls, steps: int, around: k.Surroundings) -> Floats:
    """The state after the interval of ``controls`` in ``steps`` Runge-Kutta steps."""
    return _advance(plant, y, controls, steps, around)


def mirrored(y: Floats, strips: int) -> Floats:
    """The state, or its rates, seen in a mirror in the plane of symmetry."""
    m = y.copy()
    for i in (1, 4, 6, 8, 10, 12, k.RUDDER):
        m[i] = -y[i]
    m[k.LEFT : k.LEFT + 4], m[k.RIGHT : k.RIGHT + 4] = y[k.RIGHT : k.RIGHT + 4], y[k.LEFT : k.LEFT + 4]
    m[k.WAKE : k.WAKE + strips], m[k.WAKE + strips :] = y[k.WAKE + strips :], y[k.WAKE : k.WAKE + strips]
    return m


def _about_x(angle: Any) -> Any:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_y(angle: Any) -> Any:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _exponential(phi: Any) -> Any:
    """Rotation of a small rotation vector; exact in its first four derivatives at zero."""
    a, b, c = phi
    cross = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    square = cross @ cross
    return np.eye(3) + cross + square / 2 + square @ cross / 6 + square @ square / 24


def _fuselage_points(mass: float, inertia: Floats) -> tuple[Floats, Floats]:
    """Point masses (some may be negative) with this mass and inertia (Ixx, Iyy, Izz, Ixz) about the origin."""
    xx, yy, zz, xz = inertia
    tensor = np.array([[xx, 0, -xz], [0, yy, 0], [-xz, 0, zz]])
    second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    values, axes = np.linalg.eigh(second)
    arm = 0.1
    points = [sign * arm * axes[:, i] for i in range(3) for sign in (1, -1)]
    masses = [values[i] / (2 * arm**2) for i in range(3) for _ in (1, -1)]
    return np.array([*points, np.zeros(3)]), np.array([*masses, mass - sum(masses)])


class Mechanism:
    """Fuselage and wings as particles, by differentiating their positions; knows nothing of the kernel.

    Ten coordinates: displacement (NED), rotation vector from the present attitude, flap and twist left and right.
    """

    STEP = 1e-30

    def __init__(self, plant: Plant, y: Floats) -> None:
        self.wing, self.twist_stiffness = plant.vehicle.wing, plant.parameters.twist[0]
        self.y = y
        self.body, body_masses = _fuselage_points(plant.parameters.fuselage_mass, plant.parameters.inertia)
        self.strips = wing_strips(self.wing)
        side = self.strips[:, 4:6].ravel()
        self.masses = np.concatenate((body_masses, side, side))
        w, a, b, c = y[3:7] / np.linalg.norm(y[3:7])
        cross = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
        self.r = np.eye(3) + 2 * w * cross + 2 * cross @ cross
        self.q = np.concatenate((np.zeros(6), y[k.LEFT : k.LEFT + 2], y[k.RIGHT : k.RIGHT + 2]))
        wings = (y[k.LEFT + 2 : k.LEFT + 4], y[k.RIGHT + 2 : k.RIGHT + 4])
        self.qd = np.concatenate((self.r @ y[7:10], y[10:13], *wings))

    def positions(self, q: Any) -> Any:
        """(n, 3) NED from the present place of the fuselage; q may be complex."""
        wing, rows = self.wing, [*self.body]
        incidence = _about_y(wing.incidence)
        for side, (flap, twist) in ((-1, q[6:8]), (1, q[8:10])):
            hinge = np.array([wing.hinge_x, side * wing.hinge_y, wing.hinge_z])
            flapped = incidence @ _about_x(-side * flap)
            for span, eta, chord, *_ in self.strips:
                chordwise = _about_y((twist + wing.washout) * eta) @ np.array([-1.0, 0.0, 0.0])
                out = np.array([0.0, side * span, 0.0])
                rows += [hinge + flapped @ (out + share * chord * chordwise) for share in (0.0, 0.5)]
        return q[0:3] + np.array(rows) @ (self.r @ _exponential(q[3:6])).T

    def _along(self, direction: Floats, at: float = 0.0) -> Floats:
        q = self.q + (at + 1j * self.STEP) * direction
        return np.imag(self.positions(q)) / self.STEP

    def accelerations(self) -> Floats:
        """(10,) rates of the speeds in the kernel's order: gravity and twist springs, no air, no drive."""
        jacobian = np.stack([self._along(e) for e in np.eye(10)], axis=2)
        d = 2e-4
        near, far = (self._along(self.qd, s * d) - self._along(self.qd, -s * d) for s in (1, 2))
        bias = (8 * near - far) / (12 * d)
        mass = np.einsum("nij,n,nik->jk", jacobian, self.masses, jacobian)
        load = np.einsum("nij,n,ni->j", jacobian, self.masses, GRAVITY - bias)
        load[[7, 9]] -= self.twist_stiffness * self.q[[7, 9]]
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
        """J; kinetic, of gravity and of the twist springs."""
        v, r = self._along(self.qd), np.real(self.positions(self.q)) + self.y[:3]
        kinetic = 0.5 * float(self.masses @ np.sum(v * v, axis=1))
        spring = 0.5 * self.twist_stiffness * float(np.sum(self.q[[7, 9]] ** 2))
        return kinetic - float(self.masses @ r @ GRAVITY) + spring


def pitching(plant: Plant) -> float:
    """rad; pitch of the plant."""
    y = plant.y
    return math.asin(2 * (y[3] * y[5] - y[6] * y[4]))
