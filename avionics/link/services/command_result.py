"""A command as it was asked, and what became of it."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Sender
from avionics.link.vehicle import NO_FRAMES


class Request(NamedTuple):
    """A command of either form."""

    command: int
    params: tuple[float, ...]
    """seven numbers; the fifth and sixth of a COMMAND_INT are its integers as they are"""
    sender: Sender
    frame: int = 0
    """MAV_FRAME of a COMMAND_INT"""
    is_int: bool = False


class CommandResult(NamedTuple):
    """What became of a command."""

    result: int
    outputs: tuple[Output, ...] = ()
    reason: str = ""


def refused(reason: str) -> CommandResult:
    """The flight core would not take it; while it does not tick, not yet."""
    return CommandResult(refusal_result(reason), (), reason)


def refusal_result(reason: str) -> int:
    """MAV_RESULT of a command that the flight core would refuse for ``reason``."""
    later = reason == NO_FRAMES
    return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED if later else mavlink.MAV_RESULT_DENIED)
