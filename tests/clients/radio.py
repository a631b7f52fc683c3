"""A pair of pseudo-terminals that stands for a pair of serial radios."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import NamedTuple

BUFFER = 16384
"""-; bytes that a radio keeps for a reader who is slow; what comes beyond them is lost"""


class Radio(NamedTuple):
    """The devices of both ends."""

    vehicle: str
    ground: str


@contextmanager
def radio() -> Iterator[Radio]:
    """Two serial devices; what is written to one is read from the other."""
    with ExitStack() as stack:
        ends = [_open_end(stack) for _ in range(2)]
        wake, stop = os.pipe()
        stack.callback(os.close, wake)
        relay = threading.Thread(target=_relay, args=(ends[0].air, ends[1].air, wake))
        relay.start()
        stack.callback(relay.join)
        stack.callback(os.close, stop)
        yield Radio(ends[0].device, ends[1].device)


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


def _relay(one: int, other: int, wake: int) -> None:
    """Carry bytes both ways until ``wake`` is closed on its other end."""
    to, kept = {one: other, other: one}, {one: bytearray(), other: bytearray()}
    while True:
        waiting = [end for end in kept if kept[end]]
        readable, writable, _ = select.select([one, other, wake], waiting, [])
        if wake in readable:
            return
        for end in readable:
            kept[to[end]] += os.read(end, 4096)
            del kept[to[end]][BUFFER:]
        for end in writable:
            with suppress(BlockingIOError):
                del kept[end][: os.write(end, kept[end])]
