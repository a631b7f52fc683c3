"""Wings on a tree of bodies: strips of a membrane that twists about the leading edge.

A wing sits on a body of the tree, its root at the body's joint: leading edge along the body's y axis (outward: y on
the right, -y on the left), chord along x, upward normal along -z. Its strips may turn about the leading edge by
``eta`` times one more coordinate, the tip twist, leading edge up; the membrane's mass lies at mid-chord. The air's
apparent mass is part of the mass matrix, because the acceleration that it resists is an unknown: it resists the rates
of `Motion.down` and `Motion.pitch_rate`, in air whose velocity at the base's origin is steady in NED and whose
turning is steady in the base's axes. Everything is summed over the strips in the wing's own axes and then carried to
the base once.
"""

from __future__ import annotations

from typing import NamedTuple

from sim_bridge.aerodynamics.protocol import (
    FORWARD,
    INERTIA,
    MASS,
    NOSE_UP,
    OUTWARD,
    UPWARD,
    Motion,
    SectionLoads,
    Strips,
)
from sim_bridge.compiled import inlined, kernel, noalias
from sim_bridge.elementary import QUARTER, sine_and_cosine, small_sine_and_cosine
from sim_bridge.multibody.tree import BASE, Equations, Kinematics, Tree, column
from sim_bridge.vectors import Floats, Indices, Integers

Vector = tuple[float, float, float]


class Wings(NamedTuple):
    """Arrays of all wings of a vehicle; w wings, n strips."""

    strips: Strips
    body: Integers
    """(w,); the body of the tree that a wing sits on"""
    twist: Integers
    """(w,); the coordinate of the tip twist, -1 for a wing that does not twist"""
    flap: Integers
    """(w,); the coordinate that is called the flap angle"""
    first: Indices
    """(w + 1,); the first strip of each wing, and the number of all"""
    side: Floats
    """(w,); +1 for a right wing, -1 for a left one"""
    washout: Floats
    """(w,) rad; built-in twist of the tip, leading edge up"""
    membrane: Floats
    """(n,) kg; of a strip, at mid-chord"""


class WingWork(NamedTuple):
    """Workspace of the wing kernels."""

    motion: Motion
    loads: SectionLoads
    total: Floats
    """(4, n) N, N m; sum of the parts of the loads"""
    sine: Floats
    """(n,); of the section's twist"""
    cosine: Floats
    """(n,)"""
    frame: Floats
    """(w, 5, 6); at each root in wing axes, angular part first: motion of the wing, of the air, of the wing by its
    joints alone; what has a rate without any rate of the speeds: the wing's motion, less gravity, and its motion
    through the air"""
    twist_rate: Floats
    """(w,) rad/s; of the tips"""
    inertia: Floats
    """(6, 6); of one wing at its root, wing axes; upper triangle"""
    wrench: Floats
    """(2, 6); the twist's column and the bias force of one wing"""
    column: Floats
    """(6,); the twist's column about the base's origin"""


@inlined
def wing_motion(k: Kinematics, w: Wings, q: Floats, rates: Floats, outside: Floats, work: WingWork) -> None:
    """Fill ``work.motion`` of all strips, without positions and axes.

    Args:
        q, rates: (c,) coordinates and their rates.
        outside: (9,) gravity m/s^2, then velocity m/s and angular velocity rad/s of the air at the base's origin;
            body axes.
    """
    m = work.motion
    for i in range(3):
        m.body[i] = k.velocity[0, 3 + i] - outside[3 + i]
        m.body[3 + i] = k.velocity[0, i]
    for j in range(w.body.shape[0]):
        theta, theta_rate = w.washout[j], 0.0
        if w.twist[j] >= 0:
            theta += q[w.twist[j]]
            theta_rate = rates[w.twist[j]]
        if w.flap[j] >= 0:
            m.wings[j, 0], m.wings[j, 1] = q[w.flap[j]], rates[w.flap[j]]
        work.twist_rate[j] = theta_rate
        _root(k, w.body[j], outside, work.frame[j])
        _strip_motion(w, j, theta, work)


