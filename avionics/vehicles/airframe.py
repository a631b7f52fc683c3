"""Airframe data from bench measurements, for identification only."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity


class Airframe(NamedTuple):
    """Position of the IMU and response of the tail."""

    imu_x: Annotated[float, Quantity("m", -2.0, 2.0)]
    """m; position of the IMU ahead of the center of mass"""
    imu_z: Annotated[float, Quantity("m", -2.0, 2.0)]
    """m; position of the IMU below the center of mass"""
    tail_time_constant: Annotated[float, Quantity("s", 0.0, 1.0)]
    """s; first-order lag from elevator command to tail angle"""
