"""Kinds of boards, by the prefix of their address."""

from __future__ import annotations

from typing import NamedTuple

from avionics.board.board import Surroundings
from avionics.board.hil import HilBoard
from avionics.board.razor import RazorBoard, parse_address
from avionics.link.urls import parse_url
from wingbeat.errors import InputError


class Kind(NamedTuple):
    """Form of an address."""

    form: str
    """syntax of the address"""
    help: str
    """description of the board"""


KINDS = (
    Kind("hil:tcp:HOST:PORT", "a simulated world, wingbeat sim"),
    Kind("hil:tcpin:HOST:PORT", "a simulated world that connects to here"),
    Kind("hil:unix:NAME", "a simulated world on the same computer (Linux)"),
    Kind("hil:serial:DEVICE,BAUD", "a microcontroller with sensors and servos, see docs/reference/serial_board.md"),
    Kind("razor:DEVICE[,BAUD[,OUTPUT]]", "a Razor 9DOF on a bench: 57600 baud, output oscb, osct, osrb, osrt or ox"),
)


def open_board(address: str, around: Surroundings) -> HilBoard | RazorBoard:
    """Open the board at ``address``, one of the forms in `KINDS`.

    Raises:
        InputError: none of them, or the device cannot be opened.
        BoardSilent: no answer.
    """
    check_address(address)
    if address.startswith("razor:"):
        return RazorBoard(address, around=around)
    return HilBoard(address, around=around)


def check_address(address: str) -> None:
    """Check an address without opening the board.

    Raises:
        InputError: not an address of a board.
    """
    kind, _, rest = address.partition(":")
    if kind == "razor":
        parse_address(address)
    elif kind == "hil" and rest.partition(":")[0] in ("tcp", "tcpin", "unix", "serial"):
        parse_url(rest, lockstep=True)
    else:
        raise InputError(f"board {address!r} is not one of {', '.join(one.form for one in KINDS)}")
