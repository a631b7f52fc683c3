"""Wing drive torque from strain gauge counts (instrumented vehicles only)."""

from __future__ import annotations

from typing import Annotated, Final, NamedTuple

from avionics.messages import DriveTorque, TorqueSample
from wingbeat.records import constructor
from wingbeat.units import Quantity


class Gains(NamedTuple):
    """Calibration of the strain gauges."""

    scale: Annotated[float, Quantity("N m", 1e-7, 10.0)]
    """N m; torque per count"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """counts; zero of the left drive without load"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """counts; zero of the right drive without load"""


_new_drive_torque: Final = constructor(DriveTorque)


def step(gains: Gains, sample: TorqueSample) -> DriveTorque:
    """Return the torques of one sample, positive in the direction of the upstroke."""
    left, right = sample.left_counts, sample.right_counts
    return _new_drive_torque(
        sample.time_us, (left - gains.zero_left) * gains.scale, (right - gains.zero_right) * gains.scale
    )
