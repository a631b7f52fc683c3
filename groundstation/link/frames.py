"""Received frames of the own and of other dialects."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.framing import MARKER_V2, Frame, FrameReader, decode


class Arrival(NamedTuple):
    """One frame, and what it says."""

    frame: Frame
    message: Any
    """the generated message object; None where no dialect at hand knows it"""
    at: float
    """s; of the ground's monotonic clock"""


class GroundReader(FrameReader):
    """Cuts frames out of one stream and gives those with an unknown number too, in the order in which they came."""

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
    """The sender's count of its frames, 0 to 255."""
    return frame.raw[4] if frame.raw[0] == MARKER_V2 else frame.raw[2]


def known(message_id: int) -> bool:
    """Whether our own dialect has a message."""
    return message_id in mavlink.mavlink_map


def read(frame: Frame) -> Any | None:
    """The message in a frame; None where its number is unknown or its payload is not that message's."""
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
    """ArduPilot's, with the common messages in it; only who hears a stranger pays the tenths of a second."""
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega


def message_class(name: str) -> Any | None:
    """The generated class of a message by its name, in our dialect or else in the other."""
    return _named(mavlink, name) or _named(_other_dialect(), name)


def _named(dialect: Any, name: str) -> Any | None:
    return next((kind for kind in dialect.mavlink_map.values() if kind.msgname == name), None)


def label(message: Any, enum: str, value: int) -> str:
    """Name of a value of an enumeration, as the dialect of ``message`` has it; empty where there is none."""
    entry = _dialect_of(type(message)).enums.get(enum, {}).get(value)
    return "" if entry is None else str(entry.name)


def labels(kind: Any, field: str) -> dict[int, str]:
    """Names of the values of a field of a generated message class; none for flags, which are many at once."""
    enum = kind.fieldenums_by_name.get(field)
    if enum is None or kind.fielddisplays_by_name.get(field) == "bitmask":
        return {}
    entries = _dialect_of(kind).enums.get(enum, {})
    return {int(value): str(entry.name) for value, entry in entries.items() if not entry.name.endswith("_ENUM_END")}


def _dialect_of(kind: Any) -> Any:
    return mavlink if mavlink.mavlink_map.get(kind.id) is kind else _other_dialect()
