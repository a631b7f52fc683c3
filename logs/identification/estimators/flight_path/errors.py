"""Errors of a reconstructed flight path: coloured residuals, and input noise that the kinematics integrate.

A lag window that ends at a tenth of a short record cuts into slow colour. So the residuals are freed of a first-order
pole before their autocovariance is tapered, and its spectrum gets the pole back (Andrews & Monahan, Econometrica
60(4), 1992).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.fft import next_fast_len

from logs.identification.data.noise_level import noise_level
from logs.identification.estimators.flight_path.records import (
    Path,
    Problem,
    Slopes,
    Values,
    errors_by_name,
    slopes_of,
)
from logs.identification.estimators.flight_path.sensors import Parameter
from logs.identification.models.rigid_body import INPUTS, input_slopes
from logs.identification.results import Array
from logs.identification.statistics.covariance_inflation import not_below
from logs.identification.statistics.residual_autocorrelation import colour_of

LAG_SHARE = 0.1
"""-; of the longest record, that the lag window spans"""
HIGHEST_POLE = 0.99
PARZEN_DEGREES = 3.71
"""-; of freedom, times the record's length over the window's (Priestley, Spectral Analysis and Time Series, 1981)"""


class _Residual(NamedTuple):
    """Colour of one output's residuals: a first-order pole, and the autocovariance of what it leaves."""

    pole: float
    covariances: Array
    """(L,); of the residuals freed of their pole, tapered"""
    effective: float
    """-; independent samples that carry as much knowledge of the variance"""


def _colours(problem: Problem, paths: list[Path]) -> list[_Residual]:
    """Colour of every output's residuals; those of different sensors are taken to be independent."""
    lags = int(LAG_SHARE * max(len(record.time) for record in problem.records)) + 1
    columns = range(len(problem.channels))
    fitted = _unknowns(problem) / len(columns)
    return [
        _colour([p.residuals[:, m] for p in paths], [r.used[:, m] for r in problem.records], lags, fitted)
        for m in columns
    ]


def _unknowns(problem: Problem) -> int:
    return len(problem.parameters) + len(problem.records) * len(problem.free)


def _colour(residuals: list[Array], used: list[Array], lags: int, fitted: float) -> _Residual:
    """Colour of one output's ``residuals`` (N,), of which so many unknowns were ``fitted``."""
    product = sum(float(e[1:] @ e[:-1]) for e in residuals)
    pairs = [mask[1:] * mask[:-1] for mask in used]
    power = sum(float((e[1:] ** 2 + e[:-1] ** 2) @ pair) / 2 for e, pair in zip(residuals, pairs, strict=True))
    count = float(sum(np.sum(pair) for pair in pairs))
    pole = product / power if power > 0 else 0.0
    if pole > 0:
        # Kendall's correction: the correlation of what is left by a fit to a short record is found too small.
        pole = min(pole + ((1 + pole) * max(fitted, 1.0) + 2 * pole) / max(count, 1.0), HIGHEST_POLE)
    pole = max(pole, 0.0)
    whitened = [np.append(0.0, (e[1:] - pole * e[:-1]) * pair) for e, pair in zip(residuals, pairs, strict=True)]
    masks = [np.append(0.0, pair) for pair in pairs]
    raw = colour_of([e[:, None] for e in residuals], used, lags)
    if pole == 0:
        return _Residual(0.0, raw.covariances[:, 0, 0], raw.effective)
    return _Residual(pole, colour_of([e[:, None] for e in whitened], masks, lags).covariances[:, 0, 0], raw.effective)


def _window_degrees(problem: Problem) -> float:
    """Degrees of freedom of a spectrum by Parzen's window of a tenth of the longest record."""
    lengths = [len(record.time) for record in problem.records]
    return PARZEN_DEGREES * sum(lengths) / (LAG_SHARE * max(lengths))


def _taken(problem: Problem) -> float:
    """How much larger the slow part of the residuals' spectrum was before the fit took its share of it.

    At frequency zero a spectrum has half the degrees of freedom; each output gave its share of the unknowns.
    """
    slow = _window_degrees(problem) / 2
    return slow / max(slow - _unknowns(problem) / len(problem.channels), 1.0)


def degrees_of(problem: Problem, paths: list[Path]) -> float:
    """Degrees of freedom of the standard errors: of a spectrum by Parzen's window, or fewer where samples are few."""
    effective = sum(colour.effective for colour in _colours(problem, paths)) - _unknowns(problem)
    return float(max(min(effective, _window_degrees(problem)), 1.0))


