"""Loader of flight vehicle files: one section for the gains of each module."""

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
    """Vehicle data of the flight computer."""

    name: str
    """-; name of the file"""
    title: str
    """-; display name"""
    gains: FlightGains
    """gains of all modules"""
    airframe: Airframe
    """data from the bench"""
    file: VehicleFile
    """file with its sources, attached to the log"""
    defaults: tuple[str, ...] = ()
    """section.key of the numbers not in the file, which have the defaults of `Gains`"""


def vehicle_names() -> tuple[str, ...]:
    """Return the names of the supplied vehicles."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_vehicle(name_or_path: str | Path) -> FlightVehicle:
    """Load the vehicle of a name or a file.

    Raises:
        InputError: no such vehicle, or an invalid file; one line with the reason.
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
