"""Motion of a point of a rigid body from its rates and specific forces, and what errors of these do to it.

Klein & Morelli, Aircraft System Identification, 2006, chapter 10: with the specific force f at that point,
v_dot = f + g(phi, theta) - omega x v, the Euler angles' rates from omega, and the position's from v. No aerodynamics,
no mass: whatever flies moves so. The integration is of fourth order (Runge-Kutta), the inputs
cubic between samples.
"""

from __future__ import annotations

import numpy as np

from logs.identification.results import Array
from sim_bridge.compiled import njit

STATES = ("u", "v", "w", "phi", "theta", "psi", "altitude", "north", "east")
STATE_UNITS = ("m/s", "m/s", "m/s", "rad", "rad", "rad", "m", "m", "m")
INPUTS = ("p", "q", "r", "a_x", "a_y", "a_z")
DYNAMIC = 6
"""-; states that others depend on, the first of `STATES`"""


@njit(cache=True)
def _slopes(x: Array, inputs: Array, gravity: float, out: Array) -> None:
    u, v, w, p, q, r = x[0], x[1], x[2], inputs[0], inputs[1], inputs[2]
    sin_phi, cos_phi, sin_theta, cos_theta = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4])
    sin_psi, cos_psi = np.sin(x[5]), np.cos(x[5])
    turn = q * sin_phi + r * cos_phi
    out[0] = inputs[3] - gravity * sin_theta + r * v - q * w
    out[1] = inputs[4] + gravity * cos_theta * sin_phi + p * w - r * u
    out[2] = inputs[5] + gravity * cos_theta * cos_phi + q * u - p * v
    out[3] = p + turn * sin_theta / cos_theta
    out[4] = q * cos_phi - r * sin_phi
    out[5] = turn / cos_theta
    sunk = v * sin_phi + w * cos_phi
    across = v * cos_phi - w * sin_phi
    ahead = u * cos_theta + sunk * sin_theta
    out[6] = u * sin_theta - sunk * cos_theta
    out[7] = ahead * cos_psi - across * sin_psi
    out[8] = ahead * sin_psi + across * cos_psi