def covariance_of(
    problem: Problem,
    values: Values,
    deviation: Array,
    paths: list[Path],
    slopes: list[Slopes],
    input_noise: Mapping[str, float] | None,
) -> Array:
    """Covariance (P, P) of the parameters and first states, not below that of white residuals."""
    count, free, size = len(problem.parameters), len(problem.free), _unknowns(problem)
    information, core = np.zeros((size, size)), np.zeros((size, size))
    colours, taken = _colours(problem, paths), _taken(problem)
    for index, slope in enumerate(slopes):
        at = np.concatenate((np.arange(count), count + index * free + np.arange(free)))
        weighted = slope.outputs / deviation[:, None] ** 2
        information[np.ix_(at, at)] += np.einsum("nmp,nmq->pq", weighted, slope.outputs)
        noise = noise_of_inputs(problem, values, index, input_noise)
        core[np.ix_(at, at)] += _coloured(weighted, colours) * taken + _driven(weighted, slope, noise)
    scale = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return not_below(inverse @ core @ inverse, inverse)


def with_held(
    problem: Problem,
    held: tuple[Parameter, ...],
    values: Values,
    deviation: Array,
    paths: list[Path],
    covariance: Array,
) -> Array:
    """The ``covariance`` (P, P) with what the errors ``held`` at zero, each as large as its limit, do to the others.

    Schmidt, Application of State-Space Methods to Navigation Problems, Advances in Control Systems 3, 1966: with the
    information's blocks, P + S D S^T of S = -I_xx^-1 I_xh and D the squares of the limits.
    """
    if not held:
        return covariance
    count, own, free = len(problem.parameters), len(held), len(problem.free)
    whole = problem._replace(parameters=(*problem.parameters, *held))
    far = Values(np.append(values.errors, np.zeros(own)), values.starts)
    size = _unknowns(whole)
    information = np.zeros((size, size))
    for index, path in enumerate(paths):
        slopes = slopes_of(whole, far, index, path).outputs / deviation[:, None]
        at = np.concatenate((np.arange(count + own), count + own + index * free + np.arange(free)))
        information[np.ix_(at, at)] += np.einsum("nmp,nmq->pq", slopes, slopes)
    rest = np.delete(np.arange(size), count + np.arange(own))
    inner, across = information[np.ix_(rest, rest)], information[np.ix_(rest, count + np.arange(own))]
    scale = np.sqrt(np.diag(inner))
    moved = np.linalg.solve(inner / np.outer(scale, scale), across / scale[:, None]) / scale[:, None]
    moved = moved * np.array([one.limit for one in held])
    wider: Array = covariance + moved @ moved.T
    return wider


def _coloured(weighted: Array, colours: list[_Residual]) -> Array:
    """Sum over all pairs of samples of sensitivities (N, m, p) times the residuals' autocovariance."""
    total = np.zeros((weighted.shape[2], weighted.shape[2]))
    for output, colour in enumerate(colours):
        lags = len(colour.covariances)
        # Long enough that nothing comes round from the other end.
        size = next_fast_len(len(weighted) + lags + int(np.log(1e-6) / np.log(max(abs(colour.pole), 1e-6))) + 1)
        both = np.zeros(size)
        both[:lags], both[size - lags + 1 :] = colour.covariances, colour.covariances[:0:-1]
        turn = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
        density = np.fft.rfft(both).real / np.abs(1 - colour.pole * turn) ** 2
        density[1 : (size + 1) // 2] *= 2
        waves = np.fft.rfft(weighted[:, output], size, axis=0)
        total += ((waves.conj() * density[:, None]).T @ waves).real / size
    return total


def _driven(weighted: Array, slope: Slopes, noise: Array) -> Array:
    """What white noise (6,) of the inputs does to the scores: (p, p)."""
    pulls = input_slopes(slope.steps, np.einsum("nmp,nmi->nip", weighted, slope.by_state))
    scaled = pulls * noise[:, None]
    total: Array = np.einsum("nip,niq->pq", scaled, scaled)
    return total


def noise_of_inputs(problem: Problem, values: Values, index: int, told: Mapping[str, float] | None) -> Array:
    """Standard deviations (6,) of the corrected inputs' noise."""
    measured = problem.records[index].inputs
    if told is None:
        levels = [noise_level(column) if np.any(column) else 0.0 for column in measured.T]
    else:
        levels = [told.get(name, 0.0) for name in INPUTS]
    errors = errors_by_name(problem, values)
    return np.array(
        [level / (1 + errors.get(f"scale_{name}", 0.0)) for level, name in zip(levels, INPUTS, strict=True)]
    )
