"""Trees of bodies told to MuJoCo, and its accelerations in our speeds."""

from __future__ import annotations

from typing import Any, NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sim_bridge.multibody.tree import BASE, Body, Tree, assemble, blank_kinematics, build_tree, move
from sim_bridge.vectors import Floats
from wingbeat.constants import STANDARD_GRAVITY

GRAVITY = np.array([0.0, 0.0, STANDARD_GRAVITY])
SPECK = 1e-14
"""kg and kg m^2; MuJoCo wants some of both in every moving body, where ours may have none"""


class Motion(NamedTuple):
    """A state of a tree in vacuum, and what turns its joints; c coordinates."""

    attitude: Floats
    """(3, 3); r_ned_from_frd"""
    base: Floats
    """(6,) m/s, rad/s; body axes"""
    q: Floats
    rates: Floats
    torque: Floats


def random_motion(rng: np.random.Generator, coordinates: int) -> Motion:
    attitude = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    q, rates, torque = rng.normal(size=(3, coordinates)) * np.array([[1.5], [8.0], [0.5]])
    return Motion(attitude, rng.normal(size=6) * 3.0, q, rates, torque)


def _row(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.ravel(values))


def _quaternion(r: Floats) -> str:
    return _row(np.roll(Rotation.from_matrix(r).as_quat(), 1))


def _inertial(node: ElementTree.Element, mass: float, center: Floats, tensor: Floats) -> None:
    # Given a full tensor, some releases find its axes to a millionth only.
    moments, axes = np.linalg.eigh(tensor)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    ElementTree.SubElement(
        node, "inertial", pos=_row(center), quat=_quaternion(axes), mass=repr(float(mass + SPECK)),
        diaginertia=_row(moments + SPECK),
    )  # fmt: skip


class Engine:
    """MuJoCo with the mechanism of ``tree``; its joints are called after their coordinates.

    FRD and NED axes are its axes, with gravity along +z; springs and dampers of the joints are its own.
    """

    def __init__(self, tree: Tree, stiffness: Floats, damping: Floats) -> None:
        self.root = ElementTree.Element("mujoco")
        ElementTree.SubElement(self.root, "compiler", angle="radian", autolimits="false")
        option = ElementTree.SubElement(self.root, "option", gravity=_row(GRAVITY))
        ElementTree.SubElement(option, "flag", contact="disable", constraint="disable")
        self.nodes = [ElementTree.SubElement(ElementTree.SubElement(self.root, "worldbody"), "body", name="0")]
        ElementTree.SubElement(self.nodes[0], "freejoint", name="base")
        self.tree, self.coordinates = tree, int(np.max(tree.coordinate, initial=-1)) + 1
        self.followers: list[tuple[str, int, float, float]] = []
        for b in range(tree.mass.shape[0]):
            if b > 0:
                self._hang(b, stiffness, damping)
            _inertial(self.nodes[b], tree.mass[b], tree.center[b], tree.inertia[b])

    def _hang(self, b: int, stiffness: Floats, damping: Floats) -> None:
        parent, c = self.nodes[int(self.tree.parent[b])], int(self.tree.coordinate[b])
        node = ElementTree.SubElement(
            parent, "body", name=str(b), pos=_row(self.tree.place[b]), quat=_quaternion(self.tree.rotation[b])
        )
        self.nodes.append(node)
        if c >= 0:
            ElementTree.SubElement(
                node, "joint", name=f"q{c}", type="hinge", axis=_row(self.tree.axis[b]), armature="0",
                stiffness=repr(float(stiffness[c])), damping=repr(float(damping[c])),
            )  # fmt: skip

    def add_follower(self, body: int, place: Any, center: Any, mass: float, tie: tuple[int, float, float]) -> None:
        """A particle on a hinge along the y axis of ``body``, turned by offset + share times a coordinate.

        Args:
            tie: the coordinate, its share, and the offset in rad.
        """
        name = f"follower{len(self.followers)}"
        node = ElementTree.SubElement(self.nodes[body], "body", name=name, pos=_row(place))
        ElementTree.SubElement(node, "joint", name=name, type="hinge", axis="0 1 0", armature="0")
        _inertial(node, mass, center, np.zeros((3, 3)))
        self.followers.append((name, *tie))
        self.coordinates = max(self.coordinates, tie[0] + 1)

    def compile(self) -> None:
        """Make MuJoCo's model; nothing can be added any more."""
        self.model = mujoco.MjModel.from_xml_string(ElementTree.tostring(self.root, encoding="unicode"))
        self.data = mujoco.MjData(self.model)
        self.ties = np.zeros((self.model.nv, BASE + self.coordinates))
        self.offset = np.zeros(self.model.nv)
        self.ties[:BASE, :BASE] = np.eye(BASE)
        for c in set(self.tree.coordinate.tolist()) - {-1}:
            self.ties[self._dof(f"q{c}"), BASE + c] = 1.0
        for name, c, share, offset in self.followers:
            self.ties[self._dof(name), BASE + c] = share
            self.offset[self._dof(name)] = offset

    def _dof(self, joint: str) -> int:
        return int(self.model.joint(joint).dofadr[0])

    def set_motion(self, m: Motion) -> None:
        """Its free joint's speeds: linear in the world's axes, angular in the body's."""
        d = self.data
        d.qpos[0:3] = 0.0
        d.qpos[3:7] = np.roll(Rotation.from_matrix(m.attitude).as_quat(), 1)
        d.qpos[7:] = (self.ties[:, BASE:] @ m.q + self.offset)[BASE:]
        own = np.concatenate((m.attitude @ m.base[:3], m.base[3:], m.rates))
        d.qvel[:] = self.ties @ own

    def accelerations(self, m: Motion) -> Floats:
        """(6 + c,) rates of our speeds, from MuJoCo's mass matrix, bias and passive forces tied together."""
        self.set_motion(m)
        mujoco.mj_forward(self.model, self.data)
        columns = np.zeros(self.ties.T.shape)
        for column, tie in zip(columns, self.ties.T, strict=True):
            mujoco.mj_mulM(self.model, self.data, column, tie)
        mass = columns @ self.ties
        load = self.ties.T @ (self.data.qfrc_passive - self.data.qfrc_bias)
        load[BASE:] += m.torque
        return self.computed(m, np.linalg.solve(mass, load))

    def forward(self, m: Motion) -> Floats:
        """(6 + c,) the same straight from MuJoCo's forward dynamics; of trees without followers."""
        self.set_motion(m)
        self.data.qfrc_applied[:] = self.ties[:, BASE:] @ m.torque
        mujoco.mj_forward(self.model, self.data)
        return self.computed(m, self.ties.T @ self.data.qacc)

    def inverse(self, m: Motion, rates: Floats) -> Floats:
        """(6 + c,) what MuJoCo says it takes to have these ``rates`` of our speeds; linear part in body axes."""
        self.set_motion(m)
        reference = rates.copy()
        reference[:3] = m.attitude @ (rates[:3] + np.cross(m.base[3:], m.base[:3]))
        self.data.qacc[:] = self.ties @ reference
        mujoco.mj_inverse(self.model, self.data)
        takes: Floats = self.ties.T @ self.data.qfrc_inverse
        takes[:3] = m.attitude.T @ takes[:3]
        return takes

    @staticmethod
    def computed(m: Motion, reference: Floats) -> Floats:
        """The same accelerations with the linear part as the rate of the components in body axes."""
        out = reference.copy()
        out[:3] = m.attitude.T @ reference[:3] - np.cross(m.base[3:], m.base[:3])
        return out


