"""Delay of Ctrl-C during a few statements that must not be divided."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

SIGNALS = tuple(
    signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__
)
"""those of which commands make a KeyboardInterrupt"""


class DelayedInterruption:
    """Context manager: a handler of Ctrl-C, SIGTERM or SIGHUP is called at the end of the block, not within it.

    A signal without a handler in Python is not affected. Python calls its handlers in the main thread only, so in
    other threads there is nothing to delay.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._received: list[tuple[int, FrameType | None]] = []

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            try:
                for number in SIGNALS:
                    handler = signal.getsignal(number)
                    if callable(handler):
                        self._handlers[number] = handler
                        signal.signal(number, lambda *received: self._received.append(received))
            except BaseException:
                self._restore()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._restore()
        finally:  # a signal that is received meanwhile interrupts it
            self._restore()
        for number, frame in self._received:
            self._handlers[number](number, frame)

    def _restore(self) -> None:
        for number, handler in reversed(self._handlers.items()):
            signal.signal(number, handler)
