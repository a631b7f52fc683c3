"""What is known of the airframe from the bench; no flight code reads it, identification does."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity


class Airframe(NamedTuple):
    """Where the IMU sits and how the tail follows its command."""

    imu_x: Annotated[float, Quantity("m", -2.0, 2.0)]
    """m; IMU ahead of the centre of mass"""
    imu_z: Annotated[float, Quantity("m", -2.0, 2.0)]
    """m; IMU below the centre of mass"""
    tail_time_constant: Annotated[float, Quantity("s", 0.0, 1.0)]
    """s; first-order lag from elevator command to tail angle"""
