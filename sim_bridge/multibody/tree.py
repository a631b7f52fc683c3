"""Equations of motion of a tree of rigid bodies on a free base.

Spatial vectors (angular part first) of every body refer to one point, the base's origin, in the base's axes
(FRD). Inertias of a subtree then add up without a transformation, and the mass matrix is Featherstone's composite
rigid body algorithm in a few dot products: ``M(q) du/dt = Q``, the Boltzmann-Hamel equations of Grauer Eq. 1-7 and
Sibilski Eq. 1-22 for the quasi-velocities ``u``: velocity of the base's origin and angular velocity in body axes,
then the rate of every coordinate. In these axes the spatial acceleration of the base is the component-wise rate of
its speeds, so that the velocity products need no special case.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import inlined, inlined_internal, noalias
from sim_bridge.elementary import sine_and_cosine
from sim_bridge.vectors import Floats, Integers
from wingbeat.errors import InputError

Vector = tuple[float, float, float]
Symmetric = tuple[float, float, float, float, float, float]
"""xx, xy, xz, yy, yz, zz"""

BASE = 6
"""speeds of the base, before those of the coordinates"""
ROUNDING = 0.02
"""-; by which moments of inertia, given with two digits, may violate the triangle inequality"""


class Body(NamedTuple):
    """A rigid body and its joint to the parent; its axes are FRD with all joints at zero."""

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
    """Arrays of a tree of bodies; the base is body 0, a parent precedes its children."""

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
    turning: Floats
    """(b, 2, 3, 3); what sine, and 1 less cosine, of the joint's angle add to ``rotation`` (Rodrigues)"""
    mass: Floats
    """(b,) kg"""
    center: Floats
    """(b, 3) m"""
    inertia: Floats
    """(b, 3, 3) kg m^2; about the centre of mass, body's axes"""


class Kinematics(NamedTuple):
    """Positions, velocities and loads of the bodies, filled by `move`."""

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
    """(b, 6, 6); spatial, about the base's origin, upper half; after `assemble` of the subtree, the base's full"""
    force: Floats
    """(b, 6) N m, N; what the bias motion takes less what acts on the body, about the base's origin"""
    local: Floats
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
    """Build the tree of ``bodies``; also returns the names of its coordinates.

    Raises:
        InputError: as `parents_first`, which also gives the order of the bodies in the tree.
    """
    ordered = parents_first(bodies)
    index = {body.name: i for i, body in enumerate(ordered)}
    names = [body.name for body in ordered[1:] if any(body.axis)]
    coordinate = [names.index(body.name) if body.name in names else -1 for body in ordered]
    axes = np.array([body.axis for body in ordered], dtype=np.float64)
    lengths = np.linalg.norm(axes, axis=1)
    axes[lengths > 0.0] /= lengths[lengths > 0.0, None]
    rotation = np.array([body.rotation for body in ordered], dtype=np.float64)
    tree = Tree(
        parent=np.array([index.get(body.parent, -1) for body in ordered], dtype=np.int64),
        coordinate=np.array(coordinate, dtype=np.int64),
        place=np.array([body.place for body in ordered], dtype=np.float64),
        rotation=rotation,
        axis=axes,
        turning=_turning(rotation, axes),
        mass=np.array([body.mass for body in ordered], dtype=np.float64),
        center=np.array([body.center for body in ordered], dtype=np.float64),
        inertia=np.array([inertia_matrix(body.inertia) for body in ordered]),
    )
    return tree, names


def _turning(rotation: Floats, axes: Floats) -> Floats:
    """`Tree.turning` of bodies turned by ``rotation`` (b, 3, 3) at zero angle."""
    x, y, z = axes.T
    none = np.zeros_like(x)
    across = np.stack((none, -z, y, z, none, -x, -y, x, none), axis=1).reshape(-1, 3, 3)
    return np.stack((rotation @ across, rotation @ across @ across), axis=1)


