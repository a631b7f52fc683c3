"""Persistent parameters: values that differ from the vehicle file, as JSON.

File access is outside the flight core, which uses gains, and the link, which uses a `avionics.link.vehicle.Storage`.
The file is written to a temporary name and moved, so that a power failure leaves either the old or the new one. Its
checksum detects a damaged or edited file, which is renamed to ``.damaged`` and not used. A valid file of another
vehicle is rejected and not changed.
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
    """Valid file of another vehicle, which is neither used nor changed."""


class Loaded(NamedTuple):
    """Initial parameters of a flight."""

    vehicle: FlightVehicle
    """vehicle with the gains of the file"""
    text: str
    """-; description in one line, empty without a file"""
    damaged: bool
    """True if the file was rejected and the values of the vehicle file apply"""


def default_path(vehicle: FlightVehicle) -> Path:
    """Return the parameter file of a vehicle in the state folder.

    The folder is ``WINGBEAT_STATE``, or the state folder of the platform.
    """
    return _state_path("parameters", vehicle, "json")


def key_path(vehicle: FlightVehicle) -> Path:
    """Return the signing key file of a vehicle in the same state folder."""
    return _state_path("signing", vehicle, "key")


def storage_name(vehicle: FlightVehicle) -> str:
    """Return the name under which parameters and key are stored.

    The name is unique to a vehicle of the user, whose file may be a copy. It is the name of the vehicle's folder (of
    a single file, the file's). A vehicle of the user never shares the name of a supplied one.
    """
    path = vehicle.file.path.resolve()
    if path.parent == FOLDER:
        return vehicle.name
    name = name_by_path(path)
    return f"{name}-custom" if name in vehicle_names() else name


def unused_files(vehicle: FlightVehicle) -> list[str]:
    """Return a line for each file of earlier versions that is no longer used.

    These belong to a copied vehicle with an unchanged name.
    """
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
    # Versions before 0.2 used the name in the file.
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
    """Parameter file of one vehicle."""

    def __init__(self, path: Path, vehicle: FlightVehicle) -> None:
        """Store path and vehicle; no file is read or written.

        ``vehicle`` has the values of its vehicle file.
        """
        self.path = path
        self._vehicle = vehicle
        self._table = parameters.parameter_table(vehicle.gains)
        self._kept: FlightGains | None = None

    @property
    def owner(self) -> str:
        """Vehicle that the file belongs to, see `storage_name`."""
        return storage_name(self._vehicle)

    def defaults(self) -> dict[str, float]:
        """Return all values of the vehicle file."""
        return {name: parameters.get(self._vehicle.gains, entry) for name, entry in self._table.items()}

    def stored(self) -> dict[str, float]:
        """Return the values in the file; empty without a file.

        Raises:
            InputError: it cannot be read, or is damaged.
            AnotherVehicles: it is a valid file of another vehicle.
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
        """Reject a file of another vehicle before the start.

        A damaged file is handled by `load`.

        Raises:
            AnotherVehicles: the file belongs to another vehicle.
        """
        try:
            self.stored()
        except AnotherVehicles:
            raise
        except InputError:
            return

    def load(self) -> Loaded:
        """Return the vehicle with the gains of the file, or its own if that is damaged.

        Raises:
            InputError: the file exists and cannot be opened or renamed.
            AnotherVehicles: it is a valid file of another vehicle.
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
        """Return the gains with ``values``, and the names of rejected values.

        A value is rejected if the parameter is unknown or out of range.
        """
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
        """Write ``gains`` after a change while disarmed; return whether it was written.

        Raises:
            OSError: the file cannot be written; the next attempt follows the next change.
        """
        if gains is self._kept or armed:
            return False
        self._kept = gains
        self.save({name: parameters.get(gains, entry) for name, entry in self._table.items()})
        return True

    def save(self, values: Mapping[str, float]) -> None:
        """Write the ``values`` that differ from the vehicle file, in one step.

        Raises:
            OSError: the file cannot be written; the old one is unchanged.
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
    """Return the content of a valid file, or the reason of its rejection."""
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
