"""Names that mean something to the methods, with their dimension; numbers of a map in any unit of that dimension."""

from __future__ import annotations

import math
import reprlib
from typing import Any, NamedTuple

from logs.importing.units import CONVERSIONS, Conversion
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_number

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
            told = converted(self.unit, unit, self.key)
            value = value * told.factor + told.offset
        if not low < value <= high:
            limit = f"above {low:g}" if value <= low else f"at most {high:g}"
            raise InputError(f"{self.key} = {value:g} {unit} must be {limit}")
        return value


def converted(unit: Any, wanted: str | None, key: str) -> Conversion:
    """How ``unit`` becomes the SI unit ``wanted``, any where that is None.

    Raises:
        InputError: it is not known, or in another dimension.
    """
    fitting = [name for name, one in CONVERSIONS.items() if name and wanted in (None, one.unit)]
    if not isinstance(unit, str) or unit not in CONVERSIONS:
        raise InputError(f"{key}: unit {reprlib.repr(unit)} is not known; known: {', '.join(fitting)}")
    told = CONVERSIONS[unit]
    if wanted not in (None, told.unit):
        raise InputError(f"{key} is in {wanted}; {unit!r} cannot be that (known: {', '.join(fitting)})")
    return told


def in_unit(value: float, unit: Any, wanted: str, key: str) -> float:
    """``value`` in SI ``wanted``.

    Raises:
        InputError: as `converted`.
    """
    told = converted(unit, wanted, key)
    return value * told.factor + told.offset
