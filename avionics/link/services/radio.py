"""RADIO_STATUS: free buffer of a telemetry radio."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avionics.link.services.service import Output, Sender

NoteRadio = Callable[[int, int, float], None]


class RadioService:
    """Adaptation of the link budget to RADIO_STATUS."""

    takes = frozenset({"RADIO_STATUS"})

    def __init__(self, note: NoteRadio) -> None:
        """Create the service.

        ``note`` receives the index of the link, the free buffer in percent, and the time.
        """
        self._note = note

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process the buffer state; there is no answer."""
        self._note(sender.link, message.txbuf, now)
        return []

    def step(self, now: float) -> list[Output]:
        """Return no periodic messages."""
        return []
