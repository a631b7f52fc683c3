"""Parameters that outlive a restart: what differs from the vehicle file, in a JSON file of the user's.

Files belong to the edge: the flight core knows gains, and the link a `avionics.link.vehicle.Storage`. The file is
written whole beside its place and moved there, so that a cut of the power leaves the old one or the new one; its
checksum tells a file that was damaged or edited, which is then kept beside as ``.damaged`` and not believed. A sound
file of another vehicle is refused and stays as it is.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

from avionics import parameters
from avionics.gains import FlightGains
from avionics.vehicles import FlightVehicle, vehicle_names
from avionics.vehicles.loader import FOLDER
from wingbeat.documents import parse_json
from wingbeat.errors import InputError
from wingbeat.files import write_atomically
from wingbeat.text import pluralize, read_error_text
from wingbeat.vehicle_file import name_by_path

FORMAT = "wingbeat parameters 1"


class AnotherVehicles(InputError):
    """The file is sound and another vehicle's: it is neither flown with nor touched."""


class Loaded(NamedTuple):
    """What the flight begins with."""

    vehicle: FlightVehicle
    """with the gains of the file"""
    text: str
    """-; one line for people, empty when there was no file"""
    damaged: bool
    """whether the file was refused, and the vehicle's own values hold"""


def default_path(vehicle: FlightVehicle) -> Path:
    """The parameter file of this vehicle in the user's state folder: ``WINGBEAT_STATE``, or the platform's."""
    return _state_path("parameters", vehicle, "json")


def key_path(vehicle: FlightVehicle) -> Path:
    """The signing key of this vehicle in the same state folder."""
    return _state_path("signing", vehicle, "key")


def storage_name(vehicle: FlightVehicle) -> str:
    """Name under which parameters and key are stored; unique to a user's vehicle, whose file may be a copy.

    It is the name of the vehicle's folder (of a single file, the file's). A user's vehicle never shares the name of
    one that comes with the flight computer.
    """
    path = vehicle.file.path.resolve()
    if path.parent == FOLDER:
        return vehicle.name
    name = name_by_path(path)
    return f"{name}-custom" if name in vehicle_names() else name


def unused_files(vehicle: FlightVehicle) -> list[str]:
    """A line for each file that earlier versions used for a copied vehicle whose name was left unchanged."""
    lines = []
    for path, folder in ((default_path(vehicle), "parameters"), (key_path(vehicle), "signing")):
        earlier = _state_folder() / folder / f"{_file_name(vehicle.name)}{path.suffix}"
        if earlier != path and earlier.exists() and not path.exists():
            lines.append(f"{earlier} is not used for this vehicle; to use it, copy it to {path}")
    return lines


def _state_path(kind: str, vehicle: FlightVehicle, suffix: str) -> Path:
    folder = _state_folder() / kind
    path = folder / f"{_file_name(storage_name(vehicle))}.{suffix}"
    earlier = folder / f"{_file_name(vehicle.name)}.{suffix}"
    # Versions before 0.2 stored by the name in the file.
    return earlier if vehicle.name not in vehicle_names() and earlier.exists() and not path.exists() else path


