"""Torque of the wing drives from the counts of the strain gauges (instrumented vehicles only)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from avionics.messages import DriveTorque, TorqueSample
from wingbeat.records import constructor
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Calibration of the gauges."""

    scale: Annotated[float, Quantity("N m", 1e-7, 10.0)]
    """N m; of one count"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """counts; of the left drive without load"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """counts; of the right drive without load"""


_new_drive_torque = constructor(DriveTorque)


def step(gains: Gains, sample: TorqueSample) -> DriveTorque:
    """Torques of one sample, positive when they drive the wing up; nothing to remember."""
    left, right = sample.left_counts, sample.right_counts
    return _new_drive_torque(
        sample.time_us, (left - gains.zero_left) * gains.scale, (right - gains.zero_right) * gains.scale
    )
