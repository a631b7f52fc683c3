"""Stick curves: raw axis values to stick deflections through calibration, dead zone, reversal and expo."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity

MAX_NUMBER = 255
"""-; largest number of an axis or button"""
MIN_TRAVEL = 0.1
"""-; least distance of the raw values at center and end of an axis"""


class Axis(NamedTuple):
    """Assignment, calibration and curve of one axis."""

    axis: Annotated[int, Quantity("-", 0, MAX_NUMBER)]
    """-; number of the axis on the device, from 0"""
    min: Annotated[float, Quantity("-", -1.0, 1.0)] = -1.0
    """-; raw value at the lower end"""
    center: Annotated[float, Quantity("-", -1.0, 1.0)] = 0.0
    """-; raw value of the centered axis"""
    max: Annotated[float, Quantity("-", -1.0, 1.0)] = 1.0
    """-; raw value at the upper end"""
    reversed: bool = False
    """whether the deflection has the opposite sign of the raw value"""
    deadzone: Annotated[float, Quantity("-", 0.0, 0.5)] = 0.0
    """-; deflection around the center (throttle: above the bottom) that counts as 0, as a fraction of full travel"""
    expo: Annotated[float, Quantity("-", 0.0, 1.0)] = 0.0
    """-; 0 for a linear curve to 1 for a cubic one"""


def deflection(axis: Axis, raw: float) -> float:
    """Compute the deflection of a centered stick, -1 to 1, from the raw axis value."""
    calibrated = _normalize(axis, raw)
    return _curve(-calibrated if axis.reversed else calibrated, axis.deadzone, axis.expo)


def throttle_full_travel(axis: Axis, raw: float) -> float:
    """Compute the throttle, 0 to 1, of a stick without centering: 0 at one end, 1 at the other."""
    fraction = _clip((raw - axis.min) / (axis.max - axis.min), 0.0, 1.0)
    return _curve(1.0 - fraction if axis.reversed else fraction, axis.deadzone, axis.expo)


def throttle_upper_half(axis: Axis, raw: float) -> float:
    """Compute the throttle, 0 to 1, of a self-centering stick: 0 at the center and below."""
    return max(0.0, deflection(axis, raw))


def switch_position(raw: float, positions: int) -> int:
    """Compute the position, from 0, of a switch on an axis from -1 to 1 whose range is divided into equal parts."""
    return min(int(0.5 * (_clip(raw, -1.0, 1.0) + 1.0) * positions), positions - 1)


def _normalize(axis: Axis, raw: float) -> float:
    # Both halves are scaled separately: the center of a real stick is rarely in the middle.
    travel = axis.max - axis.center if raw >= axis.center else axis.center - axis.min
    return _clip((raw - axis.center) / travel, -1.0, 1.0)


def _curve(value: float, deadzone: float, expo: float) -> float:
    """Apply dead zone and expo: (1 - e) v + e v^3 of what is left of ``value`` beyond the dead zone."""
    outside = max(0.0, abs(value) - deadzone) / (1.0 - deadzone)
    shaped = min((1.0 - expo) * outside + expo * outside**3, 1.0)
    return -shaped if value < 0.0 else shaped


def _clip(value: float, low: float, high: float) -> float:
    return max(low, min(high, value))
