"""Uncertainty of parameters and of what is computed from them, by the delta method."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.results import Array, Estimate, estimates


class ParameterUncertainty(NamedTuple):
    """Covariance of parameters and its degrees of freedom."""

    covariance: Array
    """(p, p)"""
    degrees: float
    """-; effective degrees of freedom"""

    @property
    def standard_errors(self) -> Array:
        """Standard errors (p,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    def transformed(self, gradient: Array) -> ParameterUncertainty:
        """Uncertainty of functions with the ``gradient`` (k, p) by the parameters, to first order."""
        return self._replace(covariance=gradient @ self.covariance @ gradient.T)

    def part(self, chosen: slice) -> ParameterUncertainty:
        """Uncertainty of the ``chosen`` parameters."""
        return self._replace(covariance=self.covariance[chosen, chosen])

    def estimates(self, names: dict[str, str], values: Array) -> tuple[Estimate, ...]:
        """One `Estimate` per entry of ``names`` (name to unit), from ``values`` (p,)."""
        return estimates(names, values, self.covariance, self.degrees)


def propagate(
    function: Callable[[Array], Array], values: Array, uncertainty: ParameterUncertainty
) -> tuple[Array, ParameterUncertainty]:
    """Value (k,) of ``function(values)`` and its uncertainty by the delta method (central differences)."""
    central, columns = function(values), []
    for index, error in enumerate(uncertainty.standard_errors):
        width = 0.01 * error if error > 0 else 1e-6
        ahead, behind = values.copy(), values.copy()
        ahead[index] += width
        behind[index] -= width
        columns.append((function(ahead) - function(behind)) / (2 * width))
    return central, uncertainty.transformed(np.column_stack(columns))
