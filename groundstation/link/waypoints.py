"""Mission files of the ground: the plain ``QGC WPL 110`` list, QGroundControl's ``.plan``, and our own TOML.

Our own missions are metres from home, and are sent in the local frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from avionics.link.mission_codec import encode_fence, encode_item, encode_rally, wire_scale
from avionics.link.vehicle import Home
from avionics.link.wire_item import WireItem
from avionics.missions import load_plan, plan_file, waypoint_file
from avionics.missions.waypoint_file import HEADER
from avionics.quantities import BadInput
from groundstation.link.missions import Item


class Upload(NamedTuple):
    """What of a file is sent to a vehicle."""

    mission: tuple[Item, ...]
    fence: tuple[Item, ...] = ()
    rally: tuple[Item, ...] = ()
    notes: tuple[str, ...] = ()
    """-; what of the file is not sent, for people"""


def read(path: Path) -> tuple[Item, ...]:
    """The mission of a file as it stands in it, for whatever vehicle.

    Raises:
        BadInput: as of `read_upload`.
    """
    return read_upload(path, ours=False).mission


def read_upload(path: Path, ours: bool) -> Upload:
    """Mission, fence and rally points of a file; ``ours`` leaves out what our own flight computer has no use for.

    That is a camera's commands, and the home that a plain list begins with.

    Raises:
        BadInput: unreadable, not such a list or plan, or a part that is malformed; the text says which.
    """
    if path.suffix == ".toml" or not path.suffix:
        return _own_mission(path)
    if path.suffix == ".plan":
        return _planned(path, ours)
    lines = waypoint_file.read(path)
    sent = waypoint_file.without_home(lines) if ours else lines
    notes = (f"the first line of {path.name} is home: it is not sent",) if len(sent) < len(lines) else ()
    return Upload(tuple(item_of(line.item, line.autocontinue) for line in sent), notes=notes)


def _planned(path: Path, ours: bool) -> Upload:
    file = plan_file.read(path)
    mission, note = plan_file.without_cameras(file.mission) if ours else (file.mission, "")
    items = tuple(item_of(planned.item) for planned in plan_file.numbered(mission))
    fence, rally = (tuple(map(item_of, part)) for part in (file.fence, file.rally))
    return Upload(items, fence, rally, (note,) if note else ())


def _own_mission(path: Path) -> Upload:
    plan = load_plan(path)
    return Upload(
        tuple(item_of(encode_item(item, None)) for item in plan.mission),
        tuple(map(item_of, encode_fence(plan.fence, None))),
        tuple(map(item_of, encode_rally(plan.rally, None))),
    )


def item_of(item: WireItem, autocontinue: int = 1) -> Item:
    """As MISSION_ITEM_INT carries it."""
    scale = wire_scale(item.frame)
    x, y = (0.0 if math.isnan(value) else value for value in (item.x, item.y))
    return Item(item.frame, item.command, item.params, round(x * scale), round(y * scale), item.z, autocontinue)


def wire_item(item: Item) -> WireItem:
    """The other way round."""
    scale = wire_scale(item.frame)
    return WireItem(item.frame, item.command, item.parameters, item.x / scale, item.y / scale, item.z)


def write_plan(path: Path, content: Upload, home: Home) -> None:
    """Write a mission with its fence and rally points to a new ``.plan`` file.

    Raises:
        BadInput: the file exists, or cannot be written.
    """
    mission = [plan_file.PlannedItem(wire_item(item), f"item {n}", n) for n, item in enumerate(content.mission, 1)]
    fence, rally = (tuple(map(wire_item, part)) for part in (content.fence, content.rally))
    plan_file.write(path, plan_file.PlanFile(home, tuple(mission), fence, rally))


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
    scale = wire_scale(item.frame)
    places = (f"{item.x / scale:.4f}", f"{item.y / scale:.4f}") if scale == 1e4 else _degrees(item, scale)
    parameters = (f"{value:.8g}" for value in item.parameters)
    columns = (number, int(number == 0), item.frame, item.command, *parameters, *places, f"{item.z:.8g}")
    return "\t".join(str(column) for column in (*columns, item.autocontinue))


def _degrees(item: Item, scale: float) -> tuple[str, str]:
    return f"{item.x / scale:.7f}", f"{item.y / scale:.7f}"
