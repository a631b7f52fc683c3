"""Equations of motion of any tree of rigid bodies on a free base.

Spatial vectors (angular part first) of every body are told about one point, the base's origin, in the base's axes
(FRD). Inertias of a subtree then add up without a transformation, and the mass matrix is Featherstone's composite
rigid body algorithm in a few dot products: ``M(q) du/dt = Q``, the Boltzmann-Hamel equations of Grauer Eq. 1-7 and
Sibilski Eq. 1-22 for the quasi-velocities ``u``: velocity of the base's origin and angular velocity in body axes,
then the rate of every coordinate. In these axes the spatial acceleration of the base is the component-wise rate of
its speeds, so that the velocity products need no special case.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge.elementary import sine_and_cosine
from sim_bridge.vectors import Floats, Integers, inlined, laid_in

BASE = 6
"""speeds of the base, before those of the coordinates"""
ROUNDING = 0.02
"""-; by which moments of inertia, told with two digits, may miss what a body can have"""


class Body(NamedTuple):
    """A rigid body and the joint it hangs on; its axes are FRD where all joints are at zero."""

    name: str
    parent: str
    """name of the body it hangs on; empty for the base"""
    place: tuple[float, float, float]
    """m; of the joint, in the parent's axes from the parent's joint"""
    rotation: Floats
    """(3, 3); r_parent_from_body at zero angle"""
    axis: tuple[float, float, float]
    """of the joint's positive turn, in the body's axes; (0, 0, 0) for a fixed joint"""
    mass: float
    """kg"""
    center: tuple[float, float, float]
    """m; centre of mass in the body's axes, from its joint"""
    inertia: tuple[float, float, float, float, float, float]
    """kg m^2; about the centre of mass: xx, yy, zz and the products of inertia (integrals) xy, xz, yz"""


class Tree(NamedTuple):
    """A tree of bodies as the kernels take it; the base is body 0, a parent comes before its children."""

    parent: Integers
    """(b,); index of the parent, -1 for the base"""
    coordinate: Integers
    """(b,); the coordinate that the joint turns by, -1 where it is fixed"""
    place: Floats
    """(b, 3) m"""
    rotation: Floats
    """(b, 3, 3)"""
    axis: Floats
    """(b, 3); of unit length or zero"""
    mass: Floats
    """(b,) kg"""
    center: Floats
    """(b, 3) m"""
    inertia: Floats
    """(b, 3, 3) kg m^2; about the centre of mass, body's axes"""


class Kinematics(NamedTuple):
    """Where the bodies are and how they move: filled by `move`, read by whatever loads them."""

    r: Floats
    """(b, 3, 3); r_frd_from_body, of the base the identity"""
    p: Floats
    """(b, 3) m; joints, in the base's axes; of the base zero"""
    s: Floats
    """(b, 6); motion of the body by its own joint at unit rate: angular, linear at the base's origin"""
    velocity: Floats
    """(b, 6) rad/s, m/s; angular velocity, velocity of the body's point at the base's origin"""
    bias: Floats
    """(b, 6); spatial acceleration that is there without any rate of the speeds"""
    inertia: Floats
    """(b, 6, 6); spatial, about the base's origin; of the subtree after `assemble`"""
    force: Floats
    """(b, 6) N m, N; what the bias motion takes less what acts on the body, about the base's origin"""
    turned: Floats
    """(3, 3); scratch: r_parent_from_body"""
    unit: Floats
    """(6,); scratch: force of a joint's unit acceleration"""


class Equations(NamedTuple):
    """The equations of motion ``mass u' = load`` of the speeds: six of the base, then the rates of c coordinates."""

    mass: Floats
    """(6 + c, 6 + c); upper triangle"""
    load: Floats
    """(6 + c,) N, N m"""


