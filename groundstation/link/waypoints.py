"""Mission files: ``QGC WPL 110``, QGroundControl's ``.plan``, TOML.

Our own missions are metres from home, and are sent in the local frame.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.mission_codec import encode_fence, encode_item, encode_rally, notes, to_degrees, wire_scale
from avionics.link.vehicle import Home
from avionics.link.wire_item import WireItem
from avionics.missions import load_plan, plan_file, waypoint_file
from avionics.missions.waypoint_file import HEADER
from groundstation.link.missions import Item
from groundstation.link.modes import ARDUPILOT
from wingbeat.errors import InputError

CLOSE = 2
"""1e-7 deg or 1e-4 m; rounding tolerance of a position converted to meters and degrees"""


class Upload(NamedTuple):
    """Part of a file that is sent to a vehicle."""

    mission: tuple[Item, ...]
    fence: tuple[Item, ...] = ()
    rally: tuple[Item, ...] = ()
    notes: tuple[str, ...] = ()
    """-; text about the parts of the file that are not sent"""


class Convention(NamedTuple):
    """Mission convention of a vehicle type."""

    home_first: bool
    """-; item 0 is home, as for ArduPilot: it is sent as a placeholder, and the vehicle replaces it"""
    local: bool
    """-; whether positions in meters from home are accepted"""


def convention_of(autopilot: int | None, is_wingbeat: bool = False) -> Convention:
    """Return the convention of a MAV_AUTOPILOT; an unknown one has PX4's, which is that of MAVLink.

    ``is_wingbeat`` for a Wingbeat vehicle with any autopilot type; a generic autopilot counts as one.
    """
    is_wingbeat = is_wingbeat or autopilot == mavlink.MAV_AUTOPILOT_GENERIC
    return Convention(home_first=autopilot == ARDUPILOT, local=is_wingbeat)


def read(path: Path) -> tuple[Item, ...]:
    """Read the mission of a file, independent of the vehicle.

    Raises:
        InputError: as of `read_upload`.
    """
    if _is_native(path) or path.suffix == ".plan":
        return read_upload(path, Convention(home_first=False, local=True)).mission
    return tuple(item_of(line.item, line.autocontinue) for line in waypoint_file.read(path))


def needs_home(path: Path, convention: Convention) -> bool:
    """Return whether the vehicle's home position is required to send a file."""
    return _is_native(path) and not convention.local


def _is_native(path: Path) -> bool:
    return path.suffix == ".toml" or not path.suffix


def read_upload(path: Path, convention: Convention, home: Home | None = None) -> Upload:
    """Read mission, fence and rally points of a file in the ``convention`` of a vehicle.

    The home item of a plain list is omitted if the vehicle does not use it. ``home`` is the vehicle's home position,
    to convert meters in Wingbeat files if the vehicle accepts global positions only.

    Raises:
        InputError: unreadable, not such a list or plan, or a part that is malformed; the message names it.
    """
    if _is_native(path):
        return _native_mission(path, convention, home)
    if path.suffix == ".plan":
        return _planned(path, convention)
    lines = waypoint_file.read(path)
    listed = waypoint_file.home_of(lines)
    sent = waypoint_file.without_home(lines)
    texts = notes([line.item for line in sent]) if convention.local else ()
    if convention.home_first:
        items = tuple(item_of(line.item, line.autocontinue) for line in lines)
        return Upload(items if listed is not None else _behind(None, items), notes=texts)
    if len(sent) < len(lines):
        texts = (f"the first line of {path.name} is home and is not sent", *texts)
    return Upload(tuple(item_of(line.item, line.autocontinue) for line in sent), notes=texts)


def _behind(home: Home | None, items: tuple[Item, ...]) -> tuple[Item, ...]:
    """Return the items after a home item, with jump targets adjusted."""
    x, y, z = (
        (0.0, 0.0, 0.0)
        if home is None
        else (math.degrees(home.latitude), math.degrees(home.longitude), home.altitude)
    )
    first = WireItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0), x, y, z)
    return (item_of(first), *(_moved(item, 1) for item in items))


def _moved(item: Item, by: int) -> Item:
    if item.command != mavlink.MAV_CMD_DO_JUMP:
        return item
    return item._replace(parameters=(item.parameters[0] + by, *item.parameters[1:]))


def without_first(content: Upload, convention: Convention) -> Upload:
    """Return the items without the home item of this ``convention``, with jump targets adjusted."""
    if not convention.home_first:
        return content
    return content._replace(mission=tuple(_moved(item, -1) for item in content.mission[1:]))


def _planned(path: Path, convention: Convention) -> Upload:
    file = plan_file.read(path)
    items = tuple(item_of(planned.item) for planned in plan_file.numbered(file.mission))
    fence, rally = (tuple(map(item_of, part)) for part in (file.fence, file.rally))
    return Upload(
        _behind(file.home, items) if convention.home_first and items else items,
        fence,
        rally,
        notes([planned.item for planned in file.mission]) if convention.local else (),
    )


