"""Units of logs, their SI factors, and physical limits."""

from __future__ import annotations

import math
from typing import NamedTuple

from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError


class Conversion(NamedTuple):
    """SI value = value * factor + offset."""

    unit: str
    factor: float
    offset: float = 0.0


_DEG, _INCH, _POUND = math.radians(1.0), 0.0254, 0.45359237
_FOOT = 12.0 * _INCH
_SLUG = _POUND * STANDARD_GRAVITY / _FOOT
CONVERSIONS: dict[str, Conversion] = {
    "-": Conversion("-", 1.0),
    "": Conversion("-", 1.0),
    "%": Conversion("-", 0.01),
    "counts": Conversion("counts", 1.0),
    "s": Conversion("s", 1.0),
    "ms": Conversion("s", 1e-3),
    "us": Conversion("s", 1e-6),
    "ns": Conversion("s", 1e-9),
    "min": Conversion("s", 60.0),
    "Hz": Conversion("Hz", 1.0),
    "kHz": Conversion("Hz", 1e3),
    "rpm": Conversion("Hz", 1.0 / 60.0),
    "rad": Conversion("rad", 1.0),
    "mrad": Conversion("rad", 1e-3),
    "deg": Conversion("rad", _DEG),
    "cdeg": Conversion("rad", 1e-2 * _DEG),
    "degE7": Conversion("rad", 1e-7 * _DEG),
    "rev": Conversion("rad", 2.0 * math.pi),
    "rad/s": Conversion("rad/s", 1.0),
    "mrad/s": Conversion("rad/s", 1e-3),
    "deg/s": Conversion("rad/s", _DEG),
    "rad/s^2": Conversion("rad/s^2", 1.0),
    "deg/s^2": Conversion("rad/s^2", _DEG),
    "m": Conversion("m", 1.0),
    "cm": Conversion("m", 1e-2),
    "mm": Conversion("m", 1e-3),
    "in": Conversion("m", _INCH),
    "ft": Conversion("m", _FOOT),
    "m/s": Conversion("m/s", 1.0),
    "cm/s": Conversion("m/s", 1e-2),
    "mm/s": Conversion("m/s", 1e-3),
    "km/h": Conversion("m/s", 1.0 / 3.6),
    "kn": Conversion("m/s", 1852.0 / 3600.0),
    "kt": Conversion("m/s", 1852.0 / 3600.0),
    "mph": Conversion("m/s", 5280.0 * _FOOT / 3600.0),
    "ft/s": Conversion("m/s", _FOOT),
    "m/s^2": Conversion("m/s^2", 1.0),
    "m/s/s": Conversion("m/s^2", 1.0),
    "ft/s^2": Conversion("m/s^2", _FOOT),
    "g": Conversion("m/s^2", STANDARD_GRAVITY),
    "mG": Conversion("m/s^2", 1e-3 * STANDARD_GRAVITY),
    "m^2": Conversion("m^2", 1.0),
    "cm^2": Conversion("m^2", 1e-4),
    "in^2": Conversion("m^2", _INCH**2),
    "ft^2": Conversion("m^2", _FOOT**2),
    "m^2/s^2": Conversion("m^2/s^2", 1.0),
    "V": Conversion("V", 1.0),
    "cV": Conversion("V", 1e-2),
    "mV": Conversion("V", 1e-3),
    "A": Conversion("A", 1.0),
    "cA": Conversion("A", 1e-2),
    "mA": Conversion("A", 1e-3),
    "W": Conversion("W", 1.0),
    "mW": Conversion("W", 1e-3),
    "C": Conversion("C", 1.0),
    "mAh": Conversion("C", 3.6),
    "Ah": Conversion("C", 3600.0),
    "J": Conversion("J", 1.0),
    "hJ": Conversion("J", 100.0),
    "Wh": Conversion("J", 3600.0),
    "ohm": Conversion("ohm", 1.0),
    "mohm": Conversion("ohm", 1e-3),
    "Pa": Conversion("Pa", 1.0),
    "hPa": Conversion("Pa", 100.0),
    "mbar": Conversion("Pa", 100.0),
    "kPa": Conversion("Pa", 1e3),
    "psf": Conversion("Pa", _POUND * STANDARD_GRAVITY / _FOOT**2),
    "psi": Conversion("Pa", _POUND * STANDARD_GRAVITY / _INCH**2),
    "K": Conversion("K", 1.0),
    "degC": Conversion("K", 1.0, 273.15),
    "cdegC": Conversion("K", 0.01, 273.15),
    "kg/m^3": Conversion("kg/m^3", 1.0),
    "slug/ft^3": Conversion("kg/m^3", _SLUG / _FOOT**3),
    "kg": Conversion("kg", 1.0),
    "gram": Conversion("kg", 1e-3),
    "lb": Conversion("kg", _POUND),
    "slug": Conversion("kg", _SLUG),
    "kg m^2": Conversion("kg m^2", 1.0),
    "gram cm^2": Conversion("kg m^2", 1e-7),
    "lb ft^2": Conversion("kg m^2", _POUND * _FOOT**2),
    "slug ft^2": Conversion("kg m^2", _SLUG * _FOOT**2),
    "gauss": Conversion("gauss", 1.0),
    "mgauss": Conversion("gauss", 1e-3),
    "uT": Conversion("gauss", 1e-2),
    "T": Conversion("gauss", 1e4),
    "N": Conversion("N", 1.0),
    "mN": Conversion("N", 1e-3),
    "kN": Conversion("N", 1e3),
    "gf": Conversion("N", 1e-3 * STANDARD_GRAVITY),
    "lbf": Conversion("N", _POUND * STANDARD_GRAVITY),
    "N m": Conversion("N m", 1.0),
    "mN m": Conversion("N m", 1e-3),
    "N mm": Conversion("N m", 1e-3),
}
"""Conversions by unit name; ``g`` is the acceleration, ``gf`` a gram-force, ``lb`` a mass, ``lbf`` a force."""

LIMITS: dict[str, tuple[float, float]] = {
    "rad": (-4.0 * math.pi, 4.0 * math.pi),
    "rad/s": (-200.0, 200.0),
    "m": (-2e4, 1e5),
    "m/s": (-500.0, 500.0),
    "m/s^2": (-2000.0, 2000.0),
    "V": (-1000.0, 1000.0),
    "A": (-1000.0, 1000.0),
    "W": (-1e5, 1e5),
    "Pa": (-2e5, 2e5),
    "K": (150.0, 500.0),
    "kg/m^3": (0.0, 3.0),
    "gauss": (-50.0, 50.0),
    "Hz": (-1e5, 1e5),
    "N": (-1e4, 1e4),
    "N m": (-1e3, 1e3),
}
"""Plausible limits of a quantity of small aircraft, by SI unit; values outside are not measurements."""


def conversion(unit: object) -> Conversion:
    """Return the conversion of a unit to SI.

    Raises:
        InputError: unknown unit; the message lists the known ones.
    """
    if not isinstance(unit, str) or unit not in CONVERSIONS:
        raise InputError(f"unit {unit!r} is not known; known: {', '.join(one for one in CONVERSIONS if one)}")
    return CONVERSIONS[unit]


def limits_in(unit: str) -> tuple[float, float] | None:
    """Return the plausible limits of a quantity in ``unit`` itself; None if the unit has no limits."""
    known = CONVERSIONS.get(unit)
    if known is None or known.unit not in LIMITS:
        return None
    low, high = LIMITS[known.unit]
    return (low - known.offset) / known.factor, (high - known.offset) / known.factor
