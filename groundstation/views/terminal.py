"""The console of all output."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from typing import NoReturn, TextIO, cast

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.segment import Segment
from rich.text import Text

from groundstation.views.printable import CONTROLS, printable, unfiltered

UNBOUNDED = 160
"""characters; line width without a terminal"""


def plain_text(text: str) -> Text:
    """Return `printable` text without markup interpretation, for widgets that interpret markup."""
    return Text(printable(text), end="")


class Printable:
    """Rich renderable with text filtered by `printable`, for other consoles (Textual's)."""

    def __init__(self, renderable: RenderableType) -> None:
        self._renderable = renderable

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from _printable_segments(console.render(self._renderable, options))


def _printable_segments(segments: Iterable[Segment]) -> Iterator[Segment]:
    for segment in segments:
        if segment.control or not CONTROLS.search(segment.text):
            yield segment
        else:
            yield Segment(printable(segment.text), segment.style)


class PrintableConsole(Console):
    """Console that prints no control characters of texts and interprets no markup in them."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render to segments of printable text."""
        return _printable_segments(super().render(renderable, options))

    def on_broken_pipe(self) -> NoReturn:
        """Leave a closed output to the command, which ends without a message."""
        raise BrokenPipeError


class Stripped:
    """Standard output without trailing blanks on its lines."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write complete lines; return the number of requested characters."""
        self._stream.write(re.sub(r" +$", "", text, flags=re.MULTILINE))
        return len(text)

    def flush(self) -> None:
        """Flush standard output."""
        self._stream.flush()

    @property
    def encoding(self) -> str:
        """Encoding of standard output."""
        return self._stream.encoding


def open_console(quiet: bool = False, stderr: bool = False) -> Console:
    """Open a console on stdout or stderr in the width of the terminal, or without limit if there is none."""
    stream = unfiltered(sys.stderr if stderr else sys.stdout)
    console = PrintableConsole(file=stream, quiet=quiet, highlight=False, markup=False, emoji=False)
    if console.is_terminal or stderr:
        return console
    stripped = cast("TextIO", Stripped(stream))
    return PrintableConsole(file=stripped, quiet=quiet, highlight=False, markup=False, emoji=False, width=UNBOUNDED)
