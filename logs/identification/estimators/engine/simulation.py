"""Predicted outputs of every record, residuals, and sensitivities by finite differences."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np

from logs.identification.estimators.engine.problem import Model, Predictor
from logs.identification.estimators.engine.records import Layout, Record
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
