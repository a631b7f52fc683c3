"""A fitted model flown through manoeuvres that it was not fitted to: only what each has of its own is sought."""

from __future__ import annotations

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Fit, Problem
from logs.identification.estimators.engine.records import Record, layout_of, records_of
from logs.identification.estimators.engine.simulation import Flight
from logs.identification.results import Array, FitSeries

ROUNDS = 10


def predicted(problem: Problem, fit: Fit, experiments: tuple[Experiment, ...]) -> tuple[FitSeries, ...]:
    """Measured and predicted outputs; initial state and biases of each by least squares. Nothing after a failure.

    Raises:
        InputError: a signal is missing, or nothing of the outputs was measured.
    """
    if fit.failure:
        return ()
    other = problem._replace(experiments=experiments, initial=())
    layout = layout_of(other)
    flight = Flight(problem.model, layout, records_of(other, layout))
    series = []
    for record, own in zip(flight.records, flight.first().own, strict=True):
        there = np.where(record.used > 0, record.measured, np.nan)
        scale = np.nanstd(there, axis=0)
        found = _own(flight, record, fit.values, own, np.where(scale > 0, scale, 1.0))
        model = flight.outputs(record, fit.values, found)
        series += [
            FitSeries(record.name, output, problem.model.outputs[output], record.time, there[:, n], model[:, n], True)
            for n, output in enumerate(problem.outputs)
        ]
    return tuple(series)


def _own(flight: Flight, record: Record, values: Array, own: Array, scale: Array) -> Array:
    """Initial state and biases (l,) with which the prediction fits best, by Gauss-Newton."""
    found = own
    for _ in range(ROUNDS):
        rest = (record.measured - flight.outputs(record, values, found)) * record.used / scale
        slopes = flight.slopes(record, values, found)[:, :, len(values) :] / scale[:, None]
        design = slopes.reshape(-1, len(found))
        if not (np.all(np.isfinite(rest)) and np.all(np.isfinite(design))):
            return own
        size = np.linalg.norm(design, axis=0)
        size[~(size > 0)] = np.inf
        step = np.linalg.lstsq(design / size, rest.ravel(), rcond=1e-8)[0] / size
        found = found + step
        if np.all(np.abs(step) <= 1e-8 * np.maximum(np.abs(found), 1e-3)):
            break
    return found
