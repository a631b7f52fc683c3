"""MAVLink FTP for reading: list, open, read, burst read and checksum.

Other requests are answered by a NAK at once, so that a ground station does not run into timeouts. A repeated request
gets the same answer. Bursts and checksums continue in `step` in small parts. Each sender numbers its own sessions:
some request a number and do not read the assigned one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

from avionics.link.budget import BULK, Capacity
from avionics.link.dialect import mavlink
from avionics.link.ftp_files import Content, FtpFileSystem
from avionics.link.services.service import Output, Reply, Sender

_HEADER = struct.Struct("<HBBBBBBI")
"""sequence, session, opcode, size, requested opcode, burst complete, padding, offset"""
_PAYLOAD = 251
ROOM = _PAYLOAD - _HEADER.size
"""bytes; data in one message"""
FRAME_BYTES = 280.0
"""bytes; size of one message on the wire, signed"""
MOST_SESSIONS = 8
REPEATED = 3.0
"""s; interval in which an identical request counts as repeated"""
IDLE = 60.0
"""s; idle time after which a session may be replaced"""
BURST = 100
"""messages; length of a burst, after which the station requests the next one"""
BURST_PER_STEP = 10
"""messages; limit of all bursts in one step, so that the senders alternate"""
CHECKED_PER_STEP = 65536
"""bytes; checksum progress in one step"""


class _Op(IntEnum):
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CHECKSUM = 14
    BURST = 15
    ACK = 128
    NAK = 129


_WRITING = frozenset(range(6, 14))


class _Error(IntEnum):
    FAIL = 1
    INVALID_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class _Refused(Exception):
    def __init__(self, error: _Error) -> None:
        super().__init__(error.name)
        self.error = error


class _Request(NamedTuple):
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def path(self) -> str:
        return self.data.split(b"\0")[0].decode("utf-8", errors="replace")


@dataclass
class _Session:
    content: Content
    used: float


class _Answered(NamedTuple):
    request: _Request
    reply: Reply
    time: float


@dataclass
class _Burst:
    request: _Request
    offset: int
    sequence: int
    left: int = BURST


@dataclass
class _Checksum:
    request: _Request
    content: Content
    offset: int = 0
    # Without the usual inversions, which are built into zlib.
    crc: int = 0xFFFFFFFF


class FtpService:
    """Service for FILE_TRANSFER_PROTOCOL."""

    takes = frozenset({"FILE_TRANSFER_PROTOCOL"})

    def __init__(self, files: FtpFileSystem, capacities: Sequence[Capacity]) -> None:
        """Create the service; ``capacities`` return the bytes that each link accepts now."""
        self._files = files
        self._capacities = capacities
        self._sessions: dict[tuple[Sender, int], _Session] = {}
        self._bursts: dict[Sender, _Burst] = {}
        self._checksums: dict[Sender, _Checksum] = {}
        self._answered: dict[Sender, _Answered] = {}
        self._answers: dict[int, Callable[[_Request, Sender, float], bytes]] = {
            _Op.TERMINATE: self._terminate,
            _Op.RESET: self._reset,
            _Op.LIST: self._list,
            _Op.OPEN: self._open,
            _Op.READ: self._read,
        }

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Answer a request at once, or in parts in the case of a burst or a checksum."""
        request = _read_request(bytes(message.payload))
        if request.opcode >= _Op.ACK:
            return []
        known = self._answered.get(sender)
        if known is not None and known.request == request and now - known.time < REPEATED:
            return [known.reply]
        self._bursts.pop(sender, None)
        try:
            reply = self._answer(request, sender, now)
        except _Refused as refused:
            reply = _reply(request, sender, _Op.NAK, bytes([refused.error]))
        if reply is None:
            return []
        self._remember(sender, _Answered(request, reply, now))
        return [reply]

    def _remember(self, sender: Sender, answered: _Answered) -> None:
        self._answered.pop(sender, None)
        if len(self._answered) >= MOST_SESSIONS:
            del self._answered[next(iter(self._answered))]
        self._answered[sender] = answered

    def _answer(self, request: _Request, sender: Sender, now: float) -> Reply | None:
        if request.size > ROOM:
            raise _Refused(_Error.INVALID_SIZE)
        if request.opcode == _Op.BURST:
            self._session(sender, request, now)
            self._bursts[sender] = _Burst(request, request.offset, request.sequence + 1)
            return None
        if request.opcode == _Op.CHECKSUM:
            if sender not in self._checksums and len(self._checksums) >= MOST_SESSIONS:
                raise _Refused(_Error.NO_SESSIONS)
            self._checksums[sender] = _Checksum(request, self._find(request))
            return None
        answer = self._answers.get(request.opcode)
        if answer is None:
            raise _Refused(_Error.FILE_PROTECTED if request.opcode in _WRITING else _Error.UNKNOWN_COMMAND)
        return _reply(request, sender, _Op.ACK, answer(request, sender, now))

    def _terminate(self, request: _Request, sender: Sender, now: float) -> bytes:
        self._sessions.pop((sender, request.session), None)
        return b""

    def _reset(self, request: _Request, sender: Sender, now: float) -> bytes:
        """Close the sessions of the sender only, because another station may be reading."""
        self._sessions = {key: each for key, each in self._sessions.items() if key[0] != sender}
        return b""

    def _list(self, request: _Request, sender: Sender, now: float) -> bytes:
        entries = self._files.entries(request.path)
        if entries is None:
            raise _Refused(_Error.FILE_NOT_FOUND)
        data = b""
        for entry in entries[request.offset :]:
            line = entry.encode() + b"\0"
            if len(data) + len(line) > ROOM:
                break
            data += line
        if not data:
            raise _Refused(_Error.END_OF_FILE)
        return data

    def _open(self, request: _Request, sender: Sender, now: float) -> bytes:
        content = self._find(request)
        self._evict((sender, request.session), now)
        self._sessions[sender, request.session] = _Session(content, now)
        return struct.pack("<I", content.size)

    def _evict(self, key: tuple[Sender, int], now: float) -> None:
        """Close an idle session for another one, or replace a reopened session."""
        if key in self._sessions or len(self._sessions) < MOST_SESSIONS:
            return
        oldest = min(self._sessions, key=lambda each: self._sessions[each].used)
        if now - self._sessions[oldest].used < IDLE:
            raise _Refused(_Error.NO_SESSIONS)
        del self._sessions[oldest]

    def _find(self, request: _Request) -> Content:
        content = self._files.open(request.path)
        if content is None:
            raise _Refused(_Error.FILE_NOT_FOUND)
        return content

    def _session(self, sender: Sender, request: _Request, now: float) -> _Session:
        session = self._sessions.get((sender, request.session))
        if session is None:
            raise _Refused(_Error.INVALID_SESSION)
        session.used = now
        return session

    def _read(self, request: _Request, sender: Sender, now: float) -> bytes:
        content = self._session(sender, request, now).content
        return _part(content, request.offset, request.size or ROOM)

    # --- transfers in parts

    def step(self, now: float) -> list[Output]:
        """Send the next part of every burst and checksum."""
        if not self._bursts and not self._checksums:
            return []
        outputs: list[Output] = []
        for sender, burst in tuple(self._bursts.items()):
            room = self._capacities[sender.link](BULK) / FRAME_BYTES - len(outputs)
            outputs += self._continue_download(
                sender, burst, now, int(min(max(room, 0.0), BURST_PER_STEP - len(outputs)))
            )
        for sender, checksum in tuple(self._checksums.items()):
            outputs += self._check(sender, checksum)
        return outputs

    def _continue_download(self, sender: Sender, burst: _Burst, now: float, most: int) -> list[Output]:
        outputs: list[Output] = []
        while most > len(outputs) and sender in self._bursts:
            outputs.append(self._next_part(sender, burst, now))
        return outputs

    def _next_part(self, sender: Sender, burst: _Burst, now: float) -> Reply:
        """Return the next message of a burst.

        The last one is marked; beyond the end of the file the answer is a NAK.
        """
        request = burst.request._replace(sequence=burst.sequence - 1, offset=burst.offset)
        try:
            content = self._session(sender, request, now).content
            data = _part(content, burst.offset, request.size or ROOM)
        except _Refused as refused:
            del self._bursts[sender]
            return _reply(request, sender, _Op.NAK, bytes([refused.error]))
        burst.offset += len(data)
        burst.sequence += 1
        burst.left -= 1
        last = burst.left == 0 or burst.offset >= content.size
        if last:
            del self._bursts[sender]
        return _reply(request, sender, _Op.ACK, data, last)

    def _check(self, sender: Sender, checksum: _Checksum) -> list[Output]:
        content = checksum.content
        left = content.size - checksum.offset
        try:
            data = content.read(checksum.offset, min(CHECKED_PER_STEP, left)) if left > 0 else b""
        except OSError:
            del self._checksums[sender]
            return [_reply(checksum.request, sender, _Op.NAK, bytes([_Error.FAIL]))]
        checksum.crc = zlib.crc32(data, checksum.crc)
        checksum.offset += len(data)
        if data and checksum.offset < content.size:
            return []
        del self._checksums[sender]
        return [_reply(checksum.request, sender, _Op.ACK, struct.pack("<I", checksum.crc ^ 0xFFFFFFFF))]


def _part(content: Content, offset: int, size: int) -> bytes:
    try:
        data = content.read(offset, min(size, ROOM)) if offset < content.size else b""
    except OSError:
        raise _Refused(_Error.FAIL) from None
    if not data:
        raise _Refused(_Error.END_OF_FILE)
    return data


def _read_request(payload: bytes) -> _Request:
    sequence, session, opcode, size, _, _, _, offset = _HEADER.unpack_from(payload)
    return _Request(sequence, session, opcode, size, offset, payload[_HEADER.size : _HEADER.size + size])


def _reply(request: _Request, sender: Sender, opcode: int, data: bytes, last: bool = False) -> Reply:
    sequence = (request.sequence + 1) & 0xFFFF
    header = _HEADER.pack(sequence, request.session, opcode, len(data), request.opcode, last, 0, request.offset)
    payload = (header + data).ljust(_PAYLOAD, b"\0")
    message = mavlink.MAVLink_file_transfer_protocol_message(0, sender.system, sender.component, list(payload))
    return Reply(message, sender)