def inertia_matrix(inertia: tuple[float, float, float, float, float, float]) -> Floats:
    """Inertia matrix (3, 3) in kg m^2 from xx, yy, zz and the products xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])


def parents_first(bodies: list[Body]) -> list[Body]:
    """Sort the bodies so that the base is first and each follows its parent.

    Raises:
        InputError: no base or several, a parent that is unknown or comes round to the body itself, a repeated name, a
            leaf without mass, moments of inertia that no body has.
    """
    named = {body.name: body for body in bodies}
    if len(named) != len(bodies):
        twice = next(body.name for body in bodies if sum(other.name == body.name for other in bodies) > 1)
        raise InputError(f'body "{twice}" is there twice')
    bases = [body for body in bodies if not body.parent]
    if len(bases) > 1:
        first, second = bases[:2]
        raise InputError(f'bodies.{second.name}.parent is missing: "{first.name}" is the base already')
    for body in bodies:
        if body.parent and body.parent not in named:
            raise InputError(
                f'bodies.{body.name}.parent = "{body.parent}" is not one of the bodies: {", ".join(named)}'
            )
    ordered = bases
    while len(ordered) < len(bodies):
        done = {body.name for body in ordered}
        ready = [body for body in bodies if body.parent in done and body.name not in done]
        if not ready:
            loop = _loop(next(body for body in bodies if body.name not in done), named)
            raise InputError(f'bodies.{loop[0]}.parent = "{loop[1]}" makes a loop: {" on ".join(loop)}')
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
            raise InputError(f"bodies.{body.name}.mass = 0 kg: a leaf without mass would accelerate without bound")


def _check_inertia(body: Body) -> None:
    least, middle, greatest = np.linalg.eigvalsh(inertia_matrix(body.inertia)).tolist()
    if least < -ROUNDING * greatest or greatest > (1.0 + ROUNDING) * (least + middle):
        moments = f"{least:.3g}, {middle:.3g}, {greatest:.3g} kg m^2"
        raise InputError(
            f"bodies.{body.name}.inertia has principal moments {moments}: none may be negative or exceed the sum of "
            "the others"
        )


def blank_kinematics(tree: Tree) -> Kinematics:
    """Allocate the kinematics of ``tree``."""
    b = tree.mass.shape[0]
    return Kinematics(
        r=np.zeros((b, 3, 3)),
        p=np.zeros((b, 3)),
        s=np.zeros((b, 6)),
        velocity=np.zeros((b, 6)),
        bias=np.zeros((b, 6)),
        inertia=np.zeros((b, 6, 6)),
        force=np.zeros((b, 6)),
        local=np.zeros((3, 3)),
        unit=np.zeros(6),
    )


@inlined
def _place_body(tree: Tree, b: int, angle: float, k: Kinematics) -> None:
    up = tree.parent[b]
    _place(
        angle, tree.place[b], tree.rotation[b], tree.turning[b], tree.axis[b], k.r[up], k.p[up], k.local,
        k.r[b], k.p[b], k.s[b],
    )  # fmt: skip


@noalias
def _place(
    angle: float,
    place: Floats,
    zero: Floats,
    turning: Floats,
    axis: Floats,
    up_r: Floats,
    up_p: Floats,
    local: Floats,
    r: Floats,
    p: Floats,
    s: Floats,
) -> None:
    """Fill ``r``, ``p`` and ``s`` of a body whose parent's are ``up_r`` and ``up_p``."""
    sine, cosine = sine_and_cosine(angle)
    rest = 1.0 - cosine
    for i in range(3):
        for j in range(3):
            local[i, j] = zero[i, j] + sine * turning[0, i, j] + rest * turning[1, i, j]
    for i in range(3):
        r0, r1, r2 = up_r[i, 0], up_r[i, 1], up_r[i, 2]
        p[i] = up_p[i] + r0 * place[0] + r1 * place[1] + r2 * place[2]
        for j in range(3):
            r[i, j] = r0 * local[0, j] + r1 * local[1, j] + r2 * local[2, j]
        s[i] = r[i, 0] * axis[0] + r[i, 1] * axis[1] + r[i, 2] * axis[2]
    s[3] = p[1] * s[2] - p[2] * s[1]
    s[4] = p[2] * s[0] - p[0] * s[2]
    s[5] = p[0] * s[1] - p[1] * s[0]


