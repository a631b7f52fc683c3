"""Numbers of mission items with unit, range and SI conversion, and enumerations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from wingbeat.errors import InputError
from wingbeat.schema import check_keys, read_number
from wingbeat.units import Quantity


class Key(NamedTuple):
    """Numeric key of an item: unit, range and SI conversion."""

    unit: str
    low: float
    high: float
    si: Callable[[float], float] = float
    default: float | None = None
    """default in SI, None if the key is required"""

    @property
    def quantity(self) -> Quantity:
        """Unit and range."""
        return Quantity(self.unit, self.low, self.high)


def choice(table: Mapping[str, Any], key: str, choices: Mapping[str, Any]) -> Any:
    """Return the value of the word at ``key``.

    Raises:
        InputError: missing, or none of the ``choices``.
    """
    word = str(table.get(key, "")).lower()
    if word not in choices:
        shown = f'"{word}"' if key in table else "missing"
        raise InputError(f"{key} is {shown}; it must be one of {', '.join(choices)}")
    return choices[word]


def numbers(table: Mapping[str, Any], keys: Mapping[str, Key], others: tuple[str, ...]) -> dict[str, float]:
    """Read the numbers at ``keys`` in SI.

    ``others`` are keys that are read elsewhere.

    Raises:
        InputError: unknown key, or a number that is missing or outside its range.
    """
    check_keys(table, (*others, *keys))
    return {name: number(table, name, key) for name, key in keys.items()}


def number(table: Mapping[str, Any], name: str, key: Key) -> float:
    """Read one number in SI.

    Raises:
        InputError: missing, or outside its range.
    """
    if name in table:
        return key.si(read_number(table[name], name, key.quantity))
    if key.default is None:
        raise InputError(f"{name} is missing ({key.quantity.range_text()})")
    return key.default
