"""MAVLink command requests and their results (COMMAND_ACK)."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.services.service import Output, Sender
from avionics.link.vehicle import NO_FRAMES


class Request(NamedTuple):
    """Command of COMMAND_LONG or COMMAND_INT."""

    command: int
    params: tuple[float, ...]
    """seven numbers; the fifth and sixth of a COMMAND_INT are its integers unchanged"""
    sender: Sender
    frame: int = 0
    """MAV_FRAME of a COMMAND_INT"""
    is_int: bool = False


class CommandResult(NamedTuple):
    """Result of a command."""

    result: int
    outputs: tuple[Output, ...] = ()
    reason: str = ""


def refused(reason: str) -> CommandResult:
    """Return the result of a denied command.

    The denial is temporary while the flight core does not tick.
    """
    return CommandResult(refusal_result(reason), (), reason)


def refusal_result(reason: str) -> int:
    """Return the MAV_RESULT of a command that the flight core denies for ``reason``."""
    later = reason == NO_FRAMES
    return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED if later else mavlink.MAV_RESULT_DENIED)
