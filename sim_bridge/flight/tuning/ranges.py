"""Units of the flight computer's gains and the ranges that it allows."""

from __future__ import annotations

from typing import Any, get_args

from wingbeat.docstrings import type_hints
from wingbeat.units import Quantity


def unit_of(gains: type[Any], key: str) -> str:
    """Return the unit of a gain."""
    hint = type_hints(gains)[key]
    return next(extra.unit for extra in get_args(hint) if isinstance(extra, Quantity))


def greatest(gains: type[Any], *keys: str) -> tuple[float, float, float]:
    """Return the limits of P, I and D of a class of gains, by their keys; 0 for those that a loop lacks."""
    hints = type_hints(gains)
    found = [next(extra.high for extra in get_args(hints[key]) if isinstance(extra, Quantity)) for key in keys]
    proportional, integral, damping = [*found, 0.0, 0.0][:3]
    return proportional, integral, damping
