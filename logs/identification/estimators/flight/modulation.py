"""A stroke that modulates the derivatives: forces and moments in step with the wing's phase times the motion.

Over a stroke the air meets wings at other speeds and other angles: Z_w and its like swing about their means at the
flapping frequency. To first order the swing adds forces (w, q) (sin, cos)(phase) with constant factors (the averaging
of Bogoliubov & Mitropolsky, Asymptotic Methods in the Theory of Non-Linear Oscillations, 1961, ch. 5, carried to the
first order). A stroke average does not take them out, the model of the mean derivatives has no place for them, and
what they leave in the residuals is no noise: it depends on the phases at which the inputs came. So the factors are
nuisances that all manoeuvres share. What the motion that they cause is swung by in turn, the second order, is found
with the factors as they came out and taken off the measured outputs: of derivatives that swing by 0.3 it is half a
per cent of their means.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.maneuvers import Manoeuvre
from logs.identification.models.stroke_averaged import Discrete, Matrices, discretise, propagate
from logs.identification.results import Array

LEAST_MANOEUVRES = 3
"""-; from which on inputs came at phases enough for the factors to be told"""
DEPENDENT = 1e-8
"""-; squared length of a combination of factors that adds nothing to the others"""


class Cleared(NamedTuple):
    """What is left of residuals and sensitivities where the factors are at their best."""

    residuals: list[Array]
    """(M_i, m)"""
    sensitivities: list[Array]
    """(M_i, m, p)"""
    factors: int
    """-; how many were told from one another"""


def products(manoeuvre: Manoeuvre, states: Array) -> Array:
    """w sin, w cos, q sin, q cos (N, 4) of the wing's phase, of ``states`` (N, 4) u, w, q, theta."""
    turn = 2 * np.pi * manoeuvre.strokes
    waves = (np.sin(turn), np.cos(turn))
    return np.column_stack([states[:, state] * wave for state in (1, 2) for wave in waves])


def factors_of(residuals: list[Array], columns: list[Array], sizes: Array, together: float) -> Array:
    """The factors (f,) that ``residuals`` (M_i, m) ask for, ``columns`` (M_i, m, f) being what each of them adds.

    Both are in standard deviations, of noise that ``together`` samples have in common. A derivative of the ``sizes``
    (f,) swings by about as much as itself, or less: that is the prior (ridge regression: Hoerl & Kennard,
    Technometrics 12, 1970), without which inputs that always came at the same phase would give any factor.
    """
    free = sizes > 0
    whole = np.vstack([piece.reshape(-1, piece.shape[2]) for piece in columns])[:, free] * sizes[free]
    rest = np.concatenate([piece.ravel() for piece in residuals])
    factors = np.zeros(len(sizes))
    factors[free] = np.linalg.solve(whole.T @ whole + together * np.eye(whole.shape[1]), whole.T @ rest) * sizes[free]
    return factors


def swing(manoeuvre: Manoeuvre, states: Array, factors: Array) -> Array:
    """Accelerations (N, 3) along x, along z and in pitch that ``factors`` (3 * 4,) make of ``states`` (N, 4)."""
    pushed: Array = products(manoeuvre, states) @ factors.reshape(3, -1).T
    return pushed


def responses(model: Matrices, manoeuvre: Manoeuvre, forcing: Array, imu: tuple[float, float]) -> Array:
    """Stroke-averaged outputs (M, 4, 3 k) of each ``forcing`` (N, k) along x, along z and in pitch.

    ``imu`` is its place (x, z) in m, which the pitch acceleration moves.
    """
    columns = []
    for exact, direct in zip(pushes(model, manoeuvre), felt_at(imu), strict=True):
        for force in forcing.T:
            states = propagate(exact, np.zeros(4), force)
            columns.append(manoeuvre.averaging @ (states @ model.c.T + np.outer(force, direct)))
    return np.stack(columns, axis=2)


def pushes(model: Matrices, manoeuvre: Manoeuvre) -> list[Discrete]:
    """The model driven by accelerations along x, along z and in pitch, lines between the manoeuvre's samples."""
    step = float(manoeuvre.time[1] - manoeuvre.time[0])
    return [discretise(model._replace(b=axis), step, False) for axis in np.eye(4)[:3]]


def felt_at(imu: tuple[float, float]) -> Array:
    """What (3, 4) these accelerations add to the outputs as such, of an IMU at ``imu`` (x, z) in m."""
    return np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, imu[1], -imu[0], 0]], dtype=np.float64)


def cleared(residuals: list[Array], sensitivities: list[Array], columns: list[Array]) -> Cleared:
    """``residuals`` (M_i, m) and ``sensitivities`` (M_i, m, p) orthogonal to the factors' ``columns`` (M_i, m, f)."""
    whole = np.vstack([piece.reshape(-1, piece.shape[2]) for piece in columns])
    norms = np.maximum(np.linalg.norm(whole, axis=0), 1e-300)
    squared, vectors = np.linalg.eigh((whole / norms).T @ (whole / norms))
    kept = squared > DEPENDENT * squared[-1]
    basis = (whole / norms) @ (vectors[:, kept] / np.sqrt(squared[kept]))
    ends = np.cumsum([piece.shape[0] * piece.shape[1] for piece in columns])[:-1]

    def rest(values: list[Array]) -> list[Array]:
        flat = np.vstack([piece.reshape(basis_rows, -1) for piece, basis_rows in zip(values, rows, strict=True)])
        left = flat - basis @ (basis.T @ flat)
        return [part.reshape(piece.shape) for part, piece in zip(np.split(left, ends), values, strict=True)]

    rows = [piece.shape[0] * piece.shape[1] for piece in columns]
    return Cleared(rest(residuals), rest(sensitivities), int(np.count_nonzero(kept)))
