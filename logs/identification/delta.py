"""Errors of what is computed from estimated parameters, to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from logs.identification.results import Array


def propagate(of: Callable[[Array], Array], values: Array, covariance: Array) -> tuple[Array, Array]:
    """Value (k,) and standard errors (k,) of ``of(values)`` by the delta method, gradients by central difference."""
    central, carried = carry(of, values, covariance)
    return central, np.sqrt(np.maximum(np.diag(carried), 0.0))


def carry(of: Callable[[Array], Array], values: Array, covariance: Array) -> tuple[Array, Array]:
    """Value (k,) and covariance (k, k) of ``of(values)`` by the delta method, gradients by central difference."""
    central = of(values)
    errors = np.sqrt(np.diag(covariance))
    columns = []
    for index, error in enumerate(errors):
        width = 0.01 * error if error > 0 else 1e-6
        ahead, behind = values.copy(), values.copy()
        ahead[index] += width
        behind[index] -= width
        columns.append((of(ahead) - of(behind)) / (2 * width))
    gradient = np.column_stack(columns)
    return central, gradient @ covariance @ gradient.T
