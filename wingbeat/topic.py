"""The declaration of a topic: name, message, channel number and rates."""

from __future__ import annotations

from typing import Generic, NamedTuple, Protocol, TypeVar

T = TypeVar("T")


class Topic(NamedTuple, Generic[T]):
    """One stream of messages of type ``T``."""

    name: str
    """path in the log, ``/processor/name``"""
    message: type[T]
    """the NamedTuple it carries; `wingbeat.message.Event` and `Text` have no fixed layout"""
    channel: int
    """number in the log: below 1000 of the flight computer, from 1000 of the simulator, from 2000 for viewers"""
    rate: float
    """Hz; nominal, 0 for events"""
    telemetry_rate: float = 0.0
    """Hz; default on a ground link, 0 for never"""
    logged: bool = True
    deterministic: bool = True
    """the same seed and inputs give the same bytes"""


class Publish(Protocol):
    """Receiver of all messages of a flight; type checkers match each message with the type of its topic."""

    def __call__(self, topic: Topic[T], message: T, /) -> None:
        """Process one message."""
