"""Received frames of the own and of other dialects."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.framing import MARKER_V2, Frame, FrameReader, decode


class Arrival(NamedTuple):
    """One frame with its message."""

    frame: Frame
    message: Any
    """decoded message; None if no known dialect defines it"""
    at: float
    """s; on the ground's monotonic clock"""


class GroundReader(FrameReader):
    """Parser of the frames of one stream, those of unknown messages included, in order of arrival."""

    def __init__(self) -> None:
        super().__init__()
        self._frames: list[Frame] = []

    def _scan(self, buffer: bytes, frames: list[Frame]) -> int:
        self._frames = frames
        return super()._scan(buffer, frames)

    def _unknown(self, buffer: bytes, position: int, stop: int) -> int:
        size = super()._unknown(buffer, position, stop)
        if position + size == stop:
            self._frames.append(_foreign(buffer[position:stop]))
        return size


def _foreign(raw: bytes) -> Frame:
    if raw[0] == MARKER_V2:
        return Frame(int.from_bytes(raw[7:10], "little"), raw[5], raw[6], raw[10 : 10 + raw[1]], raw)
    return Frame(raw[5], raw[3], raw[4], raw[6 : 6 + raw[1]], raw)


def sequence(frame: Frame) -> int:
    """Return the sender's frame counter, 0 to 255."""
    return frame.raw[4] if frame.raw[0] == MARKER_V2 else frame.raw[2]


def known(message_id: int) -> bool:
    """Return whether the Wingbeat dialect defines a message."""
    return message_id in mavlink.mavlink_map


def read(frame: Frame) -> Any | None:
    """Decode the message of a frame; None if its number is unknown or its payload is invalid."""
    try:
        return decode(frame) if known(frame.message_id) else _read_foreign(frame)
    except (mavlink.MAVError, ValueError):
        return None


def _read_foreign(frame: Frame) -> Any | None:
    dialect = _other_dialect()
    if frame.message_id not in dialect.mavlink_map:
        return None
    try:
        return dialect.MAVLink(None).decode(bytearray(frame.raw))
    except dialect.MAVError:
        return None


@functools.cache
def _other_dialect() -> Any:
    """Return ArduPilot's dialect, with the common messages; loaded on demand because the import is slow."""
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega


def message_class(name: str) -> Any | None:
    """Return the message class of a name in the Wingbeat dialect or else in the other."""
    return _named(mavlink, name) or _named(_other_dialect(), name)


def _named(dialect: Any, name: str) -> Any | None:
    return next((kind for kind in dialect.mavlink_map.values() if kind.msgname == name), None)


def label(message: Any, enum: str, value: int) -> str:
    """Return the name of an enumeration value in the dialect of ``message``; empty if there is none."""
    entry = _dialect_of(type(message)).enums.get(enum, {}).get(value)
    return "" if entry is None else str(entry.name)


def labels(kind: Any, field: str) -> dict[int, str]:
    """Return the value names of a field of a message class; none for bit masks."""
    enum = kind.fieldenums_by_name.get(field)
    if enum is None or kind.fielddisplays_by_name.get(field) == "bitmask":
        return {}
    entries = _dialect_of(kind).enums.get(enum, {})
    return {int(value): str(entry.name) for value, entry in entries.items() if not entry.name.endswith("_ENUM_END")}


def _dialect_of(kind: Any) -> Any:
    return mavlink if mavlink.mavlink_map.get(kind.id) is kind else _other_dialect()
