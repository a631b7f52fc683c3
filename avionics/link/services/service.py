"""Interface of a MAVLink service.

A service receives messages and the time, and returns messages and inputs for the flight core.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from avionics.link.transport import Peer
from avionics.messages import Input


class Sender(NamedTuple):
    """Sender of a message."""

    system: int
    component: int
    link: int
    """index of the link"""
    peer: Peer
    """address on that link"""
    name: str = ""
    """name of the link, for the log"""


class Reply(NamedTuple):
    """Message to one sender, or to all stations on every link."""

    message: Any
    to: Sender | None = None


Output = Reply | Input


class Service(Protocol):
    """MAVLink service."""

    takes: frozenset[str]
    """names of the processed messages"""

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Process a message; ``now`` (s) is the wall-clock time."""

    def step(self, now: float) -> list[Output]:
        """Return the periodic messages that are due."""
