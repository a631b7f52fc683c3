"""The aircraft as the loops see it: the linear model behind servos, drive and mixing, with named signals.

Signals: `elevator` and `rudder` are commanded angles in rad, `throttle` is 0 to 1, `roll_command` -1 to 1; `pitch`,
`roll` in rad, `pitch_rate`, `roll_rate`, `yaw_rate` in rad/s, `climb` in m/s, positive up.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from avionics.gains import FlightGains
from avionics.limits import between_points
from avionics.mixing import flapping
from avionics.timebase import BASE_RATE
from avionics.vehicles.airframe import Airframe
from sim_bridge.tuning import blocks
from sim_bridge.tuning.model import HALF_STROKE, DriveModel, LinearModel

STEP = 0.02
"""-; throttle step for the derivative of the stroke"""


class Aircraft(NamedTuple):
    """Aircraft to tune: linear model and flight computer gains."""

    model: LinearModel
    airframe: Airframe
    gains: FlightGains


def longitudinal(aircraft: Aircraft) -> Any:
    """Build the system from elevator (and throttle, if the model has a drive) to pitch, pitch_rate and climb."""
    model = aircraft.model
    inputs, columns = ["tail_angle"], [model.elevator]
    parts = [blocks.lag(aircraft.airframe.tail_time_constant, "elevator", "tail_angle")]
    if model.drive is not None:
        inputs, columns = [*inputs, "thrust"], [*columns, model.drive.b * stroke_slope(aircraft.gains, model.drive)]
        parts.append(blocks.lag(model.drive.lag, "throttle", "thrust"))
    outputs = ["pitch", "pitch_rate", "climb"]
    plant = _plant(model.a, columns, _measured(model), inputs, outputs)
    return blocks.joined([plant, *parts], ["elevator", "throttle"][: len(inputs)], outputs)


def _measured(model: LinearModel) -> list[list[float]]:
    """Return the outputs pitch, pitch rate, climb of u, w, q, theta, about level flight."""
    climb = [math.sin(model.pitch), -math.cos(model.pitch), 0.0, model.airspeed]
    return [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0], climb]


def lateral(aircraft: Aircraft) -> Any:
    """Build the system from roll_command to roll, roll_rate and the yaw_rate of the heading.

    The rudder share of the mixing is included. The stroke asymmetry is not, because the model has no such input.
    """
    model, across = aircraft.model, aircraft.model.lateral
    assert across is not None
    rudder = across.rudder * aircraft.gains.tail.rudder_share
    measured = [[0.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0 / math.cos(model.pitch), 0.0]]
    outputs = ["roll", "roll_rate", "yaw_rate"]
    plant = _plant(across.a, [rudder], measured, ["tail_angle"], outputs)
    servo = blocks.lag(aircraft.airframe.tail_time_constant, "roll_command", "tail_angle")
    return blocks.joined([plant, servo], ["roll_command"], outputs)


def stroke_slope(gains: FlightGains, drive: DriveModel) -> float:
    """Return the drive input per throttle at the trim: 1, or rad of half stroke from the flight computer's map."""
    if drive.input != HALF_STROKE:
        return 1.0
    at = throttle_at(gains.flapping, drive.at)
    ends = [between_points(at + side * STEP, *_map(gains.flapping)) for side in (-1.0, 1.0)]
    return (ends[1] - ends[0]) / (2.0 * STEP)


def throttle_at(gains: flapping.Gains, half_stroke: float) -> float:
    """Return the throttle of the flight computer's map for a half stroke (rad), away from its ends."""
    throttles, amplitudes = _map(gains)
    middle = np.linspace(throttles[0] + STEP, throttles[-1] - STEP, 1001)
    commanded = [between_points(float(throttle), throttles, amplitudes) for throttle in middle]
    return float(middle[int(np.argmin(np.abs(np.array(commanded) - half_stroke)))])


def _map(gains: flapping.Gains) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return gains.throttle_points, gains.amplitude_points


def loop_delay(rate: float) -> float:
    """Return the delay in s of a loop at ``rate`` Hz: one tick from sensor to actuator, and half a hold period."""
    return 1.0 / BASE_RATE + 0.5 / rate


def _plant(a: Any, columns: list[Any], measured: list[list[float]], inputs: list[str], outputs: list[str]) -> Any:
    import control

    b = np.column_stack(columns)
    return control.ss(
        a, b, measured, np.zeros((len(measured), len(columns))), inputs=inputs, outputs=outputs, name="aircraft"
    )
