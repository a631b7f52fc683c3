"""What a mission is: a list of items, in metres from home."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class ItemKind(IntEnum):
    """What an item asks for; the values are MAVLink's MAV_CMD numbers (private ones from 53000)."""

    WAYPOINT = 16
    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    HOLD = 53001
    """hold altitude and heading for a duration"""
    EXCITE = 53000
    """identification input, see `Excitation`"""


class Channel(IntEnum):
    """What an excitation is added to."""

    ELEVATOR = 0
    THROTTLE = 1
    RUDDER = 2


class Shape(IntEnum):
    """Shape of an excitation."""

    DOUBLET = 0
    MULTISTEP_3211 = 1


class Excitation(NamedTuple):
    """An identification input; while it lasts the altitude and pitch loops are frozen at their trim."""

    channel: Channel
    """-; what it is added to"""
    shape: Shape
    """-; doublet or 3-2-1-1"""
    amplitude: float
    """rad (elevator, rudder) or - (throttle)"""
    width: float
    """s; of one step"""
    settle: float
    """s; frozen before and after the input"""
    repeats: int
    """-; how often it is repeated, a settling time between"""


class MissionItem(NamedTuple):
    """One item; fields that its kind does not use are 0."""

    kind: ItemKind
    """-; what to do"""
    north: float = 0.0
    """m; from home (WAYPOINT, LAND)"""
    east: float = 0.0
    """m; from home (WAYPOINT, LAND)"""
    altitude: float = 0.0
    """m; above home (TAKEOFF, WAYPOINT, HOLD)"""
    heading: float = 0.0
    """rad; to hold (HOLD), or of the final approach (LAND)"""
    duration: float = 0.0
    """s; to hold (HOLD)"""
    excitation: Excitation | None = None
    """-; what to fly (EXCITE)"""


Mission = tuple[MissionItem, ...]
