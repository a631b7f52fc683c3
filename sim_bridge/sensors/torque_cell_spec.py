"""Section ``[torque_cell]`` of a vehicle file; apart from the sensor, so that it is read without numba."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from wingbeat.units import Quantity


class TorqueCellSpec(NamedTuple):
    """A full bridge on each drive's horn (chosen: Gerdes measured torque on a dynamometer, not in flight)."""

    installed: bool
    """false: the vehicle flies without"""
    range: Annotated[float, Quantity("N m", 1e-3, 1000.0)]
    """either way"""
    resolution: Annotated[float, Quantity("N m", 1e-6, 10.0)]
    """of one count"""
    noise: Annotated[float, Quantity("N m", 0.0, 10.0)]
    """standard deviation of one reading"""
    zero_sigma: Annotated[float, Quantity("N m", 0.0, 10.0)]
    """of the cells' residual zero offsets"""
    scale_sigma: Annotated[float, Quantity("-", 0.0, 0.2)]
    """of the cells' relative scale errors"""
