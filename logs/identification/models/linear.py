"""Linear models whose matrices are affine in named parameters, simulated by exact discretization.

``x' = A x + B u + b``, ``y = C x + D u + d``; every entry is a sum of constants and multiples of parameters. The
inputs are linear between samples (triangular hold) or held from theirs on, so that the step is exact at any sampling
rate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Feedback, Intersample, Named
from logs.identification.results import Array
from sim_bridge.compiled import njit
from sim_bridge.vectors import Integers
from wingbeat.errors import InputError

ONE = "1"
"""the regressor of constants"""
OVERFLOW = 1e12
SERIES = 13
LARGEST_RATE = 1e12
"""-; per sample: what moves faster is no flight"""


class Term(NamedTuple):
    """A share of a rate or an output: ``factor`` times the parameter (where one is named) times a signal."""

    of: str
    """-; a state, an input, or `ONE`"""
    parameter: str = ""
    """-; empty for a constant entry"""
    factor: float = 1.0
    """as the rate or output, per parameter and signal"""


Terms = tuple[Term, ...]


def times(factor: float, terms: Terms) -> Terms:
    """``terms``, each multiplied by ``factor``."""
    return tuple(term._replace(factor=factor * term.factor) for term in terms)


class Matrices(NamedTuple):
    """State space at given parameters; the last column of B and D is the constant's."""

    a: Array
    """(n, n)"""
    b: Array
    """(n, k + 1)"""
    c: Array
    """(m, n)"""
    d: Array
    """(m, k + 1)"""


class LinearModel(NamedTuple):
    """A `problem.Model` of affine matrices."""

    states: Mapping[str, Named]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, Named]
    constant: Array
    """(n + m, n + k + 1); rows of rates and outputs, columns of states, inputs and `ONE`: constant entries"""
    slopes: Array
    """(P, (n + m) (n + k + 1)); what each parameter adds to the entries"""

    def matrices(self, parameters: Array) -> Matrices:
        """State space of ``parameters`` (P,)."""
        n = len(self.states)
        whole = self.constant + (parameters @ self.slopes).reshape(self.constant.shape)
        return Matrices(whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:])

    def simulate(
        self,
        parameters: Array,
        start: Array,
        inputs: Array,
        step: float,
        intersample: Intersample | None = None,
        feedback: Feedback | None = None,
    ) -> Array:
        """Outputs (N, m); see `problem.Model`. With ``feedback`` those predicted from the samples before."""
        n, k = len(self.states), inputs.shape[1]
        whole = self.constant + (parameters @ self.slopes).reshape(self.constant.shape)
        size = n + 2 * (k + 1)
        block = np.zeros((size, size))
        block[:n, : n + k + 1] = whole[:n] * step
        block[n : n + k + 1, n + k + 1 :] = np.eye(k + 1)
        table, total = np.full((len(inputs), len(self.outputs)), np.nan), exponential(block)
        if not np.all(np.isfinite(total)):
            return table
        if intersample:
            total[:, n + k + 1 : n + 2 * k + 1] *= intersample.foh
        gain, measured, chosen = _feedback(feedback, len(inputs), n)
        shown = intersample.shown if intersample else inputs
        states = np.ascontiguousarray(start), np.ascontiguousarray(inputs), np.ascontiguousarray(shown)
        _fly(total, whole, *states, gain, measured, chosen, table)
        return table


def _feedback(feedback: Feedback | None, count: int, states: int) -> tuple[Array, Array, Integers]:
    """Gain (n, m), measured outputs (N, m) and their numbers (m,) for the kernel."""
    if feedback is None:
        return np.empty((states, 0)), np.empty((count, 0)), np.empty(0, dtype=np.int64)
    measured = np.ascontiguousarray(feedback.measured)
    return np.ascontiguousarray(feedback.gain), measured, np.array(feedback.outputs, dtype=np.int64)


