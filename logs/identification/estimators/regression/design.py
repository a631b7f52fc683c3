"""What a regression works on: response and named regressors of one or several manoeuvres, whole samples marked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.regression.averaging import Averaging, as_regressed
from logs.identification.estimators.regression.terms import Term, parse, quotient, unit_of
from logs.identification.results import Array
from wingbeat.errors import InputError

INTERCEPT = "intercept"
UNEVEN = 0.01
"""-; by which steps may differ from one another, of a step"""


class Record(NamedTuple):
    """One manoeuvre's part of a regression."""

    name: str
    """-; the experiment's"""
    regressors: Array
    """(N, p); 0 where not used"""
    response: Array
    """(N,); 0 where not used"""
    used: Array
    """-; (N,), 1.0 where every one was measured, else 0.0"""
    start: int = 0
    """-; sample of the experiment that is the record's first"""


class Design(NamedTuple):
    """A response and its regressors over all manoeuvres."""

    response: str
    """-; its name"""
    unit: str
    """-; of the response"""
    names: tuple[str, ...]
    """-; (p,), of the columns"""
    units: tuple[str, ...]
    """-; (p,), of the columns"""
    step: float
    """s; sampling interval"""
    records: tuple[Record, ...]

    @property
    def samples(self) -> int:
        """How many samples are used."""
        return int(sum(record.used.sum() for record in self.records))

    def taking(self, names: tuple[str, ...]) -> Design:
        """The design with only the columns ``names``, in that order."""
        columns = [self.names.index(name) for name in names]
        records = tuple(r._replace(regressors=r.regressors[:, columns]) for r in self.records)
        return self._replace(names=names, units=tuple(self.units[c] for c in columns), records=records)


def design_of(
    experiments: tuple[Experiment, ...],
    response: str,
    regressors: tuple[str, ...],
    constants: Mapping[str, float],
    units: Mapping[str, str],
    averaging: Averaging | None = None,
) -> Design:
    """``response`` and ``regressors`` (`terms`) of ``experiments``; ``units`` are those of ``constants`` by name.

    What is not yet averaged as ``averaging`` says is.

    Raises:
        InputError: no experiment, time steps that differ, a name that is not there, a regressor named twice.
    """
    if not experiments:
        raise InputError("a regression needs at least one manoeuvre")
    terms = tuple(parse(name) for name in regressors)
    _refuse_twins(terms)
    step = common_step(experiments)
    known = {**units, **experiments[0].units}
    target = parse(response)
    records = tuple(_record(experiment, (target, *terms), constants, averaging) for experiment in experiments)
    return Design(
        response, unit_of(target, known), regressors, tuple(unit_of(t, known) for t in terms), step, records
    )


def parameter_units(design: Design) -> dict[str, str]:
    """Unit of each column's parameter by the column's name."""
    return {name: quotient(design.unit, unit) for name, unit in zip(design.names, design.units, strict=True)}


def common_step(experiments: tuple[Experiment, ...]) -> float:
    """Sampling interval in s of all ``experiments``.

    Raises:
        InputError: fewer than three samples, times that are not equally spaced, or steps that differ.
    """
    for experiment in experiments:
        if len(experiment.time) < 3:
            raise InputError(f"{experiment.name}: {len(experiment.time)} samples are no record")
        steps = np.diff(experiment.time)
        if not np.all(np.abs(steps - experiment.step) <= UNEVEN * experiment.step):
            raise InputError(f"{experiment.name}: its samples are not equally spaced; resample it")
    first = experiments[0]
    for other in experiments[1:]:
        if abs(other.step - first.step) > UNEVEN * first.step:
            raise InputError(
                f"{first.name} has a step of {first.step:g} s, {other.name} of {other.step:g} s: resample them to one"
            )
    return first.step


def _refuse_twins(terms: tuple[Term, ...]) -> None:
    for index, term in enumerate(terms):
        for earlier in terms[:index]:
            if dict(term.powers) == dict(earlier.powers):
                raise InputError(f"regressors '{earlier.name}' and '{term.name}' are the same but for a number")
        if term.name == INTERCEPT or not term.powers:
            raise InputError(f"regressor '{term.name}' is a constant: the intercept has that part")


def _record(
    experiment: Experiment, terms: tuple[Term, ...], constants: Mapping[str, float], averaging: Averaging | None
) -> Record:
    """Of the response, first of the ``terms``, and the regressors."""
    table = np.column_stack([as_regressed(term, experiment, constants, averaging) for term in terms])
    used = np.all(np.isfinite(table), axis=1)
    table[~used] = 0.0
    return Record(experiment.name, table[:, 1:], table[:, 0], used.astype(np.float64))
