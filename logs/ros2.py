"""ROS 2 messages in CDR (``mcap-ros2-support``)."""

from __future__ import annotations

import array
import struct
from collections.abc import Callable, Iterator
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Schema

from logs.extras import load_extra
from logs.records import Damage

_WRONG = (
    struct.error, ValueError, IndexError, KeyError, TypeError, AttributeError, RuntimeError, MemoryError, McapError,
)  # fmt: skip
"""exceptions of the package for bytes or a definition that it cannot read"""
_SEQUENCES = (list, tuple, bytes, bytearray, memoryview, array.array)


def cdr_decoder(channel: Channel, schema: Schema) -> Callable[[bytes], dict[str, Any]]:
    """Return the decoder of a message to its values; members of nested messages are named ``outer.inner``.

    Raises:
        InputError: the package is not installed.
        Damage: the definition cannot be read.
    """
    support = load_extra("mcap_ros2.decoder", "mcap-ros2-support", f"reading ROS 2 messages ({channel.topic})")
    try:
        decoded = support.DecoderFactory().decoder_for("cdr", schema)
    except Exception:  # its parser has exceptions of its own, without a common ancestor
        raise Damage(f"schema {schema.name} cannot be read") from None

    def decode(data: bytes) -> dict[str, Any]:
        try:
            return dict(_members(decoded(data), ""))
        except _WRONG:
            raise Damage(f"a message of {channel.topic} cannot be read") from None

    return decode


def _members(message: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    for name in type(message).__slots__:
        value = getattr(message, name)
        if _is_message(value):
            yield from _members(value, f"{prefix}{name}.")
        else:
            yield prefix + name, _plain(value)


def _plain(value: Any) -> Any:
    if not isinstance(value, _SEQUENCES):
        return value
    return [dict(_members(item, "")) if _is_message(item) else item for item in value]


def _is_message(value: Any) -> bool:
    return hasattr(type(value), "_full_text")
