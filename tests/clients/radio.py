"""A pair of pseudo-terminals that stands for a pair of serial radios."""

from __future__ import annotations

import math
import os
import pty
import select
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import NamedTuple

BUFFER = 16384
"""-; bytes that a radio keeps for a reader who is slow; what comes beyond them is lost"""


TURN = 0.005
"""s; between two looks of a relay that holds something back"""


class Way:
    """One direction: no faster than ``rate`` (bytes/s), and what its ``buffer`` (bytes) does not hold is lost."""

    def __init__(self, rate: float, buffer: int) -> None:
        self.arrived: list[tuple[float, int]] = []
        """when (s) how many bytes were given to it"""
        self.dropped = 0
        """bytes lost"""
        self.fullest = 0
        """bytes; most that ever waited"""
        self._rate, self._buffer = rate, buffer
        self._waiting = bytearray()
        self._allowance = 0.0
        self._counted_at = 0.0

    def take(self, data: bytes, now: float) -> None:
        """Bytes to carry, at ``now`` (s)."""
        self.arrived.append((now, len(data)))
        if not self._waiting:
            self._counted_at, self._allowance = now, 0.0
        self._waiting += data
        self.dropped += max(len(self._waiting) - self._buffer, 0)
        del self._waiting[self._buffer :]
        self.fullest = max(self.fullest, len(self._waiting))

    def due(self, now: float) -> bytes:
        """What may go on at ``now`` (s); a rate that was not used is not saved up."""
        if math.isinf(self._rate):
            return bytes(self._waiting)
        self._allowance = min(self._allowance + (now - self._counted_at) * self._rate, len(self._waiting))
        self._counted_at = now
        return bytes(self._waiting[: int(self._allowance)])

    def disconnected(self, count: int) -> None:
        """So many bytes went on."""
        del self._waiting[:count]
        self._allowance = max(self._allowance - count, 0.0)

    def __len__(self) -> int:
        return len(self._waiting)


class Radio(NamedTuple):
    """The devices of both ends, and what is between them."""

    vehicle: str
    ground: str
    down: Way
    """from the vehicle to the ground"""
    up: Way


@contextmanager
def radio(rate: float = math.inf, buffer: int = BUFFER) -> Iterator[Radio]:
    """Two serial devices; what is written to one is read from the other, ``rate`` bytes/s each way."""
    with ExitStack() as stack:
        ends = [_open_end(stack) for _ in range(2)]
        down, up = Way(rate, buffer), Way(rate, buffer)
        wake, stop = os.pipe()
        stack.callback(os.close, wake)
        ways = {ends[0].air: (ends[1].air, down), ends[1].air: (ends[0].air, up)}
        relay = threading.Thread(target=_relay, args=(ways, wake))
        relay.start()
        stack.callback(relay.join)
        stack.callback(os.close, stop)
        yield Radio(ends[0].device, ends[1].device, down, up)


class _End(NamedTuple):
    air: int
    device: str


def _open_end(stack: ExitStack) -> _End:
    """A device that stays open, so that nothing is lost before and between its users."""
    air, serial = pty.openpty()
    stack.callback(os.close, air)
    stack.callback(os.close, serial)
    tty.setraw(serial)
    os.set_blocking(air, False)
    return _End(air, os.ttyname(serial))


def _relay(ways: dict[int, tuple[int, Way]], wake: int) -> None:
    """Carry bytes both ways until ``wake`` is closed on its other end."""
    while True:
        holding, before = any(len(way) for _, way in ways.values()), time.monotonic()
        readable, _, _ = select.select([*ways, wake], [], [], TURN if holding else None)
        if wake in readable:
            return
        now = time.monotonic()
        for end, (other, way) in ways.items():
            data = os.read(end, 4096) if end in readable else b""
            for at, piece in _spread(data, before if holding else now, now):
                if piece:
                    way.take(piece, at)
                with suppress(BlockingIOError):
                    way.disconnected(os.write(other, way.due(at)))


def _spread(data: bytes, since: float, now: float) -> Iterator[tuple[float, bytes]]:
    """What is found at ``now``, as it came since then (both s): who waited for a core finds much of it at once."""
    turns = max(math.ceil((now - since) / TURN), 1)
    size = math.ceil(len(data) / turns)
    for turn in range(turns):
        yield since + (now - since) * (turn + 1) / turns, data[turn * size : (turn + 1) * size]
