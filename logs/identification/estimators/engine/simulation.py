"""Predicted outputs of every record, residuals in standard deviations, and sensitivities by finite differences.

For given parameters the likelihood is largest if the noise covariance is that of the residuals; for a given
covariance it is a sum of weighted squares. The two are taken in turn (relaxation: Jategaonkar 2006, ch. 4).
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from logs.identification.estimators.engine.problem import Model, Predictor, Problem
from logs.identification.estimators.engine.records import Indices, Layout, Record
from logs.identification.results import Array

DIFFERENCE = 1e-6
"""-; of a number's size: width of a difference. A one-sided one is then 1e-6 true, at half the simulations"""
LEAST_SIZE = 1e-2
"""-; of a parameter or state that is near zero"""


class Unknowns(NamedTuple):
    """Everything that is fitted."""

    values: Array
    """(p,); parameters, the same for all records"""
    local: tuple[Array, ...]
    """(l,) of each record: local parameters, initial states, output biases, input biases"""


class Split(NamedTuple):
    """One record's local numbers by kind."""

    parameters: Array
    """(P,); all of the model's"""
    start: Array
    """(n,)"""
    output_biases: Array
    """(m,); of the fitted outputs"""
    input_biases: Array
    """(k,)"""


class Flight(NamedTuple):
    """A problem ready to be flown."""

    model: Model
    layout: Layout
    records: tuple[Record, ...]

    @property
    def predicts(self) -> bool:
        """Whether the outputs measured before a sample enter its prediction (`problem.Predictor`)."""
        return hasattr(self.model, "predict")

    def prior_squares(self, values: Array) -> float:
        """Squared distance of ``values`` (p,) from the priors, in standard deviations."""
        return float(np.sum(self.layout.precision * (values - self.layout.prior_mean) ** 2))

    def first(self) -> Unknowns:
        """Where the search begins."""
        local = tuple(self._first_local(record) for record in self.records)
        return Unknowns(self.layout.base[list(self.layout.free)], local)

    def _first_local(self, record: Record) -> Array:
        layout = self.layout
        zeros = np.zeros(len(layout.biased_outputs) + len(layout.biased_inputs))
        return np.concatenate((layout.base[list(layout.local)], record.start[list(layout.states)], zeros))

    def split(self, record: Record, values: Array, local: Array) -> Split:
        """The numbers of one record, each where it belongs."""
        layout = self.layout
        parameters, start = layout.base.copy(), record.start.copy()
        outputs, inputs = np.zeros(len(layout.outputs)), np.zeros(record.inputs.shape[1])
        parameters[list(layout.free)] = values
        states = len(layout.local)
        outs = states + len(layout.states)
        into = outs + len(layout.biased_outputs)
        parameters[list(layout.local)] = local[:states]
        start[list(layout.states)] = local[states:outs]
        outputs[list(layout.biased_outputs)] = local[outs:into]
        inputs[list(layout.biased_inputs)] = local[into:]
        return Split(parameters, start, outputs, inputs)

    def outputs(self, record: Record, values: Array, local: Array) -> Array:
        """Fitted outputs (N, m) of the model, biases included; not finite where it overflows."""
        split = self.split(record, values, local)
        inputs = record.inputs + split.input_biases if self.layout.biased_inputs else record.inputs
        if self.predicts:
            measured = np.where(record.used > 0, record.measured - split.output_biases, np.nan)
            predictor = cast(Predictor, self.model)
            predicted: Array = predictor.predict(split.parameters, split.start, inputs, measured, record.step)
            return predicted + split.output_biases
        flown = self.model.simulate(split.parameters, split.start, inputs, record.step)
        chosen: Array = flown[:, self.layout.outputs] + split.output_biases
        return chosen

    def residuals(self, unknowns: Unknowns) -> list[Array]:
        """Measured minus model (N_i, m) of each record, 0 where not measured; not finite where it overflows."""
        pairs = zip(self.records, unknowns.local, strict=True)
        return [self.residual(record, unknowns.values, local) for record, local in pairs]

    def residual(self, record: Record, values: Array, local: Array) -> Array:
        """Measured minus model (N, m) of one record, as `residuals`."""
        rest = record.measured - self.outputs(record, values, local)
        rest[record.used == 0] = 0.0
        return rest

    def slopes(self, record: Record, values: Array, local: Array, first: int = 0) -> Array:
        """Sensitivities (N, m, p + l - first) of the outputs, 0 where not measured.

        They are those to the parameters, then to the record's local numbers; the ``first`` of them are left out.
        """
        table = np.empty((*record.measured.shape, len(values) + len(local) - first))
        here = self.outputs(record, values, local)
        for index in range(table.shape[2]):
            table[:, :, index] = self._slope(record, here, np.concatenate((values, local)), first + index)
        table *= record.used[:, :, None]
        return table

    def _slope(self, record: Record, here: Array, both: Array, index: int) -> Array:
        p, layout = len(self.layout.free), self.layout
        bias = index - p - len(layout.local) - len(layout.states)
        if 0 <= bias < len(layout.biased_outputs) and not self.predicts:
            column = np.zeros(here.shape)
            column[:, layout.biased_outputs[bias]] = 1.0
            return column
        ahead = both.copy()
        ahead[index] += DIFFERENCE * max(abs(both[index]), LEAST_SIZE)
        slope: Array = (self.outputs(record, ahead[:p], ahead[p:]) - here) / (ahead[index] - both[index])
        return slope


