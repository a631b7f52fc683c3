"""Which regressors say the same: variance inflation, condition indices, variance-decomposition proportions.

Belsley, Kuh, Welsch, Regression Diagnostics, 1980, ch. 3; Klein & Morelli, Aircraft System Identification, 2006,
ch. 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

DEPENDENT = 1e6
"""-; condition index from which on nothing but rounding tells the regressors apart"""
NOTABLE = 30.0
"""-; condition index from which on regressors are said to follow one another (Belsley)"""
SHARE = 0.5
"""-; of a parameter's variance that one combination must make up to be called involved (Belsley)"""
INVOLVED = 1e-3
"""-; of the largest entry of a combination that vanishes: smaller ones are rounding"""


class Collinearity(NamedTuple):
    """Diagnostics of p regressors; the largest condition index last."""

    names: tuple[str, ...]
    """-; (p,)"""
    inflation: Array
    """-; (p,), of each parameter's variance by the others; infinite for one that depends on them"""
    indices: Array
    """-; (p,), condition index of each combination"""
    proportions: Array
    """-; (p, p), share of combination k in the variance of parameter j at [j, k]"""
    combinations: Array
    """-; (p, p), combination k over the scaled regressors in column k"""

    def groups(self, above: float = NOTABLE) -> tuple[tuple[str, ...], ...]:
        """Names that follow one another: those that a combination of condition index over ``above`` involves."""
        found = []
        for column in np.flatnonzero(self.indices > above):
            inside = self._involved(int(column))
            if np.count_nonzero(inside) > 1:
                found.append(tuple(name for name, yes in zip(self.names, inside, strict=True) if yes))
        return tuple(found)

    def _involved(self, column: int) -> Array:
        """Whether each regressor takes part in one combination (p,)."""
        weight = np.abs(self.combinations[:, column])
        if self.indices[column] > DEPENDENT:
            return np.asarray(weight > INVOLVED * weight.max())
        share = self.proportions[:, self.indices > NOTABLE].sum(axis=1)
        return np.asarray((share > SHARE) & (weight > 0.1 * weight.max()))


def collinearity(regressors: Array, names: tuple[str, ...]) -> Collinearity:
    """Diagnostics of ``regressors`` (N, p), which are taken as they are: centre them where there is an intercept.

    A column that is zero throughout has index and inflation infinite and depends on itself alone.
    """
    norms = np.linalg.norm(regressors, axis=0)
    missing = np.zeros((max(len(names) - len(regressors), 0), len(names)))
    scaled = np.vstack((regressors / np.where(norms > 0, norms, 1.0), missing))
    _, singular, transposed = np.linalg.svd(scaled, full_matrices=False)
    with np.errstate(divide="ignore"):
        shares = (transposed.T / np.maximum(singular, np.finfo(float).tiny ** 0.25)) ** 2
        indices = singular[0] / singular if len(singular) and singular[0] > 0 else np.full(len(names), np.inf)
    inflation = shares.sum(axis=1)
    return Collinearity(
        names,
        np.where(_loose(transposed, indices), np.inf, inflation),
        np.asarray(indices),
        shares / inflation[:, None],
        transposed.T,
    )


def _loose(transposed: Array, indices: Array) -> Array:
    """Whether each parameter takes part in a combination that vanishes (p,)."""
    vanishing = np.abs(transposed[indices > DEPENDENT])
    return np.asarray(np.any(vanishing > INVOLVED, axis=0)) if len(vanishing) else np.zeros(transposed.shape[1], bool)
