"""Names that mean something to the methods, with their dimension; numbers of a map in any unit of that dimension."""

from __future__ import annotations

import math
import reprlib
from typing import Any, NamedTuple

from logs.importing.units import CONVERSIONS, Conversion
from wingbeat.atmosphere import isa
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.schema import check_keys, check_known, check_table, read_number

SIGNALS = {
    "V": "m/s", "alpha": "rad", "beta": "rad", "p": "rad/s", "q": "rad/s", "r": "rad/s", "phi": "rad",
    "theta": "rad", "psi": "rad", "a_x": "m/s^2", "a_y": "m/s^2", "a_z": "m/s^2", "p_dot": "rad/s^2",
    "q_dot": "rad/s^2", "r_dot": "rad/s^2", "u": "m/s", "v": "m/s", "w": "m/s", "qbar": "Pa", "rho": "kg/m^3",
    "altitude": "m", "thrust": "N", "alpha_dot": "rad/s", "beta_dot": "rad/s",
    "climb_rate": "m/s", "north": "m", "east": "m", "airspeed": "m/s",
}  # fmt: skip
"""SI unit of what has a fixed meaning, in body axes FRD; a_x, a_y, a_z are specific forces, a_z -9.81 at rest"""
WIDEST_ANGLE = 4.0 * math.pi
"""rad; an angle, a control's too, that goes beyond it was not in radians"""
ANGLES = ("alpha", "beta", "theta")
"""that cannot leave -pi to pi"""


class Measure(NamedTuple):
    """A number of a map in its unit: ``{ value = 4500, unit = "lb" }``, or a plain number in SI."""

    value: float
    """as `unit`"""
    unit: str | None
    """None for SI"""
    key: str

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Measure:
        """Of a map's entry.

        Raises:
            InputError: it is neither.
        """
        if not isinstance(entry, dict):
            return cls(read_number(entry, key), None, key)
        for name in entry:
            check_known(name, ("value", "unit"), f"{key}.{name}")
        if "value" not in entry or "unit" not in entry:
            raise InputError(f'{key} must be a number in SI or {{ value = ..., unit = "..." }}')
        return cls(read_number(entry["value"], f"{key}.value"), entry["unit"], key)

    def si(self, unit: str, low: float = -math.inf, high: float = math.inf) -> float:
        """The number in SI ``unit``.

        Raises:
            InputError: it is in the unit of something else, or not above ``low`` and up to ``high``.
        """
        value = self.value
        if self.unit is not None:
            known = converted(self.unit, unit, self.key)
            value = value * known.factor + known.offset
        if not low < value <= high:
            limit = f"above {low:g}" if value <= low else f"at most {high:g}"
            raise InputError(f"{self.key} = {value:g} {unit} must be {limit}")
        return value


def converted(unit: Any, si_unit: str | None, key: str) -> Conversion:
    """How ``unit`` becomes the SI unit ``si_unit``, any where that is None.

    Raises:
        InputError: it is not known, or in another dimension.
    """
    fitting = [name for name, one in CONVERSIONS.items() if name and si_unit in (None, one.unit)]
    if not isinstance(unit, str) or unit not in CONVERSIONS:
        raise InputError(f"{key}: unit {reprlib.repr(unit)} is not known; known: {', '.join(fitting)}")
    known = CONVERSIONS[unit]
    if si_unit not in (None, known.unit):
        raise InputError(f"{key} is in {si_unit}; {unit!r} cannot be that (known: {', '.join(fitting)})")
    return known


def in_unit(value: float, unit: Any, si_unit: str, key: str) -> float:
    """``value`` in SI ``si_unit``.

    Raises:
        InputError: as `converted`.
    """
    known = converted(unit, si_unit, key)
    return value * known.factor + known.offset


UNITS = {
    "mass": "kg", "weight": "N", "I_x": "kg m^2", "I_y": "kg m^2", "I_z": "kg m^2", "I_xz": "kg m^2", "S": "m^2",
    "c": "m", "b": "m", "rho": "kg/m^3", "altitude": "m", "V": "m/s", "alpha": "rad", "theta": "rad", "phi": "rad",
    "qbar": "Pa", "thrust": "N", "thrust_angle": "rad", "thrust_x": "m", "thrust_z": "m",
    "imu_x": "m", "imu_y": "m", "imu_z": "m", "vane_x": "m", "flapping": "Hz",
}  # fmt: skip
"""SI unit of each constant"""
POSITIVE = ("mass", "weight", "I_x", "I_y", "I_z", "S", "c", "b", "rho", "V", "qbar", "flapping")
MASSES = ("lb", "kg", "slug")
"""units of a weight that is given as a mass"""


class ConstantsSection(NamedTuple):
    """Section [constants]: quantities by name (`UNITS`), and further numbers by any name."""

    quantities: dict[str, Measure] = {}
    others: dict[str, float] = {}
    """as the regressors use them"""

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> ConstantsSection:
        """Read the section.

        Raises:
            InputError: an unknown name, or no number.
        """
        table = dict(check_table(entry, key))
        others = check_table(table.pop("others", {}), f"{key}.others")
        check_keys(table, (*UNITS, "others"), key)
        return cls(
            {name: Measure.from_entry(value, f"{key}.{name}") for name, value in table.items()},
            {name: read_number(value, f"{key}.others.{name}") for name, value in others.items()},
        )


ALTITUDES = (-1000.0, 20000.0)


def read_constants(section: ConstantsSection) -> dict[str, float]:
    """What was known, by name in SI; the mass from the weight, the density from the altitude.

    Raises:
        InputError: a unit of something else, a mass that is not positive, or one thing known twice.
    """
    known = dict(section.others)
    for name, measure in section.quantities.items():
        if name == "weight" and measure.unit in MASSES:
            known["mass"] = measure.si(UNITS["mass"], 0.0)
        else:
            known[name] = measure.si(UNITS[name], 0.0 if name in POSITIVE else -math.inf)
    for name, other in (("mass", "weight"), ("rho", "altitude")):
        if {name, other} <= section.quantities.keys():
            raise InputError(f"constants.{name} and constants.{other} are the same: give one")
    if "weight" in known:
        known["mass"] = known.pop("weight") / STANDARD_GRAVITY
    if "altitude" in known:
        known["rho"] = density(known["altitude"])
    for name in ("alpha", "theta", "phi"):
        if not abs(known.get(name, 0.0)) < math.pi:
            raise InputError(f"constants.{name} = {known[name]:g} rad is no angle of an aircraft: is its unit known?")
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
    """Refuse where one of ``names`` was not known.

    Raises:
        InputError: with the keys that are missing.
    """
    absent = [f"constants.{name}" for name in names if name not in constants]
    if absent:
        raise InputError(f"{what} needs {', '.join(absent)}")
