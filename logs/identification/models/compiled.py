"""A model of two compiled functions, flown by the classical Runge-Kutta method of fourth order.

A model is a file with two ``@njit(cache=True)`` functions ``f(x, u, p, c, out)``: one writes the states' rates, the
other the outputs, of states ``x``, inputs ``u``, parameters ``p`` and constants ``c`` (all (.,) of float). They
are called through a pointer, so that the integrator is compiled once for all models.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import types

from logs.identification.estimators.engine.problem import Intersample, Named
from logs.identification.results import Array
from sim_bridge.compiled import njit

LONGEST_STEP = 0.05
"""s; of the integration: a mode of 3 rad/s is then 1e-6 true in amplitude after a cycle"""
OVERFLOW = 1e12
DIFFERENCE = 1e-5
"""-; width of central differences, of a state's size"""
_VECTOR = types.Array(types.float64, 1, "C")
_TABLE = types.Array(types.float64, 2, "C")
_FUNCTION = types.FunctionType(types.void(_VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR))
Compiled = Callable[[Array, Array, Array, Array, Array], None]


@njit(cache=True, error_model="numpy")
def _between(before: Array, after: Array, lines: Array, share: float, u: Array) -> None:
    """Inputs ``u`` at a ``share`` of the way from one sample to the next: ``lines`` where 1, held where 0."""
    for j in range(len(u)):
        u[j] = before[j] + (after[j] - before[j]) * share * lines[j]


@njit(cache=True, error_model="numpy")
def _displaced(x: Array, slope: Array, h: float, at: Array) -> None:
    """States ``at`` a step ``h`` along a ``slope`` from ``x``."""
    for i in range(len(x)):
        at[i] = x[i] + h * slope[i]


@njit(
    types.void(_FUNCTION, _VECTOR, _TABLE, _VECTOR, _VECTOR, _VECTOR, _TABLE, types.float64, types.int64),
    cache=True,
    error_model="numpy",
)
def _integrate(
    rates: Any, start: Array, inputs: Array, lines: Array, p: Array, c: Array, states: Array, step: float, parts: int
) -> None:
    """States (N, n) by Runge-Kutta with ``parts`` steps a sample; NaN from where they overflow."""
    n, k = states.shape[1], inputs.shape[1]
    x, at, u = start.copy(), np.empty(n), np.empty(k)
    k1, k2, k3, k4 = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    h, share = step / parts, 1.0 / parts
    alive = True
    states[0, :] = x
    for row in range(1, states.shape[0]):
        before, after = inputs[row - 1], inputs[row]
        for part in range(parts if alive else 0):
            _between(before, after, lines, part * share, u)
            rates(x, u, p, c, k1)
            _between(before, after, lines, (part + 0.5) * share, u)
            _displaced(x, k1, h / 2, at)
            rates(at, u, p, c, k2)
            _displaced(x, k2, h / 2, at)
            rates(at, u, p, c, k3)
            _between(before, after, lines, (part + 1) * share, u)
            _displaced(x, k3, h, at)
            rates(at, u, p, c, k4)
            for i in range(n):
                x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])
                if not abs(x[i]) < OVERFLOW:
                    alive = False
        for i in range(n):
            states[row, i] = x[i] if alive else np.nan


@njit(types.void(_FUNCTION, _TABLE, _TABLE, _VECTOR, _VECTOR, _TABLE), cache=True)
def _observe(outputs: Any, states: Array, inputs: Array, p: Array, c: Array, table: Array) -> None:
    for row in range(states.shape[0]):
        outputs(states[row], inputs[row], p, c, table[row])


_INTERPRETED = tuple(inspect.unwrap(kernel) for kernel in (_integrate, _observe))


class CompiledModel(NamedTuple):
    """A `problem.Model` of two compiled functions."""

    states: Mapping[str, Named]
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, Named]
    rates: Compiled
    """writes the states' rates (n,)"""
    observe: Compiled
    """writes the outputs (m,)"""
    constants: Array
    """(c,); what the functions need beside the parameters"""
    longest_step: float = LONGEST_STEP
    """s; samples further apart are integrated in parts"""
    interpreted: bool = False
    """-; the functions are plain Python: a user's model that numba cannot compile"""

    def simulate(
        self, parameters: Array, start: Array, inputs: Array, step: float, intersample: Intersample | None = None
    ) -> Array:
        """Outputs (N, m); see `problem.Model`."""
        driven = np.ascontiguousarray(inputs, dtype=np.float64)
        states = np.empty((len(driven), len(start)))
        table = np.empty((len(driven), len(self.outputs)))
        parts = max(math.ceil(step / self.longest_step - 1e-9), 1)
        p, x = np.ascontiguousarray(parameters), np.ascontiguousarray(start)
        foh, shown = np.ones(driven.shape[1]), driven
        if intersample is not None:
            foh, shown = intersample.foh, np.ascontiguousarray(intersample.shown)
        integrate, tabulate = _INTERPRETED if self.interpreted else (_integrate, _observe)
        integrate(self.rates, x, driven, foh, p, self.constants, states, step, parts)
        tabulate(self.observe, states, shown, p, self.constants, table)
        return table

    def state_matrix(self, parameters: Array, state: Array, inputs: Array) -> Array:
        """Matrix A (n, n) = df/dx at a state (n,) and inputs (k,), by central differences."""
        p, u = np.ascontiguousarray(parameters), np.ascontiguousarray(inputs)
        matrix, ahead, behind = np.empty((len(state), len(state))), np.empty(len(state)), np.empty(len(state))
        for j, value in enumerate(state):
            width = DIFFERENCE * max(abs(float(value)), 1.0)
            shift = np.where(np.arange(len(state)) == j, width, 0.0)
            self.rates(state + shift, u, p, self.constants, ahead)
            self.rates(state - shift, u, p, self.constants, behind)
            matrix[:, j] = (ahead - behind) / (2.0 * width)
        return matrix
