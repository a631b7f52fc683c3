"""By what the terms of a regression are chosen (Klein & Morelli, Aircraft System Identification, 2006, ch. 5).

The published rules count samples. Correlated residuals carry less knowledge than their number promises, so that those
rules let in everything: here they count independent samples, and PRESS leaves out whole runs of samples, not single
ones whose neighbours give them away. With white residuals all are the published ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.regression.least_squares import Piece
from logs.identification.results import Array

ALONE = 1e-10
"""-; squared length of a column, of its own, below which the others explain it whole"""


class System(NamedTuple):
    """Regressors and response of all records, one under the other, what nuisances say of them taken out."""

    columns: Array
    """(N, p)"""
    response: Array
    """(N,)"""
    basis: Array
    """(N, k); orthonormal, of the nuisances (means, trends)"""
    independent: float
    """-; independent samples among the N"""
    charge: float
    """response squared; what the predicted square error charges for each parameter"""


class Statistics(NamedTuple):
    """How good a model with some of the columns is."""

    r_squared: float
    """-; share of the response's variance that the terms explain"""
    adjusted: float
    """-; the same, charged for the parameters"""
    press: float
    """response squared; mean square error of each run of samples predicted from the others (5.98)"""
    pse: float
    """response squared; predicted square error: mean square plus a charge for each parameter (5.103)"""
    variance: float
    """response squared; s^2, squares over degrees of freedom"""
    parameters: int
    """-; fitted, nuisances included"""


def system_of(pieces: tuple[Piece, ...], nuisances: int) -> System:
    """The `System` of ``pieces`` whose first ``nuisances`` columns are means and trends, for white residuals."""
    used = np.concatenate([piece.used for piece in pieces]) > 0
    whole = np.vstack([piece.regressors for piece in pieces])[used]
    response = np.concatenate([piece.response for piece in pieces])[used]
    basis = np.linalg.qr(whole[:, :nuisances])[0] if nuisances else np.zeros((len(whole), 0))
    rest = whole[:, nuisances:] - basis @ (basis.T @ whole[:, nuisances:])
    lost = np.sum(rest**2, axis=0) <= 1e-20 * np.sum(whole[:, nuisances:] ** 2, axis=0)
    remaining = response - basis @ (basis.T @ response)
    charge = float(remaining @ remaining) / max(len(whole) - nuisances, 1) / len(whole)
    return System(np.where(lost, 0.0, rest), remaining, basis, float(len(whole)), charge)


def for_colour(system: System, independent: float, noise: float) -> System:
    """``system`` when the most complete model leaves the variance ``noise``, worth ``independent`` samples.

    The published charge, sigma_max^2 / N with the response's own variance, is far above what white noise asks,
    2 sigma^2 / N (Barron 1984); coloured noise may ask for more than the published.
    """
    return system._replace(independent=independent, charge=max(system.charge, 2 * noise / independent))


def residuals_of(system: System, chosen: tuple[int, ...]) -> Array:
    """What the columns ``chosen`` leave of the response (N,)."""
    columns = system.columns[:, chosen]
    rest: Array = system.response - columns @ np.linalg.lstsq(columns, system.response, rcond=None)[0]
    return rest


def statistics_of(system: System, chosen: tuple[int, ...]) -> Statistics:
    """`Statistics` of the model with the columns ``chosen``; NaN for shares of a response that does not vary."""
    residuals = residuals_of(system, chosen)
    count, nuisances = len(residuals), system.basis.shape[1]
    fitted = len(chosen) + nuisances
    squares, total = float(residuals @ residuals), float(system.response @ system.response)
    worst, variance = total / max(count - nuisances, 1), squares / max(count - fitted, 1)
    return Statistics(
        1 - squares / total if total > 0 else np.nan,
        1 - variance / worst if total > 0 else np.nan,
        press(system, chosen, residuals),
        squares / count + system.charge * fitted,
        variance,
        fitted,
    )


def press(system: System, chosen: tuple[int, ...], residuals: Array) -> float:
    """Mean square error of runs of N / independent samples, each predicted from all others."""
    design = np.column_stack((system.basis, np.linalg.qr(system.columns[:, chosen])[0]))
    length = max(round(len(residuals) / system.independent), 1)
    if length == 1:
        left = np.maximum(1 - np.sum(design**2, axis=1), ALONE)
        return float(np.mean((residuals / left) ** 2))
    # All runs at once, the last filled up with rows that say nothing.
    runs = -(-len(residuals) // length)
    filled = np.zeros((runs * length, design.shape[1] + 1))
    filled[: len(residuals), :-1], filled[: len(residuals), -1] = design, residuals
    stacked = filled.reshape(runs, length, -1)
    own, errors = stacked[:, :, :-1], stacked[:, :, -1:]
    across = own.transpose(0, 2, 1)
    # (I - H)^-1 of a run, in the few dimensions of the model instead of the many of the run.
    inner = np.linalg.pinv(np.eye(design.shape[1]) - across @ own, hermitian=True)
    return float(np.sum((errors + own @ (inner @ (across @ errors))) ** 2)) / len(residuals)


def partial_f(system: System, chosen: tuple[int, ...], column: int) -> float:
    """Partial F of one ``column`` of the ``chosen`` (5.92), as published: for white residuals."""
    full = residuals_of(system, chosen)
    without = residuals_of(system, tuple(c for c in chosen if c != column))
    squares = float(full @ full)
    degrees = max(len(full) - len(chosen) - system.basis.shape[1], 1)
    return (float(without @ without) - squares) / squares * degrees if squares > 0 else np.inf


def partial_correlations(system: System, chosen: tuple[int, ...]) -> Array:
    """Correlation (p,) of each column with the response, both without what the ``chosen`` say (5.90).

    Zero for the chosen and for columns that they explain whole.
    """
    residuals, kept = residuals_of(system, chosen), system.columns[:, chosen]
    rest = system.columns - kept @ np.linalg.lstsq(kept, system.columns, rcond=None)[0]
    squares, own = np.sum(rest**2, axis=0), np.sum(system.columns**2, axis=0)
    alive = squares > ALONE * own
    alive[list(chosen)] = False
    size = np.sqrt(np.where(alive, squares, 1.0) * max(float(residuals @ residuals), 1e-300))
    return np.asarray(np.where(alive, rest.T @ residuals / size, 0.0))