@inlined
def _move_body(up: int, b: int, rate: float, k: Kinematics) -> None:
    _add_joint(rate, k.s[b], k.velocity[up], k.bias[up], k.velocity[b], k.bias[b])


@noalias
def _add_joint(rate: float, s: Floats, up: Floats, up_bias: Floats, velocity: Floats, bias: Floats) -> None:
    """Fill ``velocity`` and ``bias`` of a body that turns on one moving at ``up`` (6,): its own is v x s rate."""
    v0, v1, v2, v3, v4, v5 = up[0], up[1], up[2], up[3], up[4], up[5]
    j0, j1, j2, j3, j4, j5 = rate * s[0], rate * s[1], rate * s[2], rate * s[3], rate * s[4], rate * s[5]
    velocity[0], velocity[1], velocity[2] = v0 + j0, v1 + j1, v2 + j2
    velocity[3], velocity[4], velocity[5] = v3 + j3, v4 + j4, v5 + j5
    bias[0] = up_bias[0] + v1 * j2 - v2 * j1
    bias[1] = up_bias[1] + v2 * j0 - v0 * j2
    bias[2] = up_bias[2] + v0 * j1 - v1 * j0
    bias[3] = up_bias[3] + v1 * j5 - v2 * j4 + v4 * j2 - v5 * j1
    bias[4] = up_bias[4] + v2 * j3 - v0 * j5 + v5 * j0 - v3 * j2
    bias[5] = up_bias[5] + v0 * j4 - v1 * j3 + v3 * j1 - v4 * j0


@inlined
def _load_body(tree: Tree, b: int, gravity: Floats, k: Kinematics) -> None:
    """Set the body's own inertia and the force of its bias motion and weight."""
    _load(
        tree.mass[b], tree.center[b], tree.inertia[b], gravity, k.r[b], k.p[b], k.velocity[b], k.bias[b],
        k.inertia[b], k.force[b],
    )  # fmt: skip


@noalias
def _load(
    m: float,
    center: Floats,
    central: Floats,
    gravity: Floats,
    r: Floats,
    p: Floats,
    v: Floats,
    a: Floats,
    inertia: Floats,
    force: Floats,
) -> None:
    """Fill ``inertia`` (6, 6) and ``force`` (6,) of one body by Newton and Euler about its centre of mass."""
    w0, w1, w2 = v[0], v[1], v[2]
    x = p[0] + r[0, 0] * center[0] + r[0, 1] * center[1] + r[0, 2] * center[2]
    y = p[1] + r[1, 0] * center[0] + r[1, 1] * center[1] + r[1, 2] * center[2]
    z = p[2] + r[2, 0] * center[0] + r[2, 1] * center[1] + r[2, 2] * center[2]
    ixx, ixy, ixz, iyy, iyz, izz = _turned(r, central)
    # The velocity of the centre of mass, then m times its acceleration less gravity.
    vx, vy, vz = v[3] + w1 * z - w2 * y, v[4] + w2 * x - w0 * z, v[5] + w0 * y - w1 * x
    fx = m * (a[3] + a[1] * z - a[2] * y + w1 * vz - w2 * vy - gravity[0])
    fy = m * (a[4] + a[2] * x - a[0] * z + w2 * vx - w0 * vz - gravity[1])
    fz = m * (a[5] + a[0] * y - a[1] * x + w0 * vy - w1 * vx - gravity[2])
    hx, hy, hz = ixx * w0 + ixy * w1 + ixz * w2, ixy * w0 + iyy * w1 + iyz * w2, ixz * w0 + iyz * w1 + izz * w2
    force[0] = ixx * a[0] + ixy * a[1] + ixz * a[2] + w1 * hz - w2 * hy + y * fz - z * fy
    force[1] = ixy * a[0] + iyy * a[1] + iyz * a[2] + w2 * hx - w0 * hz + z * fx - x * fz
    force[2] = ixz * a[0] + iyz * a[1] + izz * a[2] + w0 * hy - w1 * hx + x * fy - y * fx
    force[3], force[4], force[5] = fx, fy, fz
    mx, my, mz = m * x, m * y, m * z
    inertia[0, 0], inertia[0, 1], inertia[0, 2] = ixx + my * y + mz * z, ixy - mx * y, ixz - mx * z
    inertia[1, 1], inertia[1, 2], inertia[2, 2] = iyy + mx * x + mz * z, iyz - my * z, izz + mx * x + my * y
    inertia[0, 3], inertia[0, 4], inertia[0, 5] = 0.0, -mz, my
    inertia[1, 3], inertia[1, 4], inertia[1, 5] = mz, 0.0, -mx
    inertia[2, 3], inertia[2, 4], inertia[2, 5] = -my, mx, 0.0
    inertia[3, 3], inertia[3, 4], inertia[3, 5] = m, 0.0, 0.0
    inertia[4, 4], inertia[4, 5], inertia[5, 5] = m, 0.0, m


