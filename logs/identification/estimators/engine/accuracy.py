"""Cramer-Rao bounds corrected for colored residuals, and parameters that the data does not determine.

Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from logs.identification.estimators.engine.gauss_newton import Found
from logs.identification.estimators.engine.normal_equations import (
    Normal,
    Spectrum,
    pseudo_inverse,
    reduced,
    spectrum_of,
)
from logs.identification.estimators.engine.records import Indices
from logs.identification.estimators.engine.simulation import Flight
from logs.identification.estimators.engine.weights import about_mean, whitener_of
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, student_factor
from logs.identification.statistics.autoregression import runs
from logs.identification.statistics.covariance_inflation import not_below
from logs.identification.statistics.hac import Coloured, Linear, Noise, noise_of, under
from logs.identification.statistics.residual_autocorrelation import colour_of, coloured_information

LAG_SHARE = 0.1
"""-; of the longest record: width of the lag window"""
ALIKE = 1e-8
"""-; of the largest singular value of an output's sensitivities: smaller ones are rounding"""
MIXED = 1e-2
"""-; share of a parameter in a direction that the data does not determine"""
WIDEST = 1.0
"""-; of a value: half an interval, from which on it must also move the outputs less than they moved"""

register({
    "wide_interval": Entry(
        "half of its interval, {value:.3g}, exceeds the value",
        "The 95 % interval contains zero, and its ends change the outputs more than the measured motion.",
        "fly larger inputs or more of them, or fix the parameter",
    ),
    "not_significant": Entry(
        "the model explains no more of the outputs than chance",
        "An F test of the model against constant outputs is not significant at 99 %.",
        "fly larger inputs; compare the model with the aircraft",
    ),
})  # fmt: skip


class Accuracy(NamedTuple):
    """What the estimates are worth."""

    covariance: Array
    """(p, p); zero in the rows of what is not identified"""
    degrees: Array
    """-; (p,), effective degrees of freedom of each variance"""
    findings: tuple[Finding, ...]
    """withheld: the parameters without an estimate; warnings: those with a wide interval"""


def accuracy_of(flight: Flight, found: Found, names: tuple[str, ...]) -> Accuracy:
    """Errors of the parameters that are not held at a bound, nuisances and colour of the residuals included."""
    assert found.normal is not None
    free, p = np.flatnonzero(~found.held), len(names)
    equations = reduced(found.normal).only(free)
    spectrum = spectrum_of(equations, found.normal.sizes[free])
    inner, each = _sandwich(flight, found.normal, free, spectrum.inverse(), equations.rank)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = inner
    degrees = np.ones(p)
    degrees[free] = each
    values = found.unknowns.values
    lost = {names[i]: Finding("at_bound", "withheld", names[i], float(values[i])) for i in np.flatnonzero(found.held)}
    lost |= _undetermined(spectrum, [names[i] for i in free])
    for index in (names.index(name) for name in lost):
        covariance[index], covariance[:, index] = 0.0, 0.0
    halves = np.sqrt(np.diag(covariance)) * [student_factor(float(one)) for one in degrees]
    wide = [one for one in _wide(flight, found, halves, names) if one.subject not in lost]
    return Accuracy(covariance, degrees, (*(lost[name] for name in names if name in lost), *wide))


def _sandwich(flight: Flight, normal: Normal, free: Indices, inverse: Array, rank: int) -> tuple[Array, Array]:
    """Covariance (p, p) of the ``free`` parameters, and the degrees of freedom (p,) of each variance."""
    residuals = [piece.residuals for piece in normal.pieces]
    used = [record.used for record in flight.records]
    lags = max(int(LAG_SHARE * max(len(piece) for piece in residuals)), 1) + 1
    effective = colour_of(residuals, used, lags).effective
    degrees = max(effective - len(free) - rank, 1.0)
    sensitivities = []
    for piece in normal.pieces:
        inner, _ = pseudo_inverse(piece.own.T @ piece.own)
        rest = piece.slopes[:, free] - piece.own @ (inner @ (piece.own.T @ piece.slopes[:, free]))
        sensitivities.append(rest.reshape(*piece.residuals.shape, len(free)))
    given = Sensed(sensitivities, residuals, used)
    noises = [_noise_of(given, inverse, output) for output in range(residuals[0].shape[1])]
    whitened = _whitened(given, [one.model.filter if one else np.ones(1) for one, _ in noises])
    colour = colour_of(whitened.residuals, whitened.used, lags)
    covariance = inverse @ coloured_information(whitened.sensitivities, colour) @ inverse
    if not np.all(np.diag(covariance) > 0.0):
        # Of smoothed signals the residuals have next to no noise at high frequencies: there a spectrum that errs to
        # below zero, times sensitivities that are all the larger, is the whole variance.
        colour = colour_of(whitened.residuals, whitened.used, lags, definite=True)
        covariance = inverse @ coloured_information(whitened.sensitivities, colour) @ inverse
    prior = inverse * normal.precision[free] @ inverse
    covariance = covariance * (effective / degrees) + prior
    count = sum(float(mask.sum()) for mask in used)
    variance = sum(float(np.sum(piece**2)) for piece in residuals) / max(count - len(free) - rank, 1.0)
    each = np.minimum(_degrees_each([under(one, records) for one, records in noises if one], len(free)), degrees)
    return not_below(covariance, inverse * variance), each


