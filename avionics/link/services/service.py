"""What a MAVLink service is: it takes messages and the time, and gives messages and inputs for the flight core."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from avionics.link.transport import Peer
from avionics.messages import Input


class Sender(NamedTuple):
    """Who sent a message."""

    system: int
    component: int
    link: int
    """number of the link"""
    peer: Peer
    """address on that link"""
    name: str = ""
    """the link's name, for the log"""


class Reply(NamedTuple):
    """A message to send: to one sender, or to everyone on every link."""

    message: Any
    to: Sender | None = None


Output = Reply | Input


class Service(Protocol):
    """One of MAVLink's services."""

    takes: frozenset[str]
    """names of the messages it takes"""

    def receive(self, message: Any, sender: Sender, now: float) -> list[Output]:
        """Answer a message; ``now`` is wall-clock time in s."""

    def step(self, now: float) -> list[Output]:
        """What is due without having been asked."""
