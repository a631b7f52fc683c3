"""Linear longitudinal motion of the stroke-averaged aircraft (Malladi Eq. 26-28; states u, w, q, theta).

Aerodynamic forces per mass and moments per inertia are linear in the states and the tail angle:
``f_x = X_u u + X_w w + X_q q + X_delta delta``, the same for ``f_z`` (Z) and the pitch acceleration (M); the
rest is kinematics and gravity. Z_w is Malladi's Z_alpha / V, M_w his M_alpha / V; what the wings' apparent
mass and downwash lag add is contained in the derivatives.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.results import Array
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY

REGRESSORS = ("u", "w", "q", "delta")
UNITS = {
    "X_u": "1/s", "X_w": "1/s", "X_q": "m/s/rad", "X_delta": "m/s^2/rad",
    "Z_u": "1/s", "Z_w": "1/s", "Z_q": "m/s/rad", "Z_delta": "m/s^2/rad",
    "M_u": "rad/s/m", "M_w": "rad/s/m", "M_q": "1/s", "M_delta": "1/s^2",
    "tail_delay": "s", "tail_time_constant": "s",
}  # fmt: skip
TAIL_DELAY, TAIL_LAG = TAIL = ("tail_delay", "tail_time_constant")
"""what the tail has beyond what is known of it; output error finds it, to first order, where it is asked for"""
LONGITUDINAL = tuple(name for name in UNITS if name not in TAIL)
"""all derivatives: short period and speed together"""
SHORT_PERIOD = ("Z_w", "Z_q", "Z_delta", "M_w", "M_q", "M_delta")
"""the speed taken as constant"""


class Matrices(NamedTuple):
    """State space ``x' = A x + B delta``, ``y = C x + D delta``; x = (u, w, q, theta), y = (q, a_x, a_z, theta)."""

    a: Array
    """(4, 4)"""
    b: Array
    """(4,)"""
    c: Array
    """(4, 4); a_x and a_z are specific forces at the IMU"""
    d: Array
    """(4,)"""


class Discrete(NamedTuple):
    """Exact step over one sample: ``x[k+1] = F x[k] + G0 delta[k] + G1 delta[k+1]``."""

    f: Array
    """(4, 4)"""
    g0: Array
    """(4,)"""
    g1: Array
    """(4,)"""


def matrices(names: tuple[str, ...], values: Array, reference: Reference, aircraft: Aircraft) -> Matrices:
    """State space of derivatives ``names`` with ``values`` (p,); derivatives that are not named are zero.

    Without any X the speed is constant: the state u stays zero.
    """
    given = dict(zip(names, values, strict=True))
    force = np.array([[given.get(f"{axis}_{r}", 0.0) for r in REGRESSORS] for axis in "XZM"])
    (x, z, m), free_speed = force, any(name.startswith("X") for name in names)
    sin, cos = np.sin(reference.pitch), np.cos(reference.pitch)
    a, b = np.zeros((4, 4)), np.zeros(4)
    if free_speed:
        a[0] = [x[0], x[1], x[2] - reference.w, -STANDARD_GRAVITY * cos]
        b[0] = x[3]
    a[1] = [z[0], z[1], z[2] + reference.u, -STANDARD_GRAVITY * sin]
    a[2, :3] = m[:3]
    a[3, 2] = 1.0
    b[1:3] = z[3], m[3]
    at_imu_x, at_imu_z = x + aircraft.imu_z * m, z - aircraft.imu_x * m
    c = np.array([[0, 0, 1, 0], [*at_imu_x[:3], 0], [*at_imu_z[:3], 0], [0, 0, 0, 1]], dtype=float)
    return Matrices(a, b, c, np.array([0.0, at_imu_x[3], at_imu_z[3], 0.0]))


@njit(cache=True)
def multiply(a: Array, b: Array, out: Array) -> None:
    """``a b`` into ``out``, in compiled code and without BLAS."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
            for k in range(a.shape[1]):
                out[i, j] += a[i, k] * b[k, j]


@njit(cache=True)
def _sum_series(small: Array, halvings: int, total: Array, term: Array, spare: Array) -> None:
    """Taylor's series of ``small`` (n, n), squared ``halvings`` times, in ``total``; that and ``term`` begin as one.

    Scalar loops on what was allocated outside: whole-array expressions take ten seconds to compile.
    """
    n = small.shape[0]
    for order in range(1, 13):
        multiply(term, small, spare)
        for i in range(n):
            for j in range(n):
                term[i, j] = spare[i, j] / order
                total[i, j] += term[i, j]
    for _ in range(halvings):
        multiply(total, total, spare)
        for i in range(n):
            for j in range(n):
                total[i, j] = spare[i, j]


def _exponential(matrix: Array) -> Array:
    """Matrix exponential (n, n) by scaling, Taylor and squaring, without BLAS.

    A fit takes hundreds of these 6 by 6 matrices; through BLAS, whose threads wait for a busy core, one took 5 ms.
    """
    n = len(matrix)
    halvings = max(0, int(np.ceil(np.log2(np.max(np.abs(matrix)) * n + 1e-30))) + 3)
    total = np.eye(n)
    _sum_series(matrix / 2.0**halvings, halvings, total, np.eye(n), np.empty((n, n)))
    return total


def discretise(model: Matrices, step: float, held: bool) -> Discrete:
    """Exact discretisation for an input that is ``held`` over the step, or linear within it (triangular hold)."""
    block = np.zeros((6, 6))
    block[:4, :4], block[:4, 4], block[4, 5] = model.a * step, model.b * step, 1.0
    exact = _exponential(block)
    whole, ramp = exact[:4, 4], exact[:4, 5]
    return Discrete(exact[:4, :4], whole, np.zeros(4)) if held else Discrete(exact[:4, :4], whole - ramp, ramp)


@njit(cache=True)
def _carry(f: Array, g0: Array, g1: Array, tail: Array, states: Array) -> None:
    """States (N, n) of ``x[k+1] = f x[k] + g0 tail[k] + g1 tail[k+1]``, from the first."""
    for k in range(states.shape[0] - 1):
        for i in range(states.shape[1]):
            total = g0[i] * tail[k] + g1[i] * tail[k + 1]
            for j in range(states.shape[1]):
                total += f[i, j] * states[k, j]
            states[k + 1, i] = total


def propagate(exact: Discrete, start: Array, tail: Array) -> Array:
    """States (N, n) from ``start`` (n,), driven by the input ``tail`` (N,)."""
    states = np.zeros((len(tail), len(start)))
    states[0] = start
    _carry(exact.f, exact.g0, exact.g1, tail, states)
    return states


def modes_matrix(model: Matrices, names: tuple[str, ...]) -> Array:
    """The part of A that has the modes: (u, w, q, theta), or (w, q) where the speed is constant."""
    return model.a if any(name.startswith("X") for name in names) else model.a[1:3, 1:3]
