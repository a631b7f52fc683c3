"""Signal handling of commands: Ctrl-C, SIGTERM, SIGHUP.

A command that another has started as a part of its own ends with that one, whatever became of it: `follow_starter`.

Ctrl-C is a KeyboardInterrupt, and so are SIGTERM and SIGHUP: whatever finishes its file on Ctrl-C does so on them.
Python drops an exception raised in a callback from C. While a command's modules are imported, when nothing is open
yet, a signal therefore ends the program at once. While LLVM loads a kernel, which crashes without the answer of its
callback, the signal is sent again a little later.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

INTERRUPTED = 130
"""exit code after Ctrl-C: 128 plus the signal's number, as of every signal"""
WORDS = "stopped with "
"""text of the KeyboardInterrupt of a signal other than Ctrl-C"""
STARTED = "WINGBEAT_STARTED"
"""environment variable of a command whose standard input is kept open by its parent command"""
CALLBACKS = "llvmlite.binding.executionengine"
"""module with the callbacks of LLVM; numba loads kernels by it, from the cache or after it has compiled them"""
AGAIN = 0.01
"""s; until a signal that cannot be handled now is sent again"""
SIGNALS = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if name in signal.Signals.__members__)


class Ending:
    """Signal other than Ctrl-C that ended the command; later ones while files are finished have no effect."""

    def __init__(self) -> None:
        self.code: int | None = None
        """-; exit code of the received signal, None before"""

    def come(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal.

        Raises:
            KeyboardInterrupt: Ctrl-C, or the first other signal.
        """
        if _is_in_callback(frame):
            later = threading.Timer(AGAIN, _send, (number,))
            later.daemon = True
            later.start()
        elif number == signal.SIGINT:
            signal.default_int_handler(number, frame)
        elif self.code is None:
            self.code = 128 + number
            raise KeyboardInterrupt(f"{WORDS}{signal.Signals(number).name}")


@contextlib.contextmanager
def heeded() -> Iterator[Ending]:
    """Convert signals to KeyboardInterrupt; a signal that is ignored, as SIGHUP under ``nohup``, stays so.

    A child process of another command is ended by that command only. Its inherited ignored signals (a shell script
    starts jobs with SIGINT ignored) are not relevant.
    """
    ending = Ending()
    kept = {}
    part = STARTED in os.environ
    if _in_main_thread():
        kept = {number: signal.getsignal(number) for number in (signal.SIGINT, *SIGNALS)}
    for number, handler in kept.items():
        if part or handler in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, ending.come)
    if part and kept and hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, kept)
    try:
        yield ending
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Let a signal end the program at once during imports, when no file is open."""
    numbers = (signal.SIGINT, *SIGNALS) if _in_main_thread() else ()
    handlers = {number: handler for number in numbers if _raises_interrupt(handler := signal.getsignal(number))}
    for number in handlers:
        signal.signal(number, lambda number, frame: os._exit(128 + number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def follow_starter() -> None:
    """End as after SIGTERM when the parent command ends, which closes its end of the pipe."""
    if os.environ.pop(STARTED, ""):
        threading.Thread(target=_wait_for_starter, name="starter", daemon=True).start()


def _wait_for_starter() -> None:
    with contextlib.suppress(OSError):
        # Not by sys.stdin: its lock would be held when the interpreter shuts down.
        while os.read(0, 1024):
            pass
    os.kill(os.getpid(), signal.SIGTERM)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def _send(number: int) -> None:
    if sys.platform == "win32":
        signal.raise_signal(number)  # where os.kill ends the process
    else:
        os.kill(os.getpid(), number)  # which interrupts a system call of the main thread


def _raises_interrupt(handler: object) -> bool:
    return handler is signal.default_int_handler or isinstance(getattr(handler, "__self__", None), Ending)


def _is_in_callback(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_globals.get("__name__") == CALLBACKS:
            return True
        frame = frame.f_back
    return False
