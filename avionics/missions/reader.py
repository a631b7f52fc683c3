"""Reads a mission: a TOML file with one ``[[item]]`` table per item, angles in degrees with the suffix ``_deg``."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

from avionics.guidance.mission import ItemKind, Mission, MissionItem
from avionics.missions.excitations import check_excitation, read_excitation
from avionics.missions.keys import Key, choice, numbers
from avionics.quantities import BadInput

FOLDER = Path(__file__).parent
LONGEST_MISSION = 500
"""items"""


PLACE = {"north": Key("m", -1e4, 1e4), "east": Key("m", -1e4, 1e4)}
ALTITUDE = {"altitude": Key("m", 1.0, 1000.0)}
HEADING = {"heading_deg": Key("deg", -180.0, 360.0, math.radians)}
KEYS: dict[ItemKind, dict[str, Key]] = {
    ItemKind.TAKEOFF: ALTITUDE,
    ItemKind.HOLD: {**ALTITUDE, **HEADING, "duration": Key("s", 0.0, 3600.0)},
    ItemKind.WAYPOINT: {**PLACE, **ALTITUDE},
    ItemKind.RETURN: {},
    ItemKind.LAND: {**PLACE, **HEADING},
}


def mission_names() -> tuple[str, ...]:
    """Names of the missions that come with the flight computer."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_mission(name_or_path: str | Path) -> Mission:
    """The mission of that name, or in that file.

    Raises:
        BadInput: no such mission, unreadable file, or an item that cannot be flown: the text names the item's
            number, the key and the allowed range.
    """
    path = _find(name_or_path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot read mission file {path}: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{path}: not valid TOML: {error}") from None
    unknown = set(document) - {"name", "title", "item"}
    if unknown:
        raise BadInput(f"{path}: unknown key {sorted(unknown)[0]}; known: name, title, [[item]]")
    tables = document.get("item", [])
    if not isinstance(tables, list) or not 1 <= len(tables) <= LONGEST_MISSION:
        raise BadInput(f"{path}: a mission has 1 to {LONGEST_MISSION} [[item]] tables")
    mission = tuple(_item(f"{path}: item {number}", table) for number, table in enumerate(tables, 1))
    refusal = check_mission(mission)
    if refusal:
        raise BadInput(f"{path}: {refusal}")
    return mission


def check_mission(mission: Mission) -> str:
    """Why ``mission`` (from a file or from the link) cannot be flown; empty when it can."""
    if len(mission) > LONGEST_MISSION:
        return f"a mission has at most {LONGEST_MISSION} items, not {len(mission)}"
    for number, item in enumerate(mission, 1):
        values = (item.north, item.east, item.altitude, item.heading, item.duration)
        if not all(math.isfinite(value) for value in values):
            return f"item {number}: {item.kind.name} has a value that is not a number"
        refusal = check_excitation(item.excitation) if item.kind == ItemKind.EXCITE else ""
        if refusal:
            return f"item {number}: {refusal}"
    return ""


def _find(name_or_path: str | Path) -> Path:
    named = FOLDER / f"{name_or_path}.toml"
    if str(name_or_path) in mission_names():
        return named
    path = Path(name_or_path)
    if path.is_file():
        return path
    raise BadInput(f"no mission {name_or_path}: neither a file nor one of {', '.join(mission_names())}")


def _item(where: str, table: Any) -> MissionItem:
    if not isinstance(table, dict):
        raise BadInput(f"{where} must be a table")
    kind = choice(where, table, "kind", {kind.name.lower(): kind for kind in ItemKind})
    if kind == ItemKind.EXCITE:
        return MissionItem(kind, excitation=read_excitation(where, table))
    found = numbers(where, table, KEYS[kind], ("kind",))
    fields: dict[str, Any] = {key.removesuffix("_deg"): value for key, value in found.items()}
    return MissionItem(kind, **fields)
