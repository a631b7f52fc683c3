"""The likeliest parameters of an aircraft in its gusts: scoring with Levenberg's damping, then quasi-Newton steps.

Scoring takes the information for the likelihood's curvature (Jategaonkar, Flight Vehicle System Identification, 2006,
ch. 5; Klein & Morelli, Aircraft System Identification, 2006, ch. 6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.flight.gust_ekf_data import PHASES, Task
from logs.identification.estimators.flight.gust_likelihood import Likelihood, Likelihoods
from logs.identification.estimators.flight.gusts import DOUBT
from logs.identification.estimators.flight.normalized_innovations import (
    gradient_terms,
    information,
    whitened,
    whitened_change,
)
from logs.identification.results import Array

LONGEST = 1.0
"""-; step of the gusts' parameters: the first steps, far from the optimum, would leap out of sight"""
DIFFERENCE = 1e-5
"""-; of a parameter, for the likelihood's slope"""
ITERATIONS = 50
"""-; steps of each part of a search at the most"""
LITTLE, CONVERGED = 0.5, 1e-2
"""-; gain of the likelihood's logarithm by a step of scoring that others follow, and what one more promises"""
ROUNDS = 2
"""-; of a search: both parts again where the second lost its way"""
SHORTENED, SHORTER = 5, 8.0
"""-; times that a step which leads up is shortened, and by how much: a tenth of each is tried too"""
WORST_CONDITION = 1e14
"""-; of an information whose diagonal is 1"""


class End(NamedTuple):
    """Where a search ended."""

    values: Array
    """(p + 19,)"""
    cost: float
    """-; infinite where it did not converge"""


def likelihood_at(likelihoods: Likelihoods, values: Array) -> Likelihood:
    """At one set of parameters (p + 19,)."""
    return likelihoods(values[None])[0]


def climb(task: Task, values: Array, likelihoods: Likelihoods, centre: Array) -> End:
    """`scoring` as long as it gains much, then `_settled`; and both again where that lost its way."""
    for _ in range(ROUNDS):
        here, values = scoring(task, values, likelihoods, centre)
        if not np.isfinite(here.cost):
            break
        end, values = _settled(task, values, likelihoods, centre)
        if np.isfinite(end.cost):
            return end
    return End(values, np.inf)


def scoring(task: Task, values: Array, likelihoods: Likelihoods, centre: Array) -> tuple[Likelihood, Array]:
    """Where steps of scoring gain but little more; an infinite cost where they do not come to that."""
    here, damping = likelihood_at(likelihoods, values), 1e-3
    for _ in range(ITERATIONS):
        if not np.isfinite(here.cost):
            break
        scores, squared = scored(task, values, likelihoods)
        if not determined(squared):
            break
        gradient, before = _gradient(scores, values, centre), here.cost
        values, here, damping = _advanced(likelihoods, values, here, (gradient, squared), damping)
        if before - here.cost < LITTLE:
            return here, values
    return here._replace(cost=np.inf), values


def _settled(task: Task, values: Array, likelihoods: Likelihoods, centre: Array) -> tuple[End, Array]:
    """The last part of the way by quasi-Newton steps (Broyden, Fletcher, Goldfarb, Shanno) that begin with scoring.

    In calm air the information of the gusts' parameters is not the likelihood's curvature: scoring goes to and fro.
    An end of infinite cost where a step led up, and how far they had led down.
    """
    here = likelihood_at(likelihoods, values)
    scores, squared = scored(task, values, likelihoods)
    if not determined(squared):
        return End(values, np.inf), values
    inverse = np.asarray(np.linalg.inv(squared), dtype=np.float64)
    gradient = _gradient(scores, values, centre)
    for _ in range(ITERATIONS):
        if float(gradient @ inverse @ gradient) < CONVERGED:
            return End(values, here.cost), values
        step = -inverse @ gradient
        for _ in range(SHORTENED):
            there = likelihood_at(likelihoods, values + step)
            moved, there = _along(likelihoods, values, here, (step, there, float(gradient @ step)))
            if there.cost < here.cost:
                break
            step = step / SHORTER
        else:
            break
        after = _gradient(scored(task, moved, likelihoods)[0], moved, centre)
        inverse = _updated(inverse, moved - values, after - gradient)
        values, here, gradient = moved, there, after
    return End(values, np.inf), values


