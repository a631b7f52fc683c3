"""The optimum of a flight-path reconstruction, and the unknowns that its records do not tell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.estimators.flight_path.initial_values import starts_of
from logs.identification.estimators.flight_path.records import (
    Path,
    Problem,
    Slopes,
    Values,
    path_of,
    slopes_of,
)
from logs.identification.estimators.flight_path.sensors import NO_GAIN, Parameter
from logs.identification.models.rigid_body import INPUTS, STATES
from logs.identification.results import Array, Unidentified

ITERATIONS = 50
CONVERGED = 0.02
"""-; largest step, in standard errors"""
DEPENDENT = 1e-9
"""-; smallest eigenvalue of the information, scaled to a diagonal of 1, at which its unknowns are told apart"""
SHARED = 0.05
"""-; of the largest entry, above which an unknown belongs to a combination that is not told apart"""


class Fit(NamedTuple):
    """The optimum."""

    values: Values
    deviation: Array
    """(m,); of the outputs' residuals"""
    paths: list[Path]
    slopes: list[Slopes]


class _Dependent(NamedTuple):
    """Unknowns that the records do not tell apart."""

    dropped: str
    """the parameter to do without, empty where there is none among them"""
    others: tuple[str, ...]


def _paths(problem: Problem, values: Values) -> list[Path]:
    return [path_of(problem, values, index) for index in range(len(problem.records))]


def _linearised(problem: Problem, values: Values, paths: list[Path]) -> list[Slopes]:
    return [slopes_of(problem, values, index, path) for index, path in enumerate(paths)]


def _spread(problem: Problem, paths: list[Path]) -> Array:
    """Root mean square residual of every output; next to nothing is not taken for nothing."""
    squares = sum(np.sum(path.residuals**2, axis=0) for path in paths)
    spread: Array = np.sqrt(squares / np.sum([np.sum(r.used, axis=0) for r in problem.records], axis=0))
    return np.maximum(spread, 1e-9)


def _squares(paths: list[Path], deviation: Array) -> float:
    total = float(sum(np.sum((path.residuals / deviation) ** 2) for path in paths))
    return total if np.isfinite(total) else np.inf


def _columns(problem: Problem, index: int) -> NDArray[np.int64]:
    """Where the unknowns of record ``index`` stand among all."""
    count, free = len(problem.parameters), len(problem.free)
    return np.concatenate((np.arange(count), count + index * free + np.arange(free)))


def _normal(problem: Problem, deviation: Array, paths: list[Path], slopes: list[Slopes]) -> tuple[Array, Array]:
    """Information (P, P) and gradient (P,) of all unknowns."""
    size = len(problem.parameters) + len(problem.records) * len(problem.free)
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for index, (path, slope) in enumerate(zip(paths, slopes, strict=True)):
        at = _columns(problem, index)
        flat = (slope.outputs / deviation[:, None]).reshape(-1, len(at))
        information[np.ix_(at, at)] += flat.T @ flat
        gradient[at] += flat.T @ (path.residuals / deviation).ravel()
    return information, gradient


def _advanced(problem: Problem, values: Values, step: Array) -> Values:
    count = len(problem.parameters)
    starts = values.starts.copy()
    starts[:, problem.free] += step[count:].reshape(len(problem.records), -1)
    return Values(values.errors + step[:count], starts)


def fitted(problem: Problem) -> Fit | None:
    """The best optimum that any start leads to; None where none does.

    A vane that reads nothing (a scale of -1) frees the motion of the flow, and far from the right one that fits
    best. So the scales are held at first wherever the attitude was not measured, or the plain search ends so.
    """
    guesses = starts_of(problem)
    plain = optimum(problem, guesses[0])
    if plain is not None and len(guesses) == 1 and not reading_nothing(problem, plain):
        return plain
    found = [plain, *(_scales_last(problem, guess) for guess in guesses)]
    return min((fit for fit in found if fit is not None), key=lambda fit: unlikely(problem, fit), default=None)


def unscaled(problem: Problem) -> Problem:
    """Its outputs taken to have no scales."""
    return problem._replace(parameters=tuple(p for p in problem.parameters if not _scales_output(p)))


def _scales_output(asked: Parameter) -> bool:
    return asked.kind == "scale" and asked.channel not in INPUTS


def _scales_last(problem: Problem, guess: Values) -> Fit | None:
    """The optimum from where the sensors fit best whose outputs have no scales."""
    kept = [k for k, asked in enumerate(problem.parameters) if not _scales_output(asked)]
    first = optimum(unscaled(problem), Values(guess.errors[kept], guess.starts))
    if first is None:
        return None
    errors = np.zeros(len(problem.parameters))
    errors[kept] = first.values.errors
    return optimum(problem, Values(errors, first.values.starts))


