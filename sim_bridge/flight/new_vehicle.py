"""Design a new vehicle from a few numbers: scale, trim, tune, and predict its cruise.

The membrane's stiffness is found so that the model flies level at the predicted airspeed with the given flapping rate
and stroke, the drive's torque constant so that it draws the predicted power there.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from scipy.optimize import brentq

from avionics.vehicles import FOLDER as COMPUTERS
from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from avionics.vehicles.loader import SCHEMA as COMPUTER_SCHEMA
from sim_bridge.flight.tuning.cascade import Design, design
from sim_bridge.flight.tuning.proof import FlightQuality, fly_quality
from sim_bridge.flight.tuning.vehicle_file import AVIONICS, WORLD, Places, write
from sim_bridge.flight_mechanics.averaged import AveragedModel, stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.linear import averaged_modes
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.tuning.model import LinearModel, model_of
from sim_bridge.vehicles import SCHEMA as WORLD_SCHEMA
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle
from sim_bridge.vehicles.published_flights import Prediction, predict
from sim_bridge.vehicles.scaling import (
    GIVEN,
    SCALED,
    Cruise,
    Document,
    NewBird,
    Ratios,
    Reference,
    Remark,
    put,
    ratios_of,
    remarks,
    rounded,
    scaled,
    world_document,
)
from wingbeat.atmosphere import SEA_LEVEL_DENSITY
from wingbeat.documents import toml_text
from wingbeat.errors import InputError
from wingbeat.vehicle_file import Schema

REFERENCE = "arizona_100cm"
"""vehicle that is scaled: one motor moves both wings by a crank"""
SOFTEST = (0.2, 0.5, 1.0)
"""-; least membrane stiffness over the scaled one, in the order of the trials; softness costs dihedral effect"""
SLOWEST = 0.8
"""-; greatest airspeed of the protection against stall, over the cruise"""
SLIDING = 0.45
"""-; greatest airspeed of a vehicle on the ground, over the cruise"""
NEARBY = (1.0, 0.997, 1.003)
"""-; airspeeds of the trim, over the predicted one"""
HOLDS = 2
"""-; of the proof flight"""
SEARCH_START, SEARCH_STEP, SEARCH_STEPS = -0.7, 0.3, 16
"""-; logarithms of the loss of thrust between which the trim is searched"""
FREQUENCY_TOLERANCE, POWER_TOLERANCE = 0.005, 0.01
"""-; of the trim, relative to the given rate and the predicted power"""
Told = Callable[[int, int, str], None]


class ShortPeriod(NamedTuple):
    """Short-period mode of the stroke-averaged model."""

    airspeed: float
    """m/s"""
    natural_frequency: float
    """rad/s"""
    damping: float


class NewVehicle(NamedTuple):
    """A designed vehicle and what is predicted of it."""

    bird: NewBird
    prediction: Prediction
    world: SimulatedVehicle
    computer: FlightVehicle
    """before tuning"""
    design: Design
    cruise: Orbit
    short_period: tuple[ShortPeriod, ...]
    """at the predicted airspeed, and at its lower and upper limit where the model trims there"""
    remarks: tuple[Remark, ...]
    flight: FlightQuality | None
    """proof flight in light gusts; None if it did not reach its first hold"""

    @property
    def flies(self) -> bool:
        """Whether the proof flight completed both holds without touching the ground."""
        return self.flight is not None and self.flight.completed_legs == HOLDS and not self.flight.touched

    @property
    def throttle(self) -> float:
        """-; in cruise."""
        return throttle_for(self.cruise.inputs.frequency, self.world)

    @property
    def efficiency(self) -> float:
        """-; mechanical power of the wings over the electrical power, in cruise."""
        return self.cruise.means.mechanical_power / self.cruise.means.electrical_power

    @property
    def endurance(self) -> float:
        """s; in cruise on a full battery."""
        return self.world.battery.capacity / self.cruise.means.current


def design_vehicle(
    bird: NewBird, name: str, airspeed: float | None = None, on_progress: Told = lambda done, of, words: None
) -> NewVehicle:
    """Scale, trim, tune and fly a new vehicle; ``airspeed`` in m/s replaces the predicted one.

    The softest membrane whose flight completes both holds of the proof mission is taken; without one the stiffest,
    whose ``flight`` is then None or touches the ground.

    Raises:
        InputError: the wings and the tail are as heavy as the vehicle, no trim, or no gains within the margins.
    """
    prediction = predict(bird)
    if airspeed is not None:
        prediction = prediction._replace(airspeed=airspeed, airspeed_error=0.0)
    reference, error = _reference(), InputError("")
    found: NewVehicle | None = None
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / name / WORLD
        path.parent.mkdir()
        for number, softest in enumerate(SOFTEST):
            words = "scaling, trimming and tuning" if not number else "trying a stiffer membrane"
            on_progress(number, len(SOFTEST), words)
            try:
                found = _candidate(bird, prediction, reference, softest, path)
            except InputError as reason:
                error = reason
                continue
            if found.flies:
                return found
    if found is None:
        raise error
    return found


def _candidate(bird: NewBird, prediction: Prediction, reference: Reference, softest: float, path: Path) -> NewVehicle:
    """Return the vehicle with a membrane of at least ``softest`` of the scaled stiffness.

    Raises:
        InputError: no trim, or no gains within the margins.
    """
    level = Cruise(prediction.airspeed, prediction.power)
    document = world_document(bird, level, reference, path.parent.name)
    _fit_thrust(document, bird, prediction.airspeed, -math.log(softest), path)
    world, cruise = _fit_drive(document, prediction, path)
    averaged = stroke_averaged_model(world, cruise)
    model = model_of(world, cruise, axes_model(world, cruise, averaged))
    ratios = ratios_of(bird, level, reference)
    computer_path = path.with_name(AVIONICS)
    computer = _computer_document(bird, ratios, world, cruise, path.parent.name)
    vehicle, designs = _designed(model, computer, computer_path)
    try:
        flight = fly_quality(world, vehicle, designs.gains)
    except InputError:  # it did not reach the first hold
        flight = None
    about = remarks(bird, prediction.airspeed, SEA_LEVEL_DENSITY)
    modes = _short_periods(world, averaged, cruise, prediction)
    return NewVehicle(bird, prediction, world, vehicle, designs, cruise, modes, about, flight)


def _designed(model: LinearModel, computer: Document, path: Path) -> tuple[FlightVehicle, Design]:
    """Return flight computer and gains; without a pitch command by the altitude error if that leaves no margins.

    Raises:
        InputError: no gains within the margins.
    """
    path.write_text(_commented(computer, COMPUTER_SCHEMA, "flight computer"), encoding="utf-8")
    vehicle = load_flight_vehicle(path)
    try:
        return vehicle, design(model, vehicle)
    except InputError:
        put(computer, "altitude.pitch_error", 0.0, "chosen: none, for the margins of the climb loop")
        path.write_text(_commented(computer, COMPUTER_SCHEMA, "flight computer"), encoding="utf-8")
        vehicle = load_flight_vehicle(path)
        return vehicle, design(model, vehicle)


def write_vehicle(vehicle: NewVehicle, folder: Path) -> Places:
    """Write ``world.toml`` and ``avionics.toml`` with the tuned gains to a folder.

    Raises:
        InputError: one of them exists.
    """
    where = Places(folder / AVIONICS, folder / WORLD)
    write(where, vehicle.computer, vehicle.design, vehicle.world.text)
    return where


def _reference() -> Reference:
    world = load_vehicle(REFERENCE)
    cruise = trim(world, world.cruise.airspeed, 0.0)
    document = tomllib.loads(world.text)
    return Reference(document, cruise.means.airspeed, cruise.inputs.frequency, cruise.means.electrical_power)


def _loaded(document: Document, path: Path) -> SimulatedVehicle:
    path.write_text(_commented(document, WORLD_SCHEMA, "simulated vehicle"), encoding="utf-8")
    return load_vehicle(str(path))


def _level_flight(world: SimulatedVehicle, airspeed: float) -> Orbit:
    """Return the trim at ``airspeed``, or within `NEARBY` of it: the search of a trim may stall at single points.

    Raises:
        InputError: there is none.
    """
    for factor in NEARBY[:-1]:
        try:
            return trim(world, airspeed * factor, 0.0)
        except InputError:
            continue
    return trim(world, airspeed * NEARBY[-1], 0.0)


def _fit_thrust(document: Document, bird: NewBird, airspeed: float, softest: float, path: Path) -> None:
    """Find membrane stiffness and drag for level flight at ``airspeed`` with the given flapping rate.

    The membrane is softened to ``softest``, the logarithm of the scaled stiffness over the least; then drag is added.

    Raises:
        InputError: there are none.
    """
    wing, fuselage = document["wing"], document["fuselage"]
    stiffness, damping = wing["twist_stiffness"]["value"], wing["twist_damping"]["value"]
    drag = fuselage["drag_area"]["value"]
    sources = {key: f"{entry['source']}, fitted to the given flapping rate and stroke" for key, entry in (
        ("membrane", wing["twist_stiffness"]), ("drag", fuselage["drag_area"]))}  # fmt: skip

    def excess(logarithm: float) -> float:
        """Relative excess of the flapping rate at a logarithm of the loss of thrust."""
        softness = min(logarithm, softest)
        put(document, "wing.twist_stiffness", rounded(stiffness * math.exp(-softness)), sources["membrane"])
        put(document, "wing.twist_damping", rounded(damping * math.exp(-softness)), sources["membrane"])
        if logarithm > softest:
            put(document, "fuselage.drag_area", rounded(drag * math.exp(logarithm - softest)), sources["drag"])
        flown = _level_flight(_loaded(document, path), airspeed).inputs.frequency
        return float(flown / bird.frequency - 1.0)

    below: float | None = None
    for step in range(SEARCH_STEPS):
        logarithm = SEARCH_START + step * SEARCH_STEP
        try:
            found = excess(logarithm)
        except InputError:
            below = None
            continue
        if found >= 0.0 and below is not None:
            excess(brentq(excess, below, logarithm, xtol=FREQUENCY_TOLERANCE))
            return
        below = logarithm if found < 0.0 else None
    raise InputError(
        f"no level flight at {airspeed:.3g} m/s with {bird.frequency:g} Hz and a stroke of"
        f" {math.degrees(2.0 * bird.stroke):.3g} degrees: change rate, stroke, area or --airspeed"
    )


def _fit_drive(document: Document, prediction: Prediction, path: Path) -> tuple[SimulatedVehicle, Orbit]:
    """Set the torque constant so that level cruise draws the predicted power; return the vehicle and its cruise.

    Raises:
        InputError: no torque constant does.
    """
    source = "chosen: cruise draws the power that published flights predict"
    for _ in range(10):
        world = _loaded(document, path)
        cruise = _level_flight(world, prediction.airspeed)
        ratio = cruise.means.electrical_power / prediction.power
        if abs(ratio - 1.0) < POWER_TOLERANCE:
            return world, cruise
        put(document, "drive.torque_constant", rounded(world.drive.torque_constant * ratio), source)
    raise InputError(
        f"no drive draws the predicted {prediction.power:.2g} W in cruise: the last one is {ratio:.0%} of it"
    )


def _short_periods(
    world: SimulatedVehicle, averaged: AveragedModel, cruise: Orbit, prediction: Prediction
) -> tuple[ShortPeriod, ...]:
    found = [_short_period(averaged, cruise)]
    error = prediction.airspeed_error
    for factor in (1.0 / (1.0 + error), 1.0 + error) if error else ():
        try:
            orbit = trim(world, prediction.airspeed * factor, 0.0)
            found.append(_short_period(stroke_averaged_model(world, orbit), orbit))
        except InputError:  # the model does not fly level there
            continue
    return tuple(found)


def _short_period(averaged: AveragedModel, orbit: Orbit) -> ShortPeriod:
    fast = max(averaged_modes(averaged), key=lambda mode: mode.natural_frequency)
    return ShortPeriod(orbit.means.airspeed, fast.natural_frequency, fast.damping)


def _computer_document(bird: NewBird, ratios: Ratios, world: SimulatedVehicle, cruise: Orbit, name: str) -> Document:
    """Return the flight-computer file: scaled, with the trims of the new vehicle."""
    source = tomllib.loads((COMPUTERS / f"{REFERENCE}.toml").read_text(encoding="utf-8"))
    computer = scaled(source, ratios, REFERENCE)
    computer |= {"name": name, "title": world.title}
    _put_electrics(computer, world)
    _put_trims(computer, source, world, cruise)
    slow = source["altitude"]["airspeed_min"]["value"] * math.sqrt(ratios.mass / (ratios.length * ratios.chord))
    put(computer, "altitude.airspeed_min", rounded(min(slow, SLOWEST * cruise.means.airspeed)),
        f"{SCALED} {REFERENCE} by the root of wing loading")  # fmt: skip
    put(
        computer,
        "modes.touchdown_airspeed",
        rounded(SLIDING * cruise.means.airspeed),
        "chosen: below the stall; beating wings push it over the ground at a third of its cruise",
    )
    put(
        computer,
        "airspeed_check.cruise",
        rounded(cruise.means.airspeed),
        "chosen: predicted from the Strouhal number",
    )
    points = [rounded(one) for one in world.drive.frequencies]
    put(computer, "flapping.frequency_points", points, f"{SCALED} {REFERENCE} by flapping rate")
    amplitudes = [bird.stroke] * len(source["flapping"]["amplitude_points"]["value"])
    put(computer, "flapping.amplitude_points", amplitudes, GIVEN)
    return computer


def _put_electrics(computer: Document, world: SimulatedVehicle) -> None:
    sensor, battery, built = world.sections["power_sensor"], world.battery, "chosen: as built, see world.toml"
    for key, value in (
        ("capacity", battery.capacity), ("resistance", battery.resistance), ("divider", sensor.divider),
        ("open_circuit", [battery.empty_voltage, battery.full_voltage]), ("current_range", sensor.current_range),
        ("current_sensitivity", sensor.current_sensitivity), ("current_zero", sensor.current_zero),
        ("reference", sensor.reference),
    ):  # fmt: skip
        put(computer, f"power.{key}", value, built)


def _put_trims(computer: Document, old: Mapping[str, Any], world: SimulatedVehicle, cruise: Orbit) -> None:
    """Put throttle, pitch and elevator of the trimmed vehicle, and shift the limits of pitch with its trim."""
    source = f"identified: trimmed simulated vehicle at {cruise.means.airspeed:.3g} m/s"
    put(computer, "altitude.throttle_trim", rounded(throttle_for(cruise.inputs.frequency, world)), source)
    put(computer, "altitude.pitch_trim", rounded(cruise.means.pitch), source)
    put(computer, "pitch.elevator_trim", rounded(cruise.inputs.elevator), source)
    shift = cruise.means.pitch - old["altitude"]["pitch_trim"]["value"]
    for key in ("altitude.pitch_min", "altitude.pitch_max", "modes.glide_pitch"):
        section, name = key.split(".")
        put(computer, key, rounded(old[section][name]["value"] + shift), f"{SCALED} {REFERENCE} by the trim of pitch")


def _commented(document: Document, schema: Schema, what: str) -> str:
    """Return the document as TOML with a comment on the file and on each section."""
    records = {**schema.required, **schema.optional, **schema.repeated}
    about = {name: (record.__doc__ or "").split("\n")[0].rstrip(".") for name, record in records.items()}
    lines = [
        f"# {what.capitalize()}, written by wingbeat new-bird. The source of a value tells whether it is given,",
        f"# scaled from {REFERENCE} (by what), or default. Replace what you have measured, and its source.",
    ]
    for line in toml_text(document).splitlines():
        section = line.strip("[]").split(".")[0] if line.startswith("[") else ""
        if about.get(section) and not any(one.startswith(f"[{section}.") for one in lines):
            lines.append(f"# {about[section]}")
        lines.append(line)
    return "\n".join(lines) + "\n"
