"""Text for users: plural forms, suggestions for misspelled names, reasons why a file cannot be read."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

SIMILARITY = 0.65
"""-; least similarity of a suggestion, as `difflib.SequenceMatcher.ratio`: fyl and fly have 0.67"""


def pluralize(number: float, noun: str) -> str:
    """Return the number with its noun: 1 item, 2 items."""
    return f"{number:.12g} {noun}" + ("" if number == 1 else "s")


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return `` (meant 'x'?)`` with the known name most similar to ``name``; empty if none is similar."""
    near = difflib.get_close_matches(name, list(known), 1, SIMILARITY)
    return f" (meant {near[0]!r}?)" if near and near[0] != name else ""


def read_error_text(error: OSError | UnicodeDecodeError) -> str:
    """Return why a file cannot be read as text."""
    if isinstance(error, UnicodeDecodeError):
        return "it is no text in UTF-8"
    return "there is no such file" if isinstance(error, FileNotFoundError) else (error.strerror or str(error))