def exponential(matrix: Array) -> Array:
    """Matrix exponential (s, s) by scaling, Taylor series and squaring; faster than SciPy's for a few rows."""
    size, largest = len(matrix), float(np.max(np.abs(matrix)))
    if not largest < LARGEST_RATE:
        return np.full((size, size), np.nan)
    halvings = max(0, int(np.ceil(np.log2(largest * size + 1e-30))) + 1)
    _exponential(matrix / 2.0**halvings, halvings, total := np.eye(size))
    return total


@njit(cache=True)
def _exponential(small: Array, halvings: int, total: Array) -> None:
    """Taylor series of ``small`` (s, s), squared ``halvings`` times, in ``total``, which begins as one."""
    s = small.shape[0]
    term, spare = total.copy(), np.empty((s, s))
    for order in range(1, SERIES + halvings):
        left, right = (term, small) if order < SERIES else (total, total)
        for i in range(s):
            for j in range(s):
                spare[i, j] = 0.0
            for k in range(s):
                if left[i, k] != 0.0:
                    for j in range(s):
                        spare[i, j] += left[i, k] * right[k, j]
        for i in range(s):
            for j in range(s):
                if order < SERIES:
                    term[i, j] = spare[i, j] / order
                    total[i, j] += term[i, j]
                else:
                    total[i, j] = spare[i, j]


@njit(cache=True)
def _fly(
    exact: Array,
    whole: Array,
    start: Array,
    inputs: Array,
    shown: Array,
    gain: Array,
    measured: Array,
    chosen: Integers,
    table: Array,
) -> None:
    """Outputs (N, m) by the exact step ``exact``, NaN from where the states overflow.

    The outputs contain the inputs ``shown``. The innovations of the outputs ``chosen``, where ``measured``, correct
    the states by ``gain``.
    """
    n, k, m = start.shape[0], inputs.shape[1], table.shape[1]
    x, ahead = start.copy(), np.empty(n)
    ramp = n + k + 1
    for row in range(inputs.shape[0]):
        for i in range(m):
            total = whole[n + i, n + k]
            for j in range(n):
                total += whole[n + i, j] * x[j]
            for j in range(k):
                total += whole[n + i, n + j] * shown[row, j]
            table[row, i] = total
        if row + 1 == inputs.shape[0]:
            break
        for j in range(gain.shape[1]):
            innovation = measured[row, j] - table[row, chosen[j]]
            if not np.isnan(innovation):
                for i in range(n):
                    x[i] += gain[i, j] * innovation
        for i in range(n):
            total = exact[i, n + k]
            for j in range(n):
                total += exact[i, j] * x[j]
            for j in range(k):
                total += exact[i, n + j] * inputs[row, j]
                total += exact[i, ramp + j] * (inputs[row + 1, j] - inputs[row, j])
            ahead[i] = total if abs(total) < OVERFLOW else np.nan
        for i in range(n):
            x[i] = ahead[i]


def linear_model(
    states: Mapping[str, Named],
    inputs: Mapping[str, str],
    parameters: Mapping[str, Named],
    rates: Mapping[str, Terms],
    outputs: Mapping[str, tuple[str, Terms]],
) -> LinearModel:
    """A model from the terms of each state's rate and each output (its unit, its terms).

    Raises:
        InputError: a term names a signal or parameter that there is not.
    """
    columns, names = [*states, *inputs, ONE], list(parameters)
    rows = [rates.get(name, ()) for name in states] + [terms for _, terms in outputs.values()]
    constant = np.zeros((len(rows), len(columns)))
    slopes = np.zeros((len(names), len(rows), len(columns)))
    for index, terms in enumerate(rows):
        for term in terms:
            if term.of not in columns or (term.parameter and term.parameter not in names):
                raise InputError(f"the linear model has no {term.of} or no parameter {term.parameter}")
            entry = constant if not term.parameter else slopes[names.index(term.parameter)]
            entry[index, columns.index(term.of)] += term.factor
    units = {name: unit for name, (unit, _) in outputs.items()}
    return LinearModel(dict(states), dict(inputs), units, dict(parameters), constant, slopes.reshape(len(names), -1))
