"""Simulated vehicles with replaced values."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from sim_bridge.vehicles import SimulatedVehicle, load_vehicle
from wingbeat.documents import parse_toml, toml_text
from wingbeat.errors import InputError

SOURCE = "chosen: by a campaign"


def altered(vehicle: SimulatedVehicle, values: Mapping[str, Any], factors: Mapping[str, Any]) -> SimulatedVehicle:
    """Return the vehicle with ``values`` by location, ``bodies.fuselage.mass`` or ``drive.frequencies[2]``.

    ``factors`` multiply the values of the file, or those of ``values``; for a list, all numbers.

    Raises:
        InputError: unknown location, or value out of range.
    """
    if not values and not factors:
        return vehicle
    document = parse_toml(vehicle.text)
    for place, value in values.items():
        _put(vehicle, document, place, value)
    for place, factor in factors.items():
        _put(vehicle, document, place, _times(vehicle, document, place, factor))
    return _read(vehicle, toml_text(document))


@lru_cache(maxsize=64)
def _loaded(name: str, text: str) -> SimulatedVehicle:
    """A vehicle by the text of its file: a grid flies few of them many times.

    Raises:
        InputError: the text makes no vehicle.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        try:
            return load_vehicle(str(path))
        except InputError as error:
            raise InputError(str(error).replace(str(path), f"vehicle {name}")) from None


def _read(vehicle: SimulatedVehicle, text: str) -> SimulatedVehicle:
    return _loaded(vehicle.name, text)._replace(path=vehicle.path)


def _entry(vehicle: SimulatedVehicle, document: Mapping[str, Any], place: str) -> tuple[dict[str, Any], int | None]:
    """The entry of the file at a place, and which number of its list is meant; None for all of it.

    Raises:
        InputError: there is none.
    """
    found = re.fullmatch(r"([\w.-]+?)(?:\[(\d+)\])?", place)
    entry: Any = document
    for name in found[1].split(".") if found else ():
        entry = entry.get(name) if isinstance(entry, dict) else None
    if found is None or not isinstance(entry, dict) or "value" not in entry:
        raise InputError(
            f"vehicle {vehicle.name} has no value {place}; wingbeat vehicles {vehicle.path.stem} lists those it has"
        )
    if found[2] is None:
        return entry, None
    index = int(found[2])
    if not isinstance(entry["value"], list) or index >= len(entry["value"]):
        raise InputError(f"vehicle {vehicle.name}: {found[1]} has no number [{index}]")
    return entry, index


def _put(vehicle: SimulatedVehicle, document: Mapping[str, Any], place: str, value: Any) -> None:
    entry, index = _entry(vehicle, document, place)
    if index is None:
        entry["value"] = list(value) if isinstance(value, tuple) else value
    else:
        entry["value"][index] = value
    entry["source"] = SOURCE


def _times(vehicle: SimulatedVehicle, document: Mapping[str, Any], place: str, factor: float) -> Any:
    entry, index = _entry(vehicle, document, place)
    old = entry["value"] if index is None else entry["value"][index]
    numbers = old if isinstance(old, list) else [old]
    if any(isinstance(number, bool | str) for number in numbers):
        raise InputError(f"scale.vehicle.{place}: {old!r} is not a number")
    return [number * factor for number in old] if isinstance(old, list) else old * factor
