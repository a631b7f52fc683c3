"""Model files: the linear model of a flight or of tables for tune and fly."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from avionics.vehicles import FlightVehicle
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.models.modes import Mode, ModesResult
from logs.identification.models.stroke_averaged import LONGITUDINAL, TAIL, matrices
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.table.config import ALL, Map, ModesSection, OutputError, load_map
from logs.identification.sources.table.models import DROPPED, FIRST_SAMPLES, with_trim
from logs.identification.sources.table.run import TableIdentification
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


MODEL = "longitudinal"
REGRESSORS = ("u", "alpha", "q", "delta")
WANTED = tuple(f"{axis}_{name}" for axis in "XZM" for name in REGRESSORS)
TRIM = ("theta", "alpha", "flapping")
"""constants beside the airspeed without which there is no trim to be linear about"""


class TableModel(NamedTuple):
    """Linear model, and notes on it."""

    model: LinearModel
    notes: tuple[str, ...]


class _Source(NamedTuple):
    """Section of a map that gives the model."""

    subject: str
    section: ModesSection | OutputError


def check_model(chosen: Map, what: str) -> None:
    """Refuse a map that gives no model file, before the long work.

    Raises:
        InputError: with what is missing.
    """
    request = _section(chosen, what)
    named = request.section.parameters
    if len(request.section.inputs) != 1:
        raise InputError(f"--model: the model takes one elevator in inputs, not {len(request.section.inputs)}")
    free = {_common_name(name, request.section.inputs[0]) for name in named}
    left_out = [name for name in WANTED if named and name not in free and name not in DROPPED]
    if left_out:
        raise InputError(f"--model: all derivatives are wanted; parameters lacks {', '.join(left_out)}")
    absent = [f"constants.{name}" for name in TRIM if name not in chosen.constants.quantities]
    if "V" not in chosen.constants.quantities and "V" not in chosen.signals:
        absent.insert(0, "constants.V or signals.V")
    if absent:
        raise InputError(f"--model: the trim is not known: the map lacks {', '.join(absent)}")


def has_model(mapping: Path, what: str) -> bool:
    """Whether ``--model`` would write a model from this map."""
    try:
        check_model(load_map(mapping), what)
    except InputError:
        return False
    return True


def _section(chosen: Map, what: str) -> _Source:
    results = []
    if chosen.modes is not None and what in ("modes", ALL):
        results.append(_Source("modes", chosen.modes))
    if chosen.aero is not None and what in ("aero", ALL):
        results += [_Source("aero", one) for one in chosen.aero.output_error]
    for one in results:
        if one.section.model == MODEL:
            return one
    raise InputError(f'--model: it is of a fit with model = "{MODEL}" in [modes] or [[aero.output_error]]')


def _common_name(name: str, elevator: str) -> str:
    return f"{name.removesuffix(elevator)}delta" if name.endswith(f"_{elevator}") else name


def table_model(chosen: Map, results: TableIdentification, what: str, sha256: str) -> TableModel:
    """Return the linear model, with a nose-up positive elevator whatever the sign of the table.

    Raises:
        InputError: the fit failed, or a derivative was not identified.
    """
    request = _section(chosen, what)
    fit = _fit(request, results)
    elevator = request.section.inputs[0]
    if results.records[0].units.get(elevator) != "rad":
        raise InputError(f"no model is written: {elevator} is no angle")
    known = with_trim(results.constants, tuple(one for one in results.records if one.name in results.experiments))
    speed, alpha, pitch = known["V"], known["alpha"], known["theta"]
    estimates = {one.name: one for one in fit.estimates}
    values = dict.fromkeys(WANTED, 0.0) | dict(fit.fixed) | {n: e.value for n, e in estimates.items()}
    sign = -1.0 if values["M_delta"] < 0 else 1.0
    factors = {"alpha": ("w", 1.0 / speed), "delta": ("delta", sign)}
    named = {name: _renamed(name, factors) for name in WANTED}
    derivatives = {new: factor * values[name] for name, (new, factor) in named.items()}
    trim = sign * _trim(results, elevator)
    about = Reference(speed * math.cos(alpha), speed * math.sin(alpha), pitch, speed, trim)
    system = matrices(tuple(derivatives), np.array(list(derivatives.values())), about, Aircraft())
    kept = tuple(_scaled(one, *named.get(name, (name, 1.0))) for name, one in estimates.items())
    method, files = fit.title, ", ".join(results.files)
    origin_of = Identified(files, sha256, method, trim, alpha, known.get("rho"), identified_values(kept))
    origin = f"{files}, {method}, {len(results.experiments)} maneuvers"
    model = LinearModel("", origin, speed, pitch, known["flapping"], system.a, system.b, None, None, origin_of)
    return TableModel(model, _notes(fit, elevator, sign, tuple(n for n in WANTED if n not in estimates), values))


def _fit(request: _Source, results: TableIdentification) -> EstimationResult:
    """Return the fit with a number for every derivative.

    Raises:
        InputError: there is no fit, or a derivative is not identified.
    """
    fits = [one for one in results.fits if one.subject == request.subject and one.model == MODEL]
    if not fits:
        why = "; ".join(one.text for one in results.missing)
        raise InputError(f"no model is written: {why or 'nothing was fitted'}")
    fit = fits[0]
    lost = [f"{one.subject} is not identified: {one.text}" for one in fit.withheld]
    if fit.failure is not None or lost:
        raise InputError(f"no model is written: {fit.failure.text if fit.failure else '; '.join(lost)}")
    return fit


def _renamed(name: str, factors: dict[str, tuple[str, float]]) -> tuple[str, float]:
    """Return name and factor of a derivative by w and by the nose-up positive elevator."""
    axis, _, of = name.partition("_")
    new, factor = factors.get(of, (of, 1.0))
    return f"{axis}_{new}", factor


def _scaled(one: Estimate, name: str, factor: float) -> Estimate:
    ends = sorted((factor * one.low, factor * one.high))
    units = {"_w": "1/s", "M_w": "rad/s/m"}
    unit = units["M_w"] if name == "M_w" else units.get(name[1:], one.unit)
    return Estimate(name, unit, factor * one.value, abs(factor) * one.standard_error, ends[0], ends[1])


def _trim(results: TableIdentification, elevator: str) -> float:
    """Return the mean initial elevator in rad."""
    fitted = [one.signals[elevator] for one in results.records if one.name in results.experiments]
    first = [values[np.isfinite(values)][:FIRST_SAMPLES] for values in fitted]
    return float(np.mean([np.mean(values) for values in first if len(values)]))


def _notes(
    fit: EstimationResult, elevator: str, sign: float, fixed: tuple[str, ...], values: dict[str, float]
) -> tuple[str, ...]:
    notes = []
    if sign < 0:
        notes.append(f"{elevator} pitches the nose down: the model's elevator is -{elevator}")
    if fixed:
        notes.append("fixed, not estimated: " + ", ".join(f"{name} = {values[name]:.6g}" for name in fixed))
    if values.get("delay"):
        notes.append(f"the delay of {values['delay']:.3g} s is not in the model")
    return tuple(notes)
