"""Response and regressors of a linear regression over one or several maneuvers.

A response that is a derivative over several samples is the true derivative, averaged. Its regressors then go through
the same average, which leaves the coefficients without bias (filtered regression: Young, Automatica 17(1), 1981).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Literal, NamedTuple

import numpy as np
from scipy.signal import savgol_coeffs

from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import filled
from logs.identification.estimators.terms import Term, evaluate, parse, quotient, unit_of
from logs.identification.results import Array
from wingbeat.errors import InputError

INTERCEPT = "intercept"
TREND = "t^"
"""prefix of the names of a maneuver's polynomial trends"""
UNEVEN = 0.01
"""-; largest difference between sampling intervals, relative to one"""
SMOOTH = (-1.0 / 24.0, 13.0 / 24.0, 13.0 / 24.0, -1.0 / 24.0)
"""-; mean of a signal over one sampling interval by the cubic through four samples"""
LINE = (0.0, 0.5, 0.5, 0.0)
"""-; the same by the line through two samples"""
LOCAL_POLYNOMIAL, NEIGHBORS = "local_quadratic", 5
"""-; the smoothing method that is a fixed linear filter, and its samples"""
Intercept = Literal["common", "each", "none"]


class Averaging(NamedTuple):
    """Moving average of the columns of a regression."""

    weights: Array
    """-; (2 h + 1,), of a sample and its h neighbors on both sides; their sum is 1"""
    others: Array
    """-; the same for another intersample behavior"""
    through: frozenset[str]
    """-; signals that are averaged already"""


class Record(NamedTuple):
    """One maneuver of a regression."""

    name: str
    """-; the experiment's"""
    regressors: Array
    """(N, p); 0 where not used"""
    response: Array
    """(N,); 0 where not used"""
    used: Array
    """-; (N,), 1.0 where all of them were measured, else 0.0"""
    start: int = 0
    """-; sample of the experiment that is the record's first"""


class Design(NamedTuple):
    """Response and regressors over all maneuvers."""

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
        """Number of samples used."""
        return int(sum(record.used.sum() for record in self.records))

    @property
    def parameter_units(self) -> dict[str, str]:
        """Unit of each column's coefficient by the column's name."""
        return {name: quotient(self.unit, unit) for name, unit in zip(self.names, self.units, strict=True)}

    def taking(self, names: tuple[str, ...]) -> Design:
        """The design with only the columns ``names``, in that order."""
        columns = [self.names.index(name) for name in names]
        records = tuple(r._replace(regressors=r.regressors[:, columns]) for r in self.records)
        return self._replace(names=names, units=tuple(self.units[c] for c in columns), records=records)


class Nuisances(NamedTuple):
    """Intercepts and trends as regressors."""

    names: tuple[str, ...]
    """-; (k,)"""
    reported: tuple[bool, ...]
    """-; (k,), False for a trend"""
    columns: tuple[Array, ...]
    """(N_i, k) of each record"""


def design_of(
    experiments: tuple[Experiment, ...],
    response: str,
    regressors: tuple[str, ...],
    constants: Mapping[str, float],
    units: Mapping[str, str],
    averaging: Averaging | None = None,
    *,
    steady: bool = False,
) -> Design:
    """``response`` and ``regressors`` (`terms`) of ``experiments``; ``units`` are those of ``constants`` by name.

    The rows of ``steady`` readings have no common sampling interval.

    Raises:
        InputError: no experiment, sampling intervals that differ, an unknown name, a regressor named twice.
    """
    if not experiments:
        raise InputError("a regression needs at least one maneuver")
    terms = tuple(parse(name) for name in regressors)
    _refuse_duplicates(terms)
    step = 1.0 if steady else common_step(experiments)
    known = {**units, **experiments[0].units}
    target = parse(response)
    records = tuple(_record(experiment, (target, *terms), constants, averaging) for experiment in experiments)
    return Design(
        response, unit_of(target, known), regressors, tuple(unit_of(t, known) for t in terms), step, records
    )


def nuisances(records: tuple[Record, ...], intercept: Intercept, order: int) -> Nuisances:
    """Intercepts, and polynomials in time of each maneuver up to ``order``."""
    names: list[str] = []
    blocks: list[list[Array]] = [[] for _ in records]
    if intercept == "common":
        names.append(INTERCEPT)
        for block, record in zip(blocks, records, strict=True):
            block.append(record.used)
    for owner, record in enumerate(records):
        for power in range(0 if intercept == "each" else 1, order + 1):
            names.append(f"{INTERCEPT} of {record.name}" if power == 0 else f"{TREND}{power} of {record.name}")
            for index, (block, other) in enumerate(zip(blocks, records, strict=True)):
                column = np.linspace(-1, 1, len(other.used)) ** power * other.used
                block.append(column if index == owner else np.zeros(len(other.used)))
    columns = [np.column_stack(b) if b else np.zeros((len(r.used), 0)) for b, r in zip(blocks, records, strict=True)]
    return Nuisances(tuple(names), tuple(not name.startswith(TREND) for name in names), tuple(columns))


