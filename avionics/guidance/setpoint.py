"""Setpoints of an external controller for OFFBOARD.

The mode corresponds to OFFBOARD of PX4 and GUIDED of ArduPlane.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Path(IntEnum):
    """Horizontal part of a setpoint."""

    KEEP = 0
    """present path; a circle at the present position if there is none"""
    CIRCLE_HERE = 1
    """circle tangent to the present course"""
    CIRCLE_AT = 2
    """flight to a position and circle there"""
    COURSE = 3
    """straight course over ground"""
    ATTITUDE = 4
    """roll, pitch and throttle without altitude and course loops"""


class Setpoint(NamedTuple):
    """Setpoint; fields that its path does not use are 0."""

    path: Path
    """-; horizontal part"""
    north: float = 0.0
    """m; circle center, from home (CIRCLE_AT)"""
    east: float = 0.0
    """m; circle center, from home (CIRCLE_AT)"""
    radius: float = 0.0
    """m; positive clockwise, 0 for the vehicle's loiter radius (CIRCLE_AT)"""
    course: float = 0.0
    """rad; over ground (COURSE)"""
    altitude: float | None = None
    """m; above home; None to ramp the altitude with ``climb_rate``"""
    climb_rate: float = 0.0
    """m/s; positive up, 0 to hold the altitude"""
    roll: float = 0.0
    """rad; (ATTITUDE)"""
    pitch: float = 0.0
    """rad; (ATTITUDE)"""
    throttle: float = 0.0
    """-; 0 to 1 (ATTITUDE)"""
    expires: int = 1
    """-; 1 if it must be refreshed within `route.Gains.offboard_timeout`"""


class Received(NamedTuple):
    """Active setpoint and its reception time."""

    setpoint: Setpoint | None = None
    """-; None before the first"""
    time_us: int = 0
    """us; since boot, of the tick that applied it"""
