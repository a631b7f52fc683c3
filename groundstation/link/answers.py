"""What a conversation with a vehicle can end with besides success; a leaf, so that catching it costs nothing."""


class NoAnswer(RuntimeError):
    """The vehicle refused, or did not answer in time; the text is one line for the user."""


class LinkSilent(NoAnswer):
    """Nobody speaks on the link: its address is as wrong as any other bad input."""
