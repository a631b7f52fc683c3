"""Child processes of a flight: start, supervision, common end."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import IO, NamedTuple, Self

from groundstation.command.ending import STARTED

GRACE = 8.0
"""s; timeout for a child to close its recording after the stop request"""
ENDING = 10.0
"""s; timeout for the others to end after one child has ended successfully"""


class Child(NamedTuple):
    """Child process with the file of its stderr."""

    name: str
    process: subprocess.Popen[bytes]
    error_lines: IO[bytes]

    def final_error(self) -> str:
        """Last line on stderr, without the command's name."""
        self.error_lines.seek(0)
        lines = self.error_lines.read().decode("utf-8", "replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return said[-1].removeprefix("wingbeat: ") if said else ""


class Failure(NamedTuple):
    """Failure of a child process."""

    code: int
    """-; exit code, negative for a signal"""
    text: str
    """-; one line"""


class Children:
    """Child processes that run subcommands of ``wingbeat``; as a context manager it ends all of them."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._children: list[Child] = []
        self._clock = clock
        self._first_end: float | None = None

    def start(self, name: str, arguments: Sequence[str]) -> None:
        """Start ``wingbeat ARGUMENTS`` in its own session, so that only this process receives Ctrl-C.

        The child ends with this process, even after SIGKILL: see `ending.follow_starter`.
        """
        command = [sys.executable, "-m", "groundstation.command.main", *arguments]
        error_lines = tempfile.TemporaryFile()  # noqa: SIM115 (lives as long as the child)
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=error_lines,
            env=os.environ | {STARTED: "1"},
            start_new_session=True,
        )
        self._children.append(Child(name, process, error_lines))

    def running(self) -> bool:
        """Whether the flight continues: all children are alive, or the last one is closing its recording."""
        codes = [child.process.poll() for child in self._children]
        ended = [code for code in codes if code is not None]
        if any(ended) or len(ended) == len(codes):
            return False
        if ended and self._first_end is None:
            self._first_end = self._clock()
        return self._first_end is None or self._clock() - self._first_end < ENDING

    def failure(self) -> Failure | None:
        """First child, in the order of their start, that failed."""
        for child in self._children:
            code = child.process.poll()
            if code:
                return Failure(code, f"{child.name} {_ending(child, code)}")
        return None

    def last_words(self) -> list[str]:
        """Last output line of each child that succeeded, if any."""
        ended = [child.final_error() for child in self._children if child.process.poll() == 0]
        return [line for line in ended if line]

    def stop(self) -> None:
        """Request all children to close their recordings and end; kill those that do not."""
        for child in self._children:
            with contextlib.suppress(ProcessLookupError):
                child.process.send_signal(signal.SIGINT)
        deadline = self._clock() + GRACE
        for child in self._children:
            try:
                child.process.wait(max(deadline - self._clock(), 0.1))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()
        for child in self._children:
            child.error_lines.close()
            assert child.process.stdin is not None
            child.process.stdin.close()


def _ending(child: Child, code: int) -> str:
    if code < 0:
        return f"was ended by signal {signal.Signals(-code).name}"
    return f"stopped: {child.final_error() or f'exit code {code}'}"
