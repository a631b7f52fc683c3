"""Keys of campaign files: plain keys and values of vehicle files.

An angle's key may end in ``_deg``; everything else is SI and radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from sim_bridge.environment.levels import LEVELS_TOLD
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_integer, read_number
from wingbeat.units import ABOVE_ZERO, Quantity

Values = Mapping[str, Any]
"""input values of one flight, by key"""


class Key(NamedTuple):
    """Row of the table of plain keys."""

    kind: type
    unit: str
    text: str
    low: float = -math.inf
    high: float = math.inf


class Family(NamedTuple):
    """Keys with a common first word, followed by a location."""

    form: str
    text: str


KEYS: dict[str, Key] = {
    "vehicle": Key(str, "-", "name or folder of a vehicle"),
    "aerodynamics": Key(str, "-", "model of the wings' air loads"),
    "mission": Key(str, "-", "name or file of a mission"),
    "sticks": Key(str, "-", "table by which a transmitter is moved, instead of the scripted start"),
    "faults": Key(str, "-", "what fails: NAME@T or NAME@T-T2, several with spaces between, empty for nothing"),
    "turbulence": Key(str, "-", f"Dryden gusts: {LEVELS_TOLD}"),
    "vibration": Key(
        float, "-", "factor of the vibration of the vehicle file (default: 1 if it has one); 0: none", 0.0
    ),
    "seed": Key(int, "-", "of sensor noise and gusts", 0, 2**63 - 1),
    "duration": Key(float, "s", "the flight ends then at the latest", ABOVE_ZERO),
    "wind.speed": Key(float, "m/s", "steady wind", 0.0),
    "wind.from": Key(float, "rad", "where it comes from, clockwise from north", -2 * math.pi, 2 * math.pi),
    "throw.speed": Key(float, "-", "times the launch speed", 0.0, 10.0),
    "throw.pitch": Key(float, "rad", "added to the launch pitch", -math.pi / 2, math.pi / 2),
    "throw.bank": Key(float, "rad", "of the launch, right wing down positive", -math.pi, math.pi),
    "sensors.corner": Key(float, "-", "standard deviations by which every fixed error of the sensors is off", 0.0),
}
FAMILIES: dict[str, Family] = {
    "vehicle": Family("vehicle.SECTION.KEY", "a value of the world's vehicle file"),
    "gains": Family("gains.SECTION.KEY", "a gain of the flight computer, or gains.PARAMETER"),
    "scale": Family("scale.vehicle.SECTION.KEY", "a factor on a value of the file; also scale.gains.SECTION.KEY"),
    "fault": Family("fault.NAME.at", "s; when a fault begins; fault.NAME.until or .lasting ends it"),
}
DEGREES = "_deg"
LABELS = {
    "turbulence": "turbulence", "seed": "random seed", "duration": "time limit", "wind.speed": "wind speed",
    "wind.from": "wind direction (from)", "throw.speed": "launch speed factor", "throw.pitch": "launch pitch offset",
    "throw.bank": "launch bank", "sensors.corner": "sensor errors in standard deviations",
}  # fmt: skip
"""labels of plain keys that are not words"""


def label_of(key: str) -> str:
    """Return the label of an input for plots and tables."""
    name = plain_name(key)
    if name is not None:
        return LABELS.get(name, name)
    family, _, place = key.partition(".")
    words = place.replace(".", " ").replace("_", " ")
    if family == "scale":
        return f"factor on {label_of(place)}"
    return {"vehicle": f"vehicle {words}", "gains": f"gain {words}", "fault": f"fault {words}"}.get(family, key)


def check_key(key: str) -> None:
    """Check that a key exists.

    Raises:
        InputError: unknown key; the message lists the known ones.
    """
    if plain_name(key) is not None:
        return
    family, _, place = key.partition(".")
    scaled = family != "scale" or place.partition(".")[0] in ("vehicle", "gains")
    if (family in FAMILIES and "." in place and scaled) or (family == "gains" and place):
        return
    forms = (family.form for family in FAMILIES.values())
    check_known(key, (*KEYS, *forms), key)


def plain_name(key: str) -> str | None:
    """Return the row of `KEYS` for a key with or without ``_deg``; None if there is none."""
    if key in KEYS:
        return key
    name = key.removesuffix(DEGREES)
    return name if name in KEYS and KEYS[name].unit == "rad" else None


def unit_of(key: str) -> str:
    """Return the unit of a plain key's values; ``-`` if the key does not determine it."""
    if key.endswith(DEGREES):
        return "deg"
    if key.startswith("fault."):
        return "s"
    return KEYS[key].unit if key in KEYS else "-"


def check_value(key: str, value: Any) -> None:
    """Check a value against the limits of its key.

    Raises:
        InputError: see above.
    """
    name = plain_name(key)
    row = Key(float, unit_of(key), "") if name is None else KEYS[name]
    if row.kind is str:
        if not isinstance(value, str):
            raise InputError(f"{key} must be text in quotes, not {value!r}")
        return
    if name is None and isinstance(value, list):
        for one in value:
            check_value(key, one)
        return
    if key.startswith("vehicle.") and isinstance(value, str | bool):
        return  # a word or a switch of the file, which its reader knows
    read = read_integer if row.kind is int else read_number
    factor = math.degrees(1.0) if key.endswith(DEGREES) else 1.0
    try:
        read(value, key, Quantity(unit_of(key), factor * row.low, factor * row.high))
    except InputError as error:
        hint = f"; {key}{DEGREES} is in degrees" if unit_of(key) == "rad" else ""
        raise InputError(f"{error}{hint}") from None


def plain(values: Values, name: str, default: Any) -> Any:
    """Return the value of a plain key, angles in rad."""
    if name + DEGREES in values:
        return math.radians(values[name + DEGREES])
    return values.get(name, default)


def of_family(values: Values, family: str) -> dict[str, Any]:
    """Return the values of a family by location, without the family's first word."""
    head = f"{family}."
    return {key.removeprefix(head): value for key, value in values.items() if _is_of(key, head)}


def _is_of(key: str, head: str) -> bool:
    return key.startswith(head) and plain_name(key) is None