def tree_equations(tree: Tree, m: Motion, stiffness: Floats, damping: Floats) -> tuple[Floats, Floats]:
    """Our mass matrix, its upper triangle, and load of a tree in vacuum with springs, dampers and torques."""
    n = BASE + m.q.shape[0]
    mass, load, kinematics = np.zeros((n, n)), np.zeros(n), blank_kinematics(tree)
    move(tree, m.q, m.rates, m.base, m.attitude.T @ GRAVITY, kinematics)
    assemble(tree, kinematics, mass, load)
    load[BASE:] += m.torque - stiffness * m.q - damping * m.rates
    return mass, load


def random_body(rng: np.random.Generator, name: str, parent: str, fixed: bool) -> Body:
    second = rng.normal(size=(3, 3)) * 0.02
    second = second @ second.T + 1e-5 * np.eye(3)
    t = np.trace(second) * np.eye(3) - second
    axis = np.zeros(3) if fixed else rng.normal(size=3)
    return Body(
        name=name,
        parent=parent,
        place=tuple(rng.normal(size=3) * 0.3) if parent else (0.0, 0.0, 0.0),
        rotation=Rotation.random(random_state=int(rng.integers(2**31))).as_matrix() if parent else np.eye(3),
        axis=tuple(axis if parent else np.zeros(3)),
        mass=float(rng.uniform(0.02, 1.0)),
        center=tuple(rng.normal(size=3) * 0.1),
        inertia=(t[0, 0], t[1, 1], t[2, 2], -t[0, 1], -t[0, 2], -t[1, 2]),
    )


def random_tree(rng: np.random.Generator, chain: bool) -> Tree:
    """A base and one to nine more bodies: in a chain or branching, some on fixed joints."""
    count = int(rng.integers(2, 11))
    bodies = [random_body(rng, "b0", "", True)]
    for i in range(1, count):
        up = i - 1 if chain else int(rng.integers(i))
        bodies.append(random_body(rng, f"b{i}", f"b{up}", i > 1 and bool(rng.random() < 0.2)))
    # The order of the file must not matter.
    tree, _ = build_tree([bodies[i] for i in rng.permutation(count)])
    return tree