def common_step(experiments: tuple[Experiment, ...]) -> float:
    """Sampling interval in s of all ``experiments``.

    Raises:
        InputError: fewer than three samples, times that are not equally spaced, or intervals that differ.
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


def average_of_slope(slope: Array, mean: tuple[float, ...] = SMOOTH) -> Array:
    """Weights (2 h + 3,) of the average that a derivative with the weights ``slope`` (2 h + 1,) per step takes.

    A sum of differences between neighbors, summed by parts; between two samples a signal has its ``mean``.
    """
    return np.asarray(np.convolve(-np.cumsum(slope)[:-1], mean))


def averaged(values: Array, weights: Array) -> Array:
    """Moving average of ``values`` (N,); NaN where they are and where more than h neighbors in a row are missing."""
    half, found = len(weights) // 2, np.full(len(values), np.nan)
    if len(values) >= len(weights):
        found[half : len(values) - half] = np.convolve(filled(values, half), weights[::-1], mode="valid")
    return np.where(np.isfinite(values), found, np.nan)


def as_regressed(
    term: Term, experiment: Experiment, constants: Mapping[str, float], averaging: Averaging | None
) -> Array:
    """Values of a ``term`` (N,) in a regression; NaN where a signal is missing.

    Raises:
        InputError: the term names neither a signal nor a constant.
    """
    values = evaluate(term, experiment, constants)
    if averaging is None or averaging.through & term.powers.keys():
        return values
    return averaged(values, averaging.weights)


def filtered_like_derivative(experiment: Experiment, symbols: Collection[str]) -> Experiment:
    """The experiment with all signals through the local polynomial that one was smoothed by before differentiation.

    A linear filter of all signals leaves a linear relation between them unchanged; of some it biases the
    coefficients. Nothing is done if none of the ``symbols`` is the derivative of such a signal. Derivatives from the
    smoothing are removed, so that they are made with the regression's own average.
    """
    names = {name for name, method in experiment.smoothed.items() if method == LOCAL_POLYNOMIAL}
    rates = {f"{name}_dot" for name in names}
    if not rates & set(symbols):
        return experiment
    weights = savgol_coeffs(NEIGHBORS, 2)
    signals = {
        name: np.asarray(values) if name in names else averaged(np.asarray(values, dtype=np.float64), weights)
        for name, values in experiment.signals.items()
        if name not in rates
    }
    return experiment._replace(signals=signals)


def without(nuisance: Array, columns: Array) -> Array:
    """``columns`` (N, r) orthogonal to ``nuisance`` (N, k); 0 where only rounding is left."""
    if not nuisance.shape[1]:
        return columns
    rest = columns - nuisance @ np.linalg.lstsq(nuisance, columns, rcond=None)[0]
    return np.where(np.linalg.norm(rest, axis=0) <= 1e-12 * np.linalg.norm(columns, axis=0), 0.0, rest)


def bridged(design: Design, longest: int) -> Design:
    """``design`` with at most ``longest`` missing samples in a row interpolated and missing ends cut off.

    Raises:
        InputError: more missing samples in a row.
    """
    return design._replace(records=tuple(_bridge(record, design.step, longest) for record in design.records))


def _bridge(record: Record, step: float, longest: int) -> Record:
    known = np.flatnonzero(record.used > 0)
    if not len(known):
        raise InputError(f"{record.name}: not one sample has all signals of the regression")
    gaps = np.diff(known) - 1
    if gaps.max(initial=0) > longest:
        start = known[int(np.argmax(gaps))] + 1
        raise InputError(
            f"{record.name}: {int(gaps.max())} samples in a row from {start * step:.3g} s after its start lack"
            f" a signal; the frequency domain bridges {longest} at most: cut the record there or use the time domain"
        )
    index = np.arange(int(known[0]), int(known[-1]) + 1)
    columns = [np.interp(index, known, column[known]) for column in record.regressors.T]
    response = np.interp(index, known, record.response[known])
    table = np.column_stack(columns) if columns else np.zeros((len(index), 0))
    return Record(record.name, table, response, np.ones(len(index)), int(record.start + index[0]))


def _refuse_duplicates(terms: tuple[Term, ...]) -> None:
    for index, term in enumerate(terms):
        for earlier in terms[:index]:
            if dict(term.powers) == dict(earlier.powers):
                raise InputError(f"regressors '{earlier.name}' and '{term.name}' are the same but for a number")
        if term.name == INTERCEPT or not term.powers:
            raise InputError(f"regressor '{term.name}' is a constant: the intercept has that part")


def _record(
    experiment: Experiment, terms: tuple[Term, ...], constants: Mapping[str, float], averaging: Averaging | None
) -> Record:
    """Record with the response, the first of the ``terms``, and the regressors."""
    table = np.column_stack([as_regressed(term, experiment, constants, averaging) for term in terms])
    used = np.all(np.isfinite(table), axis=1)
    table[~used] = 0.0
    return Record(experiment.name, table[:, 1:], table[:, 0], used.astype(np.float64))
