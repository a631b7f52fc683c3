"""MAVLink messages as log topics with units and labels of the dialect.

A message of numbers has a constant layout as the flight computer's own messages have, so that its columns are read as
fast. One with text in it is a document.
"""

from __future__ import annotations

import functools
import math
from collections import namedtuple
from typing import Any

from groundstation.link.frames import labels
from logs.codecs import Document
from logs.layout import Field, Layout
from wingbeat.topic import Topic

FIRST_CHANNEL = 3000
"""channels of the ground station: lower ones are those of the flight computer, the world and the viewers"""
SCALARS = {
    "uint8_t": "fixed32",
    "uint16_t": "fixed32",
    "uint32_t": "fixed32",
    "int8_t": "sfixed32",
    "int16_t": "sfixed32",
    "int32_t": "sfixed32",
    "uint64_t": "fixed64",
    "int64_t": "sfixed64",
    "float": "float",
    "double": "double",
}
TIME = Field("time_us", 1, "fixed64", 0, "us", "since boot of the vehicle, by its own stamp where it gives one")


def topic_of(kind: Any, channel: int) -> Topic[Any]:
    """Return the topic of a message class, ``/mavlink/ATTITUDE``; its rate is unknown, so 0."""
    message = Document if "char" in kind.fieldtypes else _numbers(kind)
    return Topic(f"/mavlink/{kind.msgname}", message, channel, 0.0, deterministic=False)


def encode(topic: Topic[Any], message: Any, time_us: int) -> Any:
    """Convert a MAVLink message to a message of its topic."""
    if topic.message is Document:
        return Document(time_us, document(message))
    return topic.message(time_us, *(getattr(message, name) for name in message.fieldnames))


def document(message: Any) -> dict[str, Any]:
    """Convert every field of a message to JSON types."""
    return {name: _plain(getattr(message, name)) for name in message.fieldnames}


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | bytearray):
        value = value.decode("utf-8", "replace")
    if isinstance(value, str):
        return value.partition("\0")[0]
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@functools.cache
def _numbers(kind: Any) -> type[Any]:
    """A tuple of the time and every field, with the layout that the log needs."""
    make: Any = namedtuple
    made: Any = make(kind.msgname, ("time_us", *kind.fieldnames))
    fields = tuple(_field(kind, number, name) for number, name in enumerate(kind.fieldnames, 2))
    made.LAYOUT = Layout(f"mavlink.{kind.msgname}", f"MAVLink {kind.id}", (TIME, *fields))
    return made  # type: ignore[no-any-return]


def _field(kind: Any, number: int, name: str) -> Field:
    place = kind.fieldnames.index(name)
    length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
    scalar = SCALARS[kind.fieldtypes[place]]
    return Field(name, number, scalar, length, kind.fieldunits_by_name.get(name, "-"), "", labels(kind, name))
