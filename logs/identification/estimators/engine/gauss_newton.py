"""Gauss-Newton on the likelihood, its step halved or damped (Levenberg, Marquardt) where it does not help.

Jategaonkar, Flight Vehicle System Identification, 2006, ch. 4; Klein & Morelli, Aircraft System Identification,
2006, ch. 6. The noise covariance is estimated anew after every step (relaxation).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.normal_equations import Normal, Step, finite, normal_of, reduced, step_of
from logs.identification.estimators.engine.problem import Iteration, Problem, Status
from logs.identification.estimators.engine.records import Flags
from logs.identification.estimators.engine.simulation import Flight, Unknowns
from logs.identification.estimators.engine.weights import Whitener, noise_of, whitener_of
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


class Found(NamedTuple):
    """Where a search ended."""

    status: Status
    reason: str
    """-; one clause, empty where converged"""
    unknowns: Unknowns
    weights: Array
    """(m, m); the covariance that weighs the outputs"""
    normal: Normal | None
    """at the end; None where nothing could be flown"""
    held: Flags
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


def gauss_newton(problem: Problem, flight: Flight, start: Unknowns, most: int) -> Found:
    """Search from ``start`` in at most ``most`` steps."""
    held = np.zeros(len(start.values), dtype=bool)
    residuals = flight.residuals(start)
    if not all(np.all(np.isfinite(block)) for block in residuals):
        reason = f"with the start values {overflow(flight, residuals)}"
        return Found("diverged", reason, start, np.eye(len(problem.outputs)), None, held, float("inf"), ())
    now = here(problem, flight, start, residuals)
    steps: list[Iteration] = []
    before = float("inf")
    while True:
        normal = normal_of(flight, now.unknowns, now.residuals, now.whiteners)
        if not finite(normal):
            reason = "the simulation overflows next to the values found"
            return Found("diverged", reason, now.unknowns, now.noise, None, held, now.cost, tuple(steps))
        held = at_bounds(flight, normal, now.unknowns)
        step = step_of(normal, held)
        size = size_of(step, normal, held)
        steps.append(Iteration(now.cost, size))
        state = (now.unknowns, now.noise, normal, held, now.cost, tuple(steps))
        if size < SMALL_STEP and step.decrement < SMALL_COST and abs(before - now.cost) < SMALL_COST:
            return Found("converged", "", *state)
        if len(steps) > FLAT_STEPS and steps[-1 - FLAT_STEPS].cost - now.cost < SMALL_COST and size < FLAT_SIZE:
            return Found("converged", "", *state)
        if len(steps) > most:
            return Found("not converged", f"not converged after {most} steps", *state)
        advanced = _advance(flight, now, normal, step, held)
        if advanced is None:
            if size < STALLED_STEP:
                return Found("converged", "", *state)
            return Found("not converged", "no step lowers the cost any more", *state)
        before = now.cost
        now = here(problem, flight, *advanced)


def overflow(flight: Flight, residuals: list[Array]) -> str:
    """Which simulation overflows, and when."""
    for record, block in zip(flight.records, residuals, strict=True):
        bad = np.flatnonzero(~np.all(np.isfinite(block), axis=1))
        if len(bad):
            return f"the model diverges {record.time[bad[0]] - record.time[0]:.3g} s into {record.name}"
    return "the model diverges"


def size_of(step: Step, normal: Normal, held: Flags) -> float:
    """Largest change of ``step`` in standard errors; zero where it is below the numbers' own resolution."""
    determined = np.isfinite(step.errors) & ~held
    shares = np.abs(step.values[determined]) / step.errors[determined]
    shares[np.abs(step.values[determined]) < SMALL_RELATIVE_STEP * normal.sizes[determined]] = 0.0
    return float(np.max(shares, initial=0.0))


def at_bounds(flight: Flight, normal: Normal, unknowns: Unknowns) -> Flags:
    """Parameters (p,) at a bound that the likelihood would have further out."""
    low, high = flight.layout.low, flight.layout.high
    if not np.any((unknowns.values <= low) | (unknowns.values >= high)):
        return np.zeros(len(low), dtype=bool)
    gradient = reduced(normal).gradient
    held: Flags = ((unknowns.values <= low) & (gradient <= 0)) | ((unknowns.values >= high) & (gradient >= 0))
    return held


def _trials(now: Here, normal: Normal, step: Step, held: Flags) -> Iterator[Unknowns]:
    for share in SHARES:
        yield step.taken(now.unknowns, share)
    for damping in DAMPINGS:
        yield step_of(normal, held, damping).taken(now.unknowns, 1.0)


def _advance(
    flight: Flight, now: Here, normal: Normal, step: Step, held: Flags
) -> tuple[Unknowns, list[Array]] | None:
    """The first trial whose weighted squares are less; None where none is."""
    for trial in _trials(now, normal, step, held):
        inside = trial._replace(values=np.clip(trial.values, flight.layout.low, flight.layout.high))
        residuals = flight.residuals(inside)
        if squares_of(residuals, now.whiteners) + flight.prior_squares(inside.values) < now.squares:
            return inside, residuals
    return None
