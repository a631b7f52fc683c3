"""MAVLink FTP: there are no files on board yet, and saying so at once spares a ground station its time-outs."""

from __future__ import annotations

import struct
from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender

_HEADER = struct.Struct("<HBBBBBBI")
"""sequence, session, opcode, size, requested opcode, burst complete, padding, offset"""
_ACK, _NAK = 128, 129
_TERMINATE, _RESET = 1, 2
_OPENING = (4, 5, 11, 14)
"""open for reading, open for writing, open for writing an existing file, checksum of a file"""
_LIST = 3
_END_OF_LIST, _FILE_NOT_FOUND, _UNKNOWN_COMMAND = 6, 10, 7
_PAYLOAD = 251


class FtpService:
    """Answers every FTP request: an empty folder, and no file in it."""

    handles = frozenset({"FILE_TRANSFER_PROTOCOL"})

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """One answer to one request."""
        request = bytes(message.payload)
        sequence, session, opcode, _, _, _, _, offset = _HEADER.unpack_from(request)
        if opcode >= _ACK:
            return []
        reply, data = _answer(opcode)
        header = _HEADER.pack((sequence + 1) & 0xFFFF, session, reply, len(data), opcode, 0, 0, offset)
        payload = (header + data).ljust(_PAYLOAD, b"\0")
        answer = mavlink.MAVLink_file_transfer_protocol_message(0, sender.system, sender.component, list(payload))
        return [Reply(answer, sender)]

    def step(self, now: float) -> list[Output]:
        """Nothing is due without having been asked."""
        return []


def _answer(opcode: int) -> tuple[int, bytes]:
    if opcode in (_TERMINATE, _RESET):
        return _ACK, b""
    if opcode == _LIST:
        return _NAK, bytes([_END_OF_LIST])
    return _NAK, bytes([_FILE_NOT_FOUND if opcode in _OPENING else _UNKNOWN_COMMAND])
