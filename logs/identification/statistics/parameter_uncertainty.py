"""What the errors of a nonlinear fit to several records are worth: coloured residuals, scatter between records."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.results import Array, Estimate, estimate
from logs.identification.statistics.covariance_inflation import not_below
from logs.identification.statistics.delta_method import slopes
from logs.identification.statistics.residual_autocorrelation import colour_of, coloured_information

LEAST_CLUSTERS = 5
"""-; records from which on the scatter between them is looked at"""
WORST_CONDITION = 1e12
MOST_OF_ALL = 0.999
"""-; share of what is known of a direction that one record brings, beyond which it is left out of a correction"""


class Spread(NamedTuple):
    """What the parameters of a fit are worth, by the noise within records and by the scatter between them."""

    covariance: Array
    """(p, p); by the residuals within the records"""
    degrees: float
    """-; effective degrees of freedom of `covariance`"""
    between: Array | None = None
    """(p, p); by the scatter between the records, None where they are too few"""
    records: int = 0
    """-; how many `between` is from"""
    alone: bool = False
    """-; `between` counts alone where there is one, else the larger of both"""
    parts: Array | None = None
    """(K, p, p); of `between`, what each record brings where all have the same noise; None: as much as any other"""

    def standard_errors(self) -> tuple[Array, Array]:
        """Standard errors (p,) and degrees of freedom (p,), of each parameter by the kind that counts."""
        within = np.maximum(np.diag(self.covariance), 0.0)
        if self.between is None:
            return np.sqrt(within), np.full(len(within), self.degrees)
        between = np.diag(self.between)
        chosen = (between > within) | self.alone
        degrees = np.where(chosen, np.minimum(self.degrees, self._between_degrees()), self.degrees)
        return np.sqrt(np.where(chosen, between, within)), degrees

    def _between_degrees(self) -> Array:
        """Of `between`, (p,): the records that count for a parameter, less one; at least one.

        The effective number of clusters of Carter, Schnepel & Steigerwald, Rev. Econ. Stat. 99(4), 2017.
        """
        if self.parts is None:
            return np.full(len(self.covariance), self.records - 1.0)
        own = np.diagonal(self.parts, axis1=1, axis2=2)
        shares = own / np.maximum(own.sum(axis=0), 1e-300)
        return np.asarray(np.maximum(1.0 / np.maximum(np.sum(shares**2, axis=0), 1e-300) - 1.0, 1.0))

    def carried(self, gradient: Array) -> Spread:
        """Of what has the ``gradient`` (k, p) with the parameters, to first order."""
        between = None if self.between is None else gradient @ self.between @ gradient.T
        parts = None if self.parts is None else gradient @ self.parts @ gradient.T
        return self._replace(covariance=gradient @ self.covariance @ gradient.T, between=between, parts=parts)

    def part(self, chosen: slice) -> Spread:
        """Of the ``chosen`` parameters alone."""
        return self.carried(np.eye(len(self.covariance))[chosen])

    def estimates(self, names: dict[str, str], values: Array) -> tuple[Estimate, ...]:
        """One `Estimate` per entry of ``names`` (name to unit), from ``values`` (p,)."""
        rows = zip(names.items(), values, *self.standard_errors(), strict=True)
        return tuple(
            estimate(name, unit, float(value), float(error), float(degrees))
            for (name, unit), value, error, degrees in rows
        )


def carry(of: Callable[[Array], Array], values: Array, spread: Spread) -> tuple[Array, Spread]:
    """Value (k,) of ``of(values)`` and what it is worth by the delta method."""
    central, gradient = slopes(of, values, spread.standard_errors()[0])
    return central, spread.carried(gradient)


def information(sensitivities: list[Array]) -> Array:
    """Sum of S^T S over ``sensitivities`` (N_i, m, p): (p, p)."""
    total: Array = sum(np.einsum("nip,niq->pq", s, s) for s in sensitivities)
    return total


def coloured_spread(
    residuals: list[Array], sensitivities: list[Array], reach: tuple[int, int], nuisances: int
) -> Spread:
    """Cramer-Rao bounds within records, corrected for coloured residuals and for what ``nuisances`` took out of them.

    ``residuals`` (N_i, m) and ``sensitivities`` (N_i, m, p) of each record, in standard deviations, nuisances
    projected out. ``reach``, in samples, is how long the moving average was that all went through, 0 for none, and
    how far the residuals' autocovariance is looked at.
    """
    parameters = sensitivities[0].shape[2]
    flat, lags = reach
    colour = colour_of(residuals, [np.ones(len(piece)) for piece in residuals], lags, flat)
    inverse = np.asarray(np.linalg.inv(information(sensitivities)), dtype=np.float64)
    degrees = max(colour.effective - parameters - nuisances, 1.0)
    core = coloured_information(sensitivities, colour) * (colour.effective / degrees)
    total = sum(piece.size for piece in residuals)
    white = inverse * sum(float(np.sum(piece**2)) for piece in residuals) / max(total - parameters - nuisances, 1)
    covariance = not_below(inverse @ core @ inverse, white) if np.all(np.diag(core) > 0) else white
    return Spread(covariance, degrees)


def scores_of(residuals: list[Array], sensitivities: list[Array]) -> list[Array]:
    """Gradient (p,) of each record's squares."""
    return [np.einsum("nip,ni->p", s, r) for s, r in zip(sensitivities, residuals, strict=True)]


