"""Plan files in TOML: mission items, fence and rally points.

The file has one ``[[item]]`` table per item, a ``[fence]`` and ``[[rally]]`` points. Angles are in degrees with the
suffix ``_deg``. A ``survey`` becomes one waypoint for each end of its legs.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avionics.guidance import survey
from avionics.guidance.mission import (
    INSTANT,
    NO_FENCE,
    Fence,
    FlightPlan,
    ItemKind,
    Mission,
    MissionItem,
    Rally,
    RallyPoint,
    Zone,
)
from avionics.missions.excitations import check_excitation, read_excitation
from avionics.missions.keys import Key, choice, numbers
from avionics.missions.limits import (
    FENCE_ALTITUDES,
    FENCE_CIRCLE,
    KEYS,
    LONGEST_MISSION,
    MOST_CORNERS,
    RALLY,
    SURVEY,
    check_fence,
    check_item,
    check_jumps,
    check_rally,
)
from wingbeat.errors import InputError
from wingbeat.schema import check_keys, check_table, error_context, read_document

FOLDER = Path(__file__).parent
SURVEYED = "survey"
"""kind of an item that is converted to waypoints"""


def mission_names() -> tuple[str, ...]:
    """Return the names of the supplied missions."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_mission(name_or_path: str | Path) -> Mission:
    """Load the mission of a name or a file; see `load_plan`.

    Raises:
        InputError: as `load_plan`.
    """
    return load_plan(name_or_path).mission


def load_plan(name_or_path: str | Path) -> FlightPlan:
    """Load the mission of a name or a TOML file, with fence and rally points.

    Raises:
        InputError: no such mission, unreadable file, or an item that cannot be flown: the text names the number of
        the item, the key and the allowed range.
    """
    path = find(name_or_path)
    document = read_document(path, "mission file")
    with error_context(path):
        plan = _plan(document)
        refusal = check_plan(plan)
        if refusal:
            raise InputError(refusal)
    return plan


def _plan(document: Mapping[str, Any]) -> FlightPlan:
    check_keys(document, ("name", "title", "item", "fence", "rally", "fault"))
    tables = document.get("item", [])
    if not isinstance(tables, list) or not 1 <= len(tables) <= LONGEST_MISSION:
        raise InputError(f"a mission has 1 to {LONGEST_MISSION} [[item]] tables")
    return FlightPlan(_mission(tables), _fence(document.get("fence", {})), _rally(document.get("rally", [])))


def check_plan(plan: FlightPlan) -> str:
    """Return why a plan is rejected; empty if accepted."""
    fence, rally = check_fence(plan.fence), check_rally(plan.rally)
    return check_mission(plan.mission) or (fence and f"fence, {fence}") or (rally and f"rally, {rally}")


def check_mission(mission: Mission) -> str:
    """Return why a mission of a file or the link is rejected; empty if accepted."""
    if len(mission) > LONGEST_MISSION:
        return f"a mission has at most {LONGEST_MISSION} items, not {len(mission)}"
    for number, item in enumerate(mission, 1):
        refusal = check_item(item) or (check_excitation(item.excitation) if item.kind == ItemKind.EXCITE else "")
        if refusal:
            return f"item {number}: {item.kind.name}: {refusal}"
    if mission and all(item.kind in INSTANT for item in mission):
        return "no item is flown, all are passed over"
    return check_jumps(mission)


def find(name_or_path: str | Path) -> Path:
    """Return the file of a mission name, or that path.

    Raises:
        InputError: neither exists.
    """
    named = FOLDER / f"{name_or_path}.toml"
    if str(name_or_path) in mission_names():
        return named
    path = Path(name_or_path)
    if path.is_file():
        return path
    raise InputError(f"no mission {name_or_path}: neither a file nor one of {', '.join(mission_names())}")


def _mission(tables: list[Any]) -> Mission:
    """Return the items with surveys converted.

    A jump refers to the number of a table, and leads to its first item.
    """
    made = []
    for number, table in enumerate(tables, 1):
        with error_context(f"item {number}"):
            made.append(_items(check_table(table, "[[item]]"), len(tables)))
    first = [sum(map(len, made[:number])) for number in range(len(made))]
    return tuple(
        item._replace(jump_to=first[item.jump_to]) if item.kind == ItemKind.JUMP else item
        for items in made
        for item in items
    )


