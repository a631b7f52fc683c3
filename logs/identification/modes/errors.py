"""What the errors of a nonlinear fit to several records are worth: coloured residuals, scatter between records."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.accuracy.colour import colour_of, coloured_information
from logs.identification.accuracy.widened import not_below
from logs.identification.results import Array

LEAST_CLUSTERS = 5
"""-; records from which on the scatter between them is added to the error"""
WORST_CONDITION = 1e12


class Spread(NamedTuple):
    """Covariance of a fit's parameters."""

    covariance: Array
    """(p, p)"""
    degrees: float
    """-; effective degrees of freedom"""


def information(sensitivities: list[Array]) -> Array:
    """Sum of S^T S over ``sensitivities`` (N_i, m, p): (p, p)."""
    total: Array = sum(np.einsum("nip,niq->pq", s, s) for s in sensitivities)
    return total


def coloured_spread(residuals: list[Array], sensitivities: list[Array], lags: int, nuisances: int) -> Spread:
    """Cramer-Rao bounds corrected for coloured residuals and for what the ``nuisances`` took out of them.

    ``residuals`` (N_i, m) and ``sensitivities`` (N_i, m, p) of each record, in standard deviations, nuisances
    projected out. With several records the scatter between them, which tells what the model lacks, is added.
    """
    parameters = sensitivities[0].shape[2]
    colour = colour_of(residuals, [np.ones(len(piece)) for piece in residuals], lags)
    inverse = np.asarray(np.linalg.inv(information(sensitivities)), dtype=np.float64)
    degrees = max(colour.effective - parameters - nuisances, 1.0)
    core = coloured_information(sensitivities, colour) * (colour.effective / degrees)
    total = sum(piece.size for piece in residuals)
    white = inverse * sum(float(np.sum(piece**2)) for piece in residuals) / max(total - parameters - nuisances, 1)
    covariance = not_below(inverse @ core @ inverse, white)
    return with_scatter(Spread(covariance, degrees), inverse, scores_of(residuals, sensitivities))


def scores_of(residuals: list[Array], sensitivities: list[Array]) -> list[Array]:
    """Gradient (p,) of each record's squares."""
    return [np.einsum("nip,ni->p", s, r) for s, r in zip(sensitivities, residuals, strict=True)]


def with_scatter(within: Spread, inverse: Array, scores: list[Array]) -> Spread:
    """The larger of the errors ``within`` records and between them, where there are enough records to tell.

    Their sum covered the truth in all of sixty flights where 95 % is promised.
    """
    count = len(scores)
    if count < LEAST_CLUSTERS:
        return within
    between = scatter_between(inverse, scores)
    larger = np.any(np.diag(between) > np.diag(within.covariance))
    degrees = min(within.degrees, count - 1.0) if larger else within.degrees
    return Spread(not_below(within.covariance, between), degrees)


def scatter_between(inverse: Array, scores: list[Array]) -> Array:
    """Covariance (p, p) from the scatter between manoeuvres, a sandwich over clusters.

    What a model lacks is much the same all through a manoeuvre and another in the next; residuals taken as noise
    would promise too much. ``scores`` (p,) are each manoeuvre's gradient, ``inverse`` (p, p) that of the
    information of all.
    """
    count = len(scores)
    middle = np.sum([np.outer(score, score) for score in scores], axis=0) * count / (count - 1)
    sandwich: Array = inverse @ middle @ inverse.T
    return sandwich


def determined(sensitivities: list[Array]) -> bool:
    """Whether the data moves with every parameter and with no combination of them too little."""
    total = information(sensitivities)
    scale = np.sqrt(np.diag(total))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(total / np.outer(scale, scale)) < WORST_CONDITION)