def with_scatter(within: Spread, inverse: Array, scores: list[Array]) -> Spread:
    """The errors ``within`` records, and those between them where there are enough records to tell."""
    count = len(scores)
    if count < LEAST_CLUSTERS:
        return within
    return within._replace(between=scatter_between(inverse, scores), records=count)


def by_scatter(
    within: Spread, residuals: list[Array], sensitivities: list[Array], known: Array | None = None
) -> Spread:
    """The errors ``within`` records, and by the scatter between them, which then counts alone; where records are few,
    the former.

    ``residuals`` (N_i, m) and ``sensitivities`` (N_i, m, p) as `coloured_spread` takes them, ``known`` (p, p) what a
    prior tells beside them. A fit follows the records that tell most of a parameter: their scores are too small, and
    are made as large as they were (the bias-reduced sandwich CR2 of Bell & McCaffrey, Survey Methodology 28(2),
    2002).
    """
    if len(residuals) < LEAST_CLUSTERS:
        return within
    own = np.array([information([one]) for one in sensitivities])
    prior = np.zeros_like(own[0]) if known is None else known
    root = _root_of_inverse(own.sum(axis=0) + prior)
    inverse = root @ root.T
    between: Array = inverse @ prior @ inverse
    for share, score in zip(root.T @ own @ root, scores_of(residuals, sensitivities), strict=True):
        values, vectors = np.linalg.eigh(share)
        whole = vectors @ (vectors.T @ (root.T @ score) / np.sqrt(1.0 - np.minimum(values, MOST_OF_ALL)))
        between += np.outer(root @ whole, root @ whole)
    return within._replace(between=between, records=len(residuals), alone=True, parts=inverse @ own @ inverse)


def _root_of_inverse(total: Array) -> Array:
    """R (p, p) with R R^T the inverse of ``total`` (p, p), also where rounding leaves that not positive."""
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
    root: Array = vectors / np.sqrt(np.maximum(values, values[-1] / WORST_CONDITION)) / scale[:, None]
    return root


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


def determined(sensitivities: list[Array], known: Array | None = None) -> bool:
    """Whether the data, or what is ``known`` (p, p) beside, tell every parameter and no combination too little."""
    total = information(sensitivities) + (0.0 if known is None else known)
    scale = np.sqrt(np.diag(total))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(total / np.outer(scale, scale)) < WORST_CONDITION)
