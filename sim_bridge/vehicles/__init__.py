"""Vehicles of the simulated world: what is. A file for each, every value with its unit and source."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from sim_bridge.actuators.linkage import FourBar, Motor, checked
from sim_bridge.aerodynamics.models import MODELS, find_model
from sim_bridge.multibody.tree import Body
from sim_bridge.sensors.suite import SECTIONS as SENSORS
from sim_bridge.vehicles.bodies import body_tree, completed
from sim_bridge.vehicles.sections import (
    Aerodynamics,
    AsMeasured,
    Battery,
    BodyPart,
    Cruise,
    Drive,
    Fuselage,
    Launch,
    Plate,
    TailServo,
    Wing,
)
from sim_bridge.vehicles.vibration import ModeSpec, VibrationSpec
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean
from wingbeat.vehicle_file import Schema, Source, VehicleFile, read_vehicle_file

FOLDER = Path(__file__).parent
REQUIRED: dict[str, type[Any]] = {
    "fuselage": Fuselage,
    "wing": Wing,
    "aerodynamics": Aerodynamics,
    "tail_servo": TailServo,
    "drive": Drive,
    "battery": Battery,
    "launch": Launch,
    "cruise": Cruise,
}
REPEATED: dict[str, type[Any]] = {"bodies": BodyPart, "plates": Plate, "modes": ModeSpec}
OPTIONAL: dict[str, type[Any]] = {
    "linkage": FourBar,
    "motor": Motor,
    "as_measured": AsMeasured,
    "vibration": VibrationSpec,
}
MODEL_SECTIONS = {model.name: model.settings for model in MODELS.values()}
SCHEMA = Schema(REQUIRED, OPTIONAL | SENSORS | MODEL_SECTIONS, REPEATED)


class SimulatedVehicle(NamedTuple):
    """A checked vehicle file."""

    name: str
    title: str
    path: Path
    text: str
    bodies: dict[str, BodyPart]
    fuselage: Fuselage
    wing: Wing
    plates: dict[str, Plate]
    modes: dict[str, ModeSpec]
    """structural modes"""
    aerodynamics: Aerodynamics
    tail_servo: TailServo
    drive: Drive
    battery: Battery
    launch: Launch
    cruise: Cruise
    linkage: FourBar | None
    motor: Motor | None
    sections: dict[str, Any]
    """all of the file's, those of aerodynamic models and sensors too"""
    sources: dict[str, Source]
    fitted: dict[str, str]


def vehicle_names() -> list[str]:
    """Names that `load_vehicle` knows."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def load_vehicle(name_or_path: str) -> SimulatedVehicle:
    """Load a vehicle by name or by the path of its file.

    Raises:
        InputError: unknown name, unreadable file, a value that is missing, unknown or out of range, or bodies that
            make no tree with a wing on either side.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = FOLDER / f"{name_or_path}.toml"
        if not path.exists():
            guess = did_you_mean(name_or_path, vehicle_names())
            raise InputError(f"unknown vehicle {name_or_path!r}{guess}; known: {', '.join(vehicle_names())}")
    file = read_vehicle_file(path, SCHEMA, FOLDER)
    vehicle = _vehicle(file)
    _check(vehicle)
    return vehicle


def vehicle_bodies(vehicle: SimulatedVehicle) -> tuple[dict[str, BodyPart], list[Body]]:
    """The bodies with the mirror images filled in, and as a tree: base first, each after its parent.

    Raises:
        InputError: they make no tree, or a wing is not one of them or hangs on no joint of its own side, see
            `sim_bridge.vehicles.bodies`.
    """
    for key in ("right", "left"):
        _need_body(vehicle, f"wing.{key}", getattr(vehicle.wing, key))
    try:
        parts = completed(vehicle.bodies)
        return parts, body_tree(parts, vehicle.wing)
    except InputError as error:
        raise InputError(f"{vehicle.path}: {error}") from None


def _vehicle(file: VehicleFile) -> SimulatedVehicle:
    own = {key: file.sections[key] for key in (*REQUIRED, *REPEATED)}
    return SimulatedVehicle(
        file.name, file.title, file.path, file.text, **own,
        linkage=file.sections.get("linkage"), motor=file.sections.get("motor"),
        sections=file.sections, sources=file.sources, fitted=file.fitted,
    )  # fmt: skip


def with_model(vehicle: SimulatedVehicle, model: str) -> SimulatedVehicle:
    """The same vehicle flown with another of the aerodynamic models that its file has a section for.

    Raises:
        InputError: no such model, or no section of it.
    """
    find_model(model)
    if model not in vehicle.sections:
        has = ", ".join(models_of(vehicle))
        raise InputError(f"aerodynamic model {model}: {vehicle.name} has no section [{model}]; it has {has}")
    return vehicle._replace(aerodynamics=vehicle.aerodynamics._replace(model=model))


def models_of(vehicle: SimulatedVehicle) -> list[str]:
    """Names of the aerodynamic models that the vehicle's file has a section for, in the order of the table."""
    return [name for name in MODELS if name in vehicle.sections]


def _check(vehicle: SimulatedVehicle) -> None:
    path, model = vehicle.path, vehicle.aerodynamics.model
    if vehicle.wing.planform not in ("raven", "ellipse"):
        raise InputError(f'{path}: wing.planform = "{vehicle.wing.planform}" must be "raven" or "ellipse"')
    if vehicle.drive.kind not in ("servo", "crank", "linkage"):
        raise InputError(f'{path}: drive.kind = "{vehicle.drive.kind}" must be "servo", "crank" or "linkage"')
    if vehicle.drive.kind == "linkage":
        _check_linkage(vehicle)
    if len(vehicle.drive.frequencies) < 2:
        raise InputError(f"{path}: drive.frequencies must have at least 2 numbers")
    try:
        find_model(model)
    except InputError as error:
        raise InputError(f"{path}: aerodynamics.model: {error}") from None
    if model not in vehicle.sections:
        raise InputError(f'{path}: aerodynamics.model = "{model}" needs a section [{model}]')
    for name, plate in vehicle.plates.items():
        _need_body(vehicle, f"plates.{name}.body", plate.body)
        if not any(plate.normal):
            raise InputError(f"{path}: plates.{name}.normal has no direction: not all of it may be 0")
    vehicle_bodies(vehicle)


def _check_linkage(vehicle: SimulatedVehicle) -> None:
    if vehicle.linkage is None or vehicle.motor is None:
        raise InputError(f'{vehicle.path}: drive.kind = "linkage" needs sections [linkage] and [motor]')
    if vehicle.motor.rotor_inertia <= 0.0:
        raise InputError(f"{vehicle.path}: motor.rotor_inertia must be above 0 kg m^2")
    try:
        checked(vehicle.linkage)
    except InputError as error:
        raise InputError(f"{vehicle.path}: {error}") from None


def _need_body(vehicle: SimulatedVehicle, key: str, body: str) -> None:
    if body not in vehicle.bodies:
        known = ", ".join(vehicle.bodies)
        raise InputError(f'{vehicle.path}: {key} = "{body}" is not one of the bodies: {known}')