@inlined
def _turned(r: Floats, central: Floats) -> Symmetric:
    """xx, xy, xz, yy, yz, zz of a symmetric ``central`` (3, 3), turned: r own r^T."""
    x0, x1, x2 = _row(r, 0, central)
    y0, y1, y2 = _row(r, 1, central)
    z0, z1, z2 = _row(r, 2, central)
    return (
        x0 * r[0, 0] + x1 * r[0, 1] + x2 * r[0, 2],
        x0 * r[1, 0] + x1 * r[1, 1] + x2 * r[1, 2],
        x0 * r[2, 0] + x1 * r[2, 1] + x2 * r[2, 2],
        y0 * r[1, 0] + y1 * r[1, 1] + y2 * r[1, 2],
        y0 * r[2, 0] + y1 * r[2, 1] + y2 * r[2, 2],
        z0 * r[2, 0] + z1 * r[2, 1] + z2 * r[2, 2],
    )


@inlined
def _row(r: Floats, i: int, central: Floats) -> Vector:
    """Row ``i`` of r own."""
    return (
        r[i, 0] * central[0, 0] + r[i, 1] * central[1, 0] + r[i, 2] * central[2, 0],
        r[i, 0] * central[0, 1] + r[i, 1] * central[1, 1] + r[i, 2] * central[2, 1],
        r[i, 0] * central[0, 2] + r[i, 1] * central[1, 2] + r[i, 2] * central[2, 2],
    )


@inlined
def move(tree: Tree, q: Floats, rates: Floats, base: Floats, gravity: Floats, k: Kinematics) -> None:
    """Compute the motion of every body and its inertial and gravity loads.

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


@inlined_internal
def add_wrench(k: Kinematics, b: int, point: Floats, force: Floats) -> None:
    """Add a force (3,) in N on body ``b`` at ``point`` (3,) in m; both in the base's axes, from its origin."""
    k.force[b, 0] -= point[1] * force[2] - point[2] * force[1]
    k.force[b, 1] -= point[2] * force[0] - point[0] * force[2]
    k.force[b, 2] -= point[0] * force[1] - point[1] * force[0]
    for i in range(3):
        k.force[b, 3 + i] -= force[i]


