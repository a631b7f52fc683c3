"""Mission files of the ground: the plain-text ``QGC WPL 110`` list that every ground station reads and writes.

Wingbeat's own missions (TOML, metres from home) are read too, and sent in the local frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from avionics.link.mission_codec import encode_item
from avionics.missions import load_mission
from avionics.quantities import BadInput
from groundstation.link.client import Item

HEADER = "QGC WPL 110"
LOCAL_FRAMES = frozenset((1, 4, 7, 8, 9, 12, 20, 21))
"""MAV_FRAMEs whose x and y are metres, sent in 1e-4 m; the others are degrees, sent in 1e-7 deg"""
MISSION_FRAME = 2
"""MAV_FRAME_MISSION: x and y are whatever the command says, sent as they are"""


def scale_of(frame: int) -> float:
    """How many wire units x and y make of one unit in a file."""
    if frame == MISSION_FRAME:
        return 1.0
    return 1e4 if frame in LOCAL_FRAMES else 1e7


def read(path: Path) -> tuple[Item, ...]:
    """Read a mission file.

    Raises:
        BadInput: unreadable, not such a list, or a line that is malformed; the text gives its number.
    """
    if path.suffix == ".toml" or not path.suffix:
        return _own_mission(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot read mission file {path}: {error}") from None
    if not lines or lines[0].strip() != HEADER:
        raise BadInput(f"{path}: the first line of a mission file must be {HEADER!r}")
    numbered = [(number, line) for number, line in enumerate(lines[1:], 2) if line.strip()]
    items = tuple(_item(path, number, line.split()) for number, line in numbered)
    if not items:
        raise BadInput(f"{path}: the mission has no items")
    return items


def _own_mission(path: Path) -> tuple[Item, ...]:
    wire = [encode_item(item, None) for item in load_mission(path)]
    return tuple(
        Item(
            item.frame,
            item.command,
            item.params,
            round(item.x * scale_of(item.frame)),
            round(item.y * scale_of(item.frame)),
            item.z,
        )
        for item in wire
    )


def _item(path: Path, line: int, words: Sequence[str]) -> Item:
    if len(words) != 12:
        raise BadInput(f"{path}, line {line}: a mission item has 12 columns, not {len(words)}")
    try:
        frame, command, autocontinue = int(words[2]), int(words[3]), int(words[11])
        numbers = [float(word) for word in words[4:11]]
    except ValueError as error:
        raise BadInput(f"{path}, line {line}: {error}") from None
    if not 0 <= frame <= 255 or not 0 <= command <= 65535 or not 0 <= autocontinue <= 1:
        raise BadInput(f"{path}, line {line}: frame, command or autocontinue out of range")
    places = [_wire(path, line, value * scale_of(frame)) for value in numbers[4:6]]
    if not math.isfinite(numbers[6]):
        raise BadInput(f"{path}, line {line}: the altitude must be a finite number")
    parameters = (numbers[0], numbers[1], numbers[2], numbers[3])
    return Item(frame, command, parameters, places[0], places[1], numbers[6], autocontinue)


def _wire(path: Path, line: int, value: float) -> int:
    if not math.isfinite(value) or abs(value) >= 2**31:
        raise BadInput(f"{path}, line {line}: a coordinate is out of range")
    return round(value)


def write(path: Path, items: Sequence[Item]) -> None:
    """Write a mission to a new file.

    Raises:
        BadInput: the file exists, or cannot be written.
    """
    lines = [HEADER, *(_line(number, item) for number, item in enumerate(items))]
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror}") from None


def _line(number: int, item: Item) -> str:
    scale = scale_of(item.frame)
    places = (f"{item.x / scale:.4f}", f"{item.y / scale:.4f}") if scale == 1e4 else _degrees(item, scale)
    parameters = (f"{value:.8g}" for value in item.parameters)
    columns = (number, int(number == 0), item.frame, item.command, *parameters, *places, f"{item.z:.8g}")
    return "\t".join(str(column) for column in (*columns, item.autocontinue))


def _degrees(item: Item, scale: float) -> tuple[str, str]:
    return f"{item.x / scale:.7f}", f"{item.y / scale:.7f}"
