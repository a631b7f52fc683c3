"""Nelder and Mead's simplex on the integrated squares (Malladi Eq. 29): start of Gauss-Newton where it is far.

The cost is the sum of squares of measured minus modeled outputs, each in units of its motion. Initial states and
biases of each record are optimal for every set of parameters, by linear least squares.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from logs.identification.estimators.engine.normal_equations import pseudo_inverse
from logs.identification.estimators.engine.records import Record
from logs.identification.estimators.engine.simulation import Flight, Unknowns
from logs.identification.estimators.engine.weights import Whitener, variation, whitener_of
from logs.identification.results import Array

FIRST_SIZE = 0.1
"""-; of a parameter: the first simplex"""
MIN_SIZE = 1e-2
THRESHOLD = 1e-3
"""-; of the first simplex: its size at the end"""
MAX_EVALUATIONS = 600
"""-; per parameter"""
OVERFLOWED = 1e30
LARGE = 4
"""-; parameters from which on the simplex moves by steps made for many (Gao & Han, 2012)"""


class Bordered(NamedTuple):
    """A record with the sensitivities to its initial state and biases at the start of the search."""

    record: Record
    white: Whitener
    slopes: Array
    """(N m, l); in standard deviations"""
    inverse: Array
    """(l, l); of their Gram matrix"""

    def best(self, flight: Flight, values: Array, local: Array) -> tuple[Array, float]:
        """Change (l,) of the record's values ``local`` that is best for ``values``, and the squares that remain."""
        residual = flight.residual(self.record, values, local)
        finite = np.all(np.isfinite(residual), axis=1)
        if not np.all(finite):
            return np.zeros(len(local)), OVERFLOWED * (2 - float(np.argmin(finite)) / len(finite))
        raw = self.white(residual).ravel()
        change = self.inverse @ (self.slopes.T @ raw)
        return change, float(np.sum((raw - self.slopes @ change) ** 2))


def nelder_mead(flight: Flight, start: Unknowns) -> Unknowns:
    """The end of the search from ``start``."""
    from scipy.optimize import minimize  # takes 0.3 s, which a flight need not wait for

    borders = [_bordered(flight, *pair, start.values) for pair in zip(flight.records, start.own, strict=True)]
    sizes, p = FIRST_SIZE * np.maximum(np.abs(start.values), MIN_SIZE), len(start.values)

    def inside(scaled: Array) -> Array:
        clipped: Array = np.clip(start.values + scaled * sizes, flight.layout.low, flight.layout.high)
        return clipped

    def cost(scaled: Array) -> float:
        values = inside(scaled)
        pairs = zip(borders, start.own, strict=True)
        return sum(border.best(flight, values, local)[1] for border, local in pairs) + flight.prior_squares(values)

    options: dict[str, Any] = {
        "initial_simplex": np.vstack((np.zeros(p), np.eye(p))),
        "xatol": THRESHOLD,
        "fatol": np.inf,
        "maxfev": MAX_EVALUATIONS * p,
        "adaptive": p > LARGE,
    }
    values = inside(minimize(cost, np.zeros(p), method="Nelder-Mead", options=options).x)
    changed = (local + one.best(flight, values, local)[0] for one, local in zip(borders, start.own, strict=True))
    return Unknowns(values, tuple(changed))


def _bordered(flight: Flight, record: Record, local: Array, values: Array) -> Bordered:
    white = whitener_of(record, np.diag(variation(flight.records) ** 2))
    slopes = white(flight.slopes(record, values, local, len(values))).reshape(-1, len(local))
    slopes = slopes if np.all(np.isfinite(slopes)) else np.zeros_like(slopes)
    return Bordered(record, white, slopes, pseudo_inverse(slopes.T @ slopes)[0])
