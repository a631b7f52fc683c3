"""Equations of motion of a fuselage with two flapping, twisting wings.

Ten speeds ``u``: velocity of the fuselage's centre of mass and angular velocity in body axes (FRD), then flap and
tip-twist rate of the left and of the right wing. Newton-Euler equations projected on the partial velocities
(Kane's form of the Boltzmann-Hamel equations, Grauer Eq. 1-7): ``M(q) du/dt = Q``. The wing's mass sits in points
on the leading-edge spar and at mid-chord of every strip; the membrane twists linearly from root to tip. The
apparent mass of the air is part of M, because the acceleration that it resists is an unknown.
"""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.aerodynamics.strip_theory import StripParameters, section_loads
from sim_bridge.vectors import Floats, kernel

SPEEDS = 10
FLAP = (6, 8)
TWIST = (7, 9)


@kernel
def clear(mass: Floats, load: Floats) -> None:
    """Set the mass matrix (10, 10) and the generalised load (10,) to zero."""
    mass[:, :] = 0.0
    load[:] = 0.0


@kernel
def add_fuselage(mass: Floats, load: Floats, m: float, inertia: Floats, v: Floats, omega: Floats) -> None:
    """Add the fuselage: ``m`` in kg, ``inertia`` = (Ixx, Iyy, Izz, Ixz) about its centre of mass; no gravity."""
    for i in range(3):
        mass[i, i] += m
        mass[3 + i, 3 + i] += inertia[i]
    mass[3, 5] -= inertia[3]
    mass[5, 3] -= inertia[3]
    load[0] -= m * (omega[1] * v[2] - omega[2] * v[1])
    load[1] -= m * (omega[2] * v[0] - omega[0] * v[2])
    load[2] -= m * (omega[0] * v[1] - omega[1] * v[0])
    h0 = inertia[0] * omega[0] - inertia[3] * omega[2]
    h1 = inertia[1] * omega[1]
    h2 = inertia[2] * omega[2] - inertia[3] * omega[0]
    load[3] -= omega[1] * h2 - omega[2] * h1
    load[4] -= omega[2] * h0 - omega[0] * h2
    load[5] -= omega[0] * h1 - omega[1] * h0


@kernel
def add_force(load: Floats, point: Floats, force: Floats, flap: int) -> None:
    """Project a force (3,) at a wing point onto the speeds; ``point`` as `wing_point` fills it."""
    load[0] += force[0]
    load[1] += force[1]
    load[2] += force[2]
    load[3] += point[1] * force[2] - point[2] * force[1]
    load[4] += point[2] * force[0] - point[0] * force[2]
    load[5] += point[0] * force[1] - point[1] * force[0]
    load[flap] += point[3] * force[0] + point[4] * force[1] + point[5] * force[2]
    load[flap + 1] += point[6] * force[0] + point[7] * force[1] + point[8] * force[2]


@kernel
def add_body_force(load: Floats, x: float, y: float, z: float, force: Floats) -> None:
    """Project a force (3,) at a point of the fuselage onto the speeds."""
    load[0] += force[0]
    load[1] += force[1]
    load[2] += force[2]
    load[3] += y * force[2] - z * force[1]
    load[4] += z * force[0] - x * force[2]
    load[5] += x * force[1] - y * force[0]


