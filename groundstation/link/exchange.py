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
"""s; silence after which a request is repeated"""
ATTEMPTS = 12
"""requests without any answer before an exchange gives up: with 30 % lost each way, one in 3000 does so in vain"""
EXPLANATION = 0.3
"""s; a vehicle has to say why it refused"""
NOT_YET = 6.0
"""s; for which what a vehicle rejects for the moment is asked again"""
LONG_WAIT = 15.0
"""s; allowed to a vehicle that answered IN_PROGRESS"""

SYSTEM = 255
COMPONENT = 190


class Target(NamedTuple):
    """Whom an exchange talks to."""

    system: int = 1
    """-; MAVLink system id"""
    component: int = 1
    """-; MAVLink component id"""


def concerns(message: Any, target: Target) -> bool:
    """Whether a message is a part of our conversation with ``target``.

    It is when the target's autopilot said it, to us or to nobody in particular: others on the link talk to the same
    vehicle or are vehicles themselves. A message without an addressee, or with 0 for one, is for all.
    """
    sender = (message.get_srcSystem(), message.get_srcComponent())
    system, component = (getattr(message, f"target_{part}", 0) for part in ("system", "component"))
    return sender == target and system in (0, SYSTEM) and component in (0, COMPONENT)


class Progress(NamedTuple):
    """How far an exchange is."""

    done: int
    """-; parts received or sent"""
    total: int
    """-; parts altogether, 0 while unknown"""
    note: str = ""
    """-; for people, such as "got 43 of 120 parameters, retrying\""""


class Exchange(Protocol):
    """A conversation that ends by itself, well or with a ``failure``."""

    @property
    def failure(self) -> str:
        """Why it failed, one line; empty while it did not."""

    @property
    def finished(self) -> bool:
        """True once it ended, well or badly."""

    def progress(self) -> Progress:
        """How far it is."""

    def step(self, now: float, message: Any | None) -> tuple[Self, Outgoing]:
        """Take one message, or the passing of time; return the next value and what to send."""


class Timer(NamedTuple):
    """When the last request went out, and how many went without an answer."""

    sent_at: float = float("-inf")
    """s; monotonic"""
    attempts: int = 0
    """-; since the last answer"""

    def due(self, now: float, wait: float = RETRY) -> bool:
        """Whether it is time to ask (again)."""
        return now - self.sent_at >= wait

    def again(self, now: float) -> Timer:
        """After a request was sent."""
        return Timer(now, self.attempts + 1)

    def answered(self, now: float) -> Timer:
        """After an answer came: the next request waits its full time."""
        return Timer(now, 0)

    @property
    def spent(self) -> bool:
        """Whether all attempts are used."""
        return self.attempts >= ATTEMPTS


def explained(reason: str, message: Any) -> str:
    """Why the vehicle refuses, as far as it has said it: ``reason`` so far, and what one STATUSTEXT adds to it.

    What is no warning is no reason.
    """
    if message.severity > mavlink.MAV_SEVERITY_WARNING:
        return reason
    return (reason if message.chunk_seq else "") + chunk_of(message)


def chunk_of(message: Any) -> str:
    """The printable text of a STATUSTEXT that may be a part of a longer one, its spaces kept."""
    text = message.text if isinstance(message.text, str) else message.text.decode("utf-8", "replace")
    return "".join(letter if letter.isprintable() else " " for letter in text.partition("\0")[0])