@inlined
def _root(k: Kinematics, b: int, outside: Floats, frame: Floats) -> None:
    """Fill the rows of one wing's ``frame`` (5, 6), see `WingWork`."""
    _fill_frame(k.r[b], k.p[b], k.velocity[b], k.velocity[0], k.bias[b], outside, frame)


@noalias
def _fill_frame(r: Floats, p: Floats, v: Floats, base: Floats, a: Floats, outside: Floats, frame: Floats) -> None:
    """`_root` of a wing whose body is turned by ``r``, placed at ``p``, with motion ``v`` and bias ``a`` (6,)."""
    g, air, turn = outside[0:3], outside[3:6], outside[6:9]
    w0, w1, w2 = v[0] - base[0], v[1] - base[1], v[2] - base[2]
    v0, v1, v2 = v[3] - base[3], v[4] - base[4], v[5] - base[5]
    _transform_motion(r, p, (v[0], v[1], v[2]), (v[3], v[4], v[5]), frame[0])
    _transform_motion(r, p, (turn[0], turn[1], turn[2]), (air[0], air[1], air[2]), frame[1])
    _transform_motion(r, p, (w0, w1, w2), (v0, v1, v2), frame[2])
    _transform_motion(r, p, (a[0], a[1], a[2]), (a[3] - g[0], a[4] - g[1], a[5] - g[2]), frame[3])
    # In the wing's axes the air's motion has a rate although in the base's axes its turning has none, and in NED's
    # the velocity at the base's origin: V x A of the wing less that of the base, whose axes and origin it goes by.
    turning = (
        a[0] + w1 * turn[2] - w2 * turn[1],
        a[1] + w2 * turn[0] - w0 * turn[2],
        a[2] + w0 * turn[1] - w1 * turn[0],
    )
    along = (
        a[3] + v[1] * air[2] - v[2] * air[1] + v1 * turn[2] - v2 * turn[1],
        a[4] + v[2] * air[0] - v[0] * air[2] + v2 * turn[0] - v0 * turn[2],
        a[5] + v[0] * air[1] - v[1] * air[0] + v0 * turn[1] - v1 * turn[0],
    )
    _transform_motion(r, p, turning, along, frame[4])


@inlined
def _transform_motion(r: Floats, p: Floats, angular: Vector, linear: Vector, row: Floats) -> None:
    """Transform a spatial velocity from base origin and axes to wing root and axes."""
    a0, a1, a2 = angular
    l0 = linear[0] + a1 * p[2] - a2 * p[1]
    l1 = linear[1] + a2 * p[0] - a0 * p[2]
    l2 = linear[2] + a0 * p[1] - a1 * p[0]
    for i in range(3):
        row[i] = r[0, i] * a0 + r[1, i] * a1 + r[2, i] * a2
        row[3 + i] = r[0, i] * l0 + r[1, i] * l1 + r[2, i] * l2


@inlined
def _strip_motion(w: Wings, j: int, theta: float, work: WingWork) -> None:
    m, s, first, last = work.motion, w.strips, w.first[j], w.first[j + 1]
    _turn_strips(first, last, theta, s.eta, work.sine, work.cosine)
    _move_strips(
        first, last, w.side[j], work.twist_rate[j], work.frame[j], s.eta, s.chord, s.span, work.sine, work.cosine,
        m.along, m.down, m.outward, m.pitch_rate, m.plunge,
    )  # fmt: skip


@noalias
def _turn_strips(first: int, last: int, theta: float, eta: Floats, sine: Floats, cosine: Floats) -> None:
    """Sine and cosine of every section's twist; ``eta`` is at most 1."""
    if abs(theta) <= QUARTER:
        for i in range(first, last):
            sine[i], cosine[i] = small_sine_and_cosine(theta * eta[i])
    else:
        for i in range(first, last):
            sine[i], cosine[i] = sine_and_cosine(theta * eta[i])


