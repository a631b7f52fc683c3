"""Reads a flight vehicle file: one section for each module's gains."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

from avionics import control_laws
from avionics.gains import FlightGains
from avionics.guidance import altitude
from avionics.mixing import flapping
from avionics.vehicles.airframe import Airframe
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean
from wingbeat.vehicle_file import Schema, VehicleFile, read_vehicle_file

FOLDER = Path(__file__).parent
SECTIONS: Mapping[str, type[Any]] = MappingProxyType(get_type_hints(FlightGains))
"""`Gains` of each module, by section"""
_OPTIONAL = {name: record for name, record in SECTIONS.items() if len(record._field_defaults) == len(record._fields)}
_REQUIRED = {name: record for name, record in SECTIONS.items() if name not in _OPTIONAL}
SCHEMA = Schema(_REQUIRED | {"airframe": Airframe}, _OPTIONAL)


class FlightVehicle(NamedTuple):
    """A vehicle as the flight computer knows it."""

    name: str
    """-; of the file"""
    title: str
    """-; for people"""
    gains: FlightGains
    """the gains of every module"""
    airframe: Airframe
    """what is known from the bench"""
    file: VehicleFile
    """the file with its sources, to be attached to the log"""
    defaults: tuple[str, ...] = ()
    """section.key of the numbers that the file does not have: those of `Gains`"""


def vehicle_names() -> tuple[str, ...]:
    """Names of the vehicles that come with the flight computer."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_vehicle(name_or_path: str | Path) -> FlightVehicle:
    """The vehicle of that name, or in that file.

    Raises:
        InputError: no such vehicle, or a file that cannot be used; one line that says why.
    """
    file = read_vehicle_file(_find(name_or_path), SCHEMA, FOLDER)
    airframe = file.sections["airframe"]
    gains = FlightGains(**{name: file.sections.get(name) or record() for name, record in SECTIONS.items()})
    defaults = tuple(
        f"{name}.{key}"
        for name, record in SECTIONS.items()
        for key, default in record._field_defaults.items()
        if f"{name}.{key}" not in file.sources and not isinstance(default, str)
    )
    try:
        flapping.check(gains.flapping)
        altitude.check(gains.altitude)
        control_laws.check(gains)
    except InputError as error:
        raise InputError(f"{file.path}: {error}") from None
    return FlightVehicle(file.name, file.title, gains, airframe, file, defaults)


def _find(name_or_path: str | Path) -> Path:
    if str(name_or_path) in vehicle_names():
        return FOLDER / f"{name_or_path}.toml"
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.suffix == ".toml":
        raise InputError(f"cannot read vehicle file {path}: there is no such file")
    name = str(name_or_path)
    raise InputError(
        f"unknown vehicle {name!r}{did_you_mean(name, vehicle_names())}; known: {', '.join(vehicle_names())}"
    )