def build_tree(bodies: list[Body]) -> tuple[Tree, list[str]]:
    """The tree of ``bodies`` and the names of its coordinates, those of the jointed bodies.

    Raises:
        BadInput: as `parents_first`, which also gives the order of the bodies in the tree.
    """
    ordered = parents_first(bodies)
    index = {body.name: i for i, body in enumerate(ordered)}
    names = [body.name for body in ordered[1:] if any(body.axis)]
    coordinate = [names.index(body.name) if body.name in names else -1 for body in ordered]
    axes = np.array([body.axis for body in ordered], dtype=np.float64)
    lengths = np.linalg.norm(axes, axis=1)
    axes[lengths > 0.0] /= lengths[lengths > 0.0, None]
    tree = Tree(
        parent=np.array([index.get(body.parent, -1) for body in ordered], dtype=np.int64),
        coordinate=np.array(coordinate, dtype=np.int64),
        place=np.array([body.place for body in ordered], dtype=np.float64),
        rotation=np.array([body.rotation for body in ordered], dtype=np.float64),
        axis=axes,
        mass=np.array([body.mass for body in ordered], dtype=np.float64),
        center=np.array([body.center for body in ordered], dtype=np.float64),
        inertia=np.array([inertia_matrix(body.inertia) for body in ordered]),
    )
    return tree, names


