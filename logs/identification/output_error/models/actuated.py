"""A model behind an actuator: its inputs come late by a pure delay and through a first-order lag.

``u'_a = (u(t - tau) - u_a) / T``; both are parameters, zero and fixed unless the problem names them. The actuator is
at rest when the record begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from avionics.quantities import BadInput
from logs.identification.output_error.problem import Model, Named
from logs.identification.results import Array

SHORTEST_LAG = 1e-3
"""-; of a sampling interval: a shorter lag is none"""


class Actuated(NamedTuple):
    """A `problem.Model` whose inputs ``behind`` are late; parameters ``delay_<input>``, ``lag_<input>``."""

    model: Model
    behind: tuple[str, ...]
    """-; inputs of the model"""

    @property
    def states(self) -> Mapping[str, Named]:
        """Those of the model."""
        return self.model.states

    @property
    def inputs(self) -> Mapping[str, str]:
        """Those of the model."""
        return self.model.inputs

    @property
    def outputs(self) -> Mapping[str, str]:
        """Those of the model."""
        return self.model.outputs

    @property
    def parameters(self) -> Mapping[str, Named]:
        """Those of the model, then delay and lag (s) of each input."""
        own = {f"{kind}_{name}": Named("s") for name in self.behind for kind in ("delay", "lag")}
        return dict(self.model.parameters) | own

    def simulate(self, parameters: Array, start: Array, inputs: Array, step: float) -> Array:
        """Outputs (N, m); see `problem.Model`. A negative delay or lag is one that cannot be flown."""
        count, late = 2 * len(self.behind), inputs.copy()
        constants = parameters[len(parameters) - count :].reshape(-1, 2)
        names, time = list(self.model.inputs), step * np.arange(len(inputs))
        for name, (delay, lag) in zip(self.behind, constants, strict=True):
            column = names.index(name)
            late[:, column] = np.interp(time - delay, time, inputs[:, column])
            if lag > SHORTEST_LAG * step:
                late[:, column] = _lagged(np.ascontiguousarray(late[:, column]), step / lag)
        flown = self.model.simulate(parameters[: len(parameters) - count], start, late, step)
        return flown if np.all(constants > -step) else np.full_like(flown, np.nan)


@njit(cache=True)
def _lagged(values: Array, ratio: float) -> Array:
    """``values`` (N,), linear between samples, through a lag of 1 / ``ratio`` samples: exact."""
    decay = np.exp(-ratio)
    share = (1.0 - decay) / ratio
    out = np.empty(values.shape[0])
    out[0] = values[0]
    for k in range(values.shape[0] - 1):
        out[k + 1] = decay * out[k] + (share - decay) * values[k] + (1.0 - share) * values[k + 1]
    return out


def actuated(model: Model, behind: tuple[str, ...]) -> Actuated:
    """``model`` with inputs ``behind`` an actuator.

    Raises:
        BadInput: the model has no such input.
    """
    for name in behind:
        if name not in model.inputs:
            raise BadInput(f"the model has no input {name} (it has {', '.join(model.inputs)})")
    return Actuated(model, behind)
