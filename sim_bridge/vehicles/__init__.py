"""Vehicles of the simulated world: what is. A file for each, every value with its unit and source."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from avionics.quantities import BadInput, Source, read_vehicle_file
from sim_bridge.vehicles.sections import Battery, Body, Cruise, Drive, Launch, Tail, Wing

FOLDER = Path(__file__).parent
PHYSICS_SCHEMA: dict[str, type[Any]] = {
    "body": Body,
    "wing": Wing,
    "tail": Tail,
    "drive": Drive,
    "battery": Battery,
    "launch": Launch,
    "cruise": Cruise,
}


class SimulatedVehicle(NamedTuple):
    """A checked vehicle file."""

    name: str
    title: str
    path: Path
    text: str
    body: Body
    wing: Wing
    tail: Tail
    drive: Drive
    battery: Battery
    launch: Launch
    cruise: Cruise
    sections: dict[str, Any]
    sources: dict[str, Source]
    fitted: dict[str, str]


def vehicle_names() -> list[str]:
    """Names that `load_vehicle` knows."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_vehicle(name_or_path: str, extra_schema: dict[str, type[Any]] | None = None) -> SimulatedVehicle:
    """Load a vehicle by name or by the path of its file.

    Raises:
        BadInput: unknown name, unreadable file, or a value that is missing, unknown or out of range.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = FOLDER / f"{name_or_path}.toml"
        if not path.exists():
            raise BadInput(f"unknown vehicle {name_or_path!r}; known: {', '.join(vehicle_names())}")
    file = read_vehicle_file(path, PHYSICS_SCHEMA | (extra_schema or {}))
    physics = {key: file.sections[key] for key in PHYSICS_SCHEMA}
    _check(file.path, physics)
    return SimulatedVehicle(
        file.name, file.title, file.path, file.text, **physics,
        sections=file.sections, sources=file.sources, fitted=file.fitted,
    )  # fmt: skip


def _check(path: Path, sections: dict[str, Any]) -> None:
    wing, drive, body = sections["wing"], sections["drive"], sections["body"]
    if wing.planform not in ("raven", "ellipse"):
        raise BadInput(f'{path}: wing.planform = "{wing.planform}" must be "raven" or "ellipse"')
    if drive.kind not in ("servo", "crank"):
        raise BadInput(f'{path}: drive.kind = "{drive.kind}" must be "servo" or "crank"')
    if len(drive.frequencies) < 2:
        raise BadInput(f"{path}: drive.frequencies must have at least 2 numbers")
    if body.mass <= 2.0 * wing.mass:
        raise BadInput(f"{path}: body.mass = {body.mass:g} kg must exceed that of both wings")
