"""A linear model that flies every manoeuvre again: its stroke averages, and what is left of the measured ones.

The model is driven with the tail angle sample by sample and its outputs are then averaged over the same strokes as
the measured ones. Initial states and output biases of each manoeuvre enter linearly: they are projected out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Manoeuvre, Reference
from logs.identification.models.stroke_averaged import TAIL, Discrete, Matrices, discretise, matrices, propagate
from logs.identification.results import Array
from sim_bridge.compiled import njit
from sim_bridge.vectors import Integers

OUTPUTS = ("q", "a_x", "a_z", "theta")
DIFFERENCE = 1e-5
DEPENDENT = 1e-10
"""-; squared length of a combination of nuisances that adds nothing to the others"""


class Problem(NamedTuple):
    """What is fitted to what."""

    manoeuvres: tuple[Manoeuvre, ...]
    reference: Reference
    aircraft: Aircraft
    names: tuple[str, ...]
    outputs: tuple[int, ...]
    """-; columns of `OUTPUTS` that are fitted"""


class Linearised(NamedTuple):
    """All manoeuvres about the present derivatives, nuisances projected out, in standard deviations."""

    residuals: list[Array]
    """(M_i, m); measured minus model"""
    sensitivities: list[Array]
    """(M_i, m, p); of the model's outputs"""
    nuisances: int
    """-; how many were projected out"""


@njit(cache=True)
def _average(weights: Array, columns: Integers, ends: Integers, states: Array, tail: Array, means: Array) -> None:
    """Means (M, 5) of ``states`` (N, 4) and ``tail`` (N,) by the rows of a sparse matrix (M, N)."""
    for row in range(means.shape[0]):
        u = w = q = theta = angle = 0.0
        for at in range(ends[row], ends[row + 1]):
            k, weight = columns[at], weights[at]
            u += weight * states[k, 0]
            w += weight * states[k, 1]
            q += weight * states[k, 2]
            theta += weight * states[k, 3]
            angle += weight * tail[k]
        means[row, 0], means[row, 1], means[row, 2], means[row, 3], means[row, 4] = u, w, q, theta, angle


class Flown(NamedTuple):
    """The model at given derivatives, ready to fly any manoeuvre."""

    model: Matrices
    exact: Discrete
    delay: float
    """s; of the tail beyond what is known of it"""
    lag: float
    """s; of the tail's time constant beyond what is known of it"""

    def driven(self, manoeuvre: Manoeuvre, start: Array) -> Array:
        """Stroke-averaged outputs (M, 4) from the state ``start`` (4,), driven by the manoeuvre's tail angle."""
        return self.averages(manoeuvre, start, self.tail(manoeuvre))

    def tail(self, manoeuvre: Manoeuvre) -> Array:
        """The manoeuvre's tail angle (N,) with what is found of it beyond what is known."""
        angle: Array = manoeuvre.tail - self.delay * manoeuvre.tail_rate + self.lag * manoeuvre.tail_slope
        return angle

    def averages(self, manoeuvre: Manoeuvre, start: Array, tail: Array) -> Array:
        """Stroke-averaged outputs (M, 4) from the state ``start`` (4,), driven by ``tail`` (N,)."""
        means, average = np.empty((len(manoeuvre.at), 5)), manoeuvre.averaging
        states = propagate(self.exact, start, tail)
        _average(average.data, average.indices, average.indptr, states, tail, means)
        outputs: Array = means[:, :-1] @ self.model.c.T
        return outputs + np.outer(means[:, -1], self.model.d)


def flown_at(problem: Problem, values: Array) -> Flown:
    """The model at derivatives ``values`` (p,) of ``problem.names``."""
    given = dict(zip(problem.names, values, strict=True))
    delay, lag = (float(given.pop(name, 0.0)) for name in TAIL)
    model = matrices(tuple(given), np.array(list(given.values())), problem.reference, problem.aircraft)
    first = problem.manoeuvres[0]
    return Flown(model, discretise(model, float(first.time[1] - first.time[0]), first.held), delay, lag)


def _responses(problem: Problem, values: Array, starts: list[Array]) -> list[Array]:
    """Stroke-averaged outputs (M_i, m) of the model, manoeuvre by manoeuvre, from the initial states ``starts``."""
    with np.errstate(over="ignore", invalid="ignore"):
        flown = flown_at(problem, values)
        pairs = zip(problem.manoeuvres, starts, strict=True)
        return [flown.driven(m, start)[:, problem.outputs] for m, start in pairs]


