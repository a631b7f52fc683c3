"""Result of a servo fit, and the effect of the sensors' calibration errors on its intervals.

A scale or a zero that is wrong throughout leaves no trace in the residuals. Its effect is one by fitting again with
each sensor changed by one standard deviation (GUM, JCGM 100:2008, 5.1.3 with finite differences); the squares are
added to those of the random errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.results import Estimate, Unidentified, student_factor


class ServoModel(NamedTuple):
    """One fitted servo model."""

    estimates: tuple[Estimate, ...]
    """what the data gives"""
    unidentified: tuple[Unidentified, ...]
    """what it does not, and why"""
    centre_current: float
    """A; C_D, added to the current of one servo (0 for the torque)"""
    centre_voltage: float
    """V; C_E, added to the voltage (0 for the torque)"""
    residual: float
    """N m or W; standard deviation"""
    samples: int
    """-; bursts or strokes"""


class ServoResult(NamedTuple):
    """Torque and power model of the drive servos; None for one that was not asked for."""

    torque: ServoModel | None
    power: ServoModel | None


Fit = Callable[[DriveData], ServoModel]


def with_gauge_errors(fit: Fit, data: DriveData, gauges: GaugeErrors) -> ServoModel:
    """The model that ``fit`` makes of ``data``, its intervals widened by what the calibrations left.

    ``fit`` must fit the same terms every time.
    """
    model = fit(data)
    shifts = [_shift(model, fit(changed)) for changed in _changed(data, gauges)]
    widened = tuple(
        _widened(one, math.sqrt(sum(shift[index] ** 2 for shift in shifts)))
        for index, one in enumerate(model.estimates)
    )
    return model._replace(estimates=widened)


def _shift(model: ServoModel, other: ServoModel) -> list[float]:
    """By how much each estimate moved; an estimate that was lost counts as not moved."""
    moved = {one.name: one.value for one in other.estimates}
    return [moved.get(one.name, one.value) - one.value for one in model.estimates]


def _changed(data: DriveData, gauges: GaugeErrors) -> list[DriveData]:
    """The data with one sensor at a time one standard deviation off."""
    zero, scale = gauges.torque_zero, 1.0 + gauges.torque_scale
    every = (
        (zero, data._replace(torque_left=data.torque_left + zero)),
        (zero, data._replace(torque_right=data.torque_right + zero)),
        (gauges.torque_scale, data._replace(torque_left=data.torque_left * scale)),
        (gauges.torque_scale, data._replace(torque_right=data.torque_right * scale)),
        (gauges.current_zero, data._replace(current=data.current + gauges.current_zero)),
        (gauges.current_scale, data._replace(current=data.current * (1.0 + gauges.current_scale))),
        (gauges.voltage_scale, data._replace(voltage=data.voltage * (1.0 + gauges.voltage_scale))),
    )
    return [changed for error, changed in every if error]


def _widened(one: Estimate, systematic: float) -> Estimate:
    half = math.hypot(one.high - one.value, student_factor(math.inf) * systematic)
    error = math.hypot(one.standard_error, systematic)
    return one._replace(standard_error=error, low=one.value - half, high=one.value + half)
