"""Search for the maximum of the likelihood: Gauss-Newton with step control, and a simplex for poor start values.

A Gauss-Newton step that does not reduce the cost is halved, then damped (Levenberg, Marquardt). The noise covariance
is estimated after every step (relaxation). Jategaonkar, Flight Vehicle System Identification, 2006, ch. 4; Klein &
Morelli, Aircraft System Identification, 2006, ch. 6. Nelder and Mead's simplex minimizes the integrated squares
(Malladi Eq. 29), each output in units of its motion; initial states and biases of each record are optimal for every
set of parameters, by linear least squares.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from logs.identification.estimators.engine.normal_equations import (
    Normal,
    Step,
    finite,
    normal_of,
    pseudo_inverse,
    reduced,
    step_of,
)
from logs.identification.estimators.engine.problem import Iteration, Problem, Status
from logs.identification.estimators.engine.records import Flags, Record
from logs.identification.estimators.engine.simulation import (
    Flight,
    Unknowns,
    Whitener,
    noise_of,
    variation,
    whitener_of,
)
from logs.identification.results import Array

SHARES = (1.0, 0.5, 0.25, 0.125)
DAMPINGS = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 1e3, 1e5)
SMALL_STEP = 1e-2
"""-; standard errors of white residuals"""
SMALL_RELATIVE_STEP = 1e-9
"""-; of a parameter's size: records without noise have no standard error to measure with"""
SMALL_COST = 1e-2
"""-; change of the logarithm of the likelihood"""
FLAT_STEPS, FLAT_SIZE = 4, 0.5
"""-; steps in which the cost is constant, and standard errors of the last one, that end the search as well"""
STALLED_STEP = 0.1
"""-; standard errors: a smaller step that no longer lowers the cost ends the search at its numerical floor"""
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


class OptimizerResult(NamedTuple):
    """Where a search ended."""

    status: Status
    reason: str
    """-; one clause, empty where converged"""
    unknowns: Unknowns
    weights: Array
    """(m, m); the covariance that weighs the outputs"""
    normal: Normal | None
    """at the end; None where nothing could be flown"""
    at_bound: Flags
    """(p,) of bool; parameters at a bound"""
    cost: float
    """-; as `Here.cost`"""
    iterations: tuple[Iteration, ...]


class Here(NamedTuple):
    """The search at one set of unknowns."""

    unknowns: Unknowns
    residuals: list[Array]
    """as the outputs; (N, m) of each record, measured minus model"""
    noise: Array
    """as the outputs' products; (m, m), covariance of the residuals"""
    whiteners: tuple[Whitener, ...]
    squares: float
    """-; weighted residuals and distances from the priors"""

    @property
    def cost(self) -> float:
        """Negative logarithm of the likelihood, without its constant."""
        return self.squares / 2 + sum(white.log_determinant for white in self.whiteners)


def squares_of(residuals: list[Array], whiteners: tuple[Whitener, ...]) -> float:
    """Weighted squares; infinite where a simulation overflowed."""
    if not all(np.all(np.isfinite(block)) for block in residuals):
        return float("inf")
    return float(sum(np.sum(white(block) ** 2) for block, white in zip(residuals, whiteners, strict=True)))


def here(problem: Problem, flight: Flight, unknowns: Unknowns, residuals: list[Array]) -> Here:
    """The search at ``unknowns``, the noise that of ``residuals``."""
    noise = noise_of(problem, flight.records, residuals)
    whiteners = tuple(whitener_of(record, noise) for record in flight.records)
    squares = squares_of(residuals, whiteners) + flight.prior_squares(unknowns.values)
    return Here(unknowns, residuals, noise, whiteners, squares)


def gauss_newton(problem: Problem, flight: Flight, start: Unknowns, most: int) -> OptimizerResult:
    """Search from ``start`` in at most ``most`` steps."""
    at_bound = np.zeros(len(start.values), dtype=bool)
    residuals = flight.residuals(start)
    if not all(np.all(np.isfinite(block)) for block in residuals):
        reason = f"with the start values {overflow(flight, residuals)}"
        return OptimizerResult(
            "diverged", reason, start, np.eye(len(problem.outputs)), None, at_bound, float("inf"), ()
        )
    now = here(problem, flight, start, residuals)
    steps: list[Iteration] = []
    before = float("inf")
    while True:
        normal = normal_of(flight, now.unknowns, now.residuals, now.whiteners)
        if not finite(normal):
            reason = "the simulation overflows next to the values found"
            return OptimizerResult(
                "diverged", reason, now.unknowns, now.noise, None, at_bound, now.cost, tuple(steps)
            )
        at_bound = at_bounds(flight, normal, now.unknowns)
        step = step_of(normal, at_bound)
        size = size_of(step, normal, at_bound)
        steps.append(Iteration(now.cost, size))
        state = (now.unknowns, now.noise, normal, at_bound, now.cost, tuple(steps))
        if size < SMALL_STEP and step.decrement < SMALL_COST and abs(before - now.cost) < SMALL_COST:
            return OptimizerResult("converged", "", *state)
        if len(steps) > FLAT_STEPS and steps[-1 - FLAT_STEPS].cost - now.cost < SMALL_COST and size < FLAT_SIZE:
            return OptimizerResult("converged", "", *state)
        if len(steps) > most:
            return OptimizerResult("not converged", f"not converged after {most} steps", *state)
        advanced = _advance(flight, now, normal, step, at_bound)
        if advanced is None:
            if size < STALLED_STEP:
                return OptimizerResult("converged", "", *state)
            return OptimizerResult("not converged", "no step lowers the cost any more", *state)
        before = now.cost
        now = here(problem, flight, *advanced)


