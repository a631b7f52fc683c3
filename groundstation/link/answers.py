"""Exceptions of failed transactions; a leaf module."""


class NoAnswer(RuntimeError):
    """The vehicle refused, or did not answer in time; the text is one line for the user."""


class LinkSilent(NoAnswer):
    """Nobody speaks on the link: its address is as wrong as any other bad input."""