@inlined
def assemble(tree: Tree, k: Kinematics, mass: Floats, load: Floats) -> None:
    """Add the tree to ``mass`` (6 + c, 6 + c), upper triangle, and ``load`` (6 + c,); folds the subtrees of ``k``."""
    for b in range(tree.mass.shape[0] - 1, 0, -1):
        up, c = tree.parent[b], tree.coordinate[b]
        if c >= 0:
            _times(k.inertia[b], k.s[b], k.unit)
            mass[BASE + c, BASE + c] += _dot(k.s[b], k.unit)
            column(tree, k, up, k.unit, mass, BASE + c)
            load[BASE + c] -= _dot(k.s[b], k.force[b])
        _fold(k.inertia[b], k.force[b], k.inertia[up], k.force[up])
    _add_base(k.inertia[0], k.force[0], mass, load)


@noalias
def _times(inertia: Floats, s: Floats, out: Floats) -> None:
    """``out`` (6,) = ``inertia`` (6, 6) of an upper triangle times ``s`` (6,)."""
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += inertia[min(i, j), max(i, j)] * s[j]
        out[i] = total


@noalias
def _fold(inertia: Floats, force: Floats, onto: Floats, force_onto: Floats) -> None:
    """Add a subtree's inertia, upper triangle, and force to those of the body that it hangs on."""
    for i in range(6):
        force_onto[i] += force[i]
        for j in range(6):
            if j >= i:
                onto[i, j] += inertia[i, j]


@noalias
def _add_base(inertia: Floats, force: Floats, mass: Floats, load: Floats) -> None:
    """Add the whole tree to the equations of the base, and fill its ``inertia`` below the diagonal."""
    for i in range(6):
        for j in range(6):
            if j < i:
                inertia[i, j] = inertia[j, i]
    for i in range(3):
        load[i] -= force[3 + i]
        load[3 + i] -= force[i]
        for j in range(3):
            mass[i, 3 + j] += inertia[3 + i, j]
            if j >= i:
                mass[i, j] += inertia[3 + i, 3 + j]
                mass[3 + i, 3 + j] += inertia[i, j]


@inlined_internal
def column(tree: Tree, k: Kinematics, start: int, force: Floats, mass: Floats, at: int) -> None:
    """Fill column ``at`` of ``mass`` with what a unit rate's ``force`` (6,) makes on the base and on the joints of
    body ``start`` and those that it hangs on.
    """
    _add_to_base(force, mass, at)
    b = start
    while b > 0:
        c = tree.coordinate[b]
        if c >= 0:
            row = BASE + c
            mass[min(row, at), max(row, at)] += _dot(k.s[b], force)
        b = tree.parent[b]


@noalias
def _add_to_base(force: Floats, mass: Floats, at: int) -> None:
    for i in range(3):
        mass[i, at] += force[3 + i]
        mass[3 + i, at] += force[i]


@inlined
def _dot(a: Floats, b: Floats) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5])


@inlined
def impose(mass: Floats, load: Floats, is_imposed: Integers, rates: Floats) -> None:
    """Impose the rates (n,) of the speeds with ``is_imposed`` (n,) not zero, in the upper triangle of ``mass``."""
    n = load.shape[0]
    for i in range(n):
        if is_imposed[i] == 0:
            continue
        rate = rates[i]
        for j in range(i):
            if is_imposed[j] == 0:
                load[j] -= mass[j, i] * rate
            mass[j, i] = 0.0
        for j in range(i + 1, n):
            if is_imposed[j] == 0:
                load[j] -= mass[i, j] * rate
            mass[i, j] = 0.0
        mass[i, i] = 1.0
        load[i] = rate


@inlined
def solve(mass: Floats, load: Floats) -> None:
    """Solve ``mass x = load`` in place (x in ``load``) of six speeds of the base and any number of others.

    The others go first, by a U D U^T of the upper triangle from the last row up: branches of the tree that do not
    touch stay apart until only the base is left. A matrix that is not positive definite may leave not-a-number in
    ``load``.
    """
    n = load.shape[0]
    for i in range(n - 1, BASE - 1, -1):
        _eliminate(mass, load, i)
    _solve_base(mass, load)
    for i in range(BASE, n):
        total, row = 0.0, mass[i]
        for k in range(i):
            total += row[k] * load[k]
        load[i] -= row[i] * total


