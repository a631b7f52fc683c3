"""Files of `wingbeat identify --model`: a linear model for tuning and a simulated vehicle."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from avionics.vehicles import FlightVehicle
from logs.identification.data.flight import Aircraft
from logs.identification.models.modes import Mode, ModesResult
from logs.identification.models.stroke_averaged import LONGITUDINAL, TAIL, matrices
from logs.identification.results import Estimate
from sim_bridge.flight_mechanics.identified import IdentifiedWorld, identified_world, world_text
from sim_bridge.tuning.model import Identified, IdentifiedValue, LinearModel, model_text
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle, vehicle_names
from wingbeat.errors import InputError

WORLD, AVIONICS, BASE = "world.toml", "avionics.toml", "base.toml"


class Log(NamedTuple):
    """Source of the model."""

    name: str
    """-; of the file"""
    sha256: str
    """-; of its bytes, in hexadecimal digits"""
    density: float | None
    """kg/m^3; mean of the flight, None if unknown"""


class Base(NamedTuple):
    """Vehicle of the flight, whose derivatives are replaced."""

    world: SimulatedVehicle
    """its bodies, drive and sensors"""
    avionics: FlightVehicle | None
    """its flight computer's file; None if there is none"""


class Written(NamedTuple):
    """Written files, and notes on them."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]


def places(out: Path) -> tuple[Path, Path]:
    """Return the model file and the folder of its vehicle, neither of which may exist.

    Raises:
        InputError: one of them exists, ``out`` is not a TOML file, or its folder does not exist.
    """
    if out.suffix != ".toml":
        raise InputError(f"--model {out}: the name of a model ends in .toml")
    folder = out.with_suffix("")
    for path in (out, folder):
        if path.exists():
            raise InputError(f"{path} exists: it is not overwritten")
    if not out.parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.parent}")
    return out, folder


def linear_model(modes: ModesResult, log: Log, vehicle: str = "") -> LinearModel:
    """Return the longitudinal model of the first complete method, about the reference flight.

    Raises:
        InputError: no method has all its derivatives and a short period.
    """
    mode, about, period = _whole_mode(modes), modes.reference, modes.wing_period
    if about is None or period is None:
        raise InputError("no model is written: the records tell neither a flight condition nor a wing period")
    derivatives = {e.name: e.value for e in mode.derivatives if e.name not in TAIL}
    # Position of the IMU and lag of the tail affect the outputs alone.
    system = matrices(tuple(derivatives), np.array(list(derivatives.values())), about, Aircraft())
    pairs = (mode.short_period, mode.phugoid)
    kept = (*mode.derivatives, *(e for pair in pairs if pair is not None for e in pair.estimates))
    angle = math.atan2(about.w, about.u)
    found = Identified(log.name, log.sha256, mode.method, about.elevator, angle, log.density, identified_values(kept))
    origin = f"{log.name}, {mode.method}, {modes.manoeuvres} maneuvers"
    return LinearModel(
        vehicle, origin, about.airspeed, about.pitch, 1.0 / period, system.a, system.b, None, None, found
    )


def _whole_mode(modes: ModesResult) -> Mode:
    for mode in modes.modes:
        if mode.short_period is not None and set(LONGITUDINAL) <= {e.name for e in mode.derivatives}:
            return mode
    why = "; ".join(f"{mode.method}: {one.text}" for mode in modes.modes for one in mode.withheld[:1])
    raise InputError(f"no model is written: no method gives all longitudinal derivatives{why and f' ({why})'}")


def identified_values(estimates: tuple[Estimate, ...]) -> tuple[IdentifiedValue, ...]:
    """Return estimates as entries of a model file."""
    return tuple(IdentifiedValue(e.name, e.unit, e.value, e.standard_error, e.low, e.high) for e in estimates)


def write_model(
    out: Path,
    modes: ModesResult,
    log: Log,
    base: Base | None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Written:
    """Write the model and, with a ``base``, the folder of its vehicle; nothing is overwritten.

    ``progress`` gets the number of linearized and of all values.

    Raises:
        InputError: a file exists, or no method has a whole model.
    """
    places(out)
    return write_linear(out, linear_model(modes, log), base, progress)


def write_linear(
    out: Path, model: LinearModel, base: Base | None, progress: Callable[[int, int], None] = lambda done, of: None
) -> Written:
    """Write a ``model``; as `write_model`.

    Raises:
        InputError: a file exists.
    """
    path, folder = places(out)
    world, notes = _world(model, base, progress)
    paths = [path]
    if world is not None and base is not None:
        model = model._replace(vehicle=folder.name)
        files = _folder_files(folder.name, model, world, base)
        folder.mkdir()
        for name, text in files.items():
            paths.append(folder / name)
            _create(folder / name, text)
    _create(path, model_text(model))
    return Written(tuple(paths), (*notes, *_left_out(model)))


def _left_out(model: LinearModel) -> tuple[str, ...]:
    missing = [name for name, part in (("lateral", model.lateral), ("drive", model.drive)) if part is None]
    return (f"not identified, so not in the model: {' and '.join(missing)}",) if missing else ()


def _world(
    model: LinearModel, base: Base | None, progress: Callable[[int, int], None]
) -> tuple[IdentifiedWorld | None, tuple[str, ...]]:
    """Return the simulated vehicle; None with the reason if there is none."""
    if base is None:
        return None, ("no world to fly in: nothing tells the bodies of the vehicle (--vehicle does)",)
    try:
        world = identified_world(model, base.world, progress)
    except InputError as error:
        return None, (f"no world to fly in: {error}",)
    return world, world.notes


def _folder_files(name: str, model: LinearModel, world: IdentifiedWorld, base: Base) -> dict[str, str]:
    """Return the texts of the files in the vehicle's folder by name."""
    below, files = base.world.name, {}
    if below not in vehicle_names() or load_vehicle(below).text != base.world.text:
        below, files = BASE, {BASE: base.world.text}
    title = f"{base.world.title}, as identified from {model.from_log().log}"
    files[WORLD] = world_text(world, name, title, below)
    if base.avionics is not None:
        files[AVIONICS] = base.avionics.file.text
    return files


def _create(path: Path, text: str) -> None:
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path} exists: it is not overwritten") from None
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
