"""Collinear regressors and correlated parameters.

Variance inflation, condition indices and variance-decomposition proportions: Belsley, Kuh, Welsch, Regression
Diagnostics, 1980, ch. 3; Klein & Morelli, Aircraft System Identification, 2006, ch. 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array

DEPENDENT = 1e6
"""-; condition index above which regressors are linearly dependent"""
NOTABLE = 30.0
"""-; condition index above which regressors are collinear (Belsley)"""
PROPORTION = 0.5
"""-; of a parameter's variance from one combination, above which it is involved (Belsley)"""
INVOLVED = 1e-3
"""-; of the largest entry of a vanishing combination: smaller ones are rounding"""
STRONG = 0.9
"""-; magnitude of a correlation that is reported (Klein & Morelli ch. 5)"""


class Collinearity(NamedTuple):
    """Diagnostics of p regressors; the largest condition index last."""

    names: tuple[str, ...]
    """-; (p,)"""
    inflation: Array
    """-; (p,), variance inflation; infinite if the regressor depends on others"""
    indices: Array
    """-; (p,), condition index of each combination"""
    proportions: Array
    """-; (p, p), fraction of the variance of parameter j from combination k at [j, k]"""
    combinations: Array
    """-; (p, p), combination k of the scaled regressors in column k"""

    def groups(self, above: float = NOTABLE) -> tuple[tuple[str, ...], ...]:
        """Names of the regressors in each combination with a condition index over ``above``."""
        groups = []
        for column in np.flatnonzero(self.indices > above):
            inside = self._involved(int(column))
            if np.count_nonzero(inside) > 1:
                groups.append(tuple(name for name, yes in zip(self.names, inside, strict=True) if yes))
        return tuple(groups)

    def _involved(self, column: int) -> Array:
        """Whether each regressor takes part in one combination (p,)."""
        weight = np.abs(self.combinations[:, column])
        if self.indices[column] > DEPENDENT:
            return np.asarray(weight > INVOLVED * weight.max())
        proportion = self.proportions[:, self.indices > NOTABLE].sum(axis=1)
        return np.asarray((proportion > PROPORTION) & (weight > 0.1 * weight.max()))


def collinearity(regressors: Array, names: tuple[str, ...]) -> Collinearity:
    """Diagnostics of ``regressors`` (N, p), centered if there is an intercept.

    A column of zeros has an infinite index and inflation and depends on itself alone.
    """
    norms = np.linalg.norm(regressors, axis=0)
    missing = np.zeros((max(len(names) - len(regressors), 0), len(names)))
    scaled = np.vstack((regressors / np.where(norms > 0, norms, 1.0), missing))
    _, singular, transposed = np.linalg.svd(scaled, full_matrices=False)
    with np.errstate(divide="ignore"):
        parts = (transposed.T / np.maximum(singular, np.finfo(float).tiny ** 0.25)) ** 2
        indices = singular[0] / singular if len(singular) and singular[0] > 0 else np.full(len(names), np.inf)
    inflation = parts.sum(axis=1)
    dependent = np.any(np.abs(transposed[indices > DEPENDENT]) > INVOLVED, axis=0)
    return Collinearity(
        names, np.where(dependent, np.inf, inflation), np.asarray(indices), parts / inflation[:, None], transposed.T
    )


class Pair(NamedTuple):
    """Two parameters with correlated errors."""

    one: str
    other: str
    correlation: float
    """-; in [-1, 1]"""


def strong_pairs(names: tuple[str, ...], matrix: Array) -> tuple[Pair, ...]:
    """The pairs of ``names`` (p,) whose correlation in ``matrix`` (p, p) exceeds `STRONG`, the strongest first."""
    rows, columns = np.nonzero(np.triu(np.abs(np.nan_to_num(matrix)) > STRONG, 1))
    pairs = [Pair(names[i], names[j], float(matrix[i, j])) for i, j in zip(rows, columns, strict=True)]
    return tuple(sorted(pairs, key=lambda pair: -abs(pair.correlation)))
