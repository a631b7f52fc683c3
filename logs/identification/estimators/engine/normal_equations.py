"""The normal equations of all records at once, each record's local numbers eliminated by the Schur complement."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.records import Flags, Indices
from logs.identification.estimators.engine.simulation import Flight, Unknowns, Whitener
from logs.identification.results import Array

DEPENDENT = 1e-10
"""-; squared length of a combination of columns that adds nothing to the others"""
NO_EFFECT = 1e-6
"""-; norm, in standard deviations, of what the outputs do when a parameter changes by its local size"""
SMALLEST_SIZE = 1e-2


class RecordBlock(NamedTuple):
    """One record's share."""

    residuals: Array
    """(N, m); in standard deviations"""
    slopes: Array
    """(N m, p); of the parameters, in standard deviations"""
    nuisances: Array
    """(N m, l); of the record's local numbers"""


class Normal(NamedTuple):
    """All records about the present unknowns."""

    blocks: tuple[RecordBlock, ...]
    sizes: Array
    """(p,); of the parameters, to tell one that has no effect"""
    precision: Array
    """(p,); of the parameters' priors"""
    prior_gradient: Array
    """(p,); what the priors add to the gradient"""


class Step(NamedTuple):
    """A change of the unknowns."""

    values: Array
    """(p,)"""
    local: tuple[Array, ...]
    """(l,) of each record; its local numbers"""
    errors: Array
    """(p,); standard errors for white residuals, infinite where a parameter is not determined"""
    decrement: float
    """-; of the weighted squares, that the step promises: zero where the gradient is"""

    def taken(self, unknowns: Unknowns, share: float) -> Unknowns:
        """``unknowns`` after a ``share`` of the step."""
        moved = tuple(o + share * d for o, d in zip(unknowns.local, self.local, strict=True))
        return Unknowns(unknowns.values + share * self.values, moved)


def normal_of(flight: Flight, unknowns: Unknowns, residuals: list[Array], whiteners: tuple[Whitener, ...]) -> Normal:
    """Residuals and slopes of all records, in standard deviations."""
    blocks, p = [], len(unknowns.values)
    for record, local, raw, white in zip(flight.records, unknowns.local, residuals, whiteners, strict=True):
        slopes = white(flight.slopes(record, unknowns.values, local)).reshape(raw.size, -1)
        blocks.append(RecordBlock(white(raw), slopes[:, :p], slopes[:, p:]))
    sizes = np.maximum(np.maximum(np.abs(unknowns.values), np.abs(flight.first().values)), SMALLEST_SIZE)
    precision = flight.layout.precision
    return Normal(tuple(blocks), sizes, precision, precision * (flight.layout.prior_mean - unknowns.values))


def finite(normal: Normal) -> bool:
    """Whether every slope is a number: a perturbed simulation may overflow where the central one does not."""
    return all(bool(np.all(np.isfinite(p.slopes)) and np.all(np.isfinite(p.nuisances))) for p in normal.blocks)


def pseudo_inverse(matrix: Array) -> tuple[Array, int]:
    """Inverse (l, l) of a Gram matrix over what is determined, and its rank."""
    if not len(matrix):
        return matrix, 0
    scale = np.sqrt(np.diag(matrix))
    scale = np.where(scale > 0, scale, np.inf)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    determined = values > DEPENDENT * max(values[-1], 1e-300)
    part = vectors[:, determined]
    inverse: Array = (part / values[determined]) @ part.T / np.outer(scale, scale)
    return inverse, int(determined.sum())


class Reduced(NamedTuple):
    """The parameters' local equations, the nuisances eliminated."""

    information: Array
    """(p, p)"""
    gradient: Array
    """(p,)"""
    alone: Array
    """(p,); what the information of each would be if nothing else were unknown"""
    rank: int
    """-; of the nuisances"""

    def only(self, free: Indices) -> Reduced:
        """The equations of the parameters ``free`` (indices), the others staying where they are."""
        return Reduced(self.information[np.ix_(free, free)], self.gradient[free], self.alone[free], self.rank)


def reduced(normal: Normal, damping: float = 0.0) -> Reduced:
    """Schur complement of the nuisances; ``damping`` is Levenberg and Marquardt's, in shares of the diagonal."""
    information, gradient = np.diag(normal.precision), normal.prior_gradient.copy()
    alone, rank = normal.precision.copy(), 0
    for block in normal.blocks:
        gram = block.slopes.T @ block.slopes
        inverse, determined = pseudo_inverse(_damped(block.nuisances.T @ block.nuisances, damping))
        cross, r = block.slopes.T @ block.nuisances, block.residuals.ravel()
        information += gram - cross @ inverse @ cross.T
        gradient += block.slopes.T @ r - cross @ (inverse @ (block.nuisances.T @ r))
        alone += np.diag(gram)
        rank += determined
    return Reduced(information + damping * np.diag(alone), gradient, alone, rank)


def _damped(matrix: Array, damping: float) -> Array:
    damped: Array = matrix + damping * np.diag(np.diag(matrix))
    return damped


class Spectrum(NamedTuple):
    """Eigenvalues of the scaled information: what is determined, and what is not."""

    scale: Array
    """(p,); infinite where a parameter has no effect"""
    values: Array
    """(p,); of the information in units of `scale`, ascending"""
    vectors: Array
    """(p, p)"""
    determined: Flags
    """(p,) of bool; determined"""

    def inverse(self) -> Array:
        """Inverse (p, p) of the information over what is determined."""
        part = self.vectors[:, self.determined]
        scaled: Array = (part / self.values[self.determined]) @ part.T / np.outer(self.scale, self.scale)
        return scaled


def spectrum_of(reduced: Reduced, sizes: Array) -> Spectrum:
    """Scaled by what each parameter does alone, so that one that only mimics nuisances is seen to."""
    root = np.sqrt(reduced.alone)
    scale = np.where(root * sizes > NO_EFFECT, root, np.inf)
    values, vectors = np.linalg.eigh(reduced.information / np.outer(scale, scale))
    determined: Flags = values > DEPENDENT
    return Spectrum(scale, values, vectors, determined)


def step_of(normal: Normal, at_bound: Flags, damping: float = 0.0) -> Step:
    """Gauss-Newton's step, or Levenberg and Marquardt's, of all that is not ``at_bound`` (p,) of bool."""
    free = np.flatnonzero(~at_bound)
    part = reduced(normal, damping).only(free)
    spectrum = spectrum_of(part, normal.sizes[free])
    inverse = spectrum.inverse()
    values, errors = np.zeros(len(at_bound)), np.full(len(at_bound), np.inf)
    values[free] = inverse @ part.gradient
    variances = np.diag(inverse)
    errors[free] = np.where(variances > 0, np.sqrt(np.maximum(variances, 0.0)), np.inf)
    local, decrement = [], float(values[free] @ part.gradient)
    for block in normal.blocks:
        inner, _ = pseudo_inverse(_damped(block.nuisances.T @ block.nuisances, damping))
        share = block.nuisances.T @ block.residuals.ravel()
        local.append(inner @ (share - block.nuisances.T @ (block.slopes @ values)))
        decrement += float(share @ inner @ share)
    return Step(values, tuple(local), errors, decrement)
