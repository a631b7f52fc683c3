"""MAVLink frame parser and writer.

The stream parser of pymavlink discards a whole frame with a wrong checksum, and waits for the remainder of a frame
that is only noise; a lockstep partner then waits without end. This parser discards one byte and continues, so that
only the noise is lost.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink

MARKER_V1 = 0xFE
MARKER_V2 = 0xFD
_HEADER_V1 = 6
HEADER_V2 = 10
CRC_BYTES = 2
_SIGNATURE = 13
SIGNED = 0x01
"""flag of a signed frame"""
_LIKELY_V2 = re.compile(rb"\xfd(?:.[\0\1]|.?\Z)", re.DOTALL)
"""marker followed by known flags, or incomplete; limits the cost of a flood of markers"""
_LIKELY = re.compile(rb"\xfe|" + _LIKELY_V2.pattern, re.DOTALL)
HEADER = struct.Struct("<BBBBBBBHB")
"""marker, payload size, incompatible and compatible flags, sequence, system, component, message ID in two parts"""
_PACK_HEADER = HEADER.pack

CRC_EXTRA: dict[int, bytes] = {number: bytes([kind.crc_extra]) for number, kind in mavlink.mavlink_map.items()}
"""CRC_EXTRA of every known message, as the byte appended before the checksum"""

_ALL_CRC_EXTRA: dict[int, bytes] = {number: bytes([wire[0]]) for number, wire in mavlink.wire_table.items()}
_ALL_CRC_EXTRA |= CRC_EXTRA

TARGETS: dict[int, tuple[int, int]] = {number: wire[1:3] for number, wire in mavlink.wire_table.items()}
"""offsets of target system and component in the payload, -1 for none, for all messages that can be forwarded"""

_SIZE_V1: dict[int, int] = {number: wire[3] for number, wire in mavlink.wire_table.items() if number <= 0xFF}
"""bytes; payload size in MAVLink 1, without extension fields and message IDs above 255"""

LONGEST: dict[int, int] = {number: kind.unpacker.size for number, kind in mavlink.mavlink_map.items()}
"""bytes; payload size of every known message"""


class Frame(NamedTuple):
    """Frame with a valid checksum; trailing zeros of the payload are not restored."""

    message_id: int
    system: int
    component: int
    payload: bytes
    raw: bytes


def _slow_checksum(data: bytes | bytearray) -> int:
    crc: int = mavlink.x25crc(data).crc
    return crc


checksum: Callable[[bytes | bytearray], int] = getattr(mavlink, "mcrf4xx", None) or _slow_checksum
"""CRC-16/MCRF4XX of some bytes, the checksum of MAVLink; the C function of pymavlink from 2.4.48, if installed"""


def build_frame(message_id: int, payload: bytes, sequence: int, system: int, component: int) -> bytes:
    """Return an unsigned MAVLink 2 frame of a payload in wire order."""
    payload = payload.rstrip(b"\0") or payload[:1]
    header = _PACK_HEADER(
        MARKER_V2,
        len(payload),
        0,
        0,
        sequence & 0xFF,
        system,
        component,
        message_id & 0xFFFF,
        message_id >> 16,
    )
    body = header + payload
    return body + checksum(body[1:] + CRC_EXTRA[message_id]).to_bytes(2, "little")


def build_frame_v1(message_id: int, payload: bytes, sequence: int, system: int, component: int) -> bytes:
    """Return a MAVLink 1 frame of a payload in wire order.

    The result is empty for a message that MAVLink 1 does not have.
    """
    size = _SIZE_V1.get(message_id)
    if size is None:
        return b""
    header = bytes((MARKER_V1, size, sequence & 0xFF, system, component, message_id))
    body = header + payload[:size].ljust(size, b"\0")
    return body + checksum(body[1:] + _ALL_CRC_EXTRA[message_id]).to_bytes(2, "little")


def decode(frame: Frame) -> Any:
    """Return the generated message object of a frame.

    Raises:
        mavlink.MAVError: the payload does not fit the message.
    """
    return _DECODER.decode(bytearray(frame.raw))


_DECODER = mavlink.MAVLink(None)


def sole_payload(data: bytes, message_id: int) -> bytes | None:
    """Return the payload if ``data`` is exactly one valid unsigned MAVLink 2 frame of a known message, else None."""
    size = len(data) - HEADER_V2 - CRC_BYTES
    if size < 0 or data[0] != MARKER_V2 or data[1] != size or data[2]:
        return None
    if int.from_bytes(data[7:10], "little") != message_id:
        return None
    crc = checksum(data[1:-CRC_BYTES] + CRC_EXTRA[message_id])
    return data[HEADER_V2:-CRC_BYTES] if crc == int.from_bytes(data[-CRC_BYTES:], "little") else None


class FrameReader:
    """Frame parser of one stream, with counters of frames and invalid bytes."""

    def __init__(self, version_1: bool = True, foreign: bool = False) -> None:
        """Create the parser.

        If ``version_1`` is False, the marker of MAVLink 1 counts as noise, as on the bridge, which does not use it.
        If ``foreign`` is True, frames that can be forwarded but not decoded here are returned as well.
        """
        self._crc_extra = _ALL_CRC_EXTRA if foreign else CRC_EXTRA
        self._markers = (MARKER_V2, MARKER_V1) if version_1 else (MARKER_V2,)
        self._likely = _LIKELY if version_1 else _LIKELY_V2
        self.bad_bytes = 0
        self.frames = 0
        self.unknown = 0
        self._pending = b""

    @property
    def pending(self) -> bool:
        """Whether an incomplete frame waits for more bytes."""
        return bool(self._pending)

    def feed(self, data: bytes) -> list[Frame]:
        """Return all frames completed by ``data``.

        An incomplete frame waits for the next call.
        """
        buffer = self._pending + data if self._pending else data
        parsed: list[Frame] = []
        position = self._scan(buffer, parsed)
        self._pending = buffer[position:]
        self.frames += len(parsed)
        return parsed

    def give_up(self) -> list[Frame]:
        """Discard an incomplete frame and parse the bytes after its marker.

        This is used after the timeout of a lockstep partner and at the end of a datagram.
        """
        parsed: list[Frame] = []
        while self._pending:
            self.bad_bytes += 1
            rest, self._pending = self._pending[1:], b""
            parsed += self.feed(rest)
        return parsed

    def reset(self) -> None:
        """Discard partially received frames."""
        self.bad_bytes += len(self._pending)
        self._pending = b""

    def _scan(self, buffer: bytes, parsed: list[Frame]) -> int:
        position = 0
        end = len(buffer)
        while position < end:
            found_at = self._likely.search(buffer, position)
            noise = (found_at.start() if found_at else end) - position
            self.bad_bytes += noise
            position += noise
            if not found_at:
                break
            read = self._version_2 if buffer[position] == MARKER_V2 else self._version_1
            size = read(buffer, position, parsed)
            if not size:
                break
            position += size
        return position

    def _version_2(self, buffer: bytes, position: int, parsed: list[Frame]) -> int:
        """Return the bytes consumed at ``position``.

        The result is the size of a frame, 1 for a false marker, or 0 for an incomplete frame.
        """
        if len(buffer) - position < HEADER_V2:
            return 0
        flags = buffer[position + 2]
        message_id = int.from_bytes(buffer[position + 7 : position + 10], "little")
        body = position + HEADER_V2 + buffer[position + 1]
        stop = body + CRC_BYTES + (_SIGNATURE if flags & SIGNED else 0)
        extra = self._crc_extra.get(message_id)
        if extra is None:
            return self._unknown(buffer, position, stop)
        if stop > len(buffer):
            return 0
        if checksum(buffer[position + 1 : body] + extra) != int.from_bytes(buffer[body : body + 2], "little"):
            return self._bad_byte()
        payload = buffer[position + HEADER_V2 : body]
        raw = buffer[position:stop]
        parsed.append(Frame(message_id, buffer[position + 5], buffer[position + 6], payload, raw))
        return stop - position

    def _version_1(self, buffer: bytes, position: int, parsed: list[Frame]) -> int:
        if len(buffer) - position < _HEADER_V1:
            return 0
        message_id = buffer[position + 5]
        body = position + _HEADER_V1 + buffer[position + 1]
        stop = body + CRC_BYTES
        extra = self._crc_extra.get(message_id)
        if extra is None:
            return self._unknown(buffer, position, stop)
        if buffer[position + 1] > LONGEST.get(message_id, 255):
            return self._bad_byte()  # MAVLink 1 knows no extensions, so its payloads never grow
        if stop > len(buffer):
            return 0
        if checksum(buffer[position + 1 : body] + extra) != int.from_bytes(buffer[body:stop], "little"):
            return self._bad_byte()
        payload = buffer[position + _HEADER_V1 : body]
        raw = buffer[position:stop]
        parsed.append(Frame(message_id, buffer[position + 3], buffer[position + 4], payload, raw))
        return stop - position

    def _unknown(self, buffer: bytes, position: int, stop: int) -> int:
        # Without its CRC_EXTRA a foreign message cannot be checked: accept it if its end is followed by the next
        # frame or by nothing.
        if stop == len(buffer) or (stop < len(buffer) and buffer[stop] in self._markers):
            self.unknown += 1
            return stop - position
        return self._bad_byte()

    def _bad_byte(self) -> int:
        self.bad_bytes += 1
        return 1
