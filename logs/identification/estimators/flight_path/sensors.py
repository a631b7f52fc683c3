"""What aboard tells of the motion: channels, their errors and where they sit.

Every channel tells (1 + scale) times the truth plus a bias. The states are those of the point where the IMU sits, so
that its specific forces need no angular acceleration; vanes and pitot see the flow of their own places.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.models.rigid_body import INPUTS
from logs.identification.results import Array

OUTPUTS = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "altitude", "climb_rate", "north", "east")
WRAPPED = ("phi", "psi")
UNITS = {
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("a_x", "a_y", "a_z"), "m/s^2"),
    **dict.fromkeys(("airspeed", "climb_rate"), "m/s"),
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), "rad"),
    **dict.fromkeys(("altitude", "north", "east"), "m"),
}
WINDS = ("wind_north", "wind_east")
LONGITUDINAL_INPUTS = ("q", "a_x", "a_z")
LONGITUDINAL_OUTPUTS = ("airspeed", "alpha", "theta", "altitude", "climb_rate")
Place = tuple[float, float, float]
_LIMITS = {"rad/s": 0.05, "m/s^2": 0.3, "m/s": 3.0, "rad": 0.1, "m": 50.0, "-": 0.1}
"""standard error by unit, beyond which a sensor's error is better not corrected at all"""

NO_GAIN = -1.0
"""-; scale of a sensor that reads nothing: it tells (1 + scale) times the truth"""
SPEEDS = {"kn": 3600.0 / 1852.0, "mph": 2.2369, "ft/s": 3.2808, "km/h": 3.6}
"""-; by how much a number in this unit is larger than in m/s"""


class Places(NamedTuple):
    """Where the sensors sit, from the centre of mass, FRD, m."""

    imu: Place = (0.0, 0.0, 0.0)
    airspeed: Place = (0.0, 0.0, 0.0)
    alpha: Place = (0.0, 0.0, 0.0)
    beta: Place = (0.0, 0.0, 0.0)


class Parameter(NamedTuple):
    """One error of a sensor, or the wind."""

    name: str
    """bias_CHANNEL, scale_CHANNEL, wind_north or wind_east"""
    kind: str
    """bias, scale or wind"""
    channel: str
    unit: str
    limit: float
    """as the unit; largest standard error at which the parameter counts as identified"""


def parameter(name: str) -> Parameter | None:
    """The parameter of that name; None where there is none."""
    if name in WINDS:
        return Parameter(name, "wind", name.removeprefix("wind_"), "m/s", _LIMITS["m/s"])
    kind, _, channel = name.partition("_")
    if kind not in ("bias", "scale") or channel not in UNITS:
        return None
    unit = UNITS[channel] if kind == "bias" else "-"
    return Parameter(name, kind, channel, unit, _LIMITS[unit])


def usual_parameters(longitudinal: bool) -> tuple[str, ...]:
    """What is asked for where nothing is said: the inputs' biases, the vanes' biases and scales, the wind."""
    if longitudinal:
        return (*(f"bias_{name}" for name in LONGITUDINAL_INPUTS), "bias_alpha", "scale_alpha")
    vanes = ("bias_alpha", "bias_beta", "scale_alpha", "scale_beta")
    return (*(f"bias_{name}" for name in INPUTS), *vanes, *WINDS)


def corrected_inputs(measured: Array, errors: dict[str, float]) -> Array:
    """Inputs (N, 6) freed of their biases and scales."""
    bias, scale = (np.array([errors.get(f"{kind}_{name}", 0.0) for name in INPUTS]) for kind in ("bias", "scale"))
    inputs: Array = (measured - bias) / (1 + scale)
    return inputs


def input_push(inputs: Array, asked: Parameter, errors: dict[str, float]) -> Array:
    """Slope (N, 6) of the corrected ``inputs`` (N, 6) by a parameter."""
    slope = np.zeros_like(inputs)
    if asked.channel in INPUTS:
        column = INPUTS.index(asked.channel)
        factor = 1 + errors.get(f"scale_{asked.channel}", 0.0)
        slope[:, column] = -1 / factor if asked.kind == "bias" else -inputs[:, column] / factor
    return slope


def true_outputs(channels: tuple[str, ...], states: Array, inputs: Array, places: Places) -> Array:
    """What faultless sensors would tell (N, m) at ``states`` (N, 9) of the IMU's place, turning as in ``inputs``."""
    told: Array = np.column_stack([_output(channel, states, inputs, places) for channel in channels])
    return told


def velocity_at(states: Array, inputs: Array, place: Place, imu: Place) -> Array:
    """Velocity through the air (m/s; (N, 3), FRD) at a ``place`` when the states are those of the place ``imu``."""
    x, y, z = np.subtract(place, imu)
    p, q, r = inputs[:, 0], inputs[:, 1], inputs[:, 2]
    arm = np.column_stack((q * z - r * y, r * x - p * z, p * y - q * x))
    velocity: Array = states[:, :3] + arm
    return velocity


def _output(channel: str, states: Array, inputs: Array, places: Places) -> Array:
    direct = {"phi": 3, "theta": 4, "psi": 5, "altitude": 6, "north": 7, "east": 8}
    if channel in direct:
        plain: Array = states[:, direct[channel]]
        return plain
    if channel == "climb_rate":
        sunk = states[:, 1] * np.sin(states[:, 3]) + states[:, 2] * np.cos(states[:, 3])
        climb: Array = states[:, 0] * np.sin(states[:, 4]) - sunk * np.cos(states[:, 4])
        return climb
    u, v, w = velocity_at(states, inputs, getattr(places, channel), places.imu).T
    speed: Array = np.sqrt(u**2 + v**2 + w**2)
    if channel == "airspeed":
        return speed
    angle: Array = np.arctan2(w, u) if channel == "alpha" else np.arcsin(v / np.maximum(speed, 1e-9))
    return angle


def output_slopes(channels: tuple[str, ...], states: Array, inputs: Array, places: Places) -> tuple[Array, Array]:
    """Slopes of `true_outputs` by the states (N, m, 9) and by the rates (N, m, 3), by central differences."""
    by_state, by_rate = [], []
    for column in range(9):
        shift = np.zeros(9)
        shift[column] = 1e-5
        ahead, behind = (true_outputs(channels, states + side * shift, inputs, places) for side in (1, -1))
        by_state.append((ahead - behind) / 2e-5)
    for column in range(3):
        shift = np.zeros(6)
        shift[column] = 1e-5
        ahead, behind = (true_outputs(channels, states, inputs + side * shift, places) for side in (1, -1))
        by_rate.append((ahead - behind) / 2e-5)
    return np.stack(by_state, axis=2), np.stack(by_rate, axis=2)