def _nuisance_columns(problem: Problem, flown: Flown, manoeuvre: Manoeuvre, deviation: Array) -> Array:
    """Columns (M m, l): responses to each initial state, a bias of each output and for the pitch a drift."""
    still = np.zeros_like(manoeuvre.tail)
    columns = [flown.averages(manoeuvre, start, still)[:, problem.outputs] for start in np.eye(4)]
    for index, output in enumerate(problem.outputs):
        unit = np.zeros_like(columns[0])
        unit[:, index] = 1.0
        columns.append(unit)
        if OUTPUTS[output] == "theta":
            columns.append(unit * manoeuvre.at[:, None])
    return np.column_stack([(column / deviation).ravel() for column in columns])


class Projected(NamedTuple):
    """One manoeuvre with its nuisances at their optimum."""

    residuals: Array
    """(M, m); measured minus model, in standard deviations"""
    basis: Array
    """(M m, l); orthonormal, of the nuisances"""
    start: Array
    """(4,); initial state"""


def project(problem: Problem, flown: Flown, manoeuvre: Manoeuvre, deviation: Array) -> Projected:
    """What the model leaves of a manoeuvre, in units of ``deviation`` (m,), with its nuisances at their optimum."""
    forced = flown.driven(manoeuvre, np.zeros(4))
    raw = (manoeuvre.averages - forced)[:, problem.outputs] / deviation
    columns = _nuisance_columns(problem, flown, manoeuvre, deviation)
    if not (np.all(np.isfinite(raw)) and np.all(np.isfinite(columns))):  # a step so far off that the model diverges
        return Projected(np.full_like(raw, np.inf), np.zeros((raw.size, 0)), np.zeros(4))
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = np.inf
    scaled = columns / norms
    squared, vectors = np.linalg.eigh(scaled.T @ scaled)
    kept = squared > DEPENDENT * squared[-1]
    weights = vectors[:, kept] / np.sqrt(squared[kept])
    basis = scaled @ weights
    along = basis.T @ raw.ravel()
    coefficients = weights @ along / norms
    return Projected((raw.ravel() - basis @ along).reshape(raw.shape), basis, coefficients[:4])


def projections(problem: Problem, values: Array, deviation: Array) -> list[Projected]:
    """`project` of every manoeuvre at derivatives ``values`` (p,); infinite residuals where the model diverges."""
    with np.errstate(over="ignore", invalid="ignore"):
        flown = flown_at(problem, values)
        return [project(problem, flown, m, deviation) for m in problem.manoeuvres]


def residuals_of(problem: Problem, values: Array, deviation: Array) -> list[Array]:
    """Measured minus model, (M_i, m) of every manoeuvre, in units of ``deviation`` (m,)."""
    return [piece.residuals for piece in projections(problem, values, deviation)]


def without_nuisances(basis: Array, values: Array) -> Array:
    """``values`` (M, m) or (M, m, p) orthogonal to the nuisances' ``basis`` (M m, l)."""
    flat = values.reshape(len(basis), -1)
    rest: Array = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
    return rest


def linearise(problem: Problem, values: Array, deviation: Array) -> Linearised:
    """Residuals and, by central differences at the fitted initial states, sensitivities."""
    pieces = projections(problem, values, deviation)
    starts = [piece.start for piece in pieces]
    slopes: list[list[Array]] = [[] for _ in pieces]
    for index, value in enumerate(values):
        width = np.zeros_like(values)
        width[index] = DIFFERENCE * max(abs(value), 0.1)
        shifted = (_responses(problem, values + sign * width, starts) for sign in (1, -1))
        for column, (ahead, behind) in zip(slopes, zip(*shifted, strict=True), strict=True):
            column.append((ahead - behind) / (2 * width[index] * deviation))
    sensitivities = [
        without_nuisances(piece.basis, np.stack(slope, axis=2)) for piece, slope in zip(pieces, slopes, strict=True)
    ]
    return Linearised([p.residuals for p in pieces], sensitivities, sum(p.basis.shape[1] for p in pieces))


def squares_of(residuals: list[Array]) -> float:
    """Sum of the squares of all ``residuals`` (M_i, m)."""
    with np.errstate(over="ignore"):
        return float(sum(np.sum(piece**2) for piece in residuals))


def spread_of(residuals: list[Array]) -> Array:
    """Root mean square (m,) of each output over all ``residuals`` (M_i, m)."""
    spread: Array = np.sqrt(np.mean(np.vstack(residuals) ** 2, axis=0))
    return spread
