"""A command as it was asked, and what became of it."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.services.service import Output, Sender


class Request(NamedTuple):
    """A command of either form."""

    command: int
    params: tuple[float, ...]
    """seven numbers; the fifth and sixth of a COMMAND_INT are its integers as they are"""
    sender: Sender
    frame: int = 0
    """MAV_FRAME of a COMMAND_INT"""
    is_int: bool = False


class Verdict(NamedTuple):
    """What became of a command."""

    result: int
    outputs: tuple[Output, ...] = ()
    reason: str = ""