@noalias
def _move_strips(
    first: int,
    last: int,
    side: float,
    twist_rate: float,
    frame: Floats,
    eta: Floats,
    chord: Floats,
    span: Floats,
    sine: Floats,
    cosine: Floats,
    along: Floats,
    down: Floats,
    outward: Floats,
    pitch_rate: Floats,
    plunge: Floats,
) -> None:
    """Fill the columns of `Motion` for one wing's strips."""
    f, jx, jz, px, pz = frame, frame[2, 0], frame[2, 2], frame[2, 3], frame[2, 5]
    # The section turns through the air at wx, ...; its points move through it likewise.
    wx, wy, wz = f[0, 0] - f[1, 0], f[0, 1] - f[1, 1], f[0, 2] - f[1, 2]
    vx, vy, vz = f[0, 3] - f[1, 3], f[0, 4] - f[1, 4], f[0, 5] - f[1, 5]
    for i in range(first, last):
        half, y = 0.5 * chord[i], side * span[i]
        x, z = -half * cosine[i], half * sine[i]
        turn = wy + eta[i] * twist_rate
        mx = vx + turn * z - wz * y
        my = vy + wz * x - wx * z
        mz = vz + wx * y - turn * x
        along[i] = mx * cosine[i] - mz * sine[i]
        down[i] = mx * sine[i] + mz * cosine[i]
        outward[i] = side * my
        pitch_rate[i] = turn
        plunge[i] = (px - jz * y) * sine[i] + (pz + jx * y) * cosine[i]


@kernel
def wing_places(k: Kinematics, w: Wings, work: WingWork) -> None:
    """Fill positions and axes of ``work.motion`` after `wing_motion`."""
    for j in range(w.body.shape[0]):
        _strip_places(k, w, j, work)


@inlined
def _strip_places(k: Kinematics, w: Wings, j: int, work: WingWork) -> None:
    m, b, side, s = work.motion, w.body[j], w.side[j], w.strips
    for i in range(3):
        rx, ry, rz, p = k.r[b, i, 0], k.r[b, i, 1], k.r[b, i, 2], k.p[b, i]
        for n in range(w.first[j], w.first[j + 1]):
            sine, cosine = work.sine[n], work.cosine[n]
            chord = cosine * rx - sine * rz
            m.axes[0, i, n] = side * ry
            m.axes[1, i, n] = chord
            m.axes[2, i, n] = -sine * rx - cosine * rz
            m.place[i, n] = p + side * s.span[n] * ry - 0.5 * s.chord[n] * chord


@inlined
def add_wings(tree: Tree, k: Kinematics, w: Wings, work: WingWork, equations: Equations) -> None:
    """Add membrane, apparent mass and air loads of the wings to their bodies and twist coordinates.

    After `wing_motion` of the same instant, and with ``work.loads`` filled; `tree.assemble` comes after.
    """
    _sum_parts(work.loads.parts, work.total)
    for j in range(w.body.shape[0]):
        own_load = _sum_forces(w, j, work)
        own_mass = _sum_twist(w, j, work)
        _sum_inertia(w, j, work)
        _carry(k, w.body[j], work)
        if w.twist[j] >= 0:
            at = BASE + w.twist[j]
            equations.mass[at, at] += own_mass
            equations.load[at] += own_load
            column(tree, k, w.body[j], work.column, equations.mass, at)


@noalias
def _sum_parts(parts: Floats, total: Floats) -> None:
    for c in range(4):
        one = total[c]
        for i in range(one.shape[0]):
            one[i] = parts[0, c, i] + parts[1, c, i]
        for p in range(2, parts.shape[0]):
            for i in range(one.shape[0]):
                one[i] += parts[p, c, i]


class _Strip(NamedTuple):
    """Mid-chord of a strip from the wing's root in wing axes, m; how the section is turned and how fast it twists."""

    x: float
    y: float
    z: float
    sine: float
    cosine: float
    spin: float
    """rad/s; about the leading edge, against the wing"""


