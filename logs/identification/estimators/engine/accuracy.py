"""Cramer-Rao bounds corrected for colored residuals, and parameters that the data does not determine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.normal_equations import (
    Normal,
    Spectrum,
    pseudo_inverse,
    reduced,
    spectrum_of,
)
from logs.identification.estimators.engine.records import Indices
from logs.identification.estimators.engine.search import OptimizerResult
from logs.identification.estimators.engine.simulation import Flight, about_mean, whitener_of
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, student_factor
from logs.identification.statistics.covariance import record_covariance

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


def accuracy_of(flight: Flight, optimum: OptimizerResult, names: tuple[str, ...]) -> Accuracy:
    """Errors of the parameters that are not at a bound, for colored residuals and with nuisance parameters."""
    assert optimum.normal is not None
    free, p = np.flatnonzero(~optimum.at_bound), len(names)
    equations = reduced(optimum.normal).only(free)
    spectrum = spectrum_of(equations, optimum.normal.sizes[free])
    inner, each = _covariance(flight, optimum.normal, free, spectrum.inverse(), equations.rank)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = inner
    degrees = np.ones(p)
    degrees[free] = each
    values = optimum.unknowns.values
    lost = {
        names[i]: Finding("at_bound", "withheld", names[i], float(values[i]))
        for i in np.flatnonzero(optimum.at_bound)
    }
    lost |= _undetermined(spectrum, [names[i] for i in free])
    for index in (names.index(name) for name in lost):
        covariance[index], covariance[:, index] = 0.0, 0.0
    halves = np.sqrt(np.diag(covariance)) * [student_factor(float(one)) for one in degrees]
    wide = [one for one in _wide(flight, optimum, halves, names) if one.subject not in lost]
    return Accuracy(covariance, degrees, (*(lost[name] for name in names if name in lost), *wide))


def _covariance(flight: Flight, normal: Normal, free: Indices, inverse: Array, rank: int) -> tuple[Array, Array]:
    """Covariance (p, p) of the ``free`` parameters and effective degrees of freedom (p,)."""
    sensitivities = []
    for block in normal.blocks:
        inner, _ = pseudo_inverse(block.nuisances.T @ block.nuisances)
        rest = block.slopes[:, free] - block.nuisances @ (inner @ (block.nuisances.T @ block.slopes[:, free]))
        sensitivities.append(rest.reshape(*block.residuals.shape, len(free)))
    residuals, used = [block.residuals for block in normal.blocks], [record.used for record in flight.records]
    prior = np.diag(normal.precision[free])
    return record_covariance(residuals, used, sensitivities, inverse, len(free) + rank, prior)


def _undetermined(spectrum: Spectrum, names: list[str]) -> dict[str, Finding]:
    """Parameters in directions without information, by name, with those that they are correlated with."""
    lost: dict[str, Finding] = {}
    null = spectrum.vectors[:, ~spectrum.determined]
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


def _wide(flight: Flight, end: OptimizerResult, halves: Array, names: tuple[str, ...]) -> list[Finding]:
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
