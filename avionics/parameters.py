"""Numeric vehicle parameters with a stable name, a range and a unit.

A name has at most 16 characters: the prefix of the section and the name of the gain, with words shortened by
``WORDS`` and then letter by letter until it fits. ``pitch.proportional`` is PITCH_P. Names must not change after a
flight, because logs and ground stations contain them.
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import Any, NamedTuple, get_args, get_origin

from avionics.gains import FlightGains
from avionics.limits import clip
from avionics.messages import Mode
from avionics.mixing import flapping
from wingbeat.docstrings import field_texts, split_unit, type_hints
from wingbeat.errors import InputError
from wingbeat.units import Quantity

LONGEST_NAME = 16
"""characters; limit of a MAVLink parameter name"""

PREFIXES = {
    "plausibility": "SENS",
    "imu": "IMU",
    "ahrs": "AHRS",
    "encoders": "ENC",
    "wing_angle": "WING",
    "power": "PWR",
    "air_data": "AIR",
    "torque": "TRQ",
    "altitude_filter": "AFIL",
    "position_filter": "PFIL",
    "receiver": "RC",
    "airspeed_check": "CHKA",
    "wing_check": "CHKW",
    "tail_check": "CHKT",
    "modes": "MODE",
    "navigation": "NAV",
    "altitude": "ALT",
    "heading": "HDG",
    "excitation": "EXC",
    "pitch": "PITCH",
    "roll": "ROLL",
    "flapping": "FLAP",
    "tail": "TAIL",
    "preflight": "PRE",
    "throttle_descent": "TDSC",
}
WORDS = {
    "proportional": "P",
    "integral": "I",
    "damping": "D",
    "altitude": "ALT",
    "approach": "APP",
    "throttle": "THR",
    "elevator": "ELEV",
    "frequency": "FREQ",
    "airspeed": "ASPD",
    "acceleration": "ACC",
    "touchdown": "TD",
    "battery": "BAT",
    "heading": "HDG",
    "capture": "CAP",
    "tolerance": "TOL",
    "variance": "VAR",
    "voltage": "VOLT",
    "current": "CURR",
    "static": "STAT",
    "differential": "DIFF",
    "temperature": "TEMP",
    "offset": "OFS",
    "counts": "CNT",
    "noise": "NSE",
    "delay": "DLY",
    "limit": "LIM",
    "radius": "RAD",
    "share": "SHR",
    "launch": "LCH",
    "loss": "LOSS",
    "sensitivity": "SENS",
    "reference": "REF",
    "pressure": "PRES",
    "position": "POS",
    "velocity": "VEL",
    "patience": "PAT",
    "flapping": "FLAP",
    "amplitude": "AMP",
    "encoder": "ENC",
    "speed": "SPD",
    "stick": "STK",
    "width": "WID",
    "climb": "CLMB",
    "trim": "TRIM",
    "asymmetry": "ASYM",
    "rudder": "RUD",
    "least": "MIN",
    "release": "REL",
    "points": "PT",
    "offboard": "OFFB",
}


GROUNDED = {
    "imu": (),
    "wing_angle": ("zero_left", "zero_right"),
    "receiver": ("mode_channel", "arm_channel", "kill_channel"),
}
"""keys by section, or all of a section, that are dangerous to change in flight: denied while armed"""


_CHANNELS = ((0, "none"), *((number, f"channel {number}") for number in range(1, 19)))
_MODES = tuple((int(mode), mode.name) for mode in Mode if mode != Mode.OFFBOARD)
CHOICES: dict[str, tuple[tuple[int, str], ...]] = {
    "ahrs.method": ((0, "block averages and GPS"), (1, "Razor")),
    "navigation.return_type": (
        (0, "home or rally point"),
        (1, "landing sequence after the circle at home"),
        (2, "landing sequence at once"),
    ),
    "receiver.mode_channel": _CHANNELS,
    "receiver.arm_channel": _CHANNELS,
    "receiver.kill_channel": _CHANNELS,
    "receiver.mode_low": _MODES,
    "receiver.mode_middle": _MODES,
    "receiver.mode_high": _MODES,
    "receiver.reverse": ((-1, "reversed"), (1, "normal")),
}
"""meaning of each value of the keys that are an enumeration"""


class Parameter(NamedTuple):
    """Numeric parameter as presented to a ground station."""

    name: str
    """-; at most 16 characters, unique, stable"""
    section: str
    """-; section of the vehicle file"""
    key: str
    """-; key in the section"""
    place: int
    """-; index in a list, -1 for a single number"""
    unit: str
    """-; unit of the value"""
    low: float
    """minimum value"""
    high: float
    """maximum value"""
    whole: bool
    """True if only integers are allowed"""
    text: str
    """key in the vehicle file"""
    description: str = ""
    """-; docstring of the gain without its unit"""


class Change(NamedTuple):
    """Result of a request to set a parameter."""

    gains: FlightGains
    """parameters after the request"""
    value: float
    """value after the request"""
    accepted: bool
    """False if nothing was changed"""
    text: str
    """description in one line"""


def short_name(section: str, key: str, index: int = -1) -> str:
    """Return the name of a parameter.

    It consists of the prefix, the words of the key shortened until they fit, and the index in a list from 1.
    """
    tail = "" if index < 0 else f"_{index + 1}"
    prefix = PREFIXES.get(section, section.upper())
    room = LONGEST_NAME - len(prefix) - 1 - len(tail)
    words = [WORDS.get(word, word.upper()) for word in key.split("_")]
    if room < 2 * len(words) - 1:
        raise ValueError(f"{section}.{key}: no room for a name of {LONGEST_NAME} characters, add a row to PREFIXES")
    while len("_".join(words)) > room:
        longest = max(range(len(words)), key=lambda i: len(words[i]))
        words[longest] = words[longest][:-1]
    return f"{prefix}_{'_'.join(words)}{tail}"


def parameter_table(gains: FlightGains) -> dict[str, Parameter]:
    """Return all parameters of ``gains`` by name, in the order of the vehicle file.

    Raises:
        ValueError: two gains would have the same name.
    """
    return dict(_table(tuple(_shape(name, section) for name, section in zip(gains._fields, gains, strict=True))))


class _Shape(NamedTuple):
    """Structure of a section, independent of its values."""

    section: str
    kind: type[Any]
    lengths: tuple[int, ...]
    """-; lengths of its lists, -1 for scalars"""


def _shape(name: str, section: Any) -> _Shape:
    lengths = tuple(len(value) if isinstance(value, tuple) else -1 for value in section)
    return _Shape(name, type(section), lengths)


@lru_cache(maxsize=16)
def _table(shapes: tuple[_Shape, ...]) -> dict[str, Parameter]:
    """Build the table once, in 8 ms, because a tick of 5 ms may set a parameter."""
    table: dict[str, Parameter] = {}
    for shape in shapes:
        for parameter in _section_parameters(shape):
            if parameter.name in table:
                raise ValueError(f"two gains are called {parameter.name}")
            table[parameter.name] = parameter
    return table


def _section_parameters(shape: _Shape) -> list[Parameter]:
    found: list[Parameter] = []
    hints = type_hints(shape.kind)
    texts = _texts(shape.kind)
    for key, length in zip(shape.kind._fields, shape.lengths, strict=True):
        base, quantity = _numeric(hints[key])
        if base is None:
            continue
        found += [
            Parameter(
                short_name(shape.section, quantity.formerly or key, i),
                shape.section,
                key,
                i,
                quantity.unit,
                quantity.low,
                quantity.high,
                base is int,
                f"{shape.section}.{key}",
                split_unit(texts.get(key, ""))[1],
            )
            for i in (range(length) if length >= 0 else (-1,))
        ]
    return found


def _texts(kind: type[Any]) -> dict[str, str]:
    """Return the field docstrings; empty if installed without source."""
    try:
        return field_texts(kind.__module__).get(kind.__name__, {})
    except OSError:
        return {}


def _numeric(hint: Any) -> tuple[type[Any] | None, Quantity]:
    """Return the number type of a field (None for text and switches) and its quantity."""
    base, quantity = hint, Quantity("-")
    if hasattr(hint, "__metadata__"):
        base = get_args(hint)[0]
        quantity = next((extra for extra in hint.__metadata__ if isinstance(extra, Quantity)), quantity)
    if get_origin(base) is tuple:
        base = get_args(base)[0]
        if hasattr(base, "__metadata__"):
            return _numeric(base)
    return (base if base in (int, float) else None), quantity


def grounded(parameter: Parameter) -> bool:
    """Return whether the parameter may be set only while disarmed."""
    keys = GROUNDED.get(parameter.section)
    return keys is not None and (not keys or parameter.key in keys)


def choices(parameter: Parameter) -> tuple[tuple[int, str], ...]:
    """Return the meaning of each value; empty for a measure."""
    return CHOICES.get(f"{parameter.section}.{parameter.key}", ())


def get(gains: FlightGains, parameter: Parameter) -> float:
    """Return the value of ``parameter`` in ``gains``."""
    value = getattr(getattr(gains, parameter.section), parameter.key)
    return float(value if parameter.place < 0 else value[parameter.place])


def single(value: float) -> float:
    """Round to the nearest 32-bit float, as in a MAVLink parameter message."""
    if not abs(value) < 3.4e38:
        return value
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def set_value(gains: FlightGains, table: dict[str, Parameter], name: str, value: float) -> Change:
    """Return gains with ``name`` set to ``value``.

    The value is limited to its range and rounded to a 32-bit float. An unknown name or a value that is not a number
    changes nothing; the text of the `Change` contains the reason.
    """
    parameter = table.get(name)
    if parameter is None:
        return Change(gains, 0.0, False, f"unknown parameter {name}")
    if math.isnan(value):
        return Change(gains, get(gains, parameter), False, f"{name} rejected: not a number")
    held = single(clip(single(value), single(parameter.low), single(parameter.high)))
    if parameter.whole:
        held = float(round(held))
    changed = _replaced(gains, parameter, held)
    try:
        flapping.check(changed.flapping)
    except InputError as error:
        return Change(gains, get(gains, parameter), False, f"{name} rejected: {error}")
    unit = f" {parameter.unit}" if parameter.unit != "-" else ""
    if held == single(value):
        return Change(changed, held, True, f"{name} set to {held:g}{unit}")
    bounds = "a whole number" if parameter.whole else f"{parameter.low:g} to {parameter.high:g}{unit}"
    return Change(changed, held, True, f"{name} set to {held:g}{unit}: {value:g} is out of range, {bounds}")


def changed(before: FlightGains, after: FlightGains) -> dict[str, float]:
    """Return the parameters that differ between two sets of gains, by name."""
    now = {name: get(after, entry) for name, entry in parameter_table(after).items()}
    was = {name: get(before, entry) for name, entry in parameter_table(before).items()}
    return {name: value for name, value in now.items() if value != was.get(name)}


def _replaced(gains: FlightGains, parameter: Parameter, value: float) -> FlightGains:
    section = getattr(gains, parameter.section)
    number: float | int = int(value) if parameter.whole else value
    if parameter.place < 0:
        return gains._replace(**{parameter.section: section._replace(**{parameter.key: number})})
    values = list(getattr(section, parameter.key))
    values[parameter.place] = number
    return gains._replace(**{parameter.section: section._replace(**{parameter.key: tuple(values)})})
