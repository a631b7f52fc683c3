"""A model behind actuators: inputs come late by a pure delay and through a first-order lag (`preparing.lag`).

Delay and lag are parameters of the model, zero and fixed unless the problem names them. An actuator is at rest when
the record begins.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from avionics.quantities import BadInput
from logs.identification.output_error.problem import Model, Named
from logs.identification.preparing.lag import behind
from logs.identification.results import Array


class Actuator(NamedTuple):
    """What inputs have in common on their way to the model."""

    inputs: tuple[str, ...]
    """-; of the model"""
    delay: str
    """-; name of the parameter that is their delay, negative where they were recorded late"""
    lag: str = ""
    """-; name of the parameter that is their time constant; empty for none"""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the delay and the lag."""
        return (self.delay, self.lag) if self.lag else (self.delay,)


class Actuated(NamedTuple):
    """A `problem.Model` behind ``actuators``: their parameters follow those of the model."""

    model: Model
    actuators: tuple[Actuator, ...]

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
        """Those of the model, then delay and lag (s) of each actuator."""
        return dict(self.model.parameters) | {name: Named("s") for one in self.actuators for name in one.parameters}

    def simulate(self, parameters: Array, start: Array, inputs: Array, step: float) -> Array:
        """Outputs (N, m); see `problem.Model`. A negative lag is one that cannot be flown."""
        own = len(self.model.parameters)
        told = dict(zip(list(self.parameters)[own:], parameters[own:].tolist(), strict=True))
        names, late = list(self.model.inputs), inputs.copy()
        for one in self.actuators:
            for place in map(names.index, one.inputs):
                late[:, place] = behind(inputs[:, place], step, told[one.delay], told.get(one.lag, 0.0), held=False)
        flown = self.model.simulate(parameters[:own], start, late, step)
        lags = [told[one.lag] for one in self.actuators if one.lag]
        return flown if all(lag > -step for lag in lags) else np.full_like(flown, np.nan)


def actuated(model: Model, inputs: tuple[str, ...]) -> Actuated:
    """``model`` with each of ``inputs`` behind an actuator of its own; parameters ``delay_<input>``, ``lag_<input>``.

    Raises:
        BadInput: the model has no such input.
    """
    for name in inputs:
        if name not in model.inputs:
            raise BadInput(f"the model has no input {name} (it has {', '.join(model.inputs)})")
    return Actuated(model, tuple(Actuator((name,), f"delay_{name}", f"lag_{name}") for name in inputs))
