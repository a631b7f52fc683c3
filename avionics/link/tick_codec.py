"""All messages of one tick of a bridge at once: encoded into one buffer, decoded without frame objects.

This runs in every tick between two processes that wait for each other. Anything but a complete tick is left to
`avionics.link.framing.FrameReader` and `avionics.link.codec.FrameAssembler`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple

from avionics.link.framing import CRC_BYTES, CRC_EXTRA, HEADER, HEADER_V2, MARKER_V2, checksum
from avionics.link.sensor_codec import CODECS, layout_of
from avionics.messages import SensorFrame
from avionics.sensors import IMU, OTHERS, Sensor
from wingbeat.records import constructor

_ORDER = (*OTHERS, IMU)
"""sensors in the order of their messages; HIL_SENSOR closes the tick"""
_SAMPLES = attrgetter(*(sensor.field for sensor in _ORDER))
_new_sensor_frame = constructor(SensorFrame)


class _Row(NamedTuple):
    """Message of a sensor."""

    number: int
    crc_extra: int
    frame: struct.Struct
    """header and payload"""
    values: Callable[[Any], Iterable[Any]]
    """fields of the payload of a sample"""


def _row(sensor: Sensor[Any]) -> _Row:
    codec = CODECS[sensor.field]
    layout = layout_of(codec.message_id)
    frame = struct.Struct(HEADER.format + layout.format.removeprefix("<"))
    return _Row(codec.message_id, CRC_EXTRA[codec.message_id][0], frame, codec.values)


_ROWS = tuple(_row(sensor) for sensor in _ORDER)
_DECODERS = {
    row.number.to_bytes(3, "little"): (bytes([row.crc_extra]), sensor.field, CODECS[sensor.field].decode)
    for sensor, row in zip(_ORDER, _ROWS, strict=True)
}
"""CRC_EXTRA, field and decoder by message ID"""


class DecodedTick(NamedTuple):
    """Sensor frame of a tick, and the number of its messages."""

    frame: SensorFrame
    messages: int


class TickEncoder:
    """Encoder with a buffer for the longest tick."""

    def __init__(self) -> None:
        self._buffer = bytearray(sum(row.frame.size + CRC_BYTES for row in _ROWS))

    def encode(self, frame: SensorFrame, sequence: int, system: int, component: int) -> tuple[bytes, int]:
        """Return all messages of a tick, and the sequence number after them."""
        buffer, position = self._buffer, 0
        for sample, (number, extra, layout, values) in zip(_SAMPLES(frame), _ROWS, strict=True):
            if sample is None:
                continue
            header = MARKER_V2, 0, 0, 0, sequence, system, component, number & 0xFFFF, number >> 16
            layout.pack_into(buffer, position, *header, *values(sample))
            shortest, end = position + HEADER_V2 + 1, position + layout.size
            while not buffer[end - 1] and end > shortest:  # trailing zeros are not sent
                end -= 1
            buffer[position + 1] = end - position - HEADER_V2
            buffer[end] = extra
            crc = checksum(buffer[position + 1 : end + 1])
            buffer[end], buffer[end + 1] = crc & 0xFF, crc >> 8
            sequence, position = (sequence + 1) & 0xFF, end + CRC_BYTES
        return bytes(buffer[:position]), sequence


def decode_tick(data: bytes) -> DecodedTick | None:
    """Return the tick if ``data`` is exactly the unsigned MAVLink 2 messages of one, else None."""
    position, end, messages = 0, len(data), 0
    parts: dict[str, Any] = {}
    while position + HEADER_V2 + CRC_BYTES <= end:
        start = position + HEADER_V2
        body = start + data[position + 1]
        known = _DECODERS.get(data[start - 3 : start])
        if data[position] != MARKER_V2 or data[position + 2] or known is None or body + CRC_BYTES > end:
            return None
        extra, field, decode = known
        if checksum(data[position + 1 : body] + extra) != data[body] | data[body + 1] << 8:
            return None
        sample = decode(data[start:body])
        messages += 1
        position = body + CRC_BYTES
        if field == IMU.field:
            imu: Any = sample
            return DecodedTick(_new_sensor_frame(imu.time_us, imu, **parts), messages) if position == end else None
        if sample is not None:
            parts[field] = sample
    return None
