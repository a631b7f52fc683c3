"""What the course of an input between its samples, which nobody recorded, could do to a model's numbers.

Beside the line from one sample to the next, a cubic through four of them is as likely a course. Both are flown with
the fitted model; what they differ by in the outputs is carried to the parameters by least squares, as the fit carries
noise. Where a motion is slow beside the samples, or the noise large, that is little beside the intervals, however far
the input moves between two samples.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from logs.identification.diagnostics.intersample_behavior import FELT, coarse, said_coarse
from logs.identification.diagnostics.output_sensitivities import beside, flown_with, places_of
from logs.identification.estimators.engine.problem import Fit, Own, Problem
from logs.identification.estimators.engine.records import Record
from logs.identification.results import Array

LEAST = 0.1
"""-; of an input's range, by which it moves between two samples at least where its course is asked for"""
PARTS = 4
"""-; of a sampling interval, in which both courses are flown"""


def unseen(problem: Problem, fit: Fit, names: Mapping[str, str]) -> tuple[str, ...]:
    """What is said of those inputs of ``names`` whose course between samples puts off a number notably.

    ``names`` are the model's inputs by what the map calls them.
    """
    if fit.failure:
        return ()
    reach = coarse(tuple(names.values()), problem.experiments, LEAST)
    off = put_off(problem, fit, tuple(reach)) if reach else {}
    found = {name: reach[own] for name, own in names.items() if off.get(own, 0.0) > FELT}
    return said_coarse(found, "derivatives may be off by more than their intervals")


def put_off(problem: Problem, fit: Fit, names: tuple[str, ...]) -> dict[str, float]:
    """Standard errors by which the unseen course of each input puts off that number which it does most to."""
    kept = [fit.names.index(one.name) for one in fit.estimates if one.name in fit.names]
    errors = np.array([one.standard_error for one in fit.estimates if one.name in fit.names])
    if not kept:
        return dict.fromkeys(names, 0.0)
    found = beside(problem, fit, lambda record, own, _: [_between(problem, record, own, name) for name in names])
    if not np.all(np.isfinite(found.changes)):
        return dict.fromkeys(names, 0.0)
    parameters = found.parameters[:, kept]
    off = np.linalg.lstsq(parameters.T @ parameters, parameters.T @ found.changes, rcond=1e-12)[0]
    worst = np.max(np.abs(off) / np.where(errors > 0.0, errors, np.inf)[:, None], axis=0)
    return dict(zip(names, worst.tolist(), strict=True))


def _between(problem: Problem, record: Record, own: Own, name: str) -> Array:
    """Outputs (N, m) by a cubic course of the input ``name`` between its samples, less those by lines."""
    column = list(problem.model.inputs).index(name)
    places = np.arange(PARTS * (len(record.time) - 1) + 1) / PARTS
    lines = np.column_stack([np.interp(places, np.arange(len(record.time)), one) for one in record.inputs.T])
    cubic = lines.copy()
    cubic[:, column] = _cubic(record.inputs[:, column], places)
    flown = [flown_with(problem, own, one, record.step / PARTS)[::PARTS] for one in (cubic, lines)]
    return np.asarray((flown[0] - flown[1])[:, places_of(problem)])


def _cubic(values: Array, places: Array) -> Array:
    """``values`` (N,) at ``places`` (M,) between them, by the cubic through the four nearest."""
    first = np.clip(np.floor(places).astype(int) - 1, 0, len(values) - 4)
    x = places - first
    found = np.zeros(len(places))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        found += values[first + i] * np.prod([(x - j) / (i - j) for j in others], axis=0)
    return found