@inlined
def _strip(w: Wings, j: int, i: int, work: WingWork) -> _Strip:
    half, sine, cosine = 0.5 * w.strips.chord[i], work.sine[i], work.cosine[i]
    spin = w.strips.eta[i] * work.twist_rate[j]
    return _Strip(-half * cosine, w.side[j] * w.strips.span[i], half * sine, sine, cosine, spin)


@inlined
def _membrane_force(at: _Strip, f: Floats) -> tuple[float, float, float]:
    """What a kilogram of membrane takes in wing axes, less its weight; ``f`` is the wing's frame (5, 6)."""
    x, y, z, turn = at.x, at.y, at.z, f[0, 1] + at.spin
    wx, wz = f[0, 0], f[0, 2]
    px = f[0, 3] + turn * z - wz * y
    py = f[0, 4] + wz * x - wx * z
    pz = f[0, 5] + wx * y - turn * x
    sx, sz = f[3, 0] - wz * at.spin, f[3, 2] + wx * at.spin
    return (
        f[3, 3] - f[0, 5] * at.spin + f[3, 1] * z - sz * y + turn * pz - wz * py,
        f[3, 4] + sz * x - sx * z + wz * px - wx * pz,
        f[3, 5] + f[0, 3] * at.spin + sx * y - f[3, 1] * x + wx * py - turn * px,
    )


@inlined
def _rate_down(at: _Strip, f: Floats) -> float:
    """m/s^2; of `Motion.down`, which the apparent mass resists, without any rate of the speeds."""
    bx = f[4, 0] - (f[0, 2] - f[1, 2]) * at.spin
    bz = f[4, 2] + (f[0, 0] - f[1, 0]) * at.spin
    along_x = f[4, 3] - (f[0, 5] - f[1, 5]) * at.spin + f[4, 1] * at.z - bz * at.y
    along_z = f[4, 5] + (f[0, 3] - f[1, 3]) * at.spin + bx * at.y - f[4, 1] * at.x
    return float(at.sine * along_x + at.cosine * along_z)


@inlined
def _sum_forces(w: Wings, j: int, work: WingWork) -> float:
    """Sum what one wing takes without any rate of the speeds, less what the air does to it, at its root.

    In ``work.wrench``; returns the load on the twist.
    """
    f, total, apparent, n = work.frame[j], work.total, work.loads.apparent, work.wrench[1]
    n0 = n1 = n2 = f0 = f1 = f2 = spatial = 0.0
    for i in range(w.first[j], w.first[j + 1]):
        at, m = _strip(w, j, i, work), w.membrane[i]
        gx, gy, gz = _membrane_force(at, f)
        upward, forward = total[UPWARD, i] + apparent[MASS, i] * _rate_down(at, f), total[FORWARD, i]
        fx = m * gx + upward * at.sine - forward * at.cosine
        fy = m * gy - w.side[j] * total[OUTWARD, i]
        fz = m * gz + upward * at.cosine + forward * at.sine
        about = at.z * fx - at.x * fz + apparent[INERTIA, i] * f[4, 1] - total[NOSE_UP, i]
        n0 += at.y * fz - at.z * fy
        n1 += about
        n2 += at.x * fy - at.y * fx
        f0 += fx
        f1 += fy
        f2 += fz
        spatial -= w.strips.eta[i] * about
    n[0], n[1], n[2], n[3], n[4], n[5] = n0, n1, n2, f0, f1, f2
    return spatial