def overflow(flight: Flight, residuals: list[Array]) -> str:
    """Which simulation overflows, and when."""
    for record, block in zip(flight.records, residuals, strict=True):
        bad = np.flatnonzero(~np.all(np.isfinite(block), axis=1))
        if len(bad):
            return f"the model diverges {record.time[bad[0]] - record.time[0]:.3g} s into {record.name}"
    return "the model diverges"


def size_of(step: Step, normal: Normal, at_bound: Flags) -> float:
    """Largest change of ``step`` in standard errors; zero where it is below the numbers' own resolution."""
    determined = np.isfinite(step.errors) & ~at_bound
    shares = np.abs(step.values[determined]) / step.errors[determined]
    shares[np.abs(step.values[determined]) < SMALL_RELATIVE_STEP * normal.sizes[determined]] = 0.0
    return float(np.max(shares, initial=0.0))


def at_bounds(flight: Flight, normal: Normal, unknowns: Unknowns) -> Flags:
    """Parameters (p,) at a bound that the likelihood would have further out."""
    low, high = flight.layout.low, flight.layout.high
    if not np.any((unknowns.values <= low) | (unknowns.values >= high)):
        return np.zeros(len(low), dtype=bool)
    gradient = reduced(normal).gradient
    at_bound: Flags = ((unknowns.values <= low) & (gradient <= 0)) | ((unknowns.values >= high) & (gradient >= 0))
    return at_bound


def _trials(now: Here, normal: Normal, step: Step, at_bound: Flags) -> Iterator[Unknowns]:
    for share in SHARES:
        yield step.taken(now.unknowns, share)
    for damping in DAMPINGS:
        yield step_of(normal, at_bound, damping).taken(now.unknowns, 1.0)


def _advance(
    flight: Flight, now: Here, normal: Normal, step: Step, at_bound: Flags
) -> tuple[Unknowns, list[Array]] | None:
    """The first trial whose weighted squares are less; None where none is."""
    for trial in _trials(now, normal, step, at_bound):
        inside = trial._replace(values=np.clip(trial.values, flight.layout.low, flight.layout.high))
        residuals = flight.residuals(inside)
        if squares_of(residuals, now.whiteners) + flight.prior_squares(inside.values) < now.squares:
            return inside, residuals
    return None


# --- simplex ------------------------------------------------------------------------------------------------


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

    borders = [_bordered(flight, *pair, start.values) for pair in zip(flight.records, start.local, strict=True)]
    sizes, p = FIRST_SIZE * np.maximum(np.abs(start.values), MIN_SIZE), len(start.values)

    def inside(scaled: Array) -> Array:
        clipped: Array = np.clip(start.values + scaled * sizes, flight.layout.low, flight.layout.high)
        return clipped

    def cost(scaled: Array) -> float:
        values = inside(scaled)
        pairs = zip(borders, start.local, strict=True)
        return sum(border.best(flight, values, local)[1] for border, local in pairs) + flight.prior_squares(values)

    options: dict[str, Any] = {
        "initial_simplex": np.vstack((np.zeros(p), np.eye(p))),
        "xatol": THRESHOLD,
        "fatol": np.inf,
        "maxfev": MAX_EVALUATIONS * p,
        "adaptive": p > LARGE,
    }
    values = inside(minimize(cost, np.zeros(p), method="Nelder-Mead", options=options).x)
    changed = (local + one.best(flight, values, local)[0] for one, local in zip(borders, start.local, strict=True))
    return Unknowns(values, tuple(changed))


def _bordered(flight: Flight, record: Record, local: Array, values: Array) -> Bordered:
    white = whitener_of(record, np.diag(variation(flight.records) ** 2))
    slopes = white(flight.slopes(record, values, local, len(values))).reshape(-1, len(local))
    slopes = slopes if np.all(np.isfinite(slopes)) else np.zeros_like(slopes)
    return Bordered(record, white, slopes, pseudo_inverse(slopes.T @ slopes)[0])
