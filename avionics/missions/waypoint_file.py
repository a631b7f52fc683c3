"""``QGC WPL 110``: plain list of mission items, supported by all ground stations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.mission_codec import GLOBES, wire_scale
from avionics.link.vehicle import Home
from avionics.link.wire_item import WireItem
from wingbeat.errors import InputError
from wingbeat.text import read_error_text

HEADER = "QGC WPL 110"
COLUMNS = 12


class Line(NamedTuple):
    """Item of the list."""

    item: WireItem
    autocontinue: int = 1
    """-; 1 to continue with the next item"""


def read(path: Path) -> tuple[Line, ...]:
    """Read the items of a file.

    Raises:
        InputError: unreadable, not such a list, or a malformed line; the text gives its number.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read mission file {path}: {read_error_text(error)}") from None
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"]
    if not numbered or numbered[0][1].split() != HEADER.split():
        raise InputError(f"{path}: the first line of a mission file must be {HEADER!r}")
    del numbered[0]
    items = tuple(_line(f"{path}, line {number}", line.split()) for number, line in numbered)
    if not items:
        raise InputError(f"{path}: the mission has no items")
    return items


def _line(where: str, words: Sequence[str]) -> Line:
    if len(words) != COLUMNS:
        raise InputError(f"{where}: a mission item has {COLUMNS} columns, not {len(words)}")
    try:
        frame, command, autocontinue = int(words[2]), int(words[3]), int(words[11])
        numbers = [float(word) for word in words[4:11]]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not 0 <= frame <= 255 or not 0 <= command <= 65535 or not 0 <= autocontinue <= 1:
        raise InputError(f"{where}: frame, command or autocontinue out of range")
    x, y, z = numbers[4:7]
    scale = wire_scale(frame)
    if not all(math.isfinite(value) and abs(value * scale) < 2**31 for value in (x, y)):
        raise InputError(f"{where}: a coordinate is out of range")
    if not math.isfinite(z):
        raise InputError(f"{where}: the altitude must be a finite number")
    return Line(WireItem(frame, command, (numbers[0], numbers[1], numbers[2], numbers[3]), x, y, z), autocontinue)


def home_of(lines: Sequence[Line]) -> Home | None:
    """Return home if the list begins with it, as the lists of ArduPilot do.

    Home is a waypoint with its altitude above mean sea level. If it is zero, the first position of the list replaces
    it.
    """
    first = lines[0].item
    if (first.frame, first.command) != (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT):
        return None
    if (first.x, first.y) == (0.0, 0.0):
        placed = (line.item for line in lines[1:] if line.item.frame in GLOBES and (line.item.x or line.item.y))
        first = next(placed, first)._replace(z=first.z)
    return Home(math.radians(first.x), math.radians(first.y), first.z)


def without_home(lines: Sequence[Line]) -> tuple[Line, ...]:
    """Return the items after home, if the list begins with it.

    Jumps, which count home as number 0, are adapted.
    """
    if home_of(lines) is None:
        return tuple(lines)
    return tuple(line._replace(item=_one_earlier(line.item)) for line in lines[1:])


def _one_earlier(item: WireItem) -> WireItem:
    if item.command != mavlink.MAV_CMD_DO_JUMP:
        return item
    return item._replace(params=(item.params[0] - 1.0, *item.params[1:]))