def _updated(inverse: Array, step: Array, change: Array) -> Array:
    """The inverse curvature (n, n) that also tells the ``change`` (n,) of the gradient over a ``step`` (n,)."""
    along = float(step @ change)
    if along <= 0.0:
        return inverse
    turn = np.eye(len(step)) - np.outer(step, change) / along
    new: Array = turn @ inverse @ turn.T + np.outer(step, step) / along
    return new


def _advanced(
    likelihoods: Likelihoods,
    values: Array,
    here: Likelihood,
    slope: tuple[Array, Array],
    damping: float,
) -> tuple[Array, Likelihood, float]:
    """A damped step that lowers the cost, and the damping for the next; an infinite cost where none does."""
    gradient, squared = slope
    scale = np.sqrt(np.diag(squared))
    even = squared / np.outer(scale, scale)
    while damping < 1e8:
        step = -np.linalg.solve(even + damping * np.eye(len(scale)), gradient / scale) / scale
        step = step * min(1.0, LONGEST / float(np.max(np.abs(step[-len(DOUBT) :]))))
        there = likelihood_at(likelihoods, values + step)
        if there.cost < here.cost:
            return *_along(likelihoods, values, here, (step, there, float(gradient @ step))), max(damping / 8.0, 1e-9)
        damping = max(damping * 4.0, 1e-3)
    return values, here._replace(cost=np.inf), damping


def _along(
    likelihoods: Likelihoods,
    values: Array,
    here: Likelihood,
    tried: tuple[Array, Likelihood, float],
) -> tuple[Array, Likelihood]:
    """The step as it was ``tried``, or to the least of a parabola through both ends where that is lower.

    The information is not the curvature: where it is half of it, every step ends as far behind the optimum as it
    began before it.
    """
    step, there, slope = tried
    bend = there.cost - here.cost - slope if np.isfinite(there.cost) else np.inf
    share = float(np.clip(-slope / (2.0 * bend), 0.1, 3.0)) if bend > 0 else 3.0
    another = likelihood_at(likelihoods, values + share * step)
    return (values + share * step, another) if another.cost < there.cost else (values + step, there)


def scored(task: Task, values: Array, likelihoods: Likelihoods) -> tuple[Array, Array]:
    """Each stroke's gradient (K, n) of the cost without the prior, and the information (n, n) with it."""
    widths = DIFFERENCE * np.maximum(np.abs(values), 0.1)
    here, *ahead = likelihoods(np.vstack((values, values + np.diag(widths))))
    strokes, m = here.errors.shape
    shift, growth = np.empty((len(values), strokes, m)), np.empty((len(values), strokes, m, m))
    scores, squared = np.empty((len(values), strokes)), np.empty((len(values), len(values)))
    for index, (width, there) in enumerate(zip(widths, ahead, strict=True)):
        known = there if np.isfinite(there.cost) else here
        whitened(here.root, (known.errors - here.errors) / width, shift[index])
        whitened_change(here.root, known.root, width, growth[index])
        gradient_terms(shift[index], growth[index], here.white, scores[index])
    information(shift, growth, squared)
    count = len(task.names)
    squared /= len(PHASES)
    squared[count:, count:] += np.diag(1.0 / DOUBT**2)
    return scores.T / len(PHASES), squared


def _gradient(scores: Array, values: Array, centre: Array) -> Array:
    gradient: Array = np.sum(scores, axis=0)
    gradient[-len(centre) :] += (values[-len(centre) :] - centre) / DOUBT**2
    return gradient


def determined(squared: Array) -> bool:
    """Whether the information (n, n) tells every parameter and every combination of them."""
    scale = np.sqrt(np.diag(squared))
    if not np.all(np.isfinite(scale)) or not np.all(scale > 0):
        return False
    return bool(np.linalg.cond(squared / np.outer(scale, scale)) < WORST_CONDITION)
