"""Writes a user's vehicle: the flight computer's file with tuned gains and their sources, beside the world's file.

Only the numbers and sources of what was tuned change; every other line and comment stays as it was. The new text is
read back before anything is written.
"""

from __future__ import annotations

import json
import math
import re
import tempfile
from pathlib import Path
from typing import NamedTuple

from avionics.vehicles import FlightVehicle, load_vehicle
from sim_bridge.flight.tuning.cascade import Design, value_of
from sim_bridge.tuning.margins import Margins
from wingbeat.errors import InputError
from wingbeat.vehicle_file import name_by_path

WORLD, AVIONICS = "world.toml", "avionics.toml"


class Places(NamedTuple):
    """Where a user's vehicle goes."""

    avionics: Path
    """the flight computer's file"""
    world: Path | None
    """the world's, None where only the flight computer's file was asked for"""


def places(out: Path) -> Places:
    """DIR/avionics.toml and DIR/world.toml, or the one file that ``out`` names.

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
    """Write the tuned file, and the world's text beside it where there is one; existing files are never touched.

    Raises:
        InputError: a file exists, or the vehicle's own file is laid out in a way that a value cannot be replaced in.
    """
    text = _renamed(tuned_text(vehicle, design), name_by_path(where.avionics))
    where.avionics.parent.mkdir(parents=True, exist_ok=True)
    if where.world is not None and world is not None:
        _create(where.world, _renamed(world, name_by_path(where.world)))
    _create(where.avionics, text)


def _renamed(text: str, name: str) -> str:
    """The text of a vehicle file with another name, which stands before the first section."""
    head, section, rest = text.partition("\n[")
    head = re.sub(r"(?m)^name\s*=.*$", lambda _: f"name = {json.dumps(name)}", head, count=1)
    return head + section + rest


def tuned_text(vehicle: FlightVehicle, design: Design) -> str:
    """The flight computer's file with the designed gains in it.

    Raises:
        InputError: a value is not written as ``key = { value = ..., source = "..." }`` on a line of its own.
    """
    text = vehicle.file.text
    for loop in design.after:
        source = source_of(design.model.origin, loop.margins)
        for key, value in loop.gains.items():
            text = _replaced(text, vehicle.file.path, key, value, source)
    _check(text, vehicle, design)
    return text


def source_of(origin: str, margins: Margins) -> str:
    """The source of a tuned gain."""
    gain, phase = f"GM {margins.gain_db:.1f} dB", f"PM {math.degrees(margins.phase):.0f} deg"
    return f"identified: tuned by wingbeat tune on {origin}, {gain}, {phase}"


def _replaced(text: str, path: Path, key: str, value: float, source: str) -> str:
    """The text with one value and its source replaced."""
    section, name = key.split(".")
    line = re.compile(
        rf"(?ms)(^\[{section}\][^\n]*\n(?:(?!^\[).)*?^\s*{name}\s*=\s*\{{[^\n]*?\bvalue\s*=\s*)[^,}}\n]+"
        r'([^\n]*?\bsource\s*=\s*)"(?:[^"\\\n]|\\.)*"'
    )
    found, count = line.subn(lambda match: f"{match[1]}{value:g}{match[2]}{json.dumps(source)}", text, count=1)
    if count != 1:
        layout = f'{name} = {{ value = ..., unit = "...", source = "..." }}'
        raise InputError(f"{path}: {key} must be written on one line, {layout}")
    return found


def _check(text: str, vehicle: FlightVehicle, design: Design) -> None:
    """Read the text back: it must give the designed gains and leave every other as it was.

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
            raise InputError(f"{vehicle.file.path}: {key} cannot be replaced in a file laid out like this")
    if gains != wanted:
        raise InputError(f"{vehicle.file.path}: cannot be tuned without changing other values")


def _create(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path} exists already and is not overwritten; choose another --out") from None