FLOOR = 1e-8
"""-; of an output's own variation: the least standard deviation, for records without noise"""
LEAST_EIGENVALUE = 1e-6
"""-; of a correlation matrix of residuals, for outputs that repeat each other"""


class Whitener(NamedTuple):
    """One record's way to residuals of unit variance; samples that lack outputs are weighed by what they have."""

    groups: tuple[tuple[Indices, Array], ...]
    """of samples with the same outputs: their rows, and the matrix (m, m) that whitens them; one group for all
    where the noise has no correlations"""
    log_determinant: float
    """-; half the logarithm of the determinants of the noise covariance, summed over samples"""

    def __call__(self, values: Array) -> Array:
        """Residuals (N, m) or slopes (N, m, q), zero where not measured, in standard deviations."""
        if not self.groups:
            return np.zeros_like(values)
        rows, matrix = self.groups[0]
        if not len(rows):
            scale = np.diag(matrix)
            alone: Array = values * (scale if values.ndim == 2 else scale[:, None])
            return alone
        result = np.zeros_like(values)
        for rows, matrix in self.groups:
            result[rows] = values[rows] @ matrix.T if values.ndim == 2 else matrix @ values[rows]
        return result


EVERY_ROW = np.zeros(0, dtype=np.intp)


def whitener_of(record: Record, noise: Array) -> Whitener:
    """How ``noise`` (m, m) weighs the record's samples."""
    variances = np.diag(noise)
    if np.count_nonzero(noise) <= len(noise):
        half = float(record.used.sum(axis=0) @ np.log(variances)) / 2
        return Whitener(((EVERY_ROW, np.diag(1 / np.sqrt(variances))),), half)
    groups, half = [], 0.0
    for rows, there in record.groups:
        matrix, lower = np.zeros(noise.shape), np.linalg.cholesky(noise[np.ix_(there, there)])
        matrix[np.ix_(there, there)] = np.linalg.inv(lower)
        half += len(rows) * float(np.sum(np.log(np.diag(lower))))
        groups.append((rows, matrix))
    return Whitener(tuple(groups), half)


def noise_of(problem: Problem, records: tuple[Record, ...], residuals: list[Array]) -> Array:
    """Covariance (m, m) of the outputs' noise by the problem's weighting, from ``residuals`` (N_i, m)."""
    if problem.weighting == "given":
        return np.diag([problem.deviations[name] ** 2 for name in problem.outputs])
    products = np.sum([r.T @ r for r in residuals], axis=0)
    pairs = np.sum([record.used.T @ record.used for record in records], axis=0)
    covariance = products / np.maximum(pairs, 1.0)
    floor = FLOOR * variation(records)
    deviation = np.sqrt(np.maximum(np.diag(covariance), floor**2))
    if problem.weighting == "diagonal":
        return np.diag(deviation**2)
    correlation = covariance / np.outer(deviation, deviation)
    np.fill_diagonal(correlation, 1.0)
    values, vectors = np.linalg.eigh(correlation)
    safe: Array = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T * np.outer(deviation, deviation)
    return safe


def variation(records: tuple[Record, ...]) -> Array:
    """Size (m,) of each output's motion over all records, one where it does not move."""
    counts = np.maximum(np.sum([r.used.sum(axis=0) for r in records], axis=0), 1.0)
    means = np.sum([r.measured.sum(axis=0) for r in records], axis=0) / counts
    squares = np.sum([np.sum(((r.measured - means) * r.used) ** 2, axis=0) for r in records], axis=0)
    size: Array = np.sqrt(squares / counts)
    return np.where(size > 0, size, 1.0)


def about_mean(record: Record) -> Array:
    """Measured outputs (N, m) about their means over the record, 0 where not measured."""
    counts = np.maximum(record.used.sum(axis=0), 1.0)
    moved: Array = (record.measured - record.measured.sum(axis=0) / counts) * record.used
    return moved
