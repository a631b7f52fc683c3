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
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.averaged_axes import AxesModel
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError
from wingbeat.schema import error_context, read_document, read_record
from wingbeat.units import ABOVE_ZERO, Quantity

THROTTLE, HALF_STROKE = "throttle", "half_stroke"
"""units of the input of the drive's B"""
DIGITS = 7


class DriveModel(NamedTuple):
    """Response of the aircraft to the drive."""

    input: str
    """-; THROTTLE, 0 to 1, or HALF_STROKE, rad commanded"""
    b: Floats
    """(4,); of (u, w, q, theta), per input after the lag"""
    lag: float
    """s; first-order"""
    at: float
    """operating point of the input at the trim"""


class LateralModel(NamedTuple):
    """Lateral motion."""

    a: Floats
    """(4, 4); of (v m/s, p rad/s, r rad/s, roll rad)"""
    rudder: Floats
    """(4,); of the achieved rudder, rad"""


class IdentifiedValue(NamedTuple):
    """One estimate with its 95 % interval."""

    name: str
    """-; symbol"""
    unit: str
    """-; unit of ``value``"""
    value: float
    standard_error: float
    low: float
    high: float


class Identified(NamedTuple):
    """Flight test of an identified model."""

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
    """kg/m^3; of the air, None if unknown"""
    values: tuple[IdentifiedValue, ...] = ()


class LinearModel(NamedTuple):
    """Linear stroke-averaged model about a trim."""

    vehicle: str
    """-; name, file or folder"""
    origin: str
    """-; source of the numbers"""
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
    """None if unknown"""
    lateral: LateralModel | None
    """None if unknown"""
    identified: Identified | None = None
    """None for a model that is not from a flight test"""

    @property
    def flapping_rate(self) -> float:
        """Flapping frequency in rad/s."""
        return 2.0 * math.pi * self.frequency

    def from_log(self) -> Identified:
        """Return the flight test of the model.

        Raises:
            InputError: the model is not from a flight test.
        """
        if self.identified is None:
            raise InputError(f"the model ({self.origin}) is of no flight test: it has no section [identified]")
        return self.identified


def model_of(vehicle: SimulatedVehicle, orbit: Orbit, axes: AxesModel) -> LinearModel:
    """Build the model of a simulated vehicle about ``orbit``."""
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


Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]


class _Trim(NamedTuple):
    airspeed: Annotated[float, Quantity("m/s", ABOVE_ZERO)]
    pitch: float
    frequency: Annotated[float, Quantity("Hz", ABOVE_ZERO)]


class _Longitudinal(NamedTuple):
    a: Matrix
    elevator: Row


class _Drive(NamedTuple):
    input: Annotated[str, THROTTLE, HALF_STROKE]
    b: Row
    lag: Annotated[float, Quantity("s", 0.0)]
    at: float


class _Lateral(NamedTuple):
    a: Matrix
    rudder: Row


class _Estimate(NamedTuple):
    value: float
    standard_error: Annotated[float, Quantity("-", 0.0)]
    low: float
    high: float
    unit: str


class _Identified(NamedTuple):
    log: str
    sha256: str
    method: str
    elevator: float
    angle_of_attack: float
    density: Annotated[float, Quantity("kg/m^3", ABOVE_ZERO)] | None = None
    estimates: dict[str, _Estimate] = {}


class _ModelFile(NamedTuple):
    """Sections of a model file."""

    trim: _Trim
    longitudinal: _Longitudinal
    drive: _Drive | None = None
    lateral: _Lateral | None = None
    identified: _Identified | None = None
    vehicle: str = ""
    origin: str = ""


def is_model_file(path: Path) -> bool:
    """Return whether a file is a linear model rather than a vehicle."""
    if not path.is_file():
        return False
    return path.suffix == ".json" or "longitudinal" in read_document(path, "model")


def load_model(path: Path) -> LinearModel:
    """Read a model file.

    Raises:
        InputError: not such a file, or a number that is missing, not finite or of the wrong shape.
    """
    document = read_document(path, "model")
    with error_context(path):
        file = read_record(_ModelFile, document)
        identified = None if file.identified is None else _identified(file.identified)
    drive, lateral = file.drive, file.lateral
    return LinearModel(
        _vehicle(path, file.vehicle),
        file.origin or path.name,
        file.trim.airspeed,
        file.trim.pitch,
        file.trim.frequency,
        np.array(file.longitudinal.a),
        np.array(file.longitudinal.elevator),
        None if drive is None else DriveModel(drive.input, np.array(drive.b), drive.lag, drive.at),
        None if lateral is None else LateralModel(np.array(lateral.a), np.array(lateral.rudder)),
        identified,
    )


def save_model(path: Path, model: LinearModel) -> None:
    """Write a new model file.

    Raises:
        InputError: the file exists.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(model_text(model))
    except FileExistsError:
        raise InputError(f"{path} exists already; choose another name") from None


def model_text(model: LinearModel) -> str:
    """Format a model as TOML."""
    lines = [
        "# Linear motion of the stroke averages about a trim; SI and radians, body axes (x ahead, y right, z down).",
        f"vehicle = {json.dumps(model.vehicle)}",
        f"origin = {json.dumps(model.origin)}",
        "",
        "[trim]  # m/s, rad, Hz",
        *(f"{key} = {getattr(model, key):.{DIGITS}g}" for key in _Trim._fields),
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
        lines += [f"{key} = {getattr(one, key):.{DIGITS}g}" for key in ("value", "standard_error", "low", "high")]
        lines.append(f"unit = {json.dumps(one.unit)}")
    return lines


def _row(values: Floats) -> str:
    return f"[{', '.join(f'{value:.{DIGITS}g}' for value in values)}]"


def _matrix(values: Floats) -> str:
    return "[\n" + "".join(f"    {_row(row)},\n" for row in values) + "]"


def _vehicle(path: Path, name: str) -> str:
    """Return the folder of that name beside the file if it exists, else the name."""
    beside = path.parent / name
    return str(beside) if name and beside.is_dir() else name


def _identified(file: _Identified) -> Identified:
    for name, one in file.estimates.items():
        if not one.low <= one.value <= one.high:
            interval = f"{one.low:g} to {one.high:g} {one.unit}"
            raise InputError(f"identified.estimates.{name}.value = {one.value:g} is outside its interval, {interval}")
    values = tuple(
        IdentifiedValue(name, one.unit, one.value, one.standard_error, one.low, one.high)
        for name, one in file.estimates.items()
    )
    trim = (file.elevator, file.angle_of_attack)
    return Identified(file.log, file.sha256, file.method, *trim, file.density, values)
