"""Section [constants] of a map: what must be known of the vehicle, in SI."""

from __future__ import annotations

import math
from typing import NamedTuple, get_type_hints

from logs.identification.sources.table.quantities import Measure
from wingbeat.atmosphere import isa
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError


class ConstantsSection(NamedTuple):
    """As written; every entry a number in SI or with a unit."""

    mass: Measure | None = None
    weight: Measure | None = None
    I_x: Measure | None = None
    I_y: Measure | None = None
    I_z: Measure | None = None
    I_xz: Measure | None = None
    S: Measure | None = None
    c: Measure | None = None
    b: Measure | None = None
    rho: Measure | None = None
    altitude: Measure | None = None
    V: Measure | None = None
    alpha: Measure | None = None
    theta: Measure | None = None
    phi: Measure | None = None
    qbar: Measure | None = None
    thrust: Measure | None = None
    thrust_angle: Measure | None = None
    thrust_x: Measure | None = None
    thrust_z: Measure | None = None
    imu_x: Measure | None = None
    imu_y: Measure | None = None
    imu_z: Measure | None = None
    vane_x: Measure | None = None
    flapping: Measure | None = None
    others: dict[str, float] = {}
    """as the regressors take them; any further numbers that those name"""


UNITS = {
    "mass": "kg", "weight": "N", "I_x": "kg m^2", "I_y": "kg m^2", "I_z": "kg m^2", "I_xz": "kg m^2", "S": "m^2",
    "c": "m", "b": "m", "rho": "kg/m^3", "altitude": "m", "V": "m/s", "alpha": "rad", "theta": "rad", "phi": "rad",
    "qbar": "Pa", "thrust": "N", "thrust_angle": "rad", "thrust_x": "m", "thrust_z": "m",
    "imu_x": "m", "imu_y": "m", "imu_z": "m", "vane_x": "m", "flapping": "Hz",
}  # fmt: skip
POSITIVE = ("mass", "weight", "I_x", "I_y", "I_z", "S", "c", "b", "rho", "V", "qbar", "flapping")
MASSES = ("lb", "kg", "slug")
"""units in which a weight is told as a mass is"""
ALTITUDES = (-1000.0, 20000.0)


def read_constants(section: ConstantsSection) -> dict[str, float]:
    """What was told, by name in SI; the mass from the weight, the density from the altitude.

    Raises:
        InputError: a unit of something else, a mass that is not positive, or one thing told twice.
    """
    known = dict(section.others)
    for name in get_type_hints(ConstantsSection):
        measure = getattr(section, name)
        if name == "weight" and measure is not None and measure.unit in MASSES:
            known["mass"] = measure.si(UNITS["mass"], 0.0)
        elif name != "others" and measure is not None:
            known[name] = measure.si(UNITS[name], 0.0 if name in POSITIVE else -math.inf)
    for name, other in (("mass", "weight"), ("rho", "altitude")):
        if getattr(section, name) is not None and getattr(section, other) is not None:
            raise InputError(f"constants.{name} and constants.{other} say the same: give one")
    if "weight" in known:
        known["mass"] = known.pop("weight") / STANDARD_GRAVITY
    if "altitude" in known:
        known["rho"] = density(known["altitude"])
    for name in ("alpha", "theta", "phi"):
        if not abs(known.get(name, 0.0)) < math.pi:
            raise InputError(f"constants.{name} = {known[name]:g} rad is no angle of an aircraft: is its unit told?")
    return {"g": STANDARD_GRAVITY, **known}


def density(altitude: float) -> float:
    """Density (kg/m^3) of the standard atmosphere at an ``altitude`` (m).

    Raises:
        InputError: beyond the two lowest layers.
    """
    low, high = ALTITUDES
    if not low <= altitude <= high:
        raise InputError(f"constants.altitude = {altitude:g} m is outside {low:g} to {high:g} m")
    return isa(altitude).density


def need(constants: dict[str, float], *names: str, what: str) -> None:
    """Refuse where one of ``names`` was not told.

    Raises:
        InputError: with the keys that are missing.
    """
    absent = [f"constants.{name}" for name in names if name not in constants]
    if absent:
        raise InputError(f"{what} needs {', '.join(absent)}")