def inertia_matrix(inertia: tuple[float, float, float, float, float, float]) -> Floats:
    """(3, 3) kg m^2 of the moments xx, yy, zz and the products of inertia xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def parents_first(bodies: list[Body]) -> list[Body]:
    """The bodies in the order of the tree: base first, each after its parent.

    Raises:
        BadInput: no base or several, a parent that is unknown or comes round to the body itself, a repeated name, a
            leaf without mass, moments of inertia that no body has.
    """
    named = {body.name: body for body in bodies}
    if len(named) != len(bodies):
        twice = next(body.name for body in bodies if sum(other.name == body.name for other in bodies) > 1)
        raise BadInput(f'body "{twice}" is there twice')
    bases = [body for body in bodies if not body.parent]
    if len(bases) > 1:
        first, second = bases[:2]
        raise BadInput(f'bodies.{second.name}.parent is missing: "{first.name}" is the base already')
    for body in bodies:
        if body.parent and body.parent not in named:
            raise BadInput(
                f'bodies.{body.name}.parent = "{body.parent}" is not one of the bodies: {", ".join(named)}'
            )
    ordered = bases
    while len(ordered) < len(bodies):
        done = {body.name for body in ordered}
        ready = [body for body in bodies if body.parent in done and body.name not in done]
        if not ready:
            loop = _loop(next(body for body in bodies if body.name not in done), named)
            raise BadInput(f'bodies.{loop[0]}.parent = "{loop[1]}" makes a loop: {" on ".join(loop)}')
        ordered = ordered + ready
    _check_leaves(ordered)
    for body in ordered:
        _check_inertia(body)
    return ordered


def _loop(body: Body, named: dict[str, Body]) -> list[str]:
    """The names of the loop that the parents of ``body`` run into, the first repeated at the end."""
    path: list[str] = []
    while body.name not in path:
        path.append(body.name)
        body = named[body.parent]
    return [*path[path.index(body.name) :], body.name]


def _check_leaves(bodies: list[Body]) -> None:
    parents = {body.parent for body in bodies}
    for body in bodies:
        if body.name not in parents and body.mass <= 0.0:
            raise BadInput(f"bodies.{body.name}.mass = 0 kg: a leaf without mass would accelerate without bound")


def _check_inertia(body: Body) -> None:
    least, middle, greatest = np.linalg.eigvalsh(inertia_matrix(body.inertia)).tolist()
    if least < -ROUNDING * greatest or greatest > (1.0 + ROUNDING) * (least + middle):
        moments = f"{least:.3g}, {middle:.3g}, {greatest:.3g} kg m^2"
        raise BadInput(
            f"bodies.{body.name}.inertia has principal moments {moments}: none may be negative or exceed the sum of "
            "the others"
        )


def blank_kinematics(tree: Tree) -> Kinematics:
    """Room for the motion of ``tree``."""
    b = tree.mass.shape[0]
    return Kinematics(
        r=np.zeros((b, 3, 3)),
        p=np.zeros((b, 3)),
        s=np.zeros((b, 6)),
        velocity=np.zeros((b, 6)),
        bias=np.zeros((b, 6)),
        inertia=np.zeros((b, 6, 6)),
        force=np.zeros((b, 6)),
        turned=np.zeros((3, 3)),
        unit=np.zeros(6),
    )


@inlined
def _turn(axis: Floats, angle: float, zero: Floats, out: Floats) -> None:
    """``out`` (3, 3) = ``zero`` times the turn by ``angle`` about ``axis`` (Rodrigues)."""
    s, c = sine_and_cosine(angle)
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    m00, m01, m02 = c + d * x * x, d * x * y - s * z, d * x * z + s * y
    m10, m11, m12 = d * x * y + s * z, c + d * y * y, d * y * z - s * x
    m20, m21, m22 = d * x * z - s * y, d * y * z + s * x, c + d * z * z
    for i in range(3):
        a, b, e = zero[i, 0], zero[i, 1], zero[i, 2]
        out[i, 0] = a * m00 + b * m10 + e * m20
        out[i, 1] = a * m01 + b * m11 + e * m21
        out[i, 2] = a * m02 + b * m12 + e * m22


@inlined
def _place_body(tree: Tree, b: int, angle: float, k: Kinematics) -> None:
    up, local = tree.parent[b], k.turned
    _turn(tree.axis[b], angle, tree.rotation[b], local)
    for i in range(3):
        r0, r1, r2 = k.r[up, i, 0], k.r[up, i, 1], k.r[up, i, 2]
        k.p[b, i] = k.p[up, i] + r0 * tree.place[b, 0] + r1 * tree.place[b, 1] + r2 * tree.place[b, 2]
        for j in range(3):
            k.r[b, i, j] = r0 * local[0, j] + r1 * local[1, j] + r2 * local[2, j]
    for i in range(3):
        k.s[b, i] = k.r[b, i, 0] * tree.axis[b, 0] + k.r[b, i, 1] * tree.axis[b, 1] + k.r[b, i, 2] * tree.axis[b, 2]
    a0, a1, a2 = k.s[b, 0], k.s[b, 1], k.s[b, 2]
    k.s[b, 3] = k.p[b, 1] * a2 - k.p[b, 2] * a1
    k.s[b, 4] = k.p[b, 2] * a0 - k.p[b, 0] * a2
    k.s[b, 5] = k.p[b, 0] * a1 - k.p[b, 1] * a0


@inlined
def _move_body(up: int, b: int, rate: float, k: Kinematics) -> None:
    v, s = k.velocity[up], k.s[b]
    for i in range(6):
        k.velocity[b, i] = v[i] + rate * s[i]
        k.bias[b, i] = k.bias[up, i]
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        k.bias[b, i] += rate * (v[i1] * s[i2] - v[i2] * s[i1])
        linear = v[i1] * s[3 + i2] - v[i2] * s[3 + i1] + v[3 + i1] * s[i2] - v[3 + i2] * s[i1]
        k.bias[b, 3 + i] += rate * linear


@inlined
def _load_body(tree: Tree, b: int, gravity: Floats, k: Kinematics) -> None:
    """Set the body's own inertia and the force of its bias motion and weight."""
    r, m, inertia = k.r[b], tree.mass[b], k.inertia[b]
    x = k.p[b, 0] + r[0, 0] * tree.center[b, 0] + r[0, 1] * tree.center[b, 1] + r[0, 2] * tree.center[b, 2]
    y = k.p[b, 1] + r[1, 0] * tree.center[b, 0] + r[1, 1] * tree.center[b, 1] + r[1, 2] * tree.center[b, 2]
    z = k.p[b, 2] + r[2, 0] * tree.center[b, 0] + r[2, 1] * tree.center[b, 1] + r[2, 2] * tree.center[b, 2]
    inertia[:, :] = 0.0
    own = tree.inertia[b]
    for i in range(3):
        t0 = r[i, 0] * own[0, 0] + r[i, 1] * own[1, 0] + r[i, 2] * own[2, 0]
        t1 = r[i, 0] * own[0, 1] + r[i, 1] * own[1, 1] + r[i, 2] * own[2, 1]
        t2 = r[i, 0] * own[0, 2] + r[i, 1] * own[1, 2] + r[i, 2] * own[2, 2]
        for j in range(3):
            inertia[i, j] = t0 * r[j, 0] + t1 * r[j, 1] + t2 * r[j, 2]
        inertia[3 + i, 3 + i] = m
    inertia[0, 0] += m * (y * y + z * z)
    inertia[1, 1] += m * (x * x + z * z)
    inertia[2, 2] += m * (x * x + y * y)
    inertia[0, 1] -= m * x * y
    inertia[1, 0] -= m * x * y
    inertia[0, 2] -= m * x * z
    inertia[2, 0] -= m * x * z
    inertia[1, 2] -= m * y * z
    inertia[2, 1] -= m * y * z
    inertia[0, 4] = inertia[4, 0] = -m * z
    inertia[0, 5] = inertia[5, 0] = m * y
    inertia[1, 3] = inertia[3, 1] = m * z
    inertia[1, 5] = inertia[5, 1] = -m * x
    inertia[2, 3] = inertia[3, 2] = -m * y
    inertia[2, 4] = inertia[4, 2] = m * x
    _bias_force(inertia, k.velocity[b], k.bias[b], k.force[b])
    g0, g1, g2 = m * gravity[0], m * gravity[1], m * gravity[2]
    k.force[b, 0] -= y * g2 - z * g1
    k.force[b, 1] -= z * g0 - x * g2
    k.force[b, 2] -= x * g1 - y * g0
    k.force[b, 3] -= g0
    k.force[b, 4] -= g1
    k.force[b, 5] -= g2


