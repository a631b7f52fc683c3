"""Tables of what a vehicle holds and of what a flight came to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rich.table import Table

from avionics.link.dialect import mavlink
from avionics.link.mission_codec import LOCAL_FRAMES, wire_scale
from groundstation.link.client import Item, Parameter, command_name
from groundstation.views import wording
from groundstation.views.terminal import open_console

MISSION_FRAME = mavlink.MAV_FRAME_MISSION
PARAMETER_TYPES = {1: "uint8", 2: "int8", 3: "uint16", 4: "int16", 5: "uint32", 6: "int32", 9: "float"}


def plain_table(*columns: tuple[str, str]) -> Table:
    """A table without lines: each column is a heading and ``left`` or ``right``."""
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0), header_style="dim")
    for heading, side in columns:
        table.add_column(heading, justify="right" if side == "right" else "left", no_wrap=side == "right")
    return table


def parameter_record(parameter: Parameter) -> dict[str, Any]:
    """A parameter as a JSON object."""
    kind = PARAMETER_TYPES.get(parameter.kind, str(parameter.kind))
    return {"name": parameter.name, "value": parameter.value, "type": kind}


def print_mission(items: Sequence[Item]) -> None:
    """The vehicle's mission, one row an item."""
    if not items:
        print("the vehicle has no mission")
        return
    table = plain_table(("", "right"), ("command", ""), ("place", ""), ("altitude", "right"), ("parameters", ""))
    for number, item in enumerate(items):
        plain = (*item.parameters, item.x, item.y) if item.frame == MISSION_FRAME else item.parameters
        values = "  ".join("–" if math.isnan(value) else f"{value:g}" for value in plain)
        table.add_row(str(number), wording.words(command_name(item.command)), _place(item), f"{item.z:g} m", values)
    open_console().print(table)


def _place(item: Item) -> str:
    if item.frame == MISSION_FRAME or (not item.x and not item.y):
        return ""
    scale = wire_scale(item.frame)
    if item.frame in LOCAL_FRAMES:
        return f"{item.x / scale:+.1f} m N  {item.y / scale:+.1f} m E"
    return f"{item.x / scale:.6f}  {item.y / scale:.6f}"
