"""The filter between foreign text (files, links) and the terminal: no control character passes it."""

from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, TextIO, cast

_REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
_BIDIRECTIONAL = (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
CONTROLS = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\ud800-\udfff" + "".join(map(chr, _BIDIRECTIONAL)) + "]",
)
"""what `printable` replaces"""


def printable(text: str) -> str:
    """Replace every character that a terminal interprets or cannot encode, except line feeds.

    Tabs become blanks. C0 controls and DEL become their control pictures (ESC is U+241B). C1 controls, bidirectional
    controls and surrogates (undecodable bytes of file names) become U+FFFD.
    """
    return CONTROLS.sub(_symbol, text)


def _symbol(match: re.Match[str]) -> str:
    code = ord(match[0])
    if code == 0x09:
        return " "
    if code < 0x20:
        return chr(0x2400 + code)
    return "\N{SYMBOL FOR DELETE}" if code == 0x7F else _REPLACEMENT


class PrintableStream:
    """A text stream that writes `printable` text to another stream; ``unfiltered`` is that stream."""

    def __init__(self, unfiltered: TextIO) -> None:
        self.unfiltered = unfiltered

    def write(self, text: str) -> int:
        """Write text; return the number of characters accepted."""
        self.unfiltered.write(printable(text))
        return len(text)

    def writelines(self, lines: Iterable[str]) -> None:
        """Write several strings."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.unfiltered, name)


@contextlib.contextmanager
def printable_streams() -> Iterator[None]:
    """Filter stdout and stderr through `printable` while the block runs."""
    streams = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (cast("Any", PrintableStream(stream)) for stream in streams)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = streams


def unfiltered(stream: TextIO) -> TextIO:
    """Return the stream behind a `PrintableStream`, for output with control sequences of Wingbeat."""
    return getattr(stream, "unfiltered", stream)
