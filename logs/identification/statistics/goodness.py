"""How well a model's output follows the measured one: R^2, its adjusted form, and the error against the range."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array


class Goodness(NamedTuple):
    """Fit of one output."""

    r_squared: float
    """-; share of the measured variance about its mean that the model explains; below 0 it is worse than the mean"""
    adjusted: float
    """-; the same, charged for the parameters: it falls when one is added that explains no more than chance"""
    nrmse: float
    """-; root mean square error over the range of the measured: what a plot of both shows to the eye"""
    rms: float
    """as the output; root mean square error"""
    samples: int
    """-; that both have"""


def goodness(measured: Array, modelled: Array, parameters: int = 0) -> Goodness:
    """`Goodness` of ``modelled`` (N,) against ``measured`` (N,), NaN where either is missing.

    Everything is NaN where fewer than two samples are there; R^2 and NRMSE where the measured does not vary.
    ``parameters`` counts what was fitted, an intercept included.
    """
    there = np.isfinite(measured) & np.isfinite(modelled)
    count, z = int(there.sum()), measured[there]
    if count < 2:
        return Goodness(np.nan, np.nan, np.nan, np.nan, count)
    error = z - modelled[there]
    squares, spread = float(error @ error), float(np.sum((z - z.mean()) ** 2))
    rms = float(np.sqrt(squares / count))
    if spread <= 0 or np.ptp(z) == 0:  # a constant's mean is rounded
        return Goodness(np.nan, np.nan, np.nan, rms, count)
    left = count - max(parameters, 1)
    adjusted = 1 - squares / left / (spread / (count - 1)) if left > 0 else np.nan
    return Goodness(1 - squares / spread, adjusted, rms / float(np.ptp(z)), rms, count)
