"""Exact JSON of nested NamedTuples and dataclasses.

Floats are bit-exact (shortest repr).
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from wingbeat.docstrings import type_hints
from wingbeat.documents import parse_json
from wingbeat.errors import InputError

T = TypeVar("T")
Builder = Callable[[Any], Any]


def encode(record: Any) -> str:
    """Return the JSON text of a dataclass.

    The dataclass is an object; its NamedTuples are arrays in field order.
    """
    return json.dumps({field.name: getattr(record, field.name) for field in fields(record)}, separators=(",", ":"))


def decode(kind: Callable[..., T], text: str, former_names: Mapping[str, str] = MappingProxyType({})) -> T:
    """Decode a record that `encode` wrote.

    Args:
        kind: the dataclass.
        text: JSON document.
        former_names: earlier keys of renamed fields, to their present names.

    Raises:
        InputError: not JSON, or not a snapshot of ``kind``.
    """
    try:
        document = {former_names.get(key, key): value for key, value in parse_json(text).items()}
        # A field missing in an older recording has its default.
        return kind(
            **{name: build(document[name]) for name, build in _record_builders(kind).items() if name in document}
        )
    except (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        raise InputError(f"not a snapshot of this flight computer: {type(error).__name__} {error}") from None


@cache
def _record_builders(kind: Any) -> dict[str, Builder]:
    assert is_dataclass(kind)
    return {name: builder(hint) for name, hint in type_hints(kind).items()}


def builder(hint: Any) -> Builder:
    """Return a function that builds a value of type ``hint`` from its JSON.

    Supported are numbers, text, enums, tuples and NamedTuples.
    """
    origin = get_origin(hint)
    if origin is Annotated:
        return builder(get_args(hint)[0])
    if origin is Union or origin is types.UnionType:
        inner = builder(next(part for part in get_args(hint) if part is not type(None)))
        return lambda value: None if value is None else inner(value)
    if origin is tuple:
        return _tuple_builder(get_args(hint))
    if isinstance(hint, type) and issubclass(hint, tuple):
        return _named_tuple_builder(hint)
    if isinstance(hint, type) and issubclass(hint, Enum | int | float | str):
        return _number if hint is float else hint
    raise TypeError(f"a State may not hold {hint}")


def _number(value: Any) -> float:
    """Return the number unchanged, because a float field may contain an integer."""
    if not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return value


def _tuple_builder(parts: tuple[Any, ...]) -> Builder:
    if parts[-1] is Ellipsis:
        each = builder(parts[0])
        return lambda values: tuple(each(value) for value in values)
    builders = [builder(part) for part in parts]
    return lambda values: tuple(build(value) for build, value in zip(builders, values, strict=True))


def _named_tuple_builder(kind: Any) -> Builder:
    # Resolved at the first use, because a NamedTuple may be declared after the one that contains it.
    def build(values: Any) -> Any:
        builders = _field_builders(kind)
        if len(values) > len(builders):
            raise TypeError(f"{kind.__name__} has {len(builders)} fields, not {len(values)}")
        return kind(*(make(value) for make, value in zip(builders, values, strict=False)))

    return build


@cache
def _field_builders(kind: Any) -> tuple[Builder, ...]:
    return tuple(builder(hint) for hint in type_hints(kind).values())
