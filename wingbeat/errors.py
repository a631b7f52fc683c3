"""Exceptions of all packages."""

from __future__ import annotations


class InputError(ValueError):
    """User input that cannot be used; the text is one line for the terminal."""


class DocumentError(ValueError):
    """Text that is not a document of its format; the message is one line without the file name."""