def _file_name(vehicle: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", vehicle).strip("._-") or "vehicle"


def _state_folder() -> Path:
    chosen = os.environ.get("WINGBEAT_STATE")
    if chosen:
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support" / "wingbeat"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "wingbeat"
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "wingbeat"


class ParameterFile:
    """One file for one vehicle."""

    def __init__(self, path: Path, vehicle: FlightVehicle) -> None:
        """Nothing is read or written yet; ``vehicle`` is as its own file has it."""
        self.path = path
        self._vehicle = vehicle
        self._table = parameters.parameter_table(vehicle.gains)
        self._kept: FlightGains | None = None

    @property
    def owner(self) -> str:
        """The vehicle that the file belongs to, see `storage_name`."""
        return storage_name(self._vehicle)

    def defaults(self) -> dict[str, float]:
        """Every value of the vehicle file."""
        return {name: parameters.get(self._vehicle.gains, entry) for name, entry in self._table.items()}

    def stored(self) -> dict[str, float]:
        """The values in the file; none where there is no file.

        Raises:
            InputError: it cannot be read, or is damaged.
            AnotherVehicles: it is sound, and another vehicle's.
        """
        try:
            text = self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return {}
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read parameter file {self.path}: {read_error_text(error)}") from None
        checked = _checked(text)
        if isinstance(checked, str):
            raise InputError(f"parameter file {self.path} {checked}")
        names = {self.owner, self._vehicle.name} - (set(vehicle_names()) - {self.owner})
        if checked.vehicle not in names:
            raise AnotherVehicles(
                f"parameter file {self.path} belongs to vehicle {checked.vehicle} and is not changed;"
                f" choose another file for {self.owner} with --parameters"
            )
        return checked.values

    def check_owner(self) -> None:
        """Refuse another vehicle's file before anything is started; a damaged one is left to `load`.

        Raises:
            AnotherVehicles: it is one.
        """
        try:
            self.stored()
        except AnotherVehicles:
            raise
        except InputError:
            return

    def load(self) -> Loaded:
        """The vehicle with the gains of the file; with its own where the file cannot be believed.

        Raises:
            InputError: the file is there and cannot be opened, or cannot be moved aside.
            AnotherVehicles: it is sound, and another vehicle's.
        """
        if self.path.exists() and not self.path.is_file():
            raise InputError(f"parameter file {self.path} is not a file")
        try:
            values = self.stored()
        except AnotherVehicles:
            raise
        except InputError as refused:
            aside = self._move_aside()
            self._kept = self._vehicle.gains
            return Loaded(self._vehicle, f"{refused}: renamed to {aside.name}, defaults apply", True)
        gains, strange = self._applied(values)
        self._kept = gains
        text = f"{pluralize(len(values) - len(strange), 'parameter')} from {self.path}" if values else ""
        if strange:
            text += f"; ignored: {', '.join(strange)}"
        return Loaded(self._vehicle._replace(gains=gains), text, False)

    def _applied(self, values: Mapping[str, float]) -> tuple[FlightGains, list[str]]:
        """The vehicle's gains with ``values``, and the names of those that it does not have or cannot hold."""
        gains, strange = self._vehicle.gains, []
        for name, value in values.items():
            change = parameters.set_value(gains, self._table, name, value)
            if change.accepted and change.value == value:
                gains = change.gains
            else:
                strange.append(name)
        return gains, strange

    def _move_aside(self) -> Path:
        endings = ("" if number == 1 else f"-{number}" for number in count(1))
        aside = next(
            path for end in endings if not (path := self.path.with_name(f"{self.path.name}.damaged{end}")).exists()
        )
        try:
            self.path.rename(aside)
        except OSError as error:
            raise InputError(f"parameter file {self.path} is damaged and cannot be moved: {error.strerror}") from None
        return aside

    def keep(self, gains: FlightGains, armed: bool) -> bool:
        """Write ``gains`` when they have changed, but not while armed; whether anything was written.

        Raises:
            OSError: the file cannot be written; it is not tried again before the next change.
        """
        if gains is self._kept or armed:
            return False
        self._kept = gains
        self.save({name: parameters.get(gains, entry) for name, entry in self._table.items()})
        return True

    def save(self, values: Mapping[str, float]) -> None:
        """Write the ``values`` that differ from the vehicle file's, in one step.

        Raises:
            OSError: the file cannot be written; the old one stays as it is.
        """
        defaults = self.defaults()
        changed = {name: value for name, value in sorted(values.items()) if value != defaults[name]}
        document = {"format": FORMAT, "vehicle": self.owner, "values": changed}
        text = json.dumps({**document, "sha256": _checksum(document)}, indent=1) + "\n"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(self.path, text)


def _checksum(document: Mapping[str, Any]) -> str:
    canonical = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()


class _Content(NamedTuple):
    vehicle: str
    values: dict[str, float]


def _checked(text: str) -> _Content | str:
    """What is in a sound file, or what is wrong with it."""
    try:
        document = parse_json(text)
        checksum = document.pop("sha256")
        values = {str(name): float(value) for name, value in document["values"].items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return "is not a parameter file"
    if document.get("format") != FORMAT:
        return "has another format"
    if checksum != _checksum(document):
        return "is damaged: wrong checksum"
    return _Content(str(document.get("vehicle")), values)