@inlined
def _eliminate(mass: Floats, load: Floats, i: int) -> None:
    """Take the speed ``i`` out of the equations of those before it; leaves the inverse of its pivot in its place."""
    pivot = 1.0 / mass[i, i]
    value = load[i] * pivot
    load[i], mass[i, i] = value, pivot
    # Its column lies side by side in its row, of which nothing below the diagonal is in use.
    row = mass[i]
    for j in range(i):
        row[j] = mass[j, i]
    _take_off_base(row, pivot, value, mass, load)
    for j in range(BASE, i):
        if row[j] != 0.0:
            load[j] -= row[j] * value
            factor = row[j] * pivot
            for k in range(j + 1):
                mass[k, j] -= factor * row[k]


@noalias
def _take_off_base(row: Floats, pivot: float, value: float, mass: Floats, load: Floats) -> None:
    """What eliminating a speed takes off the base's equations."""
    for i in range(BASE):
        load[i] -= row[i] * value
        factor = row[i] * pivot
        for j in range(BASE):
            if j >= i:
                mass[i, j] -= factor * row[j]


@noalias
def _solve_base(mass: Floats, load: Floats) -> None:
    """Solve for the base's six speeds, its turning taken out of the equations of its moving.

    Of [[D, B], [B^T, A]] [v, w] = [f, n]: (D - B A^-1 B^T) v = f - B A^-1 n and w = A^-1 (n - B^T v).
    """
    a, n = _inverse(mass, 3), (load[3], load[4], load[5])
    b0 = (mass[0, 3], mass[0, 4], mass[0, 5])
    b1 = (mass[1, 3], mass[1, 4], mass[1, 5])
    b2 = (mass[2, 3], mass[2, 4], mass[2, 5])
    g0, g1, g2 = _of(a, b0), _of(a, b1), _of(a, b2)
    mass[0, 0] -= _inner(g0, b0)
    mass[0, 1] -= _inner(g0, b1)
    mass[0, 2] -= _inner(g0, b2)
    mass[1, 1] -= _inner(g1, b1)
    mass[1, 2] -= _inner(g1, b2)
    mass[2, 2] -= _inner(g2, b2)
    v = _of(_inverse(mass, 0), (load[0] - _inner(g0, n), load[1] - _inner(g1, n), load[2] - _inner(g2, n)))
    w = _of(a, n)
    load[0], load[1], load[2] = v
    load[3] = w[0] - g0[0] * v[0] - g1[0] * v[1] - g2[0] * v[2]
    load[4] = w[1] - g0[1] * v[0] - g1[1] * v[1] - g2[1] * v[2]
    load[5] = w[2] - g0[2] * v[0] - g1[2] * v[1] - g2[2] * v[2]


@inlined
def _inverse(mass: Floats, at: int) -> Symmetric:
    """xx, xy, xz, yy, yz, zz of the inverse of the block of three from ``at`` on the diagonal of ``mass``."""
    xx, xy, xz = mass[at, at], mass[at, at + 1], mass[at, at + 2]
    yy, yz, zz = mass[at + 1, at + 1], mass[at + 1, at + 2], mass[at + 2, at + 2]
    cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    share = 1.0 / (xx * cxx + xy * cxy + xz * cxz)
    return (
        share * cxx, share * cxy, share * cxz,
        share * (xx * zz - xz * xz), share * (xy * xz - xx * yz), share * (xx * yy - xy * xy),
    )  # fmt: skip


@inlined
def _of(m: Symmetric, v: Vector) -> Vector:
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[1] * v[0] + m[3] * v[1] + m[4] * v[2],
        m[2] * v[0] + m[4] * v[1] + m[5] * v[2],
    )


@inlined
def _inner(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
