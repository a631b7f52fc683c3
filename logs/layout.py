"""Constant layout of a message class: protobuf, struct and NumPy types.

Every field of a data topic is written always and has a fixed width, so the protobuf encoding of a message has a
constant length with the tags at constant places. `struct` then produces the bytes of the protobuf library, and
a NumPy structured type with the tags as padding reads them. Encoding: https://protobuf.dev/programming-guides/encoding
"""

from __future__ import annotations

import functools
import inspect
import struct
from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Annotated, Any, NamedTuple, get_args, get_origin

import numpy as np

from wingbeat.docstrings import field_texts, split_unit, type_hints
from wingbeat.message import Wire

VARINT, FIXED64, DELIMITED, FIXED32 = 0, 1, 2, 5


class Scalar(NamedTuple):
    """Protobuf scalar of fixed width."""

    wire_type: int
    code: str
    """of the `struct` module; NumPy uses the same letters after ``<``"""
    width: int
    """bytes"""


SCALARS: Mapping[str, Scalar] = {
    "double": Scalar(FIXED64, "d", 8),
    "float": Scalar(FIXED32, "f", 4),
    "fixed32": Scalar(FIXED32, "I", 4),
    "sfixed32": Scalar(FIXED32, "i", 4),
    "fixed64": Scalar(FIXED64, "Q", 8),
    "sfixed64": Scalar(FIXED64, "q", 8),
}


class Field(NamedTuple):
    """Field of a message as stored in the log."""

    name: str
    number: int
    """protobuf field number, from 1"""
    scalar: str
    """one of `SCALARS`"""
    length: int = 0
    """values of a packed array, 0 for a single value"""
    unit: str = "-"
    description: str = ""
    labels: Mapping[int, str] = {}
    """value names of an enumeration"""

    @property
    def tag(self) -> bytes:
        """Bytes before the value: the key, and the length in bytes for an array."""
        scalar = SCALARS[self.scalar]
        if not self.length:
            return varint(self.number << 3 | scalar.wire_type)
        return varint(self.number << 3 | DELIMITED) + varint(self.length * scalar.width)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a message's value as an array; empty for a single value."""
        return (self.length,) if self.length else ()

    @property
    def code(self) -> str:
        """Format of the value for the `struct` module."""
        return f"{self.length or ''}{SCALARS[self.scalar].code}"


class Layout(NamedTuple):
    """Message whose encoding has a constant length."""

    name: str
    """full protobuf name, ``wingbeat.<folder>.<class>``"""
    description: str
    fields: tuple[Field, ...]

    @property
    def format(self) -> str:
        """Format for `struct`: tag bytes and value of each field, little endian."""
        return "<" + "".join(f"{len(field.tag)}s{field.code}" for field in self.fields)

    @property
    def size(self) -> int:
        """Bytes of an encoded message."""
        return struct.calcsize(self.format)

    def arguments(self, message: tuple[Any, ...]) -> Iterator[Any]:
        """Tags and values in the order of `format`."""
        for field, value in zip(self.fields, message, strict=True):
            yield field.tag
            if field.length:
                yield from value
            else:
                yield value

    def encode(self, message: tuple[Any, ...]) -> bytes:
        """Encode one message as protobuf bytes; the recorder uses a faster method with the same result.

        Raises:
            struct.error: a value does not fit its scalar, or an array has another length than declared.
        """
        return struct.pack(self.format, *self.arguments(message))

    def record_type(self, before: int = 0) -> np.dtype[np.void]:
        """Return the NumPy type of an encoded message preceded by ``before`` bytes; the tags are padding."""
        names: list[str] = []
        formats: list[Any] = []
        offsets: list[int] = []
        position = before
        for field in self.fields:
            position += len(field.tag)
            names.append(field.name)
            code = f"<{SCALARS[field.scalar].code}"
            formats.append((code, (field.length,)) if field.length else code)
            offsets.append(position)
            position += struct.calcsize("<" + field.code)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": position})


def varint(value: int) -> bytes:
    """Encode a nonnegative number as a protobuf varint."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


@functools.cache
def layout_of(message: type[Any]) -> Layout:
    """Return the layout of a NamedTuple class.

    Scalars follow from its annotations, units and descriptions from its docstrings. A generated class, such as those
    of MAVLink, has its layout as ``LAYOUT``.

    Raises:
        TypeError: a field is neither ``float`` nor annotated with `wingbeat.message.Wire`.
    """
    made: Layout | None = getattr(message, "LAYOUT", None)
    if made is not None:
        return made
    hints = type_hints(message)
    texts = field_texts(message.__module__).get(message.__name__, {})
    fields = tuple(
        _field(message, number, name, hints[name], texts.get(name, "-"))
        for number, name in enumerate(message._fields, 1)
    )
    package = message.__module__.partition(".")[0]
    # The schema name of a shared message is that of the first recordings with it.
    owner = "avionics" if package == "wingbeat" else package
    return Layout(f"wingbeat.{owner}.{message.__name__}", inspect.cleandoc(message.__doc__ or ""), fields)


def _field(message: type[Any], number: int, name: str, hint: Any, text: str) -> Field:
    base, wire = _unwrap(hint)
    if wire is None or wire.scalar not in SCALARS:
        raise TypeError(f"{message.__name__}.{name}: {hint!r} has no fixed width in the log")
    unit, description = split_unit(text)
    labels = {int(member.value): member.name for member in base} if _is_enumeration(base) else {}
    return Field(name, number, wire.scalar, wire.length, unit, description, labels)


def _is_enumeration(base: Any) -> bool:
    return isinstance(base, type) and issubclass(base, Enum)


def _unwrap(hint: Any) -> tuple[Any, Wire | None]:
    if get_origin(hint) is Annotated:
        base, *extras = get_args(hint)
        return base, next((extra for extra in extras if isinstance(extra, Wire)), None)
    return hint, Wire("double") if hint is float else None
