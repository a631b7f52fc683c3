"""The linear model that is tuned on: A and B of the stroke averages about a trim, from a vehicle or from a file.

The file is TOML (or JSON with the same keys), as `wingbeat linearize --out` writes it; SI and radians, body axes:

```
vehicle = "robo_raven_ii_d"              # name, file or folder of the vehicle that was linearised
origin = "wingbeat linearize ..."        # where the numbers come from

[trim]
airspeed = 6.8                           # m/s
pitch = 0.098                            # rad
frequency = 4.0                          # Hz, of flapping

[longitudinal]                           # states u m/s, w m/s, q rad/s, theta rad
a = [[...], [...], [...], [...]]
elevator = [...]                         # B of the achieved elevator angle, rad, nose up positive

[drive]                                  # may be left out: then climb and altitude are not tuned
input = "throttle"                       # or "half_stroke": what B is per, 0 to 1 or rad commanded
b = [...]
lag = 0.17                               # s, first-order, from the command to what acts
at = 0.35                                # of the input, at the trim

[lateral]                                # states v m/s, p rad/s, r rad/s, roll rad; may be left out
a = [[...], [...], [...], [...]]
rudder = [...]                           # B of the achieved rudder angle, rad, nose right positive

[identified]                             # where A and B are of a flight test; may be left out
log = "flight.mcap"                      # its name, and the SHA-256 of its bytes
sha256 = "..."
method = "output error"
elevator = -0.02                         # rad, achieved, at the trim
angle_of_attack = 0.09                   # rad, at the trim
density = 1.2                            # kg/m^3; may be left out

[identified.estimates.X_u]               # what was estimated, by its symbol
value = -0.21
standard_error = 0.03
low = -0.27                              # of the 95 % interval
high = -0.15
unit = "1/s"
```

A folder of the vehicle's name beside the file is the vehicle meant: `wingbeat identify --model` leaves both.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.averaged_axes import AxesModel
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.documents import parse_json, parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.text import read_error_text

THROTTLE, HALF_STROKE = "throttle", "half_stroke"
"""what the drive's B is per"""
SECTIONS = {
    "trim": ("airspeed", "pitch", "frequency"),
    "longitudinal": ("a", "elevator"),
    "drive": ("input", "b", "lag", "at"),
    "lateral": ("a", "rudder"),
    "identified": ("log", "sha256", "method", "elevator", "angle_of_attack"),
}
OPTIONAL = {"identified": ("density", "estimates")}
"""keys that may be left out"""
ESTIMATE = ("value", "standard_error", "low", "high")
DIGITS = 7


class DriveModel(NamedTuple):
    """How the drive moves the aircraft along."""

    input: str
    """-; THROTTLE, 0 to 1, or HALF_STROKE, rad commanded"""
    b: Floats
    """(4,); of (u, w, q, theta), per input after the lag"""
    lag: float
    """s; first-order"""
    at: float
    """of the input, at the trim"""


class LateralModel(NamedTuple):
    """Motion out of the plane of symmetry."""

    a: Floats
    """(4, 4); of (v m/s, p rad/s, r rad/s, roll rad)"""
    rudder: Floats
    """(4,); of the achieved rudder, rad"""


class IdentifiedValue(NamedTuple):
    """One estimate with its 95 % interval."""

    name: str
    """-; its symbol"""
    unit: str
    """-; of what follows"""
    value: float
    standard_error: float
    low: float
    high: float


class Identified(NamedTuple):
    """The flight test that a model is of."""

    log: str
    """-; name of the file"""
    sha256: str
    """-; of its bytes, in hexadecimal digits"""
    method: str
    elevator: float
    """rad; achieved, at the trim"""
    angle_of_attack: float
    """rad; at the trim"""
    density: float | None = None
    """kg/m^3; of the air, None where it is not known"""
    values: tuple[IdentifiedValue, ...] = ()


class LinearModel(NamedTuple):
    """Stroke-averaged motion about a trim."""

    vehicle: str
    """-; name, file or folder"""
    origin: str
    """-; where the numbers come from"""
    airspeed: float
    """m/s"""
    pitch: float
    """rad"""
    frequency: float
    """Hz; of flapping"""
    a: Floats
    """(4, 4); of (u m/s, w m/s, q rad/s, theta rad)"""
    elevator: Floats
    """(4,); of the achieved elevator, rad"""
    drive: DriveModel | None
    """None where it is not known"""
    lateral: LateralModel | None
    """None where it is not known"""
    identified: Identified | None = None
    """None for a model that is of no flight test"""

    @property
    def flapping_rate(self) -> float:
        """rad/s; of the flapping."""
        return 2.0 * math.pi * self.frequency

    def from_log(self) -> Identified:
        """The flight test that the model is of.

        Raises:
            InputError: it is of none.
        """
        if self.identified is None:
            raise InputError(f"the model ({self.origin}) is of no flight test: it has no section [identified]")
        return self.identified


