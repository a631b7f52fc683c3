"""What the outputs of a fit would change by, in their noise and beside all that the fit itself could take of it.

The linear problem of the optimum: sensitivities to the parameters, and to anything else, without the part that each
manoeuvre's own initial states and biases explain (Schur complement; Klein & Morelli, Aircraft System Identification,
2006, sec. 6.1). Least squares in it carry a change of outputs to the parameters as the fit carries noise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from logs.identification.estimators.engine.problem import Fit, Own, Problem
from logs.identification.estimators.engine.records import Layout, Record, layout_of, records_of
from logs.identification.estimators.engine.simulation import Flight
from logs.identification.results import Array

Changes = Callable[[Record, Own, Array], list[Array]]
"""(record, its own numbers, its outputs (N, m)) -> changes of the outputs, (N, m) each"""


class Beside(NamedTuple):
    """All samples and outputs of all manoeuvres, one under the other, in standard deviations of the noise."""

    parameters: Array
    """(M, p); sensitivities to the fitted parameters"""
    changes: Array
    """(M, k)"""
    left: Array
    """(M,); what the model leaves of the measured"""


def beside(problem: Problem, fit: Fit, changes: Changes) -> Beside:
    """The ``changes`` of every manoeuvre of a ``fit`` without failure; not finite where a simulation overflows."""
    layout, p = layout_of(problem), len(fit.values)
    flight = Flight(problem.model, layout, records_of(problem, layout))
    scale = np.sqrt(np.diag(fit.noise))
    scale = np.where(scale > 0.0, scale, np.inf)
    pieces = []
    for record, own in zip(flight.records, fit.own, strict=True):
        vector = _vector(problem, layout, own)
        slopes = flight.slopes(record, fit.values, vector) / scale[:, None]
        flat = slopes.reshape(-1, slopes.shape[2])
        outputs = flight.outputs(record, fit.values, vector)
        seen = [one * record.used / scale for one in (*changes(record, own, outputs), record.measured - outputs)]
        both, mine = np.column_stack((flat[:, :p], *(one.ravel() for one in seen))), flat[:, p:]
        pieces.append(both - mine @ np.linalg.lstsq(mine, both, rcond=1e-10)[0])
    whole = np.vstack(pieces)
    return Beside(whole[:, :p], whole[:, p:-1], whole[:, -1])


def flown_with(problem: Problem, own: Own, inputs: Array, step: float) -> Array:
    """All outputs of the model (N, m) with a manoeuvre's own numbers and ``inputs`` (N, k), biases apart."""
    parameters, start = np.array(list(own.parameters.values())), np.array(list(own.initial.values()))
    biases = np.array([own.input_biases[one] for one in problem.model.inputs])
    return problem.model.simulate(parameters, start, inputs + biases, step)


def places_of(problem: Problem) -> list[int]:
    """Where the fitted outputs are among the model's."""
    return [list(problem.model.outputs).index(one) for one in problem.outputs]


def _vector(problem: Problem, layout: Layout, own: Own) -> Array:
    """A record's own numbers in the order of `Layout`."""
    parameters, states = list(problem.model.parameters), list(problem.model.states)
    inputs = list(problem.model.inputs)
    return np.array([
        *(own.parameters[parameters[place]] for place in layout.local),
        *(own.initial[states[place]] for place in layout.states),
        *(own.output_biases[problem.outputs[place]] for place in layout.biased_outputs),
        *(own.input_biases[inputs[place]] for place in layout.biased_inputs),
    ])  # fmt: skip
