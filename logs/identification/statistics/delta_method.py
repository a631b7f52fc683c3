"""Errors of what is computed from estimated parameters, to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from logs.identification.results import Array


def propagate(of: Callable[[Array], Array], values: Array, covariance: Array) -> tuple[Array, Array]:
    """Value (k,) and standard errors (k,) of ``of(values)`` by the delta method, gradients by central difference."""
    central, gradient = slopes(of, values, np.sqrt(np.diag(covariance)))
    return central, np.sqrt(np.maximum(np.diag(gradient @ covariance @ gradient.T), 0.0))


def slopes(of: Callable[[Array], Array], values: Array, errors: Array) -> tuple[Array, Array]:
    """Value (k,) and gradient (k, p) of ``of(values)`` by central differences, steps of 0.01 ``errors`` (p,)."""
    central = of(values)
    columns = []
    for index, error in enumerate(errors):
        width = 0.01 * error if error > 0 else 1e-6
        ahead, behind = values.copy(), values.copy()
        ahead[index] += width
        behind[index] -= width
        columns.append((of(ahead) - of(behind)) / (2 * width))
    return central, np.column_stack(columns)
