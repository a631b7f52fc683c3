"""Any model with one more parameter: the time by which its inputs act later than they were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from logs.identification.output_error.problem import Model, Named
from logs.identification.results import Array

DELAY = "delay"


class Delayed(NamedTuple):
    """An `output_error.problem.Model` whose inputs come ``delay`` s later; before the record they rest."""

    inner: Model

    @property
    def states(self) -> Mapping[str, Named]:
        """Of the model inside."""
        return self.inner.states

    @property
    def inputs(self) -> Mapping[str, str]:
        """Of the model inside."""
        return self.inner.inputs

    @property
    def outputs(self) -> Mapping[str, str]:
        """Of the model inside."""
        return self.inner.outputs

    @property
    def parameters(self) -> Mapping[str, Named]:
        """Of the model inside, and the delay."""
        return {**self.inner.parameters, DELAY: Named("s")}

    def simulate(self, parameters: Array, start: Array, inputs: Array, step: float) -> Array:
        """Outputs (N, m) of the model inside, driven by the inputs as they were ``parameters[-1]`` s before."""
        return self.inner.simulate(parameters[:-1], start, delayed(inputs, float(parameters[-1]) / step), step)


def delayed(inputs: Array, steps: float) -> Array:
    """``inputs`` (N, k) as they were ``steps`` samples before, linear between samples."""
    places = np.arange(len(inputs), dtype=np.float64)
    return np.column_stack(
        [np.zeros((len(inputs), 0)), *(np.interp(places - steps, places, one) for one in inputs.T)]
    )