@inlined
def _bias_force(inertia: Floats, v: Floats, bias: Floats, force: Floats) -> None:
    """``force`` (6,) = inertia bias + v x* (inertia v)."""
    h0 = h1 = h2 = l0 = l1 = l2 = 0.0
    for j in range(6):
        h0 += inertia[0, j] * v[j]
        h1 += inertia[1, j] * v[j]
        h2 += inertia[2, j] * v[j]
        l0 += inertia[3, j] * v[j]
        l1 += inertia[4, j] * v[j]
        l2 += inertia[5, j] * v[j]
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += inertia[i, j] * bias[j]
        force[i] = total
    force[0] += v[1] * h2 - v[2] * h1 + v[4] * l2 - v[5] * l1
    force[1] += v[2] * h0 - v[0] * h2 + v[5] * l0 - v[3] * l2
    force[2] += v[0] * h1 - v[1] * h0 + v[3] * l1 - v[4] * l0
    force[3] += v[1] * l2 - v[2] * l1
    force[4] += v[2] * l0 - v[0] * l2
    force[5] += v[0] * l1 - v[1] * l0


@inlined
def move(tree: Tree, q: Floats, rates: Floats, base: Floats, gravity: Floats, k: Kinematics) -> None:
    """Place and move every body, and load it with its own inertia and weight.

    Args:
        q, rates: (c,) rad, rad/s; coordinates and their rates.
        base: (6,) m/s, rad/s; velocity of the base's origin and angular velocity, body axes.
        gravity: (3,) m/s^2; body axes.
    """
    for i in range(3):
        k.r[0, i, i] = 1.0
        k.velocity[0, i] = base[3 + i]
        k.velocity[0, 3 + i] = base[i]
    _load_body(tree, 0, gravity, k)
    for b in range(1, tree.mass.shape[0]):
        c = tree.coordinate[b]
        _place_body(tree, b, q[c] if c >= 0 else 0.0, k)
        _move_body(tree.parent[b], b, rates[c] if c >= 0 else 0.0, k)
        _load_body(tree, b, gravity, k)


@laid_in
def add_wrench(k: Kinematics, b: int, point: Floats, force: Floats) -> None:
    """Let a force (3,) in N act on body ``b`` at ``point`` (3,) in m; both in the base's axes, from its origin."""
    k.force[b, 0] -= point[1] * force[2] - point[2] * force[1]
    k.force[b, 1] -= point[2] * force[0] - point[0] * force[2]
    k.force[b, 2] -= point[0] * force[1] - point[1] * force[0]
    for i in range(3):
        k.force[b, 3 + i] -= force[i]