def model_of(vehicle: SimulatedVehicle, orbit: Orbit, axes: AxesModel) -> LinearModel:
    """The model of a simulated vehicle about ``orbit``."""
    servo, inputs = vehicle.drive.kind == "servo", orbit.inputs
    throttle = throttle_for(inputs.frequency, vehicle) if vehicle.drive.kind == "crank" else inputs.throttle
    drive = DriveModel(
        HALF_STROKE if servo else THROTTLE, axes.drive, axes.drive_lag, inputs.amplitude if servo else throttle
    )
    origin = f"{vehicle.name} at {orbit.means.airspeed:.3g} m/s, {vehicle.aerodynamics.model}"
    return LinearModel(
        vehicle.name,
        origin,
        orbit.means.airspeed,
        orbit.means.pitch,
        inputs.frequency,
        axes.longitudinal.a,
        axes.longitudinal.b,
        drive,
        LateralModel(axes.lateral, axes.rudder),
    )


def is_model_file(path: Path) -> bool:
    """Whether a file is one of a linear model rather than of a vehicle."""
    if not path.is_file():
        return False
    return path.suffix == ".json" or "longitudinal" in _document(path)


def load_model(path: Path) -> LinearModel:
    """Read a model file.

    Raises:
        InputError: not such a file, or a number that is missing, not finite or of the wrong shape.
    """
    document = _document(path)
    unknown = set(document) - {*SECTIONS, "vehicle", "origin"}
    if unknown:
        raise InputError(
            f"{path}: unknown {', '.join(sorted(unknown))}; known: vehicle, origin, {', '.join(SECTIONS)}"
        )
    trim, along = _section(path, document, "trim"), _section(path, document, "longitudinal")
    drive = _drive(path, _section(path, document, "drive")) if "drive" in document else None
    across = _section(path, document, "lateral") if "lateral" in document else None
    return LinearModel(
        _vehicle(path, str(document.get("vehicle", ""))),
        str(document.get("origin", path.name)),
        _positive(path, "trim.airspeed", trim["airspeed"]),
        float(_numbers(path, "trim.pitch", trim["pitch"], ())),
        _positive(path, "trim.frequency", trim["frequency"]),
        _numbers(path, "longitudinal.a", along["a"], (4, 4)),
        _numbers(path, "longitudinal.elevator", along["elevator"], (4,)),
        drive,
        None
        if across is None
        else LateralModel(
            _numbers(path, "lateral.a", across["a"], (4, 4)), _numbers(path, "lateral.rudder", across["rudder"], (4,))
        ),
        _identified(path, _section(path, document, "identified")) if "identified" in document else None,
    )


