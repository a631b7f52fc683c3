"""Message fields by name: ``ATTITUDE.pitch``, ``BATTERY_STATUS.voltages[0]``."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

from groundstation.link.frames import message_class
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

_PATTERN = re.compile(r"([A-Za-z0-9_]+)\.([A-Za-z0-9_]+)(?:\[(\d+)\])?")


class Field(NamedTuple):
    """Field of a message."""

    message: str
    """-; name of the message"""
    name: str
    """-; of its field"""
    element: int | None = None
    """-; of an element of an array"""
    unit: str = ""
    """-; unit on the wire"""

    @property
    def path(self) -> str:
        """Notation MESSAGE.field."""
        return f"{self.message}.{self.name}" + ("" if self.element is None else f"[{self.element}]")

    def value(self, message: Any) -> Any:
        """Return the field's value in a message of this type: a number, a text, or a list."""
        value = getattr(message, self.name)
        return value if self.element is None else value[self.element]


def parse_field(text: str) -> Field:
    """Parse a field name, case-insensitive.

    Raises:
        InputError: not MESSAGE.FIELD, an unknown message, or a field that it does not have; the message lists its
            fields.
    """
    match = _PATTERN.fullmatch(text.strip())
    if match is None:
        raise InputError(f"{text!r} is not MESSAGE.FIELD, such as ATTITUDE.pitch")
    message, name, index = match[1].upper(), match[2].lower(), match[3]
    kind = message_class(message)
    if kind is None:
        raise InputError(f"unknown message {message}{did_you_mean(message, message_names())}")
    names = {field.lower(): field for field in kind.fieldnames}
    if name not in names:
        raise InputError(
            f"{message} has no field {match[2]!r}{did_you_mean(name, names)}; it has {', '.join(kind.fieldnames)}"
        )
    length = _length(kind, names[name])
    if (index is not None) != bool(length) or (index is not None and int(index) >= length):
        wanted = f"an array of {length}: {message}.{names[name]}[0]" if length else "no array"
        raise InputError(f"{message}.{names[name]} is {wanted}")
    unit = kind.fieldunits_by_name.get(names[name], "")
    return Field(message, names[name], None if index is None else int(index), unit)


def _length(kind: Any, name: str) -> int:
    """Return the number of elements of a numeric array; 0 for a single value or a text."""
    if kind.fieldtypes[kind.fieldnames.index(name)] == "char":
        return 0
    return int(kind.array_lengths[kind.ordered_fieldnames.index(name)])


def message_names() -> list[str]:
    """Return the message names of the Wingbeat dialect."""
    from avionics.link.dialect import mavlink

    return [kind.msgname for kind in mavlink.mavlink_map.values()]