@kernel
def add_mass_point(mass: Floats, load: Floats, point: Floats, m: float, gravity: Floats, flap: int) -> None:
    """Add a point mass of the wing; only the upper triangle of ``mass`` is filled."""
    x, y, z = point[0], point[1], point[2]
    mass[0, 0] += m
    mass[1, 1] += m
    mass[2, 2] += m
    mass[0, 4] += m * z
    mass[0, 5] -= m * y
    mass[1, 3] -= m * z
    mass[1, 5] += m * x
    mass[2, 3] += m * y
    mass[2, 4] -= m * x
    mass[3, 3] += m * (y * y + z * z)
    mass[4, 4] += m * (x * x + z * z)
    mass[5, 5] += m * (x * x + y * y)
    mass[3, 4] -= m * x * y
    mass[3, 5] -= m * x * z
    mass[4, 5] -= m * y * z
    for k in range(2):
        a0, a1, a2 = m * point[3 + 3 * k], m * point[4 + 3 * k], m * point[5 + 3 * k]
        j = flap + k
        mass[0, j] += a0
        mass[1, j] += a1
        mass[2, j] += a2
        mass[3, j] += y * a2 - z * a1
        mass[4, j] += z * a0 - x * a2
        mass[5, j] += x * a1 - y * a0
        mass[j, j] += a0 * point[3 + 3 * k] + a1 * point[4 + 3 * k] + a2 * point[5 + 3 * k]
        if k == 1:
            mass[flap, j] += a0 * point[3] + a1 * point[4] + a2 * point[5]
    inertial = (m * (gravity[0] - point[9]), m * (gravity[1] - point[10]), m * (gravity[2] - point[11]))
    load[0] += inertial[0]
    load[1] += inertial[1]
    load[2] += inertial[2]
    load[3] += y * inertial[2] - z * inertial[1]
    load[4] += z * inertial[0] - x * inertial[2]
    load[5] += x * inertial[1] - y * inertial[0]
    load[flap] += point[3] * inertial[0] + point[4] * inertial[1] + point[5] * inertial[2]
    load[flap + 1] += point[6] * inertial[0] + point[7] * inertial[1] + point[8] * inertial[2]


@kernel
def add_apparent_mass(mass: Floats, load: Floats, row: Floats, m: float, bias: float, flap: int) -> None:
    """Add mass that resists acceleration along one direction: ``row`` (8,) maps the wing's speeds to it.

    The force is ``-m (row du/dt + bias)``; only the upper triangle of ``mass`` is filled.
    """
    for i in range(8):
        gi = i if i < 6 else flap + i - 6
        weighted = m * row[i]
        load[gi] -= weighted * bias
        for k in range(i, 8):
            gk = k if k < 6 else flap + k - 6
            mass[gi, gk] += weighted * row[k]


@kernel
def wing_axes(c: float, s: float, twist: float, side: float, hinge: Floats, axes: Floats) -> None:
    """Unit vectors of a wing section in body axes.

    Args:
        c, s: cosine and sine of the flap angle, wing up positive. twist: rad; of the section, leading edge up.
        side: +1 for the right wing, -1 for the left.
        hinge: (3, 3) r_frd_from_hinge.
        axes: (5, 3) out: span to the tip, chord forward, normal up, flap normal (without twist), forward
            direction of the hinge.
    """
    ct, st = math.cos(twist), math.sin(twist)
    up_y, up_z = -side * s, -c
    for i in range(3):
        hx, hy, hz = hinge[i, 0], hinge[i, 1], hinge[i, 2]
        axes[0, i] = side * c * hy - s * hz
        axes[3, i] = up_y * hy + up_z * hz
        axes[4, i] = hx
        axes[1, i] = ct * hx + st * axes[3, i]
        axes[2, i] = -st * hx + ct * axes[3, i]