def save_model(path: Path, model: LinearModel) -> None:
    """Write a model file; an existing one is never touched.

    Raises:
        InputError: the file exists.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(model_text(model))
    except FileExistsError:
        raise InputError(f"{path} exists already; choose another name") from None


def model_text(model: LinearModel) -> str:
    """The TOML text of a model."""
    lines = [
        "# Linear motion of the stroke averages about a trim; SI and radians, body axes (x ahead, y right, z down).",
        f"vehicle = {json.dumps(model.vehicle)}",
        f"origin = {json.dumps(model.origin)}",
        "",
        "[trim]  # m/s, rad, Hz",
        *(f"{key} = {getattr(model, key):.{DIGITS}g}" for key in SECTIONS["trim"]),
        "",
        "[longitudinal]  # of u m/s, w m/s, q rad/s, theta rad; elevator rad, nose up positive",
        f"a = {_matrix(model.a)}",
        f"elevator = {_row(model.elevator)}",
    ]
    if model.drive is not None:
        drive = model.drive
        lines += ["", "[drive]  # throttle 0 to 1, or half_stroke rad commanded; lag s", f'input = "{drive.input}"']
        lines += [f"b = {_row(drive.b)}", f"lag = {drive.lag:.{DIGITS}g}", f"at = {drive.at:.{DIGITS}g}"]
    if model.lateral is not None:
        lines += ["", "[lateral]  # of v m/s, p rad/s, r rad/s, roll rad; rudder rad, nose right positive"]
        lines += [f"a = {_matrix(model.lateral.a)}", f"rudder = {_row(model.lateral.rudder)}"]
    if model.identified is not None:
        lines += _identified_lines(model.identified)
    return "\n".join(lines) + "\n"


def _identified_lines(identified: Identified) -> list[str]:
    lines = ["", "[identified]  # rad at the trim; estimates with their 95 % intervals"]
    lines += [f"{key} = {json.dumps(getattr(identified, key))}" for key in ("log", "sha256", "method")]
    numbers = {
        "elevator": identified.elevator,
        "angle_of_attack": identified.angle_of_attack,
        "density": identified.density,
    }
    lines += [f"{key} = {value:.{DIGITS}g}" for key, value in numbers.items() if value is not None]
    for one in identified.values:
        lines += ["", f"[identified.estimates.{json.dumps(one.name)}]"]
        lines += [f"{key} = {getattr(one, key):.{DIGITS}g}" for key in ESTIMATE]
        lines.append(f"unit = {json.dumps(one.unit)}")
    return lines


def _row(values: Floats) -> str:
    return f"[{', '.join(f'{value:.{DIGITS}g}' for value in values)}]"


def _matrix(values: Floats) -> str:
    return "[\n" + "".join(f"    {_row(row)},\n" for row in values) + "]"


def _document(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8-sig")
        identified = parse_json(text) if path.suffix == ".json" else parse_toml(text)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {read_error_text(error)}") from None
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None
    if not isinstance(identified, dict):
        raise InputError(f"{path}: not a model: no [longitudinal]")
    return identified


def _section(path: Path, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = document.get(name)
    if not isinstance(table, dict):
        raise InputError(f"{path}: section [{name}] is missing")
    for key in SECTIONS[name]:
        if key not in table:
            raise InputError(f"{path}: key {name}.{key} is missing")
    known = (*SECTIONS[name], *OPTIONAL.get(name, ()))
    unknown = set(table) - set(known)
    if unknown:
        raise InputError(f"{path}: unknown key {name}.{min(unknown)}; known: {', '.join(known)}")
    return table


def _drive(path: Path, table: Mapping[str, Any]) -> DriveModel:
    if table["input"] not in (THROTTLE, HALF_STROKE):
        raise InputError(f'{path}: drive.input must be "{THROTTLE}" or "{HALF_STROKE}", not "{table["input"]}"')
    lag = float(_numbers(path, "drive.lag", table["lag"], ()))
    if lag < 0.0:
        raise InputError(f"{path}: drive.lag = {lag:g} is below 0 s")
    at = float(_numbers(path, "drive.at", table["at"], ()))
    return DriveModel(str(table["input"]), _numbers(path, "drive.b", table["b"], (4,)), lag, at)


def _vehicle(path: Path, name: str) -> str:
    """The folder of that name beside the file where there is one, else the name itself."""
    beside = path.parent / name
    return str(beside) if name and beside.is_dir() else name


def _identified(path: Path, table: Mapping[str, Any]) -> Identified:
    words = [_words(path, f"identified.{key}", table[key]) for key in ("log", "sha256", "method")]
    trim = [float(_numbers(path, f"identified.{key}", table[key], ())) for key in ("elevator", "angle_of_attack")]
    density = _positive(path, "identified.density", table["density"]) if "density" in table else None
    estimates = table.get("estimates", {})
    if not isinstance(estimates, dict):
        raise InputError(f"{path}: identified.estimates must be a section of estimates")
    values = tuple(_estimate(path, name, entry) for name, entry in estimates.items())
    return Identified(words[0], words[1], words[2], trim[0], trim[1], density, values)


def _estimate(path: Path, name: str, entry: Any) -> IdentifiedValue:
    where = f"identified.estimates.{name}"
    if not isinstance(entry, dict) or set(entry) != {*ESTIMATE, "unit"}:
        raise InputError(f"{path}: {where} must have {', '.join(ESTIMATE)} and unit, and nothing else")
    value, error, low, high = (float(_numbers(path, f"{where}.{key}", entry[key], ())) for key in ESTIMATE)
    if error < 0.0 or not low <= value <= high:
        raise InputError(
            f"{path}: {where} is no estimate: its value must be inside its interval, its error not below 0"
        )
    return IdentifiedValue(name, _words(path, f"{where}.unit", entry["unit"]), value, error, low, high)


def _words(path: Path, name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{path}: {name} must be text")
    return value


def _positive(path: Path, name: str, value: Any) -> float:
    number = float(_numbers(path, name, value, ()))
    if number <= 0.0:
        raise InputError(f"{path}: {name} = {number:g} is not above 0")
    return number


def _numbers(path: Path, name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    words = {(): "a number", (4,): "a list of 4 numbers", (4, 4): "4 lists of 4 numbers"}[shape]
    try:
        identified = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        identified = np.array(math.nan)
    if identified.shape != shape or not np.all(np.isfinite(identified)) or isinstance(value, bool | str):
        raise InputError(f"{path}: {name} must be {words}")
    return identified
