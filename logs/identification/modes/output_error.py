"""Maximum-likelihood output error: the model flies every manoeuvre again and its outputs are fitted to the measured.

Gauss-Newton on the derivatives (Klein & Morelli, Aircraft System Identification, 2006, ch. 6; Jategaonkar,
Flight Vehicle System Identification, 2006, ch. 4). The model is driven with the tail angle sample by sample
and its outputs are then averaged over the same strokes as the measured ones. Initial states and output
biases of each manoeuvre enter linearly: they are projected out, so that the errors of the derivatives contain
theirs. Standard errors are Cramer-Rao bounds corrected for coloured residuals; with several manoeuvres
the scatter between them, which tells what the model lacks, is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.data import Aircraft
from logs.identification.modes.equation_error import DerivativeFit, failed
from logs.identification.modes.errors import coloured_spread, information
from logs.identification.modes.longitudinal import TAIL, Discrete, Matrices, discretise, matrices
from logs.identification.preparing.manoeuvre import OUTPUT_STEP, Manoeuvre, Reference
from logs.identification.results import Array
from sim_bridge.vectors import Integers, njit

OUTPUTS = ("q", "a_x", "a_z", "theta")
ITERATIONS = 40
CONVERGED = 2e-2
"""-; largest step, in standard errors"""
DIFFERENCE = 1e-5
LAG_STROKES = 2.0
DEPENDENT = 1e-10
"""-; squared length of a combination of nuisances that adds nothing to the others"""
WORST_CONDITION = 1e5


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
def _carry(f: Array, g0: Array, g1: Array, tail: Array, states: Array) -> None:
    """States (N, n) of ``x[k+1] = f x[k] + g0 tail[k] + g1 tail[k+1]``, from the first."""
    for k in range(states.shape[0] - 1):
        for i in range(states.shape[1]):
            total = g0[i] * tail[k] + g1[i] * tail[k + 1]
            for j in range(states.shape[1]):
                total += f[i, j] * states[k, j]
            states[k + 1, i] = total


def _propagate(exact: Discrete, start: Array, tail: Array) -> Array:
    """States (N, n) from ``start`` (n,), driven by ``tail`` (N,)."""
    states = np.zeros((len(tail), len(start)))
    states[0] = start
    _carry(exact.f, exact.g0, exact.g1, tail, states)
    return states


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
        states = _propagate(self.exact, start, tail)
        _average(average.data, average.indices, average.indptr, states, tail, means)
        outputs: Array = means[:, :-1] @ self.model.c.T
        return outputs + np.outer(means[:, -1], self.model.d)


def _flown(problem: Problem, values: Array) -> Flown:
    given = dict(zip(problem.names, values, strict=True))
    delay, lag = (float(given.pop(name, 0.0)) for name in TAIL)
    model = matrices(tuple(given), np.array(list(given.values())), problem.reference, problem.aircraft)
    first = problem.manoeuvres[0]
    return Flown(model, discretise(model, float(first.time[1] - first.time[0]), first.held), delay, lag)


def _responses(problem: Problem, values: Array, starts: list[Array]) -> list[Array]:
    """Stroke-averaged outputs (M_i, m) of the model, manoeuvre by manoeuvre, from the initial states ``starts``."""
    flown = _flown(problem, values)
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


def _project(problem: Problem, flown: Flown, manoeuvre: Manoeuvre, deviation: Array) -> Projected:
    forced = flown.driven(manoeuvre, np.zeros(4))
    raw = (manoeuvre.averages - forced)[:, problem.outputs] / deviation
    columns = _nuisance_columns(problem, flown, manoeuvre, deviation)
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


def _projections(problem: Problem, values: Array, deviation: Array) -> list[Projected]:
    flown = _flown(problem, values)
    return [_project(problem, flown, m, deviation) for m in problem.manoeuvres]


def _residuals(problem: Problem, values: Array, deviation: Array) -> list[Array]:
    return [piece.residuals for piece in _projections(problem, values, deviation)]


def _without_nuisances(basis: Array, values: Array) -> Array:
    flat = values.reshape(len(basis), -1)
    rest: Array = (flat - basis @ (basis.T @ flat)).reshape(values.shape)
    return rest


def _linearise(problem: Problem, values: Array, deviation: Array) -> Linearised:
    """Residuals and, by central differences at the fitted initial states, sensitivities."""
    pieces = _projections(problem, values, deviation)
    starts = [piece.start for piece in pieces]
    slopes: list[list[Array]] = [[] for _ in pieces]
    for index, value in enumerate(values):
        width = np.zeros_like(values)
        width[index] = DIFFERENCE * max(abs(value), 0.1)
        shifted = (_responses(problem, values + sign * width, starts) for sign in (1, -1))
        for column, (ahead, behind) in zip(slopes, zip(*shifted, strict=True), strict=True):
            column.append((ahead - behind) / (2 * width[index] * deviation))
    sensitivities = [
        _without_nuisances(piece.basis, np.stack(slope, axis=2)) for piece, slope in zip(pieces, slopes, strict=True)
    ]
    return Linearised([p.residuals for p in pieces], sensitivities, sum(p.basis.shape[1] for p in pieces))


def _squares(residuals: list[Array]) -> float:
    return float(sum(np.sum(piece**2) for piece in residuals))


def _spread(residuals: list[Array]) -> Array:
    spread: Array = np.sqrt(np.mean(np.vstack(residuals) ** 2, axis=0))
    return spread


def output_error(problem: Problem, start: Array) -> DerivativeFit:
    """Derivatives ``problem.names`` by Gauss-Newton from ``start`` (p,), as equation error or a prior gives it.

    The outputs' variances are estimated anew after every step (relaxation of the likelihood).
    """
    values, deviation = start.copy(), np.ones(len(problem.outputs))
    for _ in range(3):
        deviation = deviation * _spread(_residuals(problem, values, deviation))
    for _ in range(ITERATIONS):
        here = _linearise(problem, values, deviation)
        step, errors = _gauss_newton(here)
        if not np.all(np.isfinite(step)):
            return failed(problem.names, "the manoeuvres do not determine all derivatives")
        if np.max(np.abs(step) / errors) < CONVERGED:
            return _finish(problem, values, deviation, here)
        advanced = _advance(problem, values, step, deviation, _squares(here.residuals))
        if advanced is None:
            break
        values, deviation = advanced
    return failed(problem.names, "output error did not converge")


def flown_regressors(problem: Problem, fit: DerivativeFit) -> list[Array]:
    """Stroke averages (M, 4) of u, w, q and the tail angle in each manoeuvre, as the fitted model flies them."""
    flown = _flown(problem, fit.values)
    regressors = []
    for manoeuvre in problem.manoeuvres:
        start = _project(problem, flown, manoeuvre, fit.scatter).start
        tail = flown.tail(manoeuvre)
        states = _propagate(flown.exact, start, tail)
        regressors.append(manoeuvre.averaging @ np.column_stack((states[:, :3], tail)))
    return regressors


def fitted_outputs(problem: Problem, fit: DerivativeFit) -> list[Array]:
    """Stroke-averaged outputs (M_i, m) of the fitted model ; initial states and biases at their best."""
    pieces = _projections(problem, fit.values, fit.scatter)
    pairs = zip(problem.manoeuvres, pieces, strict=True)
    return [m.averages[:, problem.outputs] - piece.residuals * fit.scatter for m, piece in pairs]


def share_explained(problem: Problem, values: Array) -> float:
    """Share of the pitch rate's power that the tail explains with the derivatives ``values`` (p,), at most 1.

    What initial states and biases could explain is in neither. Negative where the model is worse than none.
    """
    deviation, pitch_rate = np.ones(len(problem.outputs)), problem.outputs.index(OUTPUTS.index("q"))
    for _ in range(3):
        deviation = deviation * _spread(_residuals(problem, values, deviation))
    flown, left, whole = _flown(problem, values), 0.0, 0.0
    for manoeuvre in problem.manoeuvres:
        piece = _project(problem, flown, manoeuvre, deviation)
        driven = flown.driven(manoeuvre, np.zeros(4))[:, problem.outputs] / deviation
        measured = piece.residuals + _without_nuisances(piece.basis, driven)
        left += float(np.sum(piece.residuals[:, pitch_rate] ** 2))
        whole += float(np.sum(measured[:, pitch_rate] ** 2))
    return 1.0 - left / whole if whole > 0 else 0.0


def _gauss_newton(here: Linearised) -> tuple[Array, Array]:
    """Step (p,) of least squares and its standard errors for white residuals; NaN where it is not determined."""
    squared = information(here.sensitivities)
    gradient = sum(np.einsum("nip,ni->p", s, r) for s, r in zip(here.sensitivities, here.residuals, strict=True))
    scale = np.sqrt(np.diag(squared))
    nothing = np.full(len(scale), np.nan)
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return nothing, nothing
    values, vectors = np.linalg.eigh(squared / np.outer(scale, scale))
    if values[0] * WORST_CONDITION**2 < values[-1]:
        return nothing, nothing
    inverse = (vectors / values) @ vectors.T / np.outer(scale, scale)
    return inverse @ gradient, np.sqrt(np.diag(inverse))


def _advance(
    problem: Problem, values: Array, step: Array, deviation: Array, before: float
) -> tuple[Array, Array] | None:
    """The step, halved until the squares fall, and the outputs' new standard deviations; None where nothing helps."""
    for halving in range(8):
        trial = values + step * 0.5**halving
        residuals = _residuals(problem, trial, deviation)
        if _squares(residuals) <= before * (1 + 1e-9):
            return trial, deviation * _spread(residuals)
    return None


def _finish(problem: Problem, values: Array, deviation: Array, here: Linearised) -> DerivativeFit:
    """Cramer-Rao bounds, corrected for coloured residuals and for what the nuisances took out of them."""
    strokes = max(m.period for m in problem.manoeuvres) / OUTPUT_STEP
    longest = max(len(piece) for piece in here.residuals)
    lags = int(min(max(longest / 10, LAG_STROKES * strokes), longest / 2)) + 1
    spread = coloured_spread(here.residuals, here.sensitivities, lags, here.nuisances)
    return DerivativeFit(problem.names, values, spread.covariance, spread.degrees, deviation)
