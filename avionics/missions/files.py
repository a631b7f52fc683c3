"""Flight plan files: TOML, ``.plan`` of QGroundControl, ``.waypoints`` lists."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from avionics.guidance.fence import mission_breach
from avionics.guidance.mission import FlightPlan, Mission, MissionItem
from avionics.link.mission_codec import GLOBES, SKIPPED, decode_fence, decode_item, decode_rally, notes, with_altitude
from avionics.link.vehicle import Home
from avionics.link.wire_item import ItemRefused, WireItem
from avionics.missions import plan_file, reader, waypoint_file
from avionics.missions.limits import check_climb
from wingbeat.errors import InputError

LISTS = (".waypoints", ".txt", ".mission")
"""file name extensions of plain lists"""


def load_flight_plan(name_or_path: str | Path) -> FlightPlan:
    """Load the plan of a name or a file.

    Global positions are relative to the home in the file.

    Raises:
        InputError: no such mission, unreadable file, or an item that cannot be flown: the text names it and the
        reason.
    """
    path = reader.find(name_or_path)
    if path.suffix == ".plan":
        plan = _from_plan(path)
    elif path.suffix in LISTS:
        plan = _from_list(path)
    else:
        plan = reader.load_plan(name_or_path)
    refusal = (
        reader.check_plan(plan) or check_climb(plan.mission) or mission_breach(plan.fence, plan.mission, first=1)
    )
    if refusal:
        raise InputError(f"{path}: {refusal}")
    return plan


def _from_plan(path: Path) -> FlightPlan:
    file = plan_file.read(path)
    if all(planned.item.command in SKIPPED for planned in file.mission):
        raise InputError(f"{path}: no mission item to fly, only {_rest(file)}")
    try:
        items = plan_file.numbered(file.mission)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    mission = _mission(path, ((planned.where, planned.item) for planned in items), file.home)
    try:
        fence = decode_fence(file.fence, file.home)
        rally = decode_rally(file.rally, file.home)
    except ItemRefused as refused:
        raise InputError(f"{path}: fence or rally points: {refused}") from None
    return FlightPlan(mission, fence, rally, notes([planned.item for planned in items]))


def _rest(file: plan_file.PlanFile) -> str:
    """Return the content of a plan without a mission, and the command that sends it."""
    parts = [name for name, items in (("a fence", file.fence), ("rally points", file.rally)) if items]
    hint = "; upload it with: wingbeat gcs URL mission upload FILE" if parts else ""
    return " and ".join(parts + ["commands that are passed over"] * bool(file.mission)) + hint


def _from_list(path: Path) -> FlightPlan:
    lines = waypoint_file.read(path)
    home = waypoint_file.home_of(lines)
    items = [line.item for line in waypoint_file.without_home(lines)]
    if home is None and any(item.frame in GLOBES and (item.x or item.y) for item in items):
        raise InputError(f"{path}: its first line must be home (frame 0, command 16): its places are on the globe")
    first = 0 if home is None else 1
    mission = _mission(path, ((f"item {number}", item) for number, item in enumerate(items, first)), home)
    return FlightPlan(mission, notes=notes(items))


def _mission(path: Path, items: Iterable[tuple[str, WireItem]], home: Home | None) -> Mission:
    made: list[MissionItem] = []
    earlier: list[WireItem] = []
    for where, sent in items:
        item = with_altitude(sent, earlier)
        try:
            made.append(decode_item(item, home, earlier))
        except ItemRefused as refused:
            raise InputError(f"{path}: {where}: {refused}") from None
        earlier.append(item)
    return tuple(made)
