"""The console that everything is printed on."""

from __future__ import annotations

import re
import sys
from typing import IO, NoReturn, cast

from rich.console import Console

UNBOUNDED = 160
"""characters; of a line where there is no terminal to fit it to"""


class QuietConsole(Console):
    """A console that leaves a reader who went away to the command, which ends quietly."""

    def on_broken_pipe(self) -> NoReturn:
        """Nobody reads any more."""
        raise BrokenPipeError


class Stripped:
    """Standard output, on whose lines no blanks trail."""

    def write(self, text: str) -> int:
        """Whole lines, as the console writes them; the number of characters that were asked for."""
        sys.stdout.write(re.sub(r" +$", "", text, flags=re.MULTILINE))
        return len(text)

    def flush(self) -> None:
        """On to the reader."""
        sys.stdout.flush()

    @property
    def encoding(self) -> str:
        """Of standard output."""
        return sys.stdout.encoding


def open_console(quiet: bool = False) -> Console:
    """A console on stdout: as wide as the terminal, wide enough for every table where there is none."""
    console = QuietConsole(quiet=quiet, highlight=False)
    if console.is_terminal:
        return console
    return QuietConsole(file=cast("IO[str]", Stripped()), quiet=quiet, highlight=False, width=UNBOUNDED)
