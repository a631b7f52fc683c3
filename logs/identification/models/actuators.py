"""A model behind actuators: inputs pass a pure delay and a first-order lag (`data.resampling.behind`).

Delay and lag are parameters of the model, zero and fixed unless the problem names them. An actuator is at rest when
the record begins.

An input that is held, as a computer's command is, changes at its samples; delayed by a part of a sample it changes
between them. The model is then flown at finer steps, each with the mean of the input over it: no line between samples
that comes late takes that in (of records at 10 Hz and 8 rad/s it left derivatives 5 to 40 % off).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from logs.identification.data.resampling import behind
from logs.identification.estimators.engine.problem import Feedback, Intersample, Model, Named
from logs.identification.models.linear import LinearModel
from logs.identification.results import Array
from wingbeat.errors import InputError

FINE = 0.01
"""s; longest step at which held inputs with a delay are flown"""


SAME = 0.05
"""-; of a sample: a change this near to one was commanded with it, after what it shows was read"""


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
    zoh_inputs: tuple[str, ...] = ()
    """-; inputs that are held from each sample to the next; the others are lines between samples"""

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

    def simulate(
        self,
        parameters: Array,
        start: Array,
        inputs: Array,
        step: float,
        intersample: Intersample | None = None,
        feedback: Feedback | None = None,
    ) -> Array:
        """Outputs (N, m); see `problem.Model`. NaN for a negative lag; ``held`` replaces the hold."""
        own = len(self.model.parameters)
        given = dict(zip(list(self.parameters)[own:], parameters[own:].tolist(), strict=True))
        behind_what = {name: one for one in self.actuators for name in one.inputs}
        late = any(given[behind_what[name].delay] for name in self.zoh_inputs if name in behind_what)
        parts = max(1, math.ceil(step / FINE)) if late else 1
        columns, seen, lines = [], [], np.ones(inputs.shape[1])
        for place, (name, values) in enumerate(zip(self.model.inputs, inputs.T, strict=True)):
            one = behind_what.get(name)
            delay, lag = (given[one.delay], given.get(one.lag, 0.0)) if one else (0.0, 0.0)
            lines[place] = float(name not in self.zoh_inputs or lag > 0.0)
            columns.append(
                _acting(np.asarray(values, np.float64).tobytes(), name in self.zoh_inputs, step, delay, lag, parts)
            )
            seen.append(columns[-1] if lines[place] else _zoh_before(values, step, delay, parts))
        ways = step / parts, Intersample(lines, np.column_stack(seen)) if self.zoh_inputs else None
        arguments = parameters[:own], start, np.column_stack(columns), *ways
        if feedback is not None and isinstance(self.model, LinearModel):
            flown = self.model.simulate(*arguments, _at_samples(feedback, parts))[::parts]
        else:
            flown = self.model.simulate(*arguments)[::parts]
        lags = [given[one.lag] for one in self.actuators if one.lag]
        return flown if all(lag > -step for lag in lags) else np.full_like(flown, np.nan)


@lru_cache(maxsize=64)
def _acting(values: bytes, zoh: bool, step: float, delay: float, lag: float, parts: int) -> Array:
    """Input behind the delay and the lag (read-only), as bytes of ``values`` (N,).

    A search changes delay and lag seldom: most of its flights are of other parameters.
    """
    delayed = (_zoh_means if zoh else _on_lines)(np.frombuffer(values), step, delay, parts)
    acting = behind(delayed, step / parts, 0.0, lag, zoh=False)
    acting.flags.writeable = False
    return acting


def _at_samples(feedback: Feedback, parts: int) -> Feedback:
    """The same at ``parts`` steps a sample: no measurement between samples."""
    measured = np.full(((len(feedback.measured) - 1) * parts + 1, feedback.measured.shape[1]), np.nan)
    measured[::parts] = feedback.measured
    return feedback._replace(measured=measured)


def _on_lines(values: Array, step: float, delay: float, parts: int) -> Array:
    """``values`` (N,), ``step`` s apart and ``delay`` s late, at ``parts`` steps a sample: lines between samples."""
    places = np.arange((len(values) - 1) * parts + 1) / parts
    late: Array = np.interp(places - delay / step, np.arange(len(values)), values)
    return late


def _zoh_means(values: Array, step: float, delay: float, parts: int) -> Array:
    """The same of ``values`` held from each sample to the next: means over the step that begins there."""
    until = np.concatenate(([0.0], np.cumsum(values)))

    def integral(places: Array) -> Array:
        """Of the held values, up to ``places`` (samples); before the first and behind the last they stay."""
        before, behind_last = np.minimum(places, 0.0), np.maximum(places - len(values), 0.0)
        whole: Array = np.interp(places, np.arange(len(until)), until) + values[0] * before + values[-1] * behind_last
        return whole

    places = np.arange((len(values) - 1) * parts + 1) / parts - delay / step
    means: Array = (integral(places + 1.0 / parts) - integral(places)) * parts
    return means


def _zoh_before(values: Array, step: float, delay: float, parts: int) -> Array:
    """The same, as it is just before each of those steps."""
    places = np.arange((len(values) - 1) * parts + 1) / parts - delay / step
    last = np.clip(np.ceil(places - SAME) - 1.0, 0, len(values) - 1).astype(np.int64)
    before: Array = values[last]
    return before


def actuated(model: Model, inputs: tuple[str, ...]) -> Actuated:
    """``model`` with each of ``inputs`` behind an actuator of its own; parameters ``delay_<input>``, ``lag_<input>``.

    Raises:
        InputError: the model has no such input.
    """
    for name in inputs:
        if name not in model.inputs:
            raise InputError(f"the model has no input {name} (it has {', '.join(model.inputs)})")
    return Actuated(model, tuple(Actuator((name,), f"delay_{name}", f"lag_{name}") for name in inputs))
