"""Vehicle files of a new ornithopter from a few numbers, by scaling a known vehicle.

Each value is scaled by its unit: lengths with the span, forces with the weight (gravity is the same), times of the
body with length over speed, times of the wings with the flapping period, lengths and times of the flight path with
the square of the speed and the speed, because gravity sets the radius of a turn. References: Pennycuick, *Modelling
the Flying Bird*, 2008, ch. 3; Shyy et al., *An Introduction to Flapping Wing Aerodynamics*, 2013, ch. 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.schema import field_hints, quantity_of
from wingbeat.units import Quantity

Document = dict[str, Any]
GIVEN, SCALED, DEFAULT = "chosen: given", "chosen: scaled from", "chosen: default, as"
"""sources of the values of a new vehicle"""
UNSCALED = (
    "accelerometer", "gyroscope", "magnetometer", "barometer", "pitot", "gps", "encoder", "encoders", "torque_cell",
    "torque", "rangefinder", "receiver", "quasi_steady", "blade_element", "vortex_lattice", "aerodynamics", "ahrs",
)  # fmt: skip
"""sections that do not depend on the size of the vehicle"""
WINGS = ("drive", "flapping", "wing_angle", "wing")
"""sections whose times are those of a stroke"""
PATH = ("navigation", "altitude", "heading", "excitation", "airspeed_check", "modes", "throttle_descent", "launch")
"""sections about the flight path: gravity sets its lengths and times"""
STRUCTURE = ("vibration", "modes")
"""sections of the world file about structural vibration, scaled as a geometrically similar beam"""
SMALLEST_BODY = 0.3
"""-; least mass of fuselage, drive and battery over the all-up mass"""
MEMBRANE_SUCTION = 0.39
"""-; leading-edge suction of a membrane wing, as of the Slow Hawk, where it was fitted to the flight of Grauer V.A"""
FULL_CELL, EMPTY_CELL, PACK = 4.2, 3.5, 3600.0
"""V, V: of a lithium-polymer cell; C of 1 A h"""


class NewBird(NamedTuple):
    """What must be known of a new vehicle."""

    mass: Annotated[float, Quantity("kg", 0.005, 20.0)]
    """all-up"""
    span: Annotated[float, Quantity("m", 0.1, 5.0)]
    """from wing tip to wing tip"""
    area: Annotated[float, Quantity("m^2", 0.001, 5.0)]
    """of both wings"""
    stroke: Annotated[float, Quantity("rad", 0.1, 1.2)]
    """half of the angle between the highest and the lowest wing position"""
    frequency: Annotated[float, Quantity("Hz", 0.5, 40.0)]
    """of flapping in cruise"""
    tail_area: Annotated[float, Quantity("m^2", 0.0001, 2.0)]
    tail_arm: Annotated[float, Quantity("m", 0.02, 3.0)]
    """from the center of mass to the tail"""
    cells: Annotated[int, Quantity("-", 1, 12)]
    """lithium-polymer cells in series"""
    capacity: Annotated[float, Quantity("A h", 0.01, 50.0)]
    """of the battery"""

    @property
    def tip_speed(self) -> float:
        """m/s; flapping frequency times vertical travel of a wing tip, the numerator of the Strouhal number."""
        return self.frequency * self.span * math.sin(self.stroke)

    @property
    def weight(self) -> float:
        """N."""
        return self.mass * STANDARD_GRAVITY

    @property
    def root_chord(self) -> float:
        """m; of an elliptic wing of this area and span."""
        return 4.0 * self.area / (math.pi * self.span)


def checked_bird(bird: NewBird) -> NewBird:
    """Return the numbers of a new vehicle.

    Raises:
        InputError: one is out of its range.
    """
    hints = field_hints(NewBird)
    for name, value in bird._asdict().items():
        quantity = quantity_of(hints[name])
        if quantity is not None and not quantity.low <= value <= quantity.high:
            raise InputError(f"{name} = {value:.4g} {quantity.violation_text()}")
    return bird


class Remark(NamedTuple):
    """A property of the new vehicle beside the range of what flies."""

    code: str
    """-; key of `RANGES`"""
    value: float
    low: float
    high: float

    @property
    def unusual(self) -> bool:
        """Whether the value lies outside of the range."""
        return not self.low <= self.value <= self.high


RANGES = {
    "wing_loading": (
        "N/m^2",
        "0.08 to 1.5 times 47 W^(1/3): Tennekes, The Simple Science of Flight, 2009, ch. 1, for birds; the published"
        " ornithopters with membranes lie between 0.08 and 0.3",
    ),
    "lift_coefficient": ("-", "0.15 to 1.2: level flight of the published ornithopters, 0.17 to 0.7"),
    "strouhal": (
        "-",
        "0.2 to 0.55: 0.2 to 0.4 in cruising animals (Taylor, Nudds, Thomas, Nature 425, 2003), 0.39 to 0.53 in the"
        " published ornithopters",
    ),
    "tail_volume": ("-", "0.1 to 1.2: ornithopters here 0.12 to 0.5; airplanes 0.5 to 1 (Raymer, Table 6.4)"),
}
"""unit and source of the range by code of a remark"""


def remarks(bird: NewBird, airspeed: float, density: float) -> tuple[Remark, ...]:
    """Return wing loading, lift coefficient, Strouhal number and tail volume at ``airspeed`` in m/s."""
    usual = 47.0 * bird.weight ** (1.0 / 3.0)
    pressure = 0.5 * density * airspeed**2
    return (
        Remark("wing_loading", bird.weight / bird.area, 0.08 * usual, 1.5 * usual),
        Remark("lift_coefficient", bird.weight / (pressure * bird.area), 0.15, 1.2),
        Remark("strouhal", bird.tip_speed / airspeed, 0.2, 0.55),
        Remark("tail_volume", bird.tail_area * bird.tail_arm * bird.span / bird.area**2, 0.1, 1.2),
    )


class Cruise(NamedTuple):
    """Level cruise of the new vehicle."""

    airspeed: float
    """m/s"""
    power: float
    """W; electrical"""


class Reference(NamedTuple):
    """The known vehicle."""

    world: Mapping[str, Any]
    """document of its world file"""
    airspeed: float
    """m/s; of its trimmed cruise"""
    frequency: float
    """Hz; of flapping in that trim"""
    power: float
    """W; electrical, in that trim"""

    @property
    def name(self) -> str:
        """Name in its file."""
        return str(self.world["name"])

    def value(self, section: str, key: str) -> Any:
        """Return a value of the world file."""
        return self.world[section][key]["value"]

    @property
    def mass(self) -> float:
        """All-up mass in kg."""
        bodies = self.world["bodies"]
        own = sum(part["mass"]["value"] for part in bodies.values() if "mass" in part)
        mirrored = sum(bodies[part["mirror_of"]]["mass"]["value"] for part in bodies.values() if "mirror_of" in part)
        return float(own + mirrored + 2.0 * self.value("wing", "membrane_mass"))


class Ratios(NamedTuple):
    """New over reference."""

    length: float
    """of the span"""
    mass: float
    speed: float
    period: float
    """of a stroke"""
    chord: float
    arm: float
    """of the tail"""
    tail_area: float
    power: float
    """electrical"""
    voltage: float

    @property
    def current(self) -> float:
        """Of the drive."""
        return self.power / self.voltage


def ratios_of(bird: NewBird, cruise: Cruise, reference: Reference) -> Ratios:
    """Compute the ratios to the reference."""
    return Ratios(
        bird.span / (2.0 * reference.value("wing", "semispan")),
        bird.mass / reference.mass,
        cruise.airspeed / reference.airspeed,
        reference.frequency / bird.frequency,
        bird.root_chord / reference.value("wing", "root_chord"),
        bird.tail_arm / -reference.world["bodies"]["elevator"]["place"]["value"][0],
        bird.tail_area / reference.world["plates"]["tailplane"]["area"]["value"],
        cruise.power / reference.power,
        FULL_CELL * bird.cells / reference.value("battery", "full_voltage"),
    )


def law_of(unit: str, section: str, ratios: Ratios) -> tuple[float, str]:
    """Return factor and law of a value with ``unit`` in ``section``; ``(1, "")`` if it does not scale."""
    length, time = ratios.length, ratios.length / ratios.speed
    words = {"m": "span", "s": "span / speed"}
    if section in PATH:
        length, time = ratios.speed**2, ratios.speed
        words = {"m": "speed^2", "s": "speed"}
    if section in WINGS:
        time, words["s"] = ratios.period, "flapping period"
    base = {
        "m": (length, words["m"]), "s": (time, words["s"]), "Hz": (1.0 / ratios.period, "flapping rate"),
        "kg": (ratios.mass, "mass"), "N": (ratios.mass, "mass"), "A": (ratios.current, "power / voltage"),
        "V": (ratios.voltage, "cells"), "ohm": (ratios.voltage / ratios.current, "voltage / current"),
        "C": (ratios.current * ratios.length / ratios.speed, "charge"),
    }  # fmt: skip
    if section not in WINGS:
        base["Hz"] = (1.0, "")
    factor, told, sign = 1.0, [], 1
    for token in re.findall(r"[A-Za-z]+(?:\^\d+)?|/", unit):
        name, _, power = token.partition("^")
        if token == "/":
            sign = -1
        elif name in base and base[name][1]:
            exponent = sign * int(power or 1)
            factor *= base[name][0] ** exponent
            told.append(f"({base[name][1]})^{exponent}" if exponent != 1 else base[name][1])
        elif name not in ("rad", "counts"):
            return 1.0, ""
    return factor, " x ".join(told)


def scaled(document: Mapping[str, Any], ratios: Ratios, reference: str, fixed: tuple[str, ...] = ()) -> Document:
    """Return a vehicle document with each value scaled by its unit, but in ``fixed`` sections, and its source."""

    def of_section(table: Mapping[str, Any], section: str) -> Document:
        return {
            key: entry
            if not isinstance(entry, dict)
            else _entry(entry, section in (*UNSCALED, *fixed), section, ratios, reference)
            if "value" in entry
            else of_section(entry, section)
            for key, entry in table.items()
        }

    return {
        section: of_section(table, section) if isinstance(table, dict) else table
        for section, table in document.items()
    }


def _entry(entry: Mapping[str, Any], fixed: bool, section: str, ratios: Ratios, reference: str) -> Document:
    value = entry["value"]
    unit = {key: entry[key] for key in ("unit",) if key in entry}
    number = isinstance(value, int | float) and not isinstance(value, bool)
    factor, law = (1.0, "") if fixed else law_of(str(entry.get("unit", "-")), section, ratios)
    if not law or not (number or isinstance(value, list)):
        return {"value": value, **unit, "source": f"{DEFAULT} {reference}"}
    new = rounded(value * factor) if number else [rounded(one * factor) for one in value]
    return {"value": new, **unit, "source": f"{SCALED} {reference} by {law}"}


def rounded(value: float) -> float:
    """Round to five digits, as in the files."""
    return float(f"{value:.5g}")


def put(document: Document, path: str, value: Any, source: str) -> None:
    """Set ``section.key`` or ``section.name.key`` of a vehicle document and its source.

    Raises:
        InputError: the document has no such entry.
    """
    *sections, key = path.split(".")
    table = document
    for name in sections:
        table = table.get(name, {})
    if key not in table:
        raise InputError(f"the reference vehicle has no {path}")
    table[key] = {**table[key], "value": value, "source": source}


def world_document(bird: NewBird, cruise: Cruise, reference: Reference, name: str) -> Document:
    """Return the world file of a new vehicle with one motor on a crank.

    Raises:
        InputError: the wings and the tail are as heavy as the vehicle.
    """
    ratios, known = ratios_of(bird, cruise, reference), reference.name
    world = scaled(reference.world, ratios, known, STRUCTURE)
    world |= {"name": name, "title": f"{name}: {bird.mass:g} kg, span {bird.span:g} m, scaled from {known}"}
    put(world, "wing.semispan", rounded(bird.span / 2.0), GIVEN)
    put(world, "wing.root_chord", rounded(bird.root_chord), f"{GIVEN}: elliptic wings of {bird.area:g} m^2")
    put(world, "strip_theory.suction_efficiency", MEMBRANE_SUCTION, "chosen: default, a membrane wing, as slow_hawk")
    for key, factor, law in (
        ("twist_stiffness", ratios.mass * ratios.chord, "mass x chord"),
        ("twist_damping", ratios.mass * ratios.chord * ratios.period, "mass x chord x flapping period"),
    ):  # air loads twist a membrane by weight times chord
        put(world, f"wing.{key}", rounded(reference.value("wing", key) * factor), f"{SCALED} {known} by {law}")
    put(world, "plates.tailplane.area", bird.tail_area, GIVEN)
    fin = rounded(reference.world["plates"]["fin"]["area"]["value"] * ratios.tail_area)
    put(world, "plates.fin.area", fin, f"{SCALED} {known} by tail area")
    put(world, "cruise.airspeed", rounded(cruise.airspeed), "chosen: predicted from the Strouhal number")
    put(world, "cruise.frequency", bird.frequency, GIVEN)
    put(world, "cruise.stroke_amplitude", bird.stroke, GIVEN)
    for key in ("drag_area", "side_area"):
        area = rounded(reference.value("fuselage", key) * ratios.mass ** (2.0 / 3.0))
        put(world, f"fuselage.{key}", area, f"{SCALED} {known} by mass^(2/3), as bodies of birds (Pennycuick 2008)")
    _put_bodies(world, bird, reference, ratios)
    _put_drive(world, bird, reference)
    _put_tail_panels(world, bird)
    _put_structure(world, reference, ratios)
    return world


def _put_bodies(world: Document, bird: NewBird, reference: Reference, ratios: Ratios) -> None:
    """Put the tail at its arm, the wings by their chord, and the center of mass at the origin."""
    bodies, known = world["bodies"], reference.name
    x, y, z = reference.world["bodies"]["right_wing"]["place"]["value"]
    hinge = [rounded(x * ratios.chord), rounded(y * ratios.length), rounded(z * ratios.length)]
    put(world, "bodies.right_wing.place", hinge, f"{SCALED} {known} by span, along x by chord")
    for part in ("elevator", "rudder"):
        height = bodies[part]["place"]["value"][2]
        put(world, f"bodies.{part}.place", [-bird.tail_arm, 0.0, height], GIVEN)
    tail = [(bodies[part]["mass"]["value"], bodies[part]["place"]["value"]) for part in ("elevator", "rudder")]
    wings = 2.0 * (bodies["right_wing"]["mass"]["value"] + world["wing"]["membrane_mass"]["value"])
    body = bird.mass - wings - sum(mass for mass, _ in tail)
    if body <= SMALLEST_BODY * bird.mass:
        raise InputError(f"{bird.mass:g} kg leave {body:.3g} kg for fuselage, drive and battery")
    put(world, "bodies.fuselage.mass", rounded(body), f"{GIVEN}: {bird.mass:g} kg less wings and tail")
    center = [rounded(-sum(mass * at[axis] for mass, at in tail) / body) for axis in range(3)]
    put(world, "bodies.fuselage.center", center, "chosen: the origin is the common center of mass with the tail")
    across, along = ratios.mass * ratios.length**2, ratios.mass * ratios.arm**2
    mixed = ratios.mass * ratios.length * ratios.arm
    factors = (across, along, along, mixed, mixed, mixed)
    old = reference.world["bodies"]["fuselage"]["inertia"]["value"]
    inertia = [rounded(one * factor) for one, factor in zip(old, factors, strict=True)]
    put(world, "bodies.fuselage.inertia", inertia, f"{SCALED} {known} by mass, span and tail arm")


def _put_drive(world: Document, bird: NewBird, reference: Reference) -> None:
    known = reference.name
    put(world, "drive.crank_amplitude", bird.stroke, GIVEN)
    put(world, "drive.travel", max(reference.value("drive", "travel"), round(bird.stroke + 0.4, 2)),
        f"{GIVEN}: beyond the stroke")  # fmt: skip
    full = rounded(FULL_CELL * bird.cells)
    for key, value in (("full_voltage", full), ("empty_voltage", rounded(EMPTY_CELL * bird.cells))):
        put(world, f"battery.{key}", value, f"{GIVEN}: {bird.cells} lithium-polymer cells")
    put(world, "battery.capacity", rounded(PACK * bird.capacity), f"{GIVEN}: {bird.capacity:g} A h")
    put(world, "drive.nominal_voltage", rounded(3.7 * bird.cells), f"{GIVEN}: {bird.cells} lithium-polymer cells")
    # A current sensor of the size of the drive: the ADC sees the same voltages as in the reference.
    pulse = world["drive"]["pulse_current"]["value"] / reference.value("drive", "pulse_current")
    for key, factor in (
        ("current_range", pulse), ("current_noise", pulse), ("current_zero_sigma", pulse),
        ("current_sensitivity", 1.0 / pulse), ("voltage_noise", 1.0), ("reference", 1.0), ("current_zero", 1.0),
        ("edge", 1.0),
    ):  # fmt: skip
        value = rounded(reference.value("power_sensor", key) * factor)
        source = f"{SCALED} {known} by current" if factor != 1.0 else f"{DEFAULT} {known}"
        put(world, f"power_sensor.{key}", value, source)
    limit = 0.95 * reference.value("power_sensor", "reference") / full
    divider = rounded(min(reference.value("power_sensor", "divider"), limit))
    put(world, "power_sensor.divider", divider, "chosen: a full battery stays below the ADC's reference")


def _put_structure(world: Document, reference: Reference, ratios: Ratios) -> None:
    """Scale the structural modes: frequency and rotation by displacement go with the inverse of the span."""
    known = reference.name
    if "vibration" in world:
        rate = rounded(reference.value("vibration", "reference_rate") / ratios.period)
        put(world, "vibration.reference_rate", rate, f"{SCALED} {known} by flapping rate")
        if "airspeed_buffet" in world["vibration"]:
            buffet = rounded(reference.value("vibration", "airspeed_buffet") / ratios.speed**2)
            put(world, "vibration.airspeed_buffet", buffet, f"{SCALED} {known} by 1 / speed^2")
        for key in ("washout_difference", "membrane_difference", "stroke_difference"):
            put(world, f"vibration.{key}", 0.0, f"{DEFAULT}: equal wings; measure yours")
    for name, mode in reference.world.get("modes", {}).items():
        source = f"{SCALED} {known} by 1 / span"
        put(world, f"modes.{name}.frequency", rounded(mode["frequency"]["value"] / ratios.length), source)
        rotation = [rounded(one / ratios.length) for one in mode["rotation"]["value"]]
        put(world, f"modes.{name}.rotation", rotation, source)


def _put_tail_panels(world: Document, bird: NewBird) -> None:
    """Give the tail of the vortex lattice its size; tailplane of aspect ratio 2, square fin."""
    chord, height = math.sqrt(bird.tail_area / 2.0), math.sqrt(world["plates"]["fin"]["area"]["value"])
    for key, value in (
        ("tail_place", [-bird.tail_arm, 0.0, 0.0]), ("tail_span", rounded(2.0 * chord)),
        ("tail_chord", rounded(chord)),
        ("fin_place", [-bird.tail_arm, 0.0, world["bodies"]["rudder"]["place"]["value"][2]]),
        ("fin_height", rounded(height)), ("fin_chord", rounded(height)),
    ):  # fmt: skip
        put(world, f"vortex_lattice.{key}", value, f"{GIVEN}: area and arm of the tail")