def unlikely(problem: Problem, fit: Fit) -> float:
    """Minus the logarithm of the likelihood, the outputs' variances estimated: sum of N log(deviation)."""
    samples = np.sum([np.sum(record.used, axis=0) for record in problem.records], axis=0)
    return float(samples @ np.log(fit.deviation))


def reading_nothing(problem: Problem, fit: Fit) -> list[Parameter]:
    """Scales of outputs nearer to a sensor that reads nothing than to one that reads what is there."""
    pairs = zip(problem.parameters, fit.values.errors, strict=True)
    return [asked for asked, value in pairs if _scales_output(asked) and value < NO_GAIN / 2]


def optimum(problem: Problem, values: Values) -> Fit | None:
    """Gauss-Newton, the outputs' variances estimated anew after every step; None where it does not converge."""
    paths = _paths(problem, values)
    if not np.isfinite(_squares(paths, np.ones(len(problem.channels)))):
        return None
    deviation = _spread(problem, paths)
    for _ in range(ITERATIONS):
        slopes = _linearised(problem, values, paths)
        information, gradient = _normal(problem, deviation, paths, slopes)
        scale = np.sqrt(np.diag(information))
        step = np.linalg.solve(information / np.outer(scale, scale), gradient / scale) / scale
        errors = np.sqrt(np.diag(np.linalg.inv(information / np.outer(scale, scale)))) / scale
        if np.max(np.abs(step) / errors) < CONVERGED:
            return Fit(values, deviation, paths, slopes)
        before, taken = _squares(paths, deviation), None
        for halving in range(10):
            trial = _advanced(problem, values, step * 0.5**halving)
            paths = _paths(problem, trial)
            if _squares(paths, deviation) <= before * (1 + 1e-9):
                taken = trial
                break
        if taken is None:
            return None
        values, deviation = taken, _spread(problem, paths)
    return None


# --- what cannot be told --------------------------------------------------------------------------------


def independent(problem: Problem) -> tuple[Problem, list[Unidentified], str]:
    """The problem without parameters that the records do not tell from others, those, and why nothing is left."""
    refused: list[Unidentified] = []
    while True:
        values = starts_of(problem)[0]
        paths = _paths(problem, values)
        if not all(np.all(np.isfinite(part)) for path in paths for part in (path.states, path.residuals)):
            return problem, refused, "the kinematics run away from the first guess: are the units SI, the axes FRD?"
        information, _ = _normal(problem, _spread(problem, paths), paths, _linearised(problem, values, paths))
        found = _dependent(problem, information)
        if found is None:
            return problem, refused, ""
        if not found.dropped:
            return problem, refused, f"the outputs do not tell the first {' and '.join(found.others)}"
        reason = "has no effect on the outputs measured"
        if found.others:
            reason = f"not to be told from {', '.join(found.others)} in these records"
        refused.append(Unidentified(found.dropped, reason))
        problem = problem._replace(parameters=tuple(p for p in problem.parameters if p.name != found.dropped))


def _dependent(problem: Problem, information: Array) -> _Dependent | None:
    """The unknowns of the weakest combination, where it is too weak; the last asked of its parameters is dropped."""
    names = [p.name for p in problem.parameters]
    names += [f"{STATES[state]} at the start" for _ in problem.records for state in problem.free]
    scale = np.sqrt(np.diag(information))
    dead = scale <= 1e-9 * np.max(scale)
    if np.any(dead):
        index = int(np.flatnonzero(dead)[0])
        return _Dependent(names[index], ()) if index < len(problem.parameters) else _Dependent("", (names[index],))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    if values[0] > DEPENDENT:
        return None
    weights = np.abs(vectors[:, 0])
    together = [int(i) for i in np.flatnonzero(weights > SHARED * np.max(weights))]
    among = [i for i in together if i < len(problem.parameters)]
    dropped = names[among[-1]] if among else ""
    return _Dependent(dropped, tuple(dict.fromkeys(names[i] for i in together if names[i] != dropped)))


def vague_among(problem: Problem, covariance: Array) -> Unidentified | None:
    """The parameter whose standard error exceeds its limit by most; None where all are within."""
    errors = np.sqrt(np.diag(covariance))
    excess = [float(error / p.limit) for p, error in zip(problem.parameters, errors, strict=False)]
    if not excess or max(excess) <= 1:
        return None
    index = int(np.argmax(excess))
    worst = problem.parameters[index]
    told = f"these records tell it no better than to {errors[index]:.2g} {worst.unit} (standard error)"
    return Unidentified(worst.name, told.replace(" - ", " "))
