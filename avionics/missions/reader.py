"""Reads a mission: a TOML file with one ``[[item]]`` table per item, angles in degrees with the suffix ``_deg``."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from avionics.guidance.mission import Channel, Excitation, ItemKind, Mission, MissionItem, Shape
from avionics.quantities import BadInput

FOLDER = Path(__file__).parent
LONGEST_MISSION = 500
"""items"""


class Key(NamedTuple):
    """A number in an item: its unit, its range, and what it is in SI."""

    unit: str
    low: float
    high: float
    si: Callable[[float], float] = float


PLACE = {"north": Key("m", -1e4, 1e4), "east": Key("m", -1e4, 1e4)}
ALTITUDE = {"altitude": Key("m", 1.0, 1000.0)}
HEADING = {"heading_deg": Key("deg", -180.0, 360.0, math.radians)}
PULSE = {"width": Key("s", 0.02, 10.0), "settle": Key("s", 0.0, 30.0), "repeats": Key("-", 1, 100)}
KEYS: dict[ItemKind, dict[str, Key]] = {
    ItemKind.TAKEOFF: ALTITUDE,
    ItemKind.HOLD: {**ALTITUDE, **HEADING, "duration": Key("s", 0.0, 3600.0)},
    ItemKind.WAYPOINT: {**PLACE, **ALTITUDE},
    ItemKind.RETURN: {},
    ItemKind.LAND: {**PLACE, **HEADING},
}
AMPLITUDES: dict[Channel, tuple[str, Key]] = {
    Channel.ELEVATOR: ("amplitude_deg", Key("deg", 0.1, 45.0, math.radians)),
    Channel.THROTTLE: ("amplitude", Key("-", 0.005, 0.5)),
    Channel.RUDDER: ("amplitude_deg", Key("deg", 0.1, 45.0, math.radians)),
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
        numbers = (item.north, item.east, item.altitude, item.heading, item.duration)
        if not all(math.isfinite(value) for value in numbers):
            return f"item {number}: {item.kind.name} has a value that is not a number"
        refusal = check_excitation(item.excitation) if item.kind == ItemKind.EXCITE else ""
        if refusal:
            return f"item {number}: {refusal}"
    return ""


def check_excitation(excitation: Excitation | None) -> str:
    """Why an identification input cannot be flown; empty when it can."""
    if excitation is None:
        return "EXCITE without an excitation"
    name, key = AMPLITUDES[excitation.channel]
    low, high = key.si(key.low), key.si(key.high)
    values = {"width": excitation.width, "settle": excitation.settle, "repeats": float(excitation.repeats)}
    for word, value in values.items():
        if not PULSE[word].low <= value <= PULSE[word].high:
            return f"{word} = {value:g} is outside {PULSE[word].low:g} to {PULSE[word].high:g} {PULSE[word].unit}"
    if not low * (1.0 - 1e-6) <= excitation.amplitude <= high * (1.0 + 1e-6):
        return f"{name} is outside {key.low:g} to {key.high:g} {key.unit}"
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
    kind = _choice(where, table, "kind", {kind.name.lower(): kind for kind in ItemKind})
    if kind == ItemKind.EXCITE:
        return MissionItem(kind, excitation=_excitation(where, table))
    numbers = _numbers(where, table, KEYS[kind], ("kind",))
    fields: dict[str, Any] = {key.removesuffix("_deg"): value for key, value in numbers.items()}
    return MissionItem(kind, **fields)


def _excitation(where: str, table: Mapping[str, Any]) -> Excitation:
    channel = _choice(where, table, "channel", {channel.name.lower(): channel for channel in Channel})
    shape = _choice(where, table, "shape", {"doublet": Shape.DOUBLET, "3211": Shape.MULTISTEP_3211})
    name, key = AMPLITUDES[channel]
    numbers = _numbers(where, table, {name: key, **PULSE}, ("kind", "channel", "shape"))
    if numbers["repeats"] != int(numbers["repeats"]):
        raise BadInput(f"{where}: repeats must be a whole number, not {numbers['repeats']:g}")
    return Excitation(channel, shape, numbers[name], numbers["width"], numbers["settle"], int(numbers["repeats"]))


def _choice(where: str, table: Mapping[str, Any], key: str, choices: Mapping[str, Any]) -> Any:
    word = str(table.get(key, "")).lower()
    if word not in choices:
        said = f'"{word}"' if key in table else "missing"
        raise BadInput(f"{where}: {key} is {said}; it must be one of {', '.join(choices)}")
    return choices[word]


def _numbers(
    where: str, table: Mapping[str, Any], keys: Mapping[str, Key], others: tuple[str, ...]
) -> dict[str, float]:
    for name in table:
        if name not in keys and name not in others:
            raise BadInput(f"{where}: unknown key {name}; known: {', '.join((*others, *keys))}")
    return {name: _number(where, table, name, key) for name, key in keys.items()}


def _number(where: str, table: Mapping[str, Any], name: str, key: Key) -> float:
    expected = f"a number from {key.low:g} to {key.high:g} {key.unit}"
    value = table.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput(f"{where}: {name} {'is missing' if value is None else f'= {value!r}'}; it must be {expected}")
    if not key.low <= value <= key.high:
        raise BadInput(f"{where}: {name} = {value:g} is outside its range; it must be {expected}")
    return key.si(value)
