"""Signals that a map's section names, each in the unit that it must have, and bands of frequency."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

LEAST_ALIKE = 10
"""-; samples, of which fewer may be alike by chance"""
ALIKE = 1e-9
"""-; what a correlation of one column with itself lacks by rounding, its square's half"""


def signal(one: Experiment, name: str, unit: str | None, key: str) -> Array:
    """The signal (N,) that the map's ``key`` names, in SI ``unit``; None takes any.

    Raises:
        InputError: it is not in [signals], is in another unit, or has no sample.
    """
    if name not in one.signals:
        guess = did_you_mean(name, one.signals)
        raise InputError(f"{key} = {name!r} is not in [signals]{guess}; there are: {', '.join(one.signals)}")
    own = one.units.get(name, "-")
    if unit is not None and own != unit:
        raise InputError(f"signals.{name} is in {own}; {key} must be in {unit}")
    values = np.asarray(one.signals[name], dtype=np.float64)
    if not np.any(np.isfinite(values)):
        raise InputError(f"{one.name}: {name} ({key}) was not measured")
    return values


def band_frequencies(band: tuple[float, float], experiments: tuple[Experiment, ...], key: str) -> Array:
    """Frequencies (F,) in Hz of a ``band`` in Hz, one over the longest record's length apart.

    Raises:
        InputError: the band does not rise from above 0, or holds none; ``key`` is whose it is.
    """
    low, high = band
    length = max(len(one.time) * one.step for one in experiments)
    found = np.arange(max(np.ceil(low * length), 1.0), np.floor(high * length) + 1.0) / length
    if not 0 < low < high or not len(found):
        raise InputError(f"{key}: band = [{low:g}, {high:g}] Hz holds no frequency")
    return found


def check_apart(experiments: Sequence[Experiment], inputs: Sequence[str], outputs: Sequence[str], key: str) -> None:
    """Refuse an output that is an input, but for scale and offset: any fit to it is perfect, and tells nothing.

    Raises:
        InputError: it names both; ``key`` is whose they are.
    """
    for given, seen in product(inputs, outputs):
        if given == seen:
            raise InputError(f"{key}: {given} is in inputs and in outputs")
        pairs = [
            (np.asarray(one.signals[given]), np.asarray(one.signals[seen]))
            for one in experiments
            if given in one.signals and seen in one.signals
        ]
        both = np.concatenate([np.column_stack(pair) for pair in pairs]) if pairs else np.zeros((0, 2))
        both = both[np.all(np.isfinite(both), axis=1)]
        if len(both) < LEAST_ALIKE or not np.all(np.ptp(both, axis=0) > 0.0):
            continue
        left = 1.0 - abs(float(np.corrcoef(both.T)[0, 1]))
        if left < ALIKE:
            raise InputError(f"{key}: input {given} and output {seen} are one signal: is it the same column?")
