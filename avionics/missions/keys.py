"""What the readers of mission items share: numbers with a unit and a range, and words out of a list."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from wingbeat.errors import InputError


class Key(NamedTuple):
    """A number in an item: its unit, its range, and what it is in SI."""

    unit: str
    low: float
    high: float
    si: Callable[[float], float] = float
    default: float | None = None
    """in SI, where the key may be left out"""


def choice(where: str, table: Mapping[str, Any], key: str, choices: Mapping[str, Any]) -> Any:
    """What the word at ``key`` stands for.

    Raises:
        InputError: missing, or none of the ``choices``.
    """
    word = str(table.get(key, "")).lower()
    if word not in choices:
        said = f'"{word}"' if key in table else "missing"
        raise InputError(f"{where}: {key} is {said}; it must be one of {', '.join(choices)}")
    return choices[word]


def numbers(
    where: str, table: Mapping[str, Any], keys: Mapping[str, Key], others: tuple[str, ...]
) -> dict[str, float]:
    """The numbers at ``keys`` in SI; ``others`` are the keys that are read elsewhere.

    Raises:
        InputError: a key that is not known, or a number that is missing or outside its range.
    """
    for name in table:
        if name not in keys and name not in others:
            raise InputError(f"{where}: unknown key {name}; known: {', '.join((*others, *keys))}")
    return {name: number(where, table, name, key) for name, key in keys.items()}


def number(where: str, table: Mapping[str, Any], name: str, key: Key) -> float:
    """One number in SI.

    Raises:
        InputError: missing, or outside its range.
    """
    expected = f"a number from {key.low:g} to {key.high:g} {key.unit}"
    value = table.get(name)
    if value is None and key.default is not None:
        return key.default
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(
            f"{where}: {name} {'is missing' if value is None else f'= {value!r}'}; it must be {expected}"
        )
    if not key.low <= value <= key.high:
        raise InputError(f"{where}: {name} = {value:g} is outside its range; it must be {expected}")
    return key.si(value)