@kernel
def wing_point(
    span: float, aft: float, eta: float, twist: float, axes: Floats, rates: Floats, frame: Floats, point: Floats
) -> None:
    """A point of the wing: position, partial velocities, velocity-product acceleration.

    Args:
        span, aft: m; distance from the hinge, and behind the leading edge. eta: span over semispan.
        rates: (2,) flap and tip-twist rate, rad/s.
        frame: (5, 3) hinge position, velocity and angular velocity of the body, the rest as for `add_wing`.
        point: (18,) out: position 0-2, partial velocity of the flap 3-5 and twist rate 6-8, velocity-product
            acceleration 9-11, velocity 12-14; 15-17 spare.
    """
    sine, cosine = math.sin(twist), math.cos(twist)
    flap_rate, twist_rate = rates[0], rates[1]
    for i in range(3):
        point[i] = frame[0, i] + span * axes[0, i] - aft * axes[1, i]
        point[3 + i] = span * axes[3, i] + aft * sine * axes[0, i]
        point[6 + i] = -eta * aft * axes[2, i]
        second = (-span * axes[0, i] + aft * sine * axes[3, i]) * flap_rate * flap_rate
        second += 2.0 * eta * aft * cosine * axes[0, i] * flap_rate * twist_rate
        second += eta * eta * aft * axes[1, i] * twist_rate * twist_rate
        point[9 + i] = second
    v, w = frame[1], frame[2]
    x, y, z = point[0], point[1], point[2]
    rx = point[3] * flap_rate + point[6] * twist_rate
    ry = point[4] * flap_rate + point[7] * twist_rate
    rz = point[5] * flap_rate + point[8] * twist_rate
    tx = w[1] * z - w[2] * y
    ty = w[2] * x - w[0] * z
    tz = w[0] * y - w[1] * x
    point[12] = v[0] + tx + rx
    point[13] = v[1] + ty + ry
    point[14] = v[2] + tz + rz
    ax, ay, az = v[0] + tx + 2.0 * rx, v[1] + ty + 2.0 * ry, v[2] + tz + 2.0 * rz
    point[9] += w[1] * az - w[2] * ay
    point[10] += w[2] * ax - w[0] * az
    point[11] += w[0] * ay - w[1] * ax


@kernel
def normal_row(point: Floats, direction: Floats, row: Floats) -> None:
    """Fill ``row`` (8,): speeds of body and wing to the speed of ``point`` along ``direction`` (3,)."""
    d0, d1, d2 = direction[0], direction[1], direction[2]
    row[0] = d0
    row[1] = d1
    row[2] = d2
    row[3] = point[1] * d2 - point[2] * d1
    row[4] = point[2] * d0 - point[0] * d2
    row[5] = point[0] * d1 - point[1] * d0
    row[6] = point[3] * d0 + point[4] * d1 + point[5] * d2
    row[7] = point[6] * d0 + point[7] * d1 + point[8] * d2


