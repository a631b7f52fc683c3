"""A moving average that some columns of a regression went through, given to the others too.

The slope of a measured rate over several samples is the true angular acceleration, averaged. Regressors as measured
beside it give coefficients that are too small, by what the average takes of a motion, and more where an input jumps;
regressors that went through the same average give the coefficients themselves (the filtered regression of Young,
Automatica 17(1), 1981, with a finite filter).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import filled
from logs.identification.estimators.regression.terms import Term, evaluate
from logs.identification.results import Array

SMOOTH = (-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0)
"""-; mean of a signal from one sample to the next, of the two and their neighbours: that of a cubic through them"""
LINE = (0.0, 0.5, 0.5, 0.0)
"""-; the same of a line through the two"""


class Averaging(NamedTuple):
    """What the columns of a regression are averaged with."""

    weights: Array
    """-; (2 h + 1,), of a sample and its h neighbours on both sides; they add up to 1"""
    others: Array
    """-; the same by another course between samples, of which neither is known to be the one"""
    through: frozenset[str]
    """-; signals that went through it before"""


def average_of_slope(slope: Array, mean: tuple[float, ...] = SMOOTH) -> Array:
    """Weights (2 h + 3,) of the average that a slope with the weights ``slope`` (2 h + 1,) per step takes.

    A sum of differences between neighbours, summed by parts; between two samples a signal is its ``mean``.
    """
    between = -np.cumsum(slope)[:-1]
    return np.asarray(np.convolve(between, mean))


def averaged(values: Array, weights: Array) -> Array:
    """The ``values`` (N,) averaged; NaN where they are and where more than h neighbours in a row are missing.

    A straight line bridges fewer.
    """
    half, found = len(weights) // 2, np.full(len(values), np.nan)
    if len(values) >= len(weights):
        found[half : len(values) - half] = np.convolve(filled(values, half), weights[::-1], mode="valid")
    return np.where(np.isfinite(values), found, np.nan)


def as_regressed(
    term: Term, experiment: Experiment, constants: Mapping[str, float], averaging: Averaging | None
) -> Array:
    """A ``term`` (N,) as a regression has it; NaN where it has none.

    Raises:
        InputError: it names what is neither a signal nor a constant.
    """
    values = evaluate(term, experiment, constants)
    if averaging is None or averaging.through & term.powers.keys():
        return values
    return averaged(values, averaging.weights)