def _native_mission(path: Path, convention: Convention, home: Home | None) -> Upload:
    plan = load_plan(path)
    home = None if convention.local else home
    items = tuple(item_of(encode_item(item, home)) for item in plan.mission)
    return Upload(
        _behind(home, items) if convention.home_first else items,
        tuple(map(item_of, encode_fence(plan.fence, home))),
        tuple(map(item_of, encode_rally(plan.rally, home))),
    )


def is_local(item: Item) -> bool:
    """Return whether the item's position is in meters from home."""
    return bool(item.frame == mavlink.MAV_FRAME_LOCAL_NED)


def on_globe(item: Item, home: Home) -> Item:
    """Convert the item's position from meters from ``home`` to a global one; other items are unchanged."""
    if not is_local(item):
        return item
    wire = wire_item(item)
    latitude, longitude = to_degrees(home, wire.x, wire.y)
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    return item_of(wire._replace(frame=frame, x=latitude, y=longitude, z=-wire.z), item.autocontinue)


_SAME_FRAME = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: mavlink.MAV_FRAME_GLOBAL_TERRAIN_ALT,
}


def differences(
    file_items: Sequence[Item], vehicle_items: Sequence[Item]
) -> list[tuple[int, Item | None, Item | None]]:
    """Return number and items at which two lists differ; None for the end of a list."""
    pairs = enumerate(itertools.zip_longest(file_items, vehicle_items))
    return [
        (number, is_wingbeat, vehicle_items)
        for number, (is_wingbeat, vehicle_items) in pairs
        if not _equal(is_wingbeat, vehicle_items)
    ]


def _equal(is_wingbeat: Item | None, vehicle_items: Item | None) -> bool:
    """Equal for all that a vehicle keeps: single precision, a NaN parameter kept as 0, frames with two numbers."""
    if is_wingbeat is None or vehicle_items is None:
        return False
    frames = {_SAME_FRAME.get(item.frame, item.frame) for item in (is_wingbeat, vehicle_items)}
    numbers = zip((*is_wingbeat.parameters, is_wingbeat.z), (*vehicle_items.parameters, vehicle_items.z), strict=True)
    same_kind = is_wingbeat.command == vehicle_items.command and len(frames) == 1
    return same_kind and _same_place(is_wingbeat, vehicle_items) and all(_near(*pair) for pair in numbers)


def _same_place(is_wingbeat: Item, vehicle_items: Item) -> bool:
    """Whether both lead to one place; a takeoff from home may come back without its place."""
    if is_wingbeat.command == mavlink.MAV_CMD_NAV_TAKEOFF and (0, 0) in (
        (is_wingbeat.x, is_wingbeat.y),
        (vehicle_items.x, vehicle_items.y),
    ):
        return True
    return abs(is_wingbeat.x - vehicle_items.x) <= CLOSE and abs(is_wingbeat.y - vehicle_items.y) <= CLOSE


def _near(first: float, second: float) -> bool:
    first, second = (0.0 if math.isnan(value) else value for value in (first, second))
    return abs(first - second) <= 1e-3 + 1e-6 * abs(first)


def item_of(item: WireItem, autocontinue: int = 1) -> Item:
    """Convert to MISSION_ITEM_INT."""
    scale = wire_scale(item.frame)
    x, y = (0.0 if math.isnan(value) else value for value in (item.x, item.y))
    return Item(item.frame, item.command, item.params, round(x * scale), round(y * scale), item.z, autocontinue)


def wire_item(item: Item) -> WireItem:
    """Convert from MISSION_ITEM_INT."""
    scale = wire_scale(item.frame)
    return WireItem(item.frame, item.command, item.parameters, item.x / scale, item.y / scale, item.z)


def write_plan(path: Path, content: Upload, home: Home) -> None:
    """Write a mission with its fence and rally points to a new ``.plan`` file.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    mission = [plan_file.PlannedItem(wire_item(item), f"item {n}", n) for n, item in enumerate(content.mission, 1)]
    fence, rally = (tuple(map(wire_item, part)) for part in (content.fence, content.rally))
    plan_file.write(path, plan_file.PlanFile(home, tuple(mission), fence, rally))


def write(path: Path, items: Sequence[Item]) -> None:
    """Write a mission to a new file.

    Raises:
        InputError: the file exists, or cannot be written.
    """
    lines = [HEADER, *(_line(number, item) for number, item in enumerate(items))]
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None


def _line(number: int, item: Item) -> str:
    scale = wire_scale(item.frame)
    places = (f"{item.x / scale:.4f}", f"{item.y / scale:.4f}") if scale == 1e4 else _degrees(item, scale)
    parameters = (f"{value:.8g}" for value in item.parameters)
    columns = (number, int(number == 0), item.frame, item.command, *parameters, *places, f"{item.z:.8g}")
    return "\t".join(str(column) for column in (*columns, item.autocontinue))


def _degrees(item: Item, scale: float) -> tuple[str, str]:
    return f"{item.x / scale:.7f}", f"{item.y / scale:.7f}"
