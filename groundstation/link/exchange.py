"""Protocol of transactions with a vehicle: requests, retries, progress.

An exchange is a value. ``step(now, message)`` takes the time (s, monotonic) and one message, or None when only time
went by, and returns the next value and the messages to send. Nothing here owns a clock or a socket, so a test plays
a lossy vehicle against it in no time. The retry rules are those of the MAVLink services "Command", "Parameter" and
"Mission" protocols.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, Self

from avionics.link.dialect import mavlink

Outgoing = tuple[Any, ...]

RETRY = 0.7
"""s; response timeout after which a request is repeated"""
ATTEMPTS = 12
"""unanswered requests before an exchange fails: with 30 % loss in each direction, one in 3000 fails"""
EXPLANATION = 0.3
"""s; time for a vehicle to send the reason of a denial"""
NOT_YET = 6.0
"""s; time for which a temporarily rejected request is repeated"""
LONG_WAIT = 15.0
"""s; timeout for a vehicle that responded IN_PROGRESS"""

SYSTEM = 255
COMPONENT = 190


class Target(NamedTuple):
    """Target of an exchange."""

    system: int = 1
    """-; MAVLink system id"""
    component: int = 1
    """-; MAVLink component id"""


def concerns(message: Any, target: Target) -> bool:
    """Return whether a message belongs to the exchange with ``target``.

    It does if the target's autopilot sent it, to this ground station or to no particular one: other stations may use
    the same vehicle, and other vehicles the same link. A message without a target, or with target 0, is a broadcast.
    """
    sender = (message.get_srcSystem(), message.get_srcComponent())
    system, component = (getattr(message, f"target_{part}", 0) for part in ("system", "component"))
    return sender == target and system in (0, SYSTEM) and component in (0, COMPONENT)


class Progress(NamedTuple):
    """Progress of an exchange."""

    done: int
    """-; parts received or sent"""
    total: int
    """-; parts in total, 0 if unknown"""
    note: str = ""
    """-; for people, such as "got 43 of 120 parameters, retrying\""""


class Exchange(Protocol):
    """Protocol of an exchange with the vehicle, which ends by itself, with a ``failure`` if it failed."""

    @property
    def failure(self) -> str:
        """Reason of the failure, one line; empty without a failure."""

    @property
    def finished(self) -> bool:
        """Whether the exchange has ended."""

    def progress(self) -> Progress:
        """Return the progress."""

    def step(self, now: float, message: Any | None) -> tuple[Self, Outgoing]:
        """Process one message, or the passing of time; return the next state and the messages to send."""


class Timer(NamedTuple):
    """Time of the last request, and number of requests without a response."""

    sent_at: float = float("-inf")
    """s; monotonic"""
    attempts: int = 0
    """-; since the last response"""

    def due(self, now: float, wait: float = RETRY) -> bool:
        """Return whether a request is due."""
        return now - self.sent_at >= wait

    def again(self, now: float) -> Timer:
        """Return the timer after a request was sent."""
        return Timer(now, self.attempts + 1)

    def answered(self, now: float) -> Timer:
        """Return the timer after a response: the next request waits for the full timeout."""
        return Timer(now, 0)

    @property
    def spent(self) -> bool:
        """Return whether all attempts are used."""
        return self.attempts >= ATTEMPTS


def explained(reason: str, message: Any) -> str:
    """Return the reason of a denial: ``reason`` so far, extended by one STATUSTEXT.

    Only warnings and more severe messages are reasons.
    """
    if message.severity > mavlink.MAV_SEVERITY_WARNING:
        return reason
    return (reason if message.chunk_seq else "") + chunk_of(message)


def chunk_of(message: Any) -> str:
    """Return the printable text of a STATUSTEXT chunk, with its blanks."""
    text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else " " for letter in text.partition("\0")[0])
