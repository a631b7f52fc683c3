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
```
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from avionics.quantities import BadInput
from sim_bridge.flight_mechanics.averaged_axes import AxesModel
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import throttle_for
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle

THROTTLE, HALF_STROKE = "throttle", "half_stroke"
"""what the drive's B is per"""
SECTIONS = {
    "trim": ("airspeed", "pitch", "frequency"),
    "longitudinal": ("a", "elevator"),
    "drive": ("input", "b", "lag", "at"),
    "lateral": ("a", "rudder"),
}
OPTIONAL = ("drive", "lateral")
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

    @property
    def flapping_rate(self) -> float:
        """rad/s; of the flapping."""
        return 2.0 * math.pi * self.frequency


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
        BadInput: not such a file, or a number that is missing, not finite or of the wrong shape.
    """
    document = _document(path)
    unknown = set(document) - {*SECTIONS, "vehicle", "origin"}
    if unknown:
        raise BadInput(f"{path}: unknown {', '.join(sorted(unknown))}; known: vehicle, origin, {', '.join(SECTIONS)}")
    trim, along = _section(path, document, "trim"), _section(path, document, "longitudinal")
    drive = _drive(path, _section(path, document, "drive")) if "drive" in document else None
    across = _section(path, document, "lateral") if "lateral" in document else None
    return LinearModel(
        str(document.get("vehicle", "")),
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
    )


def save_model(path: Path, model: LinearModel) -> None:
    """Write a model file; an existing one is never touched.

    Raises:
        BadInput: the file exists.
    """
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(model_text(model))
    except FileExistsError:
        raise BadInput(f"{path} exists already; choose another name") from None


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
    return "\n".join(lines) + "\n"


def _row(values: Floats) -> str:
    return f"[{', '.join(f'{value:.{DIGITS}g}' for value in values)}]"


def _matrix(values: Floats) -> str:
    return "[\n" + "".join(f"    {_row(row)},\n" for row in values) + "]"


def _document(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
        found = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot read {path}: {error}") from None
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise BadInput(f"{path}: not valid {'JSON' if path.suffix == '.json' else 'TOML'}: {error}") from None
    if not isinstance(found, dict):
        raise BadInput(f"{path}: not a model: no [longitudinal]")
    return found


def _section(path: Path, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = document.get(name)
    if not isinstance(table, dict):
        raise BadInput(f"{path}: section [{name}] is missing")
    for key in SECTIONS[name]:
        if key not in table:
            raise BadInput(f"{path}: key {name}.{key} is missing")
    unknown = set(table) - set(SECTIONS[name])
    if unknown:
        raise BadInput(f"{path}: unknown key {name}.{min(unknown)}; known: {', '.join(SECTIONS[name])}")
    return table


def _drive(path: Path, table: Mapping[str, Any]) -> DriveModel:
    if table["input"] not in (THROTTLE, HALF_STROKE):
        raise BadInput(f'{path}: drive.input must be "{THROTTLE}" or "{HALF_STROKE}", not "{table["input"]}"')
    lag = float(_numbers(path, "drive.lag", table["lag"], ()))
    if lag < 0.0:
        raise BadInput(f"{path}: drive.lag = {lag:g} is below 0 s")
    at = float(_numbers(path, "drive.at", table["at"], ()))
    return DriveModel(str(table["input"]), _numbers(path, "drive.b", table["b"], (4,)), lag, at)


def _positive(path: Path, name: str, value: Any) -> float:
    number = float(_numbers(path, name, value, ()))
    if number <= 0.0:
        raise BadInput(f"{path}: {name} = {number:g} is not above 0")
    return number


def _numbers(path: Path, name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    words = {(): "a number", (4,): "a list of 4 numbers", (4, 4): "4 lists of 4 numbers"}[shape]
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.array(math.nan)
    if found.shape != shape or not np.all(np.isfinite(found)) or isinstance(value, bool | str):
        raise BadInput(f"{path}: {name} must be {words}")
    return found