@inlined
def _sum_twist(w: Wings, j: int, work: WingWork) -> float:
    """Sum what a unit rate of one wing's twist takes at its root.

    In ``work.wrench``; returns what it takes along the twist itself.
    """
    s, side, t, apparent = w.strips, w.side[j], work.wrench[0], work.loads.apparent
    t0 = t1 = t2 = t3 = t5 = spatial = 0.0
    for i in range(w.first[j], w.first[j + 1]):
        eta, half, y = s.eta[i], 0.5 * s.chord[i], side * s.span[i]
        mass = w.membrane[i] + apparent[MASS, i]
        fx, fz = eta * half * mass * work.sine[i], eta * half * mass * work.cosine[i]
        about = eta * (half * half * mass + apparent[INERTIA, i])
        t0 += y * fz
        t1 += about
        t2 -= y * fx
        t3 += fx
        t5 += fz
        spatial += eta * about
    t[0], t[1], t[2], t[3], t[4], t[5] = t0, t1, t2, t3, 0.0, t5
    return spatial


@inlined
def _sum_inertia(w: Wings, j: int, work: WingWork) -> None:
    """Sum one wing's inertia at its root, upper triangle of ``work.inertia``.

    A strip's mass is the membrane's m in every direction and the air's besides along the normal: in the plane of the
    section ``mx``, ``mz`` on the diagonal and ``mc`` beside it.
    """
    s, side, c, apparent = w.strips, w.side[j], work.inertia, work.loads.apparent
    i00 = i01 = i02 = i03 = i04 = i05 = i11 = i12 = i13 = i15 = 0.0
    i22 = i23 = i24 = i25 = i33 = i35 = i44 = i55 = 0.0
    for i in range(w.first[j], w.first[j + 1]):
        sine, cosine, half, y = work.sine[i], work.cosine[i], 0.5 * s.chord[i], side * s.span[i]
        m, a, x, z = w.membrane[i], apparent[MASS, i], -half * cosine, half * sine
        mx, mz, mc = m + a * sine * sine, m + a * cosine * cosine, a * sine * cosine
        fx, fz = half * (m + a) * sine, half * (m + a) * cosine
        i00 += mz * y * y + m * z * z
        i01 += y * fz
        i02 -= m * x * z + mc * y * y
        i03 += y * mc
        i04 -= m * z
        i05 += y * mz
        i11 += half * half * (m + a) + apparent[INERTIA, i]
        i12 -= y * fx
        i13 += fx
        i15 += fz
        i22 += m * x * x + mx * y * y
        i23 -= y * mx
        i24 += m * x
        i25 -= y * mc
        i33 += mx
        i35 += mc
        i44 += m
        i55 += mz
    c[0, 0], c[0, 1], c[0, 2], c[0, 3], c[0, 4], c[0, 5] = i00, i01, i02, i03, i04, i05
    c[1, 1], c[1, 2], c[1, 3], c[1, 4], c[1, 5] = i11, i12, i13, 0.0, i15
    c[2, 2], c[2, 3], c[2, 4], c[2, 5] = i22, i23, i24, i25
    c[3, 3], c[3, 4], c[3, 5], c[4, 4], c[4, 5], c[5, 5] = i33, 0.0, i35, i44, 0.0, i55


@inlined
def _carry(k: Kinematics, b: int, work: WingWork) -> None:
    """Add the wing's sums, at the root in wing axes, to body ``b`` about the base's origin."""
    _carry_inertia(k.r[b], k.p[b], work.inertia, k.inertia[b])
    for i in range(6):
        work.column[i] = 0.0
    _add_wrench(k.r[b], k.p[b], work.wrench[0], work.column)
    _add_wrench(k.r[b], k.p[b], work.wrench[1], k.force[b])


