"""RADIO_STATUS: how full a telemetry radio's buffer is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avionics.link.services.service import Output, Sender

NoteRadio = Callable[[int, int, float], None]


class RadioService:
    """Tells the link's budget what the radio says of it."""

    takes = frozenset({"RADIO_STATUS"})

    def __init__(self, note: NoteRadio) -> None:
        """``note`` is given the number of the link, the percentage of the buffer that is free, and the time."""
        self._note = note

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Take the state of the buffer; a radio has no answer."""
        self._note(sender.link, message.txbuf, now)
        return []

    def step(self, now: float) -> list[Output]:
        """Nothing is due without having been asked."""
        return []
