"""Search for the maximum of the likelihood, and the covariance of what it finds.

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
    Spectrum,
    Step,
    finite,
    normal_of,
    pseudo_inverse,
    reduced,
    spectrum_of,
    step_of,
)
from logs.identification.estimators.engine.problem import Iteration, Problem, Status
from logs.identification.estimators.engine.records import Flags, Indices, Record
from logs.identification.estimators.engine.simulation import (
    Flight,
    Unknowns,
    Whitener,
    about_mean,
    noise_of,
    variation,
    whitener_of,
)
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, student_factor
from logs.identification.statistics.covariance import record_covariance

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


MIXED = 1e-2
"""-; share of a parameter in a direction that the data does not determine"""
WIDEST = 1.0
"""-; of a value: half an interval, from which on it must also move the outputs less than they moved"""

register({
    "wide_interval": Entry(
        "half of its interval, {value:.3g}, exceeds the value",
        "The 95 % interval contains zero, and its ends change the outputs more than the measured motion.",
        "fly larger inputs or more of them, or fix the parameter",
    ),
    "not_significant": Entry(
        "the model explains no more of the outputs than chance",
        "An F test of the model against constant outputs is not significant at 99 %.",
        "fly larger inputs; compare the model with the aircraft",
    ),
})  # fmt: skip


class Accuracy(NamedTuple):
    """What the estimates are worth."""

    covariance: Array
    """(p, p); zero in the rows of what is not identified"""
    degrees: Array
    """-; (p,), effective degrees of freedom of each variance"""
    findings: tuple[Finding, ...]
    """withheld: the parameters without an estimate; warnings: those with a wide interval"""


def accuracy_of(flight: Flight, optimum: OptimizerResult, names: tuple[str, ...]) -> Accuracy:
    """Errors of the parameters that are not at a bound, for colored residuals and with nuisance parameters."""
    assert optimum.normal is not None
    free, p = np.flatnonzero(~optimum.at_bound), len(names)
    equations = reduced(optimum.normal).only(free)
    spectrum = spectrum_of(equations, optimum.normal.sizes[free])
    inner, each = _covariance(flight, optimum.normal, free, spectrum.inverse(), equations.rank)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = inner
    degrees = np.ones(p)
    degrees[free] = each
    values = optimum.unknowns.values
    lost = {
        names[i]: Finding("at_bound", "withheld", names[i], float(values[i]))
        for i in np.flatnonzero(optimum.at_bound)
    }
    lost |= _undetermined(spectrum, [names[i] for i in free])
    for index in (names.index(name) for name in lost):
        covariance[index], covariance[:, index] = 0.0, 0.0
    halves = np.sqrt(np.diag(covariance)) * [student_factor(float(one)) for one in degrees]
    wide = [one for one in _wide(flight, optimum, halves, names) if one.subject not in lost]
    return Accuracy(covariance, degrees, (*(lost[name] for name in names if name in lost), *wide))


def _covariance(flight: Flight, normal: Normal, free: Indices, inverse: Array, rank: int) -> tuple[Array, Array]:
    """Covariance (p, p) of the ``free`` parameters and effective degrees of freedom (p,)."""
    sensitivities = []
    for block in normal.blocks:
        inner, _ = pseudo_inverse(block.nuisances.T @ block.nuisances)
        rest = block.slopes[:, free] - block.nuisances @ (inner @ (block.nuisances.T @ block.slopes[:, free]))
        sensitivities.append(rest.reshape(*block.residuals.shape, len(free)))
    residuals, used = [block.residuals for block in normal.blocks], [record.used for record in flight.records]
    prior = np.diag(normal.precision[free])
    return record_covariance(residuals, used, sensitivities, inverse, len(free) + rank, prior)


def _undetermined(spectrum: Spectrum, names: list[str]) -> dict[str, Finding]:
    """Parameters in directions without information, by name, with those that they are correlated with."""
    lost: dict[str, Finding] = {}
    null = spectrum.vectors[:, ~spectrum.determined]
    share = np.sqrt(np.sum(null**2, axis=1))
    for index, name in enumerate(names):
        if not np.isfinite(spectrum.scale[index]):
            lost[name] = Finding("no_effect", "withheld", name)
        elif share[index] > MIXED:
            related = np.abs(null @ null[index]) > MIXED * share[index]
            others = [other for i, other in enumerate(names) if related[i] and other != name]
            details = {"others": ", ".join(others) or "the initial states and biases"}
            lost[name] = Finding("not_identifiable", "withheld", name, details=details)
    return lost


def _wide(flight: Flight, end: OptimizerResult, halves: Array, names: tuple[str, ...]) -> list[Finding]:
    """Parameters whose half interval exceeds them and would move the outputs more than they moved."""
    assert end.normal is not None
    motion, effects = _motion(flight, end.weights), np.sqrt(reduced(end.normal).alone)
    return [
        Finding("wide_interval", "warning", name, float(half), abs(float(value)))
        for name, half, value, effect in zip(names, halves, end.unknowns.values, effects, strict=True)
        if not np.isfinite(half) or (half > WIDEST * abs(value) and half * effect > motion)
    ]


def _motion(flight: Flight, weights: Array) -> float:
    """Norm of the outputs' own motion about their means, as the search weighs it."""
    squares = [float(np.sum(whitener_of(r, weights)(about_mean(r)) ** 2)) for r in flight.records]
    return float(np.sqrt(sum(squares)))