@njit(cache=True)
def _step(x: Array, inputs: Array, dt: float, gravity: float, work: Array, out: Array) -> None:
    """One step of Runge-Kutta from ``x`` (9,), ``inputs`` (3, 6) at its begin, middle and end; ``work`` is (2, 9)."""
    slope, trial = work[0], work[1]
    for i in range(9):
        out[i] = trial[i] = x[i]
    for stage in range(4):
        _slopes(trial, inputs[(stage + 1) // 2], gravity, slope)
        share = dt / 6 if stage == 0 or stage == 3 else dt / 3
        ahead = dt if stage == 2 else dt / 2
        for i in range(9):
            out[i] += share * slope[i]
            trial[i] = x[i] + ahead * slope[i]


@njit(cache=True)
def _fly(inputs: Array, dt: float, gravity: float, states: Array) -> None:
    work = np.zeros((2, 9))
    for k in range(states.shape[0] - 1):
        _step(states[k], inputs[2 * k : 2 * k + 3], dt, gravity, work, states[k + 1])


@njit(cache=True)
def _linearise(states: Array, inputs: Array, dt: float, gravity: float, carry: Array, gain: Array) -> None:
    """Jacobians of every step by state (N - 1, 9, 9) and by inputs that shift all along it (N - 1, 9, 6)."""
    work, ends, x, near = np.zeros((2, 9)), np.zeros((2, 9)), np.zeros(9), np.zeros((3, 6))
    for k in range(states.shape[0] - 1):
        for j in range(12):
            width = 1e-4 if j < 3 else 1e-5
            for side in range(2):
                shift = width if side == 0 else -width
                for i in range(9):
                    x[i] = states[k, i] + (shift if i == j and j < DYNAMIC else 0.0)
                for n in range(3):
                    for i in range(6):
                        near[n, i] = inputs[2 * k + n, i] + (shift if i == j - DYNAMIC else 0.0)
                _step(x, near, dt, gravity, work, ends[side])
            for i in range(9):
                slope = (ends[0, i] - ends[1, i]) / (2 * width)
                if j < DYNAMIC:
                    carry[k, i, j] = slope
                else:
                    gain[k, i, j - DYNAMIC] = slope
        for i in range(6, 9):
            carry[k, i, i] = 1.0


@njit(cache=True)
def _carry_on(carry: Array, gain: Array, pushes: Array, slopes: Array) -> None:
    """Slopes of the states (N, 9, p), from the first, under the inputs' slopes ``pushes`` (N, 6, p)."""
    for k in range(slopes.shape[0] - 1):
        for i in range(9):
            for j in range(slopes.shape[2]):
                total = 0.0
                for n in range(9):
                    total += carry[k, i, n] * slopes[k, n, j]
                for n in range(6):
                    total += gain[k, i, n] * 0.5 * (pushes[k, n, j] + pushes[k + 1, n, j])
                slopes[k + 1, i, j] = total


@njit(cache=True)
def _carry_back(carry: Array, gain: Array, weights: Array, pulls: Array) -> None:
    """Adjoint of `_carry_on`: slopes (N, 6, p) by each input of sums of the states weighted with (N, 9, p)."""
    behind, now = weights[-1].copy(), weights[-1].copy()
    for k in range(weights.shape[0] - 2, -1, -1):
        for j in range(weights.shape[2]):
            for n in range(6):
                total = 0.0
                for i in range(9):
                    total += 0.5 * gain[k, i, n] * behind[i, j]
                pulls[k, n, j] += total
                pulls[k + 1, n, j] += total
            for n in range(9):
                total = weights[k, n, j]
                for i in range(9):
                    total += carry[k, i, n] * behind[i, j]
                now[n, j] = total
        behind, now = now, behind


def with_middles(inputs: Array) -> Array:
    """Inputs (2 N - 1, 6) with those half way between the samples (N, 6), by cubics through four of them."""
    dense = np.empty((2 * len(inputs) - 1, 6))
    dense[::2] = inputs
    dense[1::2] = (inputs[1:] + inputs[:-1]) / 2
    dense[3:-3:2] += (inputs[1:-2] + inputs[2:-1] - inputs[:-3] - inputs[3:]) / 16
    return dense


def fly(start: Array, inputs: Array, dt: float, gravity: float) -> Array:
    """States (N, 9) as in `STATES` from ``start`` (9,) under ``inputs`` (N, 6) as in `INPUTS`, ``dt`` s apart."""
    return flown(start, with_middles(inputs), dt, gravity)


def flown(start: Array, inputs: Array, dt: float, gravity: float) -> Array:
    """States (N, 9) as `fly` gives them, the inputs (2 N - 1, 6) `with_middles`."""
    states = np.zeros((len(inputs) // 2 + 1, 9))
    states[0] = start
    _fly(inputs, dt, gravity, states)
    return states


def jacobians(states: Array, inputs: Array, dt: float, gravity: float) -> tuple[Array, Array]:
    """Of every step by the state before it (N - 1, 9, 9) and by the inputs over it (N - 1, 9, 6)."""
    return linearised(states, with_middles(inputs), dt, gravity)


def linearised(states: Array, inputs: Array, dt: float, gravity: float) -> tuple[Array, Array]:
    """The `jacobians` along ``states`` (N, 9) under inputs (2 N - 1, 6) `with_middles`."""
    carry, gain = np.zeros((len(states) - 1, 9, 9)), np.zeros((len(states) - 1, 9, 6))
    _linearise(states, inputs, dt, gravity, carry, gain)
    return carry, gain


def state_slopes(steps: tuple[Array, Array], first: Array, pushes: Array) -> Array:
    """Slopes of all states (N, 9, p) by p parameters: ``first`` (9, p) of the first state, ``pushes`` (N, 6, p) of
    the inputs; ``steps`` are the `jacobians`."""
    slopes = np.zeros((len(pushes), *first.shape))
    slopes[0] = first
    _carry_on(*steps, np.ascontiguousarray(pushes), slopes)
    return slopes


def input_slopes(steps: tuple[Array, Array], weights: Array) -> Array:
    """Slopes (N, 6, p) by every sample of the inputs of p sums of all states with the ``weights`` (N, 9, p)."""
    pulls = np.zeros((len(weights), 6, weights.shape[2]))
    _carry_back(*steps, np.ascontiguousarray(weights), pulls)
    return pulls
