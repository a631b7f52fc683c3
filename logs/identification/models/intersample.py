"""A linear motion between samples, exactly: of inputs that are held or lines, and late by parts of a sample.

An input that is ``delay`` late changes, or bends, once within each step, a share of the step behind its beginning.
From there and to there it is a constant or a line, so that the motion and its integral are matrix exponentials (Van
Loan, IEEE Trans. Automatic Control 23, 1978).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from logs.identification.results import Array
from sim_bridge.compiled import njit

SAME = 1e-9
"""-; of a step: what lies closer to a sample is at it"""


class Acting(NamedTuple):
    """What inputs are in each step, before their change in it and behind it."""

    share: float
    """-; of the step, before the change"""
    early: tuple[Array, Array]
    """(N - 1, k) each; at the beginning of the step, and just before the change"""
    later: tuple[Array, Array]
    """(N - 1, k) each; just behind the change, and just before the end of the step"""
    before: Array
    """(N, k); at the samples, of what changes there as it was before"""

    @property
    def means(self) -> Array:
        """(N - 1, k); over each step."""
        early, later = ((one + other) / 2 for one, other in (self.early, self.later))
        mean: Array = self.share * early + (1.0 - self.share) * later
        return mean


class ExactMotion(NamedTuple):
    """A motion as a linear system flies it."""

    states: Array
    """(N, n)"""
    means: Array
    """(N - 1, n); of the states over each step"""
    rates: Array
    """(N, n); of the states at the samples, by inputs that change there as they were before"""


def acting_of(inputs: Array, step: float, delay: float, held: list[int]) -> Acting:
    """What ``inputs`` (N, k), every ``step`` s, are when they act ``delay`` s late.

    Those in ``held`` (columns) keep their value from a sample to the next, the others are lines; before the first
    sample and behind the last they rest.
    """
    late = delay / step
    whole = int(np.floor(late + SAME))
    share = max(late - whole, 0.0)
    lines = np.ones(inputs.shape[1])
    lines[held] = 0.0
    old, now, coming = (_shifted(inputs, whole + more) for more in (1, 0, -1))
    begin = old + (now - old) * (1.0 - share) * lines
    end = now + (coming - now) * (1.0 - share) * lines
    turning = old + (now - old) * lines
    return Acting(share, (begin[:-1], turning[:-1]), (now[:-1], end[:-1]), begin)


def _shifted(values: Array, samples: int) -> Array:
    """``values`` (N, k) so many ``samples`` later, the first and the last standing for what there is not."""
    return values[np.clip(np.arange(len(values)) - samples, 0, len(values) - 1)]


def fly(a: Array, b: Array, start: Array, acting: Acting, step: float) -> ExactMotion:
    """Motion from ``start`` (n,) of ``x' = a x + b u``, ``a`` (n, n) and ``b`` (n, k), with ``acting`` inputs."""
    n = len(a)
    shares = (acting.share, 1.0 - acting.share)
    ways = [_over(a, b, share * step) for share in shares]
    pushed = [_pushed(way, n, *ends) for way, ends in zip(ways, (acting.early, acting.later), strict=True)]
    first, second = ways
    state = first[:n, :n].T
    states = np.vstack((start, pushed[0][:, :n] @ second[:n, :n].T + pushed[1][:, :n]))
    _carry(np.ascontiguousarray(second[:n, :n] @ first[:n, :n]), states)
    middle = states[:-1] @ state + pushed[0][:, :n]
    integrals = states[:-1] @ first[n : 2 * n, :n].T + middle @ second[n : 2 * n, :n].T
    means = (integrals + pushed[0][:, n:] + pushed[1][:, n:]) / step
    return ExactMotion(states, means, states @ a.T + acting.before @ b.T)


def _over(a: Array, b: Array, length: float) -> Array:
    """(2 n + 2 k, 2 n + 2 k); states, their integrals, inputs and what these grow by, over ``length`` s."""
    n, k = b.shape
    block = np.zeros((2 * n + 2 * k, 2 * n + 2 * k))
    block[:n, :n], block[:n, 2 * n : 2 * n + k] = a * length, b * length
    block[n : 2 * n, :n] = np.eye(n) * length
    block[2 * n : 2 * n + k, 2 * n + k :] = np.eye(k)
    return np.asarray(expm(block))


def _pushed(way: Array, n: int, begin: Array, end: Array) -> Array:
    """(N - 1, 2 n); what inputs from ``begin`` to ``end`` (N - 1, k) add to states and integrals."""
    return np.asarray(np.hstack((begin, end - begin)) @ way[: 2 * n, 2 * n :].T)


@njit(cache=True)
def _carry(over: Array, states: Array) -> None:
    """Fill ``states`` (N, n) but the first, which hold what is added in each step, by ``over`` (n, n)."""
    count, n = states.shape
    for row in range(1, count):
        for i in range(n):
            for j in range(n):
                states[row, i] += over[i, j] * states[row - 1, j]
