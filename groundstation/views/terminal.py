"""The console that everything is printed on."""

from __future__ import annotations

from typing import NoReturn

from rich.console import Console

UNBOUNDED = 160
"""characters; of a line where there is no terminal to fit it to"""


class QuietConsole(Console):
    """A console that leaves a reader who went away to the command, which ends quietly."""

    def on_broken_pipe(self) -> NoReturn:
        """Nobody reads any more."""
        raise BrokenPipeError


def open_console(quiet: bool = False) -> Console:
    """A console on stdout: as wide as the terminal, wide enough for every table where there is none."""
    console = QuietConsole(quiet=quiet, highlight=False)
    if not console.is_terminal:
        console.width = UNBOUNDED
    return console