class Sensed(NamedTuple):
    """What the information is made of, record by record."""

    sensitivities: list[Array]
    """(N_i, m, p)"""
    residuals: list[Array]
    """(N_i, m)"""
    used: list[Array]
    """-; (N_i, m), 1.0 or 0.0"""


def _whitened(given: Sensed, filters: list[Array]) -> Sensed:
    """Residuals of each output made white by its own of the ``filters``, sensitivities coloured by it instead.

    A lag window of a tenth of the record is shorter than the memory of slow residuals (Andrews & Monahan,
    Econometrica 60, 1992): with the noise ``T^-1 e``, ``S^T T^-1`` meets the white ``e``.
    """
    residuals, used = [one.copy() for one in given.residuals], [one.copy() for one in given.used]
    sensitivities = [one.copy() for one in given.sensitivities]
    for output, gains in enumerate(filters):
        order = len(gains) - 1
        for place, mask in enumerate(given.used if order else ()):
            there = (runs(mask[:, output], order) >= order).astype(np.float64)
            residuals[place][:, output] = lfilter(gains, [1.0], given.residuals[place][:, output]) * there
            used[place][:, output] = there
            turned = lfilter([1.0], gains, given.sensitivities[place][::-1, output], axis=0)
            sensitivities[place][:, output] = turned[::-1]
    return Sensed(sensitivities, residuals, used)


def _noise_of(given: Sensed, inverse: Array, output: int) -> tuple[Noise | None, tuple[Linear, ...]]:
    """The noise of one output, None where nothing tells it, and the output's part in the estimates."""
    slopes = np.vstack([one[:, output] for one in given.sensitivities])
    left, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
    basis = left[:, sizes > ALIKE * max(float(sizes[0]), 1e-300)]
    edges = pairwise(np.cumsum([0, *(len(one) for one in given.used)]))
    records = tuple(
        Linear(slopes[first:last] @ inverse, basis[first:last], left_over[:, output], mask[:, output])
        for (first, last), left_over, mask in zip(edges, given.residuals, given.used, strict=True)
    )
    try:
        return noise_of(records), records
    except np.linalg.LinAlgError:
        return None, records


def _degrees_each(parts: list[Coloured], count: int) -> Array:
    """Degrees of freedom (p,) of each variance, a sum over outputs (Satterthwaite, Biometrics 2, 1946)."""
    if not parts:
        return np.full(count, np.inf)
    variances = np.array([np.maximum(np.diag(one.covariance), 0.0) for one in parts])
    shares = variances / np.maximum(variances.sum(axis=0), 1e-300)
    return np.asarray(1.0 / np.maximum(np.sum(shares**2 / [one.degrees for one in parts], axis=0), 1e-12))


def _undetermined(spectrum: Spectrum, names: list[str]) -> dict[str, Finding]:
    """Parameters in directions without information, by name, with those that they are correlated with."""
    lost: dict[str, Finding] = {}
    null = spectrum.vectors[:, ~spectrum.kept]
    share = np.sqrt(np.sum(null**2, axis=1))
    for index, name in enumerate(names):
        if not np.isfinite(spectrum.scale[index]):
            lost[name] = Finding("no_effect", "withheld", name)
        elif share[index] > MIXED:
            related = np.abs(null @ null[index]) > MIXED * share[index]
            others = [other for i, other in enumerate(names) if related[i] and other != name]
            details = {"others": ", ".join(others) or "the initial states and biases"}
            lost[name] = Finding("not_identifiable", "withheld", name, details=details)
    return lost


def _wide(flight: Flight, end: Found, halves: Array, names: tuple[str, ...]) -> list[Finding]:
    """Parameters whose half interval exceeds them and would move the outputs more than they moved."""
    assert end.normal is not None
    motion, effects = _motion(flight, end.weights), np.sqrt(reduced(end.normal).alone)
    return [
        Finding("wide_interval", "warning", name, float(half), abs(float(value)))
        for name, half, value, effect in zip(names, halves, end.unknowns.values, effects, strict=True)
        if not np.isfinite(half) or (half > WIDEST * abs(value) and half * effect > motion)
    ]


def _motion(flight: Flight, weights: Array) -> float:
    """Norm of the outputs' own motion about their means, as the search weighs it."""
    squares = [float(np.sum(whitener_of(r, weights)(about_mean(r)) ** 2)) for r in flight.records]
    return float(np.sqrt(sum(squares)))
