"""Limits that a trimmed flight exceeds: travels, frequencies, throttle, the range of a model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from sim_bridge.aerodynamics import derivatives, regression
from sim_bridge.flight_mechanics.stroke_map import StrokeInputs
from sim_bridge.vehicles import SimulatedVehicle


class Control(NamedTuple):
    """Control of a steady flight, with its range."""

    name: str
    value: float
    low: float
    high: float
    unit: str
    spent: str
    """message if the control is saturated"""

    def left(self, rate: float) -> float:
        """Return the number of steps until the limit at ``rate`` per step; infinite at rest."""
        end = self.high if rate > 0.0 else self.low
        return max((end - self.value) / rate, 0.0) if rate else math.inf


MODEL_RANGES: dict[str, Callable[[Any, float], None]] = {
    regression.MODEL.name: regression.check,
    derivatives.MODEL.name: derivatives.check,
}
"""check by model that rejects an airspeed in m/s outside of its validity, from its section of the vehicle file"""

MODEL_WARNINGS = {
    regression.MODEL.name: "as printed, the mean thrust of regression is a drag: its flight needs a tow"
}
"""reason by model why a vehicle may have no trim"""


def check_model(vehicle: SimulatedVehicle, airspeed: float) -> None:
    """Reject an airspeed in m/s outside the validity of the vehicle's aerodynamic model.

    Raises:
        InputError: outside the validity of the model.
    """
    model = vehicle.aerodynamics.model
    if model in MODEL_RANGES:
        MODEL_RANGES[model](vehicle.sections[model], airspeed)


def model_warning(vehicle: SimulatedVehicle) -> str:
    """Return the remark on the vehicle's aerodynamic model if no trim is found; usually empty."""
    return MODEL_WARNINGS.get(vehicle.aerodynamics.model, "")


def excesses(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> list[str]:
    """Return the inputs beyond the limits of the vehicle, as text after "it needs"; empty within the limits."""
    found = [_elevator(vehicle, inputs), *DRIVES[vehicle.drive.kind](vehicle, inputs)]
    return [words for words in found if words]


def controls(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> list[Control]:
    """Return elevator and thrust control with their ranges."""
    travel, drive = vehicle.tail_servo.travel, vehicle.drive
    elevator = Control(
        "elevator", inputs.elevator, -travel, travel, "rad", "the tail cannot hold the pitch moment"
    )  # fmt: skip
    reach = drive.travel - abs(vehicle.cruise.stroke_mean)
    thrust = {
        "servo": Control(
            "commanded half stroke", inputs.amplitude, 0.0, reach, "rad", "a larger stroke gives no more thrust"
        ),
        "crank": Control(
            "stroke", inputs.frequency, min(drive.frequencies), max(drive.frequencies), "Hz",
            "the drive's stroke holds no flight",
        ),
        "linkage": Control("throttle", inputs.throttle, 0.0, 1.0, "", "the motor gives no more"),
    }  # fmt: skip
    return [elevator, thrust[drive.kind]]


def running_out(vehicle: SimulatedVehicle, now: StrokeInputs, ahead: StrokeInputs) -> str:
    """Return which control first saturates on a continuation of steady flights, as text.

    Args:
        now, ahead: inputs of the last flight found, and of its extrapolation by one step.
    """
    pairs = zip(controls(vehicle, now), controls(vehicle, ahead), strict=True)
    one = min(pairs, key=lambda pair: pair[0].left(pair[1].value - pair[0].value))[0]
    limit = f"{one.high:.3g}" if one.low == 0.0 or one.low == -one.high else f"{one.low:g} to {one.high:g}"
    sign = "±" if one.low == -one.high else ""
    return f"{one.spent} ({one.name} at {one.value:.2g} of {sign}{limit} {one.unit}".rstrip() + ")"


def _elevator(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> str:
    travel = vehicle.tail_servo.travel
    return _beyond(abs(inputs.elevator) > travel, f"{inputs.elevator:.2g} rad of elevator, the servo has {travel:g}")


def _servo(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> list[str]:
    reach = abs(vehicle.cruise.stroke_mean) + abs(inputs.amplitude)
    travel = vehicle.drive.travel
    return [
        _beyond(inputs.amplitude < 0.0, "wings that take power out of the air"),
        _beyond(reach > travel, f"the wings at {reach:.2g} rad, the servos stop at {travel:g}"),
    ]


def _crank(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> list[str]:
    low, high = min(vehicle.drive.frequencies), max(vehicle.drive.frequencies)
    range_ = f"the drive has {low:g} to {high:g}"
    return [_beyond(not low <= inputs.frequency <= high, f"a stroke of {inputs.frequency:.3g} Hz, {range_}")]


def _linkage(vehicle: SimulatedVehicle, inputs: StrokeInputs) -> list[str]:
    return [_beyond(not 0.0 <= inputs.throttle <= 1.0, f"a throttle of {inputs.throttle:.2g}, of 0 to 1")]


DRIVES: dict[str, Callable[[SimulatedVehicle, StrokeInputs], list[str]]] = {
    "servo": _servo,
    "crank": _crank,
    "linkage": _linkage,
}
"""by the kind of drive"""


def _beyond(is_so: bool, words: str) -> str:
    return words if is_so else ""
