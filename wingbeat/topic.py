"""The declaration of a topic: name, message, channel number and rates."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple


class Topic(NamedTuple):
    """One stream of messages."""

    name: str
    """path in the log, ``/processor/what``"""
    message: type[Any]
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


Publish = Callable[[Topic, Any], None]
"""takes every message of a flight with its topic"""
