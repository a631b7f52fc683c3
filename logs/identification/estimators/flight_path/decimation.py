"""Records of a flight path cut into short ones or thinned: what a doubt needs no whole record for."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from logs.identification.estimators.flight_path.records import LEAST_SAMPLES, Path, Problem, Record, Values
from logs.identification.results import Array

WINDOW = 15.0
"""s; at most of a record with a first state of its own: over longer ones the inputs' integrated noise hides all"""
SLOWEST = 0.1
"""s; at most between samples of a thinned record, as the motion goes on between them"""
LEAST_THINNED = 600
"""-; samples of all records that are left, at least"""


def windows_of(problem: Problem, values: Values, paths: Sequence[Path]) -> tuple[Problem, Values]:
    """The records in pieces of equal length, up to `WINDOW`, that begin where the ``paths`` pass.

    A record with an output that was not measured in each of its pieces stays longer.
    """
    records: list[Record] = []
    starts: list[Array] = []
    for record, path in zip(problem.records, paths, strict=True):
        bounds = _bounds(record)
        for begin, end in pairwise(bounds):
            records.append(_cut(record, slice(int(begin), int(end))))
            starts.append(path.states[begin])
    return problem._replace(records=tuple(records)), Values(values.errors, np.array(starts))


def _bounds(record: Record) -> Array:
    """First samples of the pieces, and the number of all samples."""
    there = np.any(record.used > 0, axis=0)
    most = int(np.ceil((record.time[-1] - record.time[0]) / WINDOW - 1e-6))
    for count in range(most, 1, -1):
        bounds = np.linspace(0, len(record.time), count + 1).astype(int)
        told = np.add.reduceat(record.used[:, there], bounds[:-1], axis=0)
        if np.min(np.diff(bounds)) >= LEAST_SAMPLES and np.min(told) >= LEAST_SAMPLES // 2:
            return bounds
    return np.array([0, len(record.time)])


def _cut(record: Record, at: slice) -> Record:
    return Record(record.name, record.time[at], record.inputs[at], record.outputs[at], record.used[at])


def thinned(problem: Problem) -> Problem:
    """The records at fewer samples, each the mean of as many neighbours, where they have far more than it takes."""
    every = sum(len(record.time) for record in problem.records) // LEAST_THINNED
    return problem._replace(records=tuple(_means(record, every) for record in problem.records))


def _means(record: Record, every: int) -> Record:
    """Of neighbours, so many but for `SLOWEST` and `LEAST_SAMPLES`; of an output of those that were measured."""
    most = min(SLOWEST / record.step * (1 + 1e-9), len(record.time) / LEAST_SAMPLES)
    every = min(every, int(most))
    if every < 2:
        return record
    count = len(record.time) // every

    def added(values: Array) -> Array:
        return np.asarray(values[: count * every].reshape(count, every, -1).sum(axis=1))

    samples = added(record.used)
    outputs = added(record.outputs) / np.maximum(samples, 1.0)
    time = added(record.time)[:, 0] / every
    return Record(record.name, time, added(record.inputs) / every, outputs, np.minimum(samples, 1.0))