def _items(table: Mapping[str, Any], count: int) -> list[MissionItem]:
    # Skipped commands come from plans and uploads alone.
    kinds = {kind.name.lower(): kind for kind in ItemKind if kind != ItemKind.SKIP}
    kind = choice(table, "kind", {**kinds, SURVEYED: SURVEYED})
    if kind == SURVEYED:
        return _survey(table)
    if kind == ItemKind.EXCITE:
        return [MissionItem(kind, excitation=read_excitation(table))]
    if kind == ItemKind.JUMP:
        return [_jump(table, count)]
    found = numbers(table, KEYS[kind], ("kind",))
    fields: dict[str, Any] = {key.removesuffix("_deg"): value for key, value in found.items()}
    item = MissionItem(kind, **fields)
    refusal = check_item(item)
    if refusal:
        raise InputError(refusal)
    return [item]


def _jump(table: Mapping[str, Any], count: int) -> MissionItem:
    keys = {"item": Key("-", 1, count), "repeats": Key("-", -1, 1000)}
    found = numbers(table, keys, ("kind",))
    for name, value in found.items():
        if value != int(value):
            raise InputError(f"{name} must be a whole number, not {value:g}")
    return MissionItem(ItemKind.JUMP, jump_to=int(found["item"]) - 1, repeats=int(found["repeats"]))


def _survey(table: Mapping[str, Any]) -> list[MissionItem]:
    found = numbers(table, SURVEY, ("kind", "polygon"))
    corners = _polygon(table.get("polygon"))
    flown = survey.legs(corners, found["spacing"], found["heading_deg"], found["overshoot"])
    if not flown or 2 * len(flown) > LONGEST_MISSION:
        raise InputError(f"a survey has 1 to {LONGEST_MISSION // 2} legs, not {len(flown)}: change its spacing")
    return [MissionItem(ItemKind.WAYPOINT, north, east, found["altitude"]) for leg in flown for north, east in leg]


def _polygon(corners: Any) -> tuple[tuple[float, float], ...]:
    """Return the corners ``[[north, east], ...]`` in m."""
    expected = f"polygon must be a list of 3 to {MOST_CORNERS} corners, [north, east] in m within 100 km of home"
    if not isinstance(corners, list) or not 3 <= len(corners) <= MOST_CORNERS:
        raise InputError(expected)
    for corner in corners:
        sound = isinstance(corner, list) and len(corner) == 2
        if not sound or not all(isinstance(m, int | float) and not isinstance(m, bool) for m in corner):
            raise InputError(f"{expected}, not {corner!r}")
        if not all(abs(metres) <= 1e5 for metres in corner):
            raise InputError(f"{expected}, not {corner!r}")
    return tuple((float(north), float(east)) for north, east in corners)


def _fence(table: Any) -> Fence:
    if not check_table(table, "fence"):
        return NO_FENCE
    with error_context("fence"):
        altitudes = numbers(table, FENCE_ALTITUDES, ("zone",))
        zones = table.get("zone", [])
        if not isinstance(zones, list):
            raise InputError("zones are [[fence.zone]] tables")
    made = []
    for number, zone in enumerate(zones, 1):
        with error_context(f"fence, zone {number}"):
            made.append(_zone(check_table(zone, "[[fence.zone]]")))
    return Fence(tuple(made), altitudes["min_altitude"], altitudes["max_altitude"])


def _zone(table: Mapping[str, Any]) -> Zone:
    keep_in = choice({"keep": "in", **table}, "keep", {"in": 1, "out": 0})
    if "polygon" in table:
        numbers(table, {}, ("keep", "polygon"))
        return Zone(keep_in, _polygon(table["polygon"]))
    found = numbers(table, FENCE_CIRCLE, ("keep",))
    return Zone(keep_in, ((found["north"], found["east"]),), found["radius"])


def _rally(tables: Any) -> Rally:
    if not isinstance(tables, list):
        raise InputError("rally points are [[rally]] tables")
    points = []
    for number, table in enumerate(tables, 1):
        with error_context(f"rally {number}"):
            points.append(RallyPoint(**numbers(check_table(table, "[[rally]]"), RALLY, ())))
    return tuple(points)
