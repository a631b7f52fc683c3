"""Equation error in the frequency domain for [modes] of a map: output error's derivatives by another way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.frequency_equations import (
    METHOD,
    STATES,
    EquationSettings,
    frequency_equation_error,
)
from logs.identification.models.modes import SHORT_PERIOD, Mode, nothing
from logs.identification.results import EstimationResult
from logs.identification.sources.table.config import DELAY, ModesSection
from logs.identification.sources.table.signal_lookup import band_frequencies
from logs.identification.tables.models import DROPPED, with_speed

SINGLE = "delta"
"""what the derivatives by a single input are called, as output error calls them"""


def has_equations(asked: ModesSection) -> bool:
    """Whether the short period is asked for, and alpha or q is among the outputs."""
    return (not asked.kinds or SHORT_PERIOD in asked.kinds) and bool(set(STATES) & set(asked.outputs))


def by_equations(
    asked: ModesSection,
    experiments: tuple[Experiment, ...],
    constants: Mapping[str, float],
    fits: Sequence[EstimationResult],
) -> Mode:
    """The short period by its two equations; with output error's delay, and its error, where that is free.

    Raises:
        InputError: a band without a frequency.
    """
    delay, error = asked.delay.fixed, 0.0
    if delay is None:
        found = next((one for fit in fits for one in fit.estimates if one.name == DELAY), None)
        delay, error = (None, 0.0) if found is None else (found.value, found.standard_error)
    if delay is None:
        return nothing(METHOD, "the delay is free, and output error did not find it: hold it")
    frequencies = None if asked.band is None else band_frequencies(asked.band, experiments, "modes")
    inputs = (SINGLE,) if len(asked.inputs) == 1 else asked.inputs
    named = tuple(_renamed(one, asked.inputs, inputs) for one in experiments)
    speed = with_speed(constants, experiments).get("V")
    arm = float(constants.get("imu_x", 0.0))
    hold = tuple(own for own, name in zip(inputs, asked.inputs, strict=True) if name in asked.hold)
    equations = EquationSettings(inputs, _held(asked, inputs), speed, arm, delay, error, frequencies, hold)
    return frequency_equation_error(named, equations)


def _renamed(one: Experiment, names: tuple[str, ...], inputs: tuple[str, ...]) -> Experiment:
    signals = {**one.signals, **{own: one.signals[name] for own, name in zip(inputs, names, strict=True)}}
    return one._replace(signals={name: np.asarray(values) for name, values in signals.items()})


def _held(asked: ModesSection, inputs: tuple[str, ...]) -> dict[str, float]:
    """Derivatives that are not free: as `tables.models` has them, those that the map does not name are zero."""
    names = [f"{axis}_{name}" for axis in "ZM" for name in (*STATES, *inputs)]
    if not asked.parameters:
        return {name: 0.0 for name in names if name in DROPPED}
    held = dict.fromkeys(names, 0.0)
    for name, one in asked.parameters.items():
        own = name
        if len(asked.inputs) == 1 and name.endswith(f"_{asked.inputs[0]}"):
            own = f"{name.removesuffix(asked.inputs[0])}{SINGLE}"
        if one.fixed is None:
            held.pop(own, None)
        else:
            held[own] = one.fixed
    return held
