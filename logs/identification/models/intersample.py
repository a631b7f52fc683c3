"""Linear motion between samples, exactly: inputs are held or linear between samples, and delayed by any time.

A delayed input changes, or bends, once within each step. Before and after it is a constant or a line, so that the
motion and its integral are matrix exponentials (Van Loan, IEEE Trans. Automatic Control 23, 1978).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from logs.identification.results import Array
from sim_bridge.compiled import njit

SAME = 1e-9
"""-; of a step: times closer to a sample are at it"""


class Acting(NamedTuple):
    """Inputs that act in each step, before the change in it and after."""

    fraction: float
    """-; of the step, before the change"""
    early: tuple[Array, Array]
    """(N - 1, k) each; at the start of the step, and just before the change"""
    later: tuple[Array, Array]
    """(N - 1, k) each; just after the change, and just before the end of the step"""
    before: Array
    """(N, k); at the samples, just before a change there"""

    @property
    def means(self) -> Array:
        """Mean (N - 1, k) over each step."""
        early, later = ((one + other) / 2 for one, other in (self.early, self.later))
        mean: Array = self.fraction * early + (1.0 - self.fraction) * later
        return mean


class Motion(NamedTuple):
    """Motion of a linear system."""

    states: Array
    """(N, n)"""
    means: Array
    """(N - 1, n); of the states over each step"""
    rates: Array
    """(N, n); of the states at the samples, just before a change of the inputs there"""


def acting_inputs(inputs: Array, step: float, delay: float, zoh_columns: list[int]) -> Acting:
    """The ``inputs`` (N, k), every ``step`` s, as they act ``delay`` s later.

    ``zoh_columns`` have a zero-order hold. Before the first sample and after the last they are constant.
    """
    whole = int(np.floor(delay / step + SAME))
    fraction = max(delay / step - whole, 0.0)
    linear = np.ones(inputs.shape[1])
    linear[zoh_columns] = 0.0
    index = np.arange(len(inputs)) - whole
    old, now, coming = (inputs[np.clip(index + k, 0, len(inputs) - 1)] for k in (-1, 0, 1))
    start = old + (now - old) * (1.0 - fraction) * linear
    end = now + (coming - now) * (1.0 - fraction) * linear
    changing = old + (now - old) * linear
    return Acting(fraction, (start[:-1], changing[:-1]), (now[:-1], end[:-1]), start)


def simulate(a: Array, b: Array, start: Array, acting: Acting, step: float) -> Motion:
    """Motion from ``start`` (n,) of ``x' = a x + b u``, ``a`` (n, n) and ``b`` (n, k), with ``acting`` inputs."""
    n = len(a)
    blocks = [_exponential(a, b, part * step) for part in (acting.fraction, 1.0 - acting.fraction)]
    forced = [
        np.hstack((first, last - first)) @ block[: 2 * n, 2 * n :].T
        for block, (first, last) in zip(blocks, (acting.early, acting.later), strict=True)
    ]
    early, later = (block[:n, :n] for block in blocks)
    states = np.vstack((start, forced[0][:, :n] @ later.T + forced[1][:, :n]))
    _accumulate(np.ascontiguousarray(later @ early), states)
    middle = states[:-1] @ early.T + forced[0][:, :n]
    integrals = states[:-1] @ blocks[0][n : 2 * n, :n].T + middle @ blocks[1][n : 2 * n, :n].T
    means = (integrals + forced[0][:, n:] + forced[1][:, n:]) / step
    return Motion(states, means, states @ a.T + acting.before @ b.T)


def _exponential(a: Array, b: Array, length: float) -> Array:
    """Transition (2 n + 2 k, 2 n + 2 k) of states, their integrals, inputs and their increments over ``length`` s."""
    n, k = b.shape
    block = np.zeros((2 * n + 2 * k, 2 * n + 2 * k))
    block[:n, :n], block[:n, 2 * n : 2 * n + k] = a * length, b * length
    block[n : 2 * n, :n] = np.eye(n) * length
    block[2 * n : 2 * n + k, 2 * n + k :] = np.eye(k)
    return np.asarray(expm(block))


@njit(cache=True)
def _accumulate(transition: Array, states: Array) -> None:
    """Accumulate the ``states`` (N, n), which contain the increments of each step, by the ``transition`` (n, n)."""
    count, n = states.shape
    for row in range(1, count):
        for i in range(n):
            for j in range(n):
                states[row, i] += transition[i, j] * states[row - 1, j]
