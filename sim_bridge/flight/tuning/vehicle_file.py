"""Write a tuned vehicle: the flight computer's file with tuned gains and their sources, and the world's file.

Only the values and sources of tuned gains change; all other lines and comments are kept. The new text is read back
before anything is written.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit
from tomlkit.items import Table

from avionics.vehicles import FlightVehicle, load_vehicle
from sim_bridge.flight.tuning import tail_check
from sim_bridge.flight.tuning.cascade import Design, value_of
from sim_bridge.tuning.margins import Margins
from wingbeat.errors import InputError
from wingbeat.schema import field_hints, quantity_of
from wingbeat.units import Quantity
from wingbeat.vehicle_file import name_by_path

WORLD, AVIONICS = "world.toml", "avionics.toml"


class Places(NamedTuple):
    """Paths of the files of a user's vehicle."""

    avionics: Path
    """flight computer file"""
    world: Path | None
    """world file, None if only the flight computer file was requested"""


def places(out: Path) -> Places:
    """Return DIR/avionics.toml and DIR/world.toml, or the one file that ``out`` names.

    Raises:
        InputError: one of them exists already.
    """
    alone = out.suffix == ".toml"
    found = Places(out, None) if alone else Places(out / AVIONICS, out / WORLD)
    if not alone and out.is_file():
        raise InputError(f"{out} is a file; --out takes a new folder, or a name that ends in .toml")
    for path in found:
        if path is not None and path.exists():
            raise InputError(f"{path} exists already and is not overwritten; choose another --out")
    return found


def write(where: Places, vehicle: FlightVehicle, design: Design, world: str | None) -> None:
    """Write the tuned file, and the text of the world beside it if there is one; existing files are not changed.

    Raises:
        InputError: a file exists, or the new text does not contain the designed gains.
    """
    text = _renamed(tuned_text(vehicle, design), name_by_path(where.avionics))
    where.avionics.parent.mkdir(parents=True, exist_ok=True)
    if where.world is not None and world is not None:
        _create(where.world, _renamed(world, name_by_path(where.world)))
    _create(where.avionics, text)


def _renamed(text: str, name: str) -> str:
    """The text of a vehicle file with another name, if it has one."""
    document = tomlkit.parse(text)
    if "name" in document:
        document["name"] = name
    return tomlkit.dumps(document)


def tuned_text(vehicle: FlightVehicle, design: Design) -> str:
    """Return the flight computer file with the designed gains.

    A gain that the file does not list is added to its section.

    Raises:
        InputError: the new text does not contain the designed gains.
    """
    document = tomlkit.parse(vehicle.file.text)
    for loop in design.after:
        source = source_of(design.model.origin, loop.margins)
        for key, value in loop.gains.items():
            _put(document, vehicle, key, value, source)
    source = f"identified: by wingbeat tune from {design.model.origin}"
    for key in tail_check.KEYS:
        _put(document, vehicle, key, value_of(design.gains, key), source)
    text = tomlkit.dumps(document)
    _check(text, vehicle, design)
    return text


def source_of(origin: str, margins: Margins) -> str:
    """Return the source text of a tuned gain."""
    gain, phase = f"GM {margins.gain_db:.1f} dB", f"PM {math.degrees(margins.phase):.0f} deg"
    return f"identified: tuned by wingbeat tune on {origin}, {gain}, {phase}"


def _put(document: Any, vehicle: FlightVehicle, key: str, value: float, source: str) -> None:
    """Set ``section.name`` of the document."""
    section, name = key.split(".")
    table = document.setdefault(section, tomlkit.table())
    gains = type(getattr(vehicle.gains, section))
    _set(table, name, value, quantity_of(field_hints(gains)[name]), source)


def _set(table: Any, name: str, value: float, quantity: Quantity | None, source: str) -> None:
    """Set a value and its source; an entry with the earlier key of a renamed field keeps that key."""
    if quantity is not None and quantity.formerly in table:
        name = quantity.formerly
    if name not in table:
        _append(table, name, tomlkit.value('{ value = 0.0, unit = "-", source = "" }'))
        table[name]["unit"] = "-" if quantity is None else quantity.unit
    table[name]["value"] = float(f"{value:g}")
    table[name]["source"] = source


def _append(table: Any, name: str, item: Any) -> None:
    """Add an entry behind the last one, in front of blank lines and comments at the end of the section."""
    # A section in several parts is a proxy without a body.
    body = table.value.body if isinstance(table, Table) else []
    count = next((i for i in range(len(body), 0, -1) if body[i - 1][0] is not None), 0)
    trailing = body[count:]
    del body[count:]
    table[name] = item
    body.extend(trailing)


def _check(text: str, vehicle: FlightVehicle, design: Design) -> None:
    """Read the text back: it must give the designed gains, and all others unchanged.

    Raises:
        InputError: it does not.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / AVIONICS
        path.write_text(text, encoding="utf-8")
        gains = load_vehicle(path).gains
    wanted = vehicle.gains
    for key in design.values:
        section, name = key.split(".")
        wanted = wanted._replace(**{section: getattr(wanted, section)._replace(**{name: design.values[key]})})
        if value_of(gains, key) != design.values[key]:
            raise InputError(f"{vehicle.file.path}: {key} is not {design.values[key]:g} after tuning")
    if gains != wanted:
        raise InputError(f"{vehicle.file.path}: cannot be tuned without changing other values")


def _create(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path} exists already and is not overwritten; choose another --out") from None