@noalias
def _carry_inertia(r: Floats, p: Floats, spatial: Floats, out: Floats) -> None:
    """Add a spatial inertia ``spatial`` (6, 6), at ``p`` in axes turned by ``r``, to ``out``; upper triangles.

    With its blocks A, B, D of turning, both and moving: a force at ``p`` has the moment p x F about the origin.
    """
    c = spatial
    a = _turned(r, ((c[0, 0], c[0, 1], c[0, 2]), (c[0, 1], c[1, 1], c[1, 2]), (c[0, 2], c[1, 2], c[2, 2])))
    b = _turned(r, ((c[0, 3], c[0, 4], c[0, 5]), (c[1, 3], c[1, 4], c[1, 5]), (c[2, 3], c[2, 4], c[2, 5])))
    d = _turned(r, ((c[3, 3], c[3, 4], c[3, 5]), (c[3, 4], c[4, 4], c[4, 5]), (c[3, 5], c[4, 5], c[5, 5])))
    x, y, z = p[0], p[1], p[2]
    # B + p x D, then A + p x B^T + (B + p x D) (p x)^T.
    b0, b1, b2 = b
    d0, d1, d2 = d
    e0 = (b0[0] + y * d2[0] - z * d1[0], b0[1] + y * d2[1] - z * d1[1], b0[2] + y * d2[2] - z * d1[2])
    e1 = (b1[0] + z * d0[0] - x * d2[0], b1[1] + z * d0[1] - x * d2[1], b1[2] + z * d0[2] - x * d2[2])
    e2 = (b2[0] + x * d1[0] - y * d0[0], b2[1] + x * d1[1] - y * d0[1], b2[2] + x * d1[2] - y * d0[2])
    out[0, 0] += a[0][0] + y * b0[2] - z * b0[1] + y * e0[2] - z * e0[1]
    out[0, 1] += a[0][1] + y * b1[2] - z * b1[1] + z * e0[0] - x * e0[2]
    out[0, 2] += a[0][2] + y * b2[2] - z * b2[1] + x * e0[1] - y * e0[0]
    out[1, 1] += a[1][1] + z * b1[0] - x * b1[2] + z * e1[0] - x * e1[2]
    out[1, 2] += a[1][2] + z * b2[0] - x * b2[2] + x * e1[1] - y * e1[0]
    out[2, 2] += a[2][2] + x * b2[1] - y * b2[0] + x * e2[1] - y * e2[0]
    for j in range(3):
        out[0, 3 + j] += e0[j]
        out[1, 3 + j] += e1[j]
        out[2, 3 + j] += e2[j]
    out[3, 3] += d0[0]
    out[3, 4] += d0[1]
    out[3, 5] += d0[2]
    out[4, 4] += d1[1]
    out[4, 5] += d1[2]
    out[5, 5] += d2[2]


@inlined
def _turned(r: Floats, a: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
    """r a r^T."""
    return _row(r, 0, a), _row(r, 1, a), _row(r, 2, a)


@inlined
def _row(r: Floats, i: int, a: tuple[Vector, Vector, Vector]) -> Vector:
    x = r[i, 0] * a[0][0] + r[i, 1] * a[1][0] + r[i, 2] * a[2][0]
    y = r[i, 0] * a[0][1] + r[i, 1] * a[1][1] + r[i, 2] * a[2][1]
    z = r[i, 0] * a[0][2] + r[i, 1] * a[1][2] + r[i, 2] * a[2][2]
    return (
        x * r[0, 0] + y * r[0, 1] + z * r[0, 2],
        x * r[1, 0] + y * r[1, 1] + z * r[1, 2],
        x * r[2, 0] + y * r[2, 1] + z * r[2, 2],
    )


@noalias
def _add_wrench(r: Floats, p: Floats, wrench: Floats, out: Floats) -> None:
    """Add ``wrench`` (6,), at the root in wing axes, to ``out`` about the base's origin."""
    f0 = r[0, 0] * wrench[3] + r[0, 1] * wrench[4] + r[0, 2] * wrench[5]
    f1 = r[1, 0] * wrench[3] + r[1, 1] * wrench[4] + r[1, 2] * wrench[5]
    f2 = r[2, 0] * wrench[3] + r[2, 1] * wrench[4] + r[2, 2] * wrench[5]
    for i in range(3):
        out[i] += r[i, 0] * wrench[0] + r[i, 1] * wrench[1] + r[i, 2] * wrench[2]
    out[0] += p[1] * f2 - p[2] * f1
    out[1] += p[2] * f0 - p[0] * f2
    out[2] += p[0] * f1 - p[1] * f0
    out[3] += f0
    out[4] += f1
    out[5] += f2
