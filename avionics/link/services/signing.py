"""SETUP_SIGNING: set or remove the key; the answer is a STATUSTEXT.

A key is accepted only while disarmed, only if the message addresses this vehicle, and only over a private link: a
serial line or this computer. Once a key is set, the links accept only frames signed with it, so that only its owner
can change it. The key is neither logged nor reported.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Reply, Sender
from avionics.link.services.statustext import refusal_text
from avionics.link.signing import Finding, Signing
from avionics.link.telemetry import boot_ms
from avionics.link.vehicle import VehicleView

Confidential = Callable[[Sender], bool]
TELL_EVERY = 5.0
"""s; interval of the reports of rejected frames"""
COUNTERS = {
    Finding.UNSIGNED: b"sig_unsign",
    Finding.FORGED: b"sig_forged",
    Finding.REPLAYED: b"sig_replay",
    Finding.AHEAD: b"sig_ahead",
}


class SigningService:
    """Service for SETUP_SIGNING."""

    takes = frozenset({"SETUP_SIGNING"})

    def __init__(self, vehicle: VehicleView, signing: Signing, confidential: Confidential) -> None:
        """Create the service.

        ``confidential`` returns whether the link to a sender is private.
        """
        self._vehicle = vehicle
        self._signing = signing
        self._confidential = confidential
        self._due = -float("inf")

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Set the key, or return the reason of a denial."""
        reason = self._refusal(message, sender)
        return list(refusal_text(reason or self._take(message), sender))

    def _refusal(self, message: Any, sender: Sender) -> str:
        if message.target_system == 0:
            return "signing: the key must be sent to one vehicle"
        if self._vehicle.armed:
            return "signing: armed"
        if not self._confidential(sender):
            return "signing: a key is taken by wire or from this computer, or with --signing-key"
        late = self._signing.too_far_ahead(message.initial_timestamp)
        return "signing: the time stamp is too late" if late else ""

    def _take(self, message: Any) -> str:
        key = bytes(message.secret_key)
        try:
            self._signing.set_key(key if any(key) else None, message.initial_timestamp)
        except OSError as error:
            return f"signing: the key cannot be kept: {error.strerror}"
        if not self._signing.active:
            return "signing: off, unsigned frames count"
        return "signing: on" if self._signing.kept else "signing: on, until the next start"

    def step(self, now: float) -> list[Output]:
        """Report the rejected frames periodically as NAMED_VALUE_INT while a key is set."""
        if not self._signing.active or now < self._due:
            return []
        self._due = now + TELL_EVERY
        time_ms = boot_ms(self._vehicle.time_us)
        refused = self._signing.refused
        return [
            Reply(mavlink.MAVLink_named_value_int_message(time_ms, name, refused[finding]))
            for finding, name in COUNTERS.items()
        ]
