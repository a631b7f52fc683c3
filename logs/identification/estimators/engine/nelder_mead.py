"""The robust path: Nelder and Mead's simplex on the integrated squares (Malladi Eq. 29), and several starts.

``eta(s)`` is the integral over time of the squared differences between measured and simulated outputs, each output
in units of its own motion, so that outputs of several units add up. Each manoeuvre's own numbers (initial states,
biases) are at their best for every ``s``, by linear least squares. When the simplex has shrunk, the units become
those of the residuals and the search goes on (relaxation), so that it ends where the likelihood is greatest.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from logs.identification.estimators.engine.gauss_newton import (
    Found,
    Here,
    at_bounds,
    here,
    overflow,
    size_of,
    squares_of,
)
from logs.identification.estimators.engine.normal_equations import finite, normal_of, pseudo_inverse, step_of
from logs.identification.estimators.engine.problem import Iteration, Problem
from logs.identification.estimators.engine.records import Record
from logs.identification.estimators.engine.simulation import Flight, Unknowns
from logs.identification.estimators.engine.weights import Whitener, variation, whitener_of
from logs.identification.results import Array

PASSES = 6
FIRST_SIZE = 0.1
"""-; of a parameter: the first simplex"""
LEAST_SIZE = 1e-2
THRESHOLD = 1e-3
"""-; of the first simplex: its size at the end"""
MOST_EVALUATIONS = 200
"""-; per parameter, of one pass"""
OVERFLOWED = 1e30
LARGE = 4
"""-; parameters from which on the simplex moves by steps made for many (Gao & Han, 2012)"""
SETTLED = 1e-2
"""-; change of the logarithm of the likelihood between passes"""
NEAR = 0.5
"""-; standard errors that Gauss-Newton would still move the end of the simplex by"""


def nelder_mead(problem: Problem, flight: Flight, start: Unknowns) -> Found:
    """Search from ``start``; errors are then computed at its end as at Gauss-Newton's."""
    sizes = FIRST_SIZE * np.maximum(np.abs(start.values), LEAST_SIZE)
    weights, unknowns, before = np.diag(variation(flight.records) ** 2), start, float("inf")
    steps: list[Iteration] = []
    for turn in range(PASSES):
        unknowns, done = _pass(flight, unknowns, weights, sizes / 2**turn)
        residuals = flight.residuals(unknowns)
        if not all(np.all(np.isfinite(piece)) for piece in residuals):
            return _nowhere(flight, unknowns, weights, f"of all the simplex tried, {overflow(flight, residuals)}")
        now = here(problem, flight, unknowns, residuals)
        steps.append(Iteration(now.cost, float("nan")))
        if done and abs(before - now.cost) < SETTLED:
            break
        weights, before = now.noise, now.cost
    return _ended(flight, now, done, tuple(steps))


def _nowhere(flight: Flight, unknowns: Unknowns, weights: Array, reason: str) -> Found:
    held = np.zeros(len(unknowns.values), dtype=bool)
    return Found("diverged", reason, unknowns, weights, None, held, float("inf"), ())


def _ended(flight: Flight, now: Here, done: bool, steps: tuple[Iteration, ...]) -> Found:
    """The end of the search, believed only where Gauss-Newton would hardly move it."""
    normal = normal_of(flight, now.unknowns, now.residuals, now.whiteners)
    if not finite(normal):
        return _nowhere(flight, now.unknowns, now.noise, "the simulation overflows next to the values found")
    held = at_bounds(flight, normal, now.unknowns)
    size = size_of(step_of(normal, held), normal, held)
    state = (now.unknowns, now.noise, normal, held, now.cost, (*steps, Iteration(now.cost, size)))
    if not done:
        return Found("not converged", "the simplex did not shrink to its threshold", *state)
    if size > NEAR:
        return Found("not converged", f"the simplex shrank {size:.1f} standard errors from the optimum", *state)
    return Found("converged", "", *state)


class Bordered(NamedTuple):
    """A record's own numbers as they enter at the beginning of a pass, to be at their best for any parameters."""

    record: Record
    white: Whitener
    slopes: Array
    """(N m, l); in standard deviations"""
    inverse: Array
    """(l, l); of their Gram matrix"""

    def best(self, flight: Flight, values: Array, own: Array) -> tuple[Array, float]:
        """The change (l,) of its own numbers that is best for ``values``, and the squares that it leaves."""
        residual = flight.residual(self.record, values, own)
        sound = np.all(np.isfinite(residual), axis=1)
        if not np.all(sound):
            return np.zeros(len(own)), OVERFLOWED * (2 - float(np.argmin(sound)) / len(sound))
        raw = self.white(residual).ravel()
        change = self.inverse @ (self.slopes.T @ raw)
        return change, float(np.sum((raw - self.slopes @ change) ** 2))


def _bordered(flight: Flight, unknowns: Unknowns, weights: Array) -> tuple[Bordered, ...]:
    borders = []
    for record, own in zip(flight.records, unknowns.own, strict=True):
        white = whitener_of(record, weights)
        slopes = white(flight.slopes(record, unknowns.values, own, len(unknowns.values))).reshape(-1, len(own))
        slopes = slopes if np.all(np.isfinite(slopes)) else np.zeros_like(slopes)
        borders.append(Bordered(record, white, slopes, pseudo_inverse(slopes.T @ slopes)[0]))
    return tuple(borders)


def _pass(flight: Flight, start: Unknowns, weights: Array, sizes: Array) -> tuple[Unknowns, bool]:
    """The best of one simplex, and whether it shrank to its threshold."""
    from scipy.optimize import minimize  # takes 0.3 s, which a flight need not wait for

    borders, p = _bordered(flight, start, weights), len(start.values)

    def placed(scaled: Array) -> Array:
        inside: Array = np.clip(start.values + scaled * sizes, flight.layout.low, flight.layout.high)
        return inside

    def cost(scaled: Array) -> float:
        pairs = zip(borders, start.own, strict=True)
        values = placed(scaled)
        return sum(border.best(flight, values, own)[1] for border, own in pairs) + flight.prior_squares(values)

    options: dict[str, Any] = {
        "initial_simplex": np.vstack((np.zeros(p), np.eye(p))),
        "xatol": THRESHOLD,
        "fatol": np.inf,
        "maxfev": MOST_EVALUATIONS * p,
        "adaptive": p > LARGE,
    }
    outcome = minimize(cost, np.zeros(p), method="Nelder-Mead", options=options)
    values = placed(outcome.x)
    pairs = zip(borders, start.own, strict=True)
    changed = tuple(own + border.best(flight, values, own)[0] for border, own in pairs)
    moved, still = Unknowns(values, changed), Unknowns(values, start.own)
    whiteners = tuple(border.white for border in borders)
    better = squares_of(flight.residuals(moved), whiteners) <= squares_of(flight.residuals(still), whiteners)
    return moved if better else still, bool(outcome.success)
