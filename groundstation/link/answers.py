"""Exceptions of failed transactions; a leaf module."""


class NoAnswer(RuntimeError):
    """Error: the vehicle denied a request or the request timed out; the text is one line for the user."""


class LinkSilent(NoAnswer):
    """Error: no data are received on the link; handled like an invalid address."""
