"""Signals that a map's section names, each in the unit that it must have."""

from __future__ import annotations

import difflib

import numpy as np

from avionics.quantities import BadInput
from logs.identification.experiment import Experiment
from logs.identification.results import Array


def signal(one: Experiment, name: str, unit: str | None, key: str) -> Array:
    """The signal (N,) that the map's ``key`` names, in SI ``unit``; None takes any.

    Raises:
        BadInput: it is not in [signals], is in another unit, or has no sample.
    """
    if name not in one.signals:
        near = difflib.get_close_matches(name, list(one.signals), 1)
        guess = f" (meant {near[0]!r}?)" if near else ""
        raise BadInput(f"{key} = {name!r} is not in [signals]{guess}; there are: {', '.join(one.signals)}")
    own = one.units.get(name, "-")
    if unit is not None and own != unit:
        raise BadInput(f"signals.{name} is in {own}; {key} must be in {unit}")
    values = np.asarray(one.signals[name], dtype=np.float64)
    if not np.any(np.isfinite(values)):
        raise BadInput(f"{one.name}: {name} ({key}) was not measured")
    return values