@laid_in
def point_velocity(k: Kinematics, b: int, point: Floats, out: Floats) -> None:
    """Velocity (3,) in m/s of the point of body ``b`` at ``point`` (3,), both in the base's axes."""
    v = k.velocity[b]
    out[0] = v[3] + v[1] * point[2] - v[2] * point[1]
    out[1] = v[4] + v[2] * point[0] - v[0] * point[2]
    out[2] = v[5] + v[0] * point[1] - v[1] * point[0]


@inlined
def assemble(tree: Tree, k: Kinematics, mass: Floats, load: Floats) -> None:
    """Add the tree to ``mass`` (6 + c, 6 + c), upper triangle, and ``load`` (6 + c,); folds the subtrees of ``k``."""
    for b in range(tree.mass.shape[0] - 1, 0, -1):
        up, c = tree.parent[b], tree.coordinate[b]
        if c >= 0:
            for i in range(6):
                k.unit[i] = _dot(k.inertia[b, i], k.s[b])
            mass[BASE + c, BASE + c] += _dot(k.s[b], k.unit)
            column(tree, k, up, k.unit, mass, BASE + c)
            load[BASE + c] -= _dot(k.s[b], k.force[b])
        for i in range(6):
            k.force[up, i] += k.force[b, i]
            for j in range(6):
                k.inertia[up, i, j] += k.inertia[b, i, j]
    for i in range(3):
        load[i] -= k.force[0, 3 + i]
        load[3 + i] -= k.force[0, i]
        for j in range(3):
            mass[i, j] += k.inertia[0, 3 + i, 3 + j]
            mass[3 + i, 3 + j] += k.inertia[0, i, j]
            mass[i, 3 + j] += k.inertia[0, 3 + i, j]


@laid_in
def column(tree: Tree, k: Kinematics, start: int, force: Floats, mass: Floats, at: int) -> None:
    """Fill column ``at`` of ``mass`` with what a unit rate's ``force`` (6,) makes on the base and on the joints of
    body ``start`` and those that it hangs on.
    """
    for i in range(3):
        mass[i, at] += force[3 + i]
        mass[3 + i, at] += force[i]
    b = start
    while b > 0:
        c = tree.coordinate[b]
        if c >= 0:
            row = BASE + c
            mass[min(row, at), max(row, at)] += _dot(k.s[b], force)
        b = tree.parent[b]


@inlined
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inlined
def hold(mass: Floats, load: Floats, held: Integers, rates: Floats) -> None:
    """Impose the rates (n,) of the speeds whose ``held`` (n,) is not zero, keeping ``mass`` symmetric."""
    n = load.shape[0]
    for i in range(n):
        if held[i] == 0:
            continue
        for j in range(n):
            if held[j] == 0:
                load[j] -= (mass[i, j] if i <= j else mass[j, i]) * rates[i]
    for i in range(n):
        if held[i] == 0:
            continue
        for j in range(n):
            mass[i, j] = 0.0
            mass[j, i] = 0.0
        mass[i, i] = 1.0
        load[i] = rates[i]


@inlined
def solve(mass: Floats, load: Floats) -> None:
    """Solve ``mass x = load`` in place (x in ``load``) by a U D U^T of the upper triangle.

    From the last row up: branches of the tree that do not touch stay apart until only the base is left. A matrix that
    is not positive definite leaves not-a-number in ``load``.
    """
    n = load.shape[0]
    for i in range(n - 1, -1, -1):
        pivot = 1.0 / mass[i, i]
        for j in range(i):
            factor = mass[j, i] * pivot
            if factor != 0.0:
                for k in range(j + 1):
                    mass[k, j] -= factor * mass[k, i]
                load[j] -= factor * load[i]
        load[i] *= pivot
    for i in range(n):
        total, pivot = load[i], 1.0 / mass[i, i]
        for k in range(i):
            total -= mass[k, i] * pivot * load[k]
        load[i] = total
