"""Cramer-Rao bounds corrected for colored residuals, and parameters that the data does not determine.

Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997.
"""

from __future__ import annotations

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
from logs.identification.statistics.covariance_inflation import not_below
from logs.identification.statistics.parameter_uncertainty import LEAST_CLUSTERS, Spread, by_scatter
from logs.identification.statistics.residual_autocorrelation import colour_of, coloured_information

LAG_SHARE = 0.2
"""-; of the longest record: width of the lag window"""
MAX_POLE = 0.97
"""-; of the filter that prewhitens residuals"""
Arrays = list[Array]
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


def accuracy_of(flight: Flight, optimum: Found, names: tuple[str, ...]) -> Accuracy:
    """Errors of the parameters that are not at a bound, for colored residuals and with nuisance parameters."""
    assert optimum.normal is not None
    free, p = np.flatnonzero(~optimum.held), len(names)
    equations = reduced(optimum.normal).only(free)
    spectrum = spectrum_of(equations, optimum.normal.sizes[free])
    inner, each = _sandwich(flight, optimum.normal, free, spectrum.inverse(), equations.rank)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = inner
    degrees = np.ones(p)
    degrees[free] = each
    values = optimum.unknowns.values
    lost = {
        names[i]: Finding("at_bound", "withheld", names[i], float(values[i])) for i in np.flatnonzero(optimum.held)
    }
    lost |= _undetermined(spectrum, [names[i] for i in free])
    for index in (names.index(name) for name in lost):
        covariance[index], covariance[:, index] = 0.0, 0.0
    halves = np.sqrt(np.diag(covariance)) * [student_factor(float(one)) for one in degrees]
    wide = [one for one in _wide(flight, optimum, halves, names) if one.subject not in lost]
    return Accuracy(covariance, degrees, (*(lost[name] for name in names if name in lost), *wide))


def _sandwich(flight: Flight, normal: Normal, free: Indices, inverse: Array, rank: int) -> tuple[Array, Array]:
    """Covariance (p, p) of the ``free`` parameters and effective degrees of freedom (p,).

    The Cramer-Rao bound for residuals with their estimated autocorrelation (Morelli & Klein, 1997), prewhitened
    (Andrews & Monahan, Econometrica 60, 1992), at least that for white residuals and, of enough records, that of the
    scatter between them (CR2), which contains errors of the model's structure.
    """
    residuals = [piece.residuals for piece in normal.pieces]
    used = [record.used for record in flight.records]
    sensitivities = []
    for piece in normal.pieces:
        inner, _ = pseudo_inverse(piece.own.T @ piece.own)
        rest = piece.slopes[:, free] - piece.own @ (inner @ (piece.own.T @ piece.slopes[:, free]))
        sensitivities.append(rest.reshape(*piece.residuals.shape, len(free)))
    unfiltered = sensitivities
    lags = max(int(LAG_SHARE * max(len(piece) for piece in residuals)), 1) + 1
    effective = colour_of(residuals, used, lags).effective
    degrees = max(effective - len(free) - rank, 1.0)
    count = sum(float(mask.sum()) for mask in used)
    variance = sum(float(np.sum(piece**2)) for piece in residuals) / max(count - len(free) - rank, 1.0)
    residuals, used, sensitivities = _prewhitened(residuals, used, sensitivities)
    colored = colour_of(residuals, used, lags)
    covariance = inverse @ coloured_information(sensitivities, colored) @ inverse
    if not np.all(np.diag(covariance) > 0.0):
        # The estimated spectrum is negative where the residuals have next to no power: use the one that never is.
        colored = colour_of(residuals, used, lags, definite=True)
        covariance = inverse @ coloured_information(sensitivities, colored) @ inverse
    prior = inverse * normal.precision[free] @ inverse
    within = not_below(covariance * (effective / degrees) + prior, inverse * variance)
    each = np.full(len(free), degrees)
    if len(normal.pieces) < LEAST_CLUSTERS:
        return within, each
    parts = [piece.residuals for piece in normal.pieces], unfiltered, np.diag(normal.precision[free])
    between = by_scatter(Spread(within, degrees), *parts)
    assert between.between is not None
    wider = np.diag(between.between) > np.diag(within)
    each = np.where(wider, np.minimum(between.standard_errors()[1], degrees), degrees)
    return not_below(within, between.between), each


def _prewhitened(residuals: Arrays, used: Arrays, sensitivities: Arrays) -> tuple[Arrays, Arrays, Arrays]:
    """Residuals (N_i, m) behind a first-order filter of each output that makes them nearly white.

    The adjoint of its inverse goes over the sensitivities (N_i, m, p), so that the information stays the same.
    """
    residuals, used, sensitivities = ([one.copy() for one in each] for each in (residuals, used, sensitivities))
    for output in range(residuals[0].shape[1]):
        pairs = [(r[:, output], u[:, output]) for r, u in zip(residuals, used, strict=True)]
        if not any(np.any(u[1:] * u[:-1]) for _, u in pairs):
            continue
        products = sum(float(np.sum(r[1:] * r[:-1])) for r, _ in pairs)
        squares = sum(float(np.sum(r[:-1] ** 2 * u[1:])) for r, u in pairs)
        pole = float(np.clip(products / max(squares, 1e-300), -MAX_POLE, MAX_POLE))
        for r, u, s in zip(residuals, used, sensitivities, strict=True):
            both = u[1:, output] * u[:-1, output]
            r[1:, output] = (r[1:, output] - pole * r[:-1, output]) * both
            r[0, output], u[0, output], u[1:, output] = 0.0, 0.0, both
            s[:, output] = lfilter([1.0], [1.0, -pole], s[::-1, output], axis=0)[::-1]
    return residuals, used, sensitivities


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