@kernel
def add_wing(
    mass: Floats,
    load: Floats,
    state: Floats,
    side: float,
    strips: Floats,
    hinge: Floats,
    frame: Floats,
    lags: Floats,
    lag_rates: Floats,
    density: float,
    section: StripParameters,
    washout: float,
    work: Floats,
    loads: Floats,
) -> None:
    """Add one wing's inertia and air loads.

    Args:
        state: (4,) flap angle, tip twist, flap rate, tip-twist rate.
        side: +1 right, -1 left.
        strips: (n, 6) span m, eta, chord m, width m, spar mass kg, membrane mass kg.
        hinge: (3, 3) r_frd_from_hinge; frame: (5, 3) hinge position, velocity and angular velocity of the body,
            velocity of the air, gravity, all in body axes.
        lags, lag_rates: (n,) wake states in m/s and their rates (out).
        work: (8, 18) scratch. loads: (n, 6) out: force in body axes and moment about the body's origin.
    """
    flap = 8 if side > 0.0 else 6
    axes, le, half, row, force = work[0:5, 0:3], work[5], work[6], work[7, 0:8], work[7, 8:11]
    motion, out, turn = work[0, 4:9], work[1, 4:10], work[2, 4:7]
    rates = state[2:4]
    cosine, sine = math.cos(state[0]), math.sin(state[0])
    for i in range(strips.shape[0]):
        span, eta, chord, width = strips[i, 0], strips[i, 1], strips[i, 2], strips[i, 3]
        twist = (state[1] + washout) * eta
        wing_axes(cosine, sine, twist, side, hinge, axes)
        wing_point(span, 0.0, eta, twist, axes, rates, frame, le)
        wing_point(span, 0.5 * chord, eta, twist, axes, rates, frame, half)
        add_mass_point(mass, load, le, strips[i, 4], frame[4], flap)
        add_mass_point(mass, load, half, strips[i, 5], frame[4], flap)
        pitch_rate = side * (frame[2, 0] * axes[0, 0] + frame[2, 1] * axes[0, 1] + frame[2, 2] * axes[0, 2])
        pitch_rate += eta * state[3]
        along, plunge, down = 0.0, 0.0, 0.0
        for k in range(3):
            along += (le[12 + k] - frame[3, k]) * axes[1, k]
            plunge -= le[3 + k] * rates[0] * axes[2, k]
            down -= (half[12 + k] - frame[3, k]) * axes[2, k]
        motion[0], motion[1], motion[2] = along, plunge, down
        motion[3], motion[4] = down + 0.25 * chord * pitch_rate, pitch_rate
        section_loads(motion, chord, density, lags[i], section, out)
        lag_rates[i] = out[3]
        for k in range(3):
            turn[k] = frame[2, k] - side * state[2] * axes[4, k] + side * eta * state[3] * axes[0, k]
        # The apparent mass resists d(w_n)/dt of the relative velocity, whose direction turns with the section.
        bias = 0.0
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            turned = turn[k1] * axes[2, k2] - turn[k2] * axes[2, k1]
            bias += half[9 + k] * axes[2, k] + (half[12 + k] - frame[3, k]) * turned
        normal_row(half, axes[2], row)
        apparent = out[4] * width
        add_apparent_mass(mass, load, row, apparent, bias, flap)
        speed = abs(along)
        for k in range(3):
            row[k] = 0.0
            row[3 + k] = side * axes[0, k]
        row[6] = 0.0
        row[7] = eta
        add_apparent_mass(mass, load, row, apparent * chord * chord / 32.0, 0.0, flap)
        couple = -0.25 * apparent * chord * speed * pitch_rate
        for k in range(3):
            load[3 + k] += couple * side * axes[0, k]
            loads[i, 3 + k] = couple * side * axes[0, k]
            force[k] = (out[0] + out[1]) * axes[2, k] + out[2] * axes[1, k]
            loads[i, k] = force[k] * width
        load[flap + 1] += couple * eta
        quarter_share = 0.25 * chord * out[0] * width
        for k in range(3):
            force[k] = loads[i, k]
        add_force(load, half, force, flap)
        # The circulatory force acts a quarter chord ahead of the middle: a couple about the span.
        for k in range(3):
            load[3 + k] += quarter_share * side * axes[0, k]
            loads[i, 3 + k] += quarter_share * side * axes[0, k]
        load[flap + 1] += quarter_share * eta
        loads[i, 3] += half[1] * force[2] - half[2] * force[1]
        loads[i, 4] += half[2] * force[0] - half[0] * force[2]
        loads[i, 5] += half[0] * force[1] - half[1] * force[0]


@kernel
def hold_speeds(mass: Floats, load: Floats, rates: Floats, first: int, last: int) -> None:
    """Impose the rates of speeds ``first`` to ``last - 1`` (from ``rates``), keeping ``mass`` symmetric."""
    for i in range(first, last):
        for j in range(SPEEDS):
            if j < first or j >= last:
                load[j] -= _symmetric(mass, i, j) * rates[i]
    for i in range(first, last):
        for j in range(SPEEDS):
            mass[i, j] = 0.0
            mass[j, i] = 0.0
        mass[i, i] = 1.0
        load[i] = rates[i]


@kernel
def _symmetric(mass: Floats, i: int, j: int) -> float:
    return float(mass[i, j] if i <= j else mass[j, i])


@kernel
def solve(mass: Floats, load: Floats) -> None:
    """Solve ``mass x = load`` in place (x in ``load``) by an LDL^T of the upper triangle.

    A matrix that is not positive definite leaves not-a-number in ``load``.
    """
    n = SPEEDS
    for i in range(n):
        pivot = mass[i, i]
        for j in range(i + 1, n):
            factor = mass[i, j] / pivot
            if factor != 0.0:
                for k in range(j, n):
                    mass[j, k] -= factor * mass[i, k]
                load[j] -= factor * load[i]
    for i in range(n - 1, -1, -1):
        total = load[i]
        for k in range(i + 1, n):
            total -= mass[i, k] * load[k]
        load[i] = total / mass[i, i]


def hinge_rotation(incidence: float) -> Floats:
    """r_frd_from_hinge (3, 3) of a flapping axis raised by ``incidence`` rad at the front."""
    c, s = math.cos(incidence), math.sin(incidence)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
