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
    LINEAR_SWEEP = 2
    """the frequency rises or falls evenly"""
    LOGARITHMIC_SWEEP = 3
    """every octave takes the same time"""
    MULTISINE = 4
    """sines of one period, disjoint on every channel, see `multisine`"""


class Excitation(NamedTuple):
    """An identification input; while it lasts the loops are frozen at their trim, or fly on as asked.

    Frozen are the altitude and pitch loops, and the roll loop where the rudder is used.
    """

    channel: Channel
    """-; what it is added to"""
    shape: Shape
    """-; its course in time"""
    amplitude: float
    """rad (elevator, rudder) or - (throttle); greatest excursion"""
    width: float
    """s; of one step, of a whole sweep, or the period of a multisine"""
    settle: float
    """s; before and after the input, the loops as during it"""
    repeats: int
    """-; how often it is repeated, a settling time between"""
    low: float = 0.0
    """Hz; where a sweep begins, or the lowest frequency of a multisine"""
    high: float = 0.0
    """Hz; where a sweep ends, or the highest frequency of a multisine"""
    beside: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, -, rad; of a multisine on elevator, throttle and rudder beside that on ``channel``"""
    loops: int = 0
    """-; 1 when the loops fly on, 0 when they are frozen"""

    def amplitudes(self) -> tuple[float, float, float]:
        """Greatest excursion of elevator (rad), throttle (-) and rudder (rad)."""
        elevator, throttle, rudder = (
            beside + (self.amplitude if channel == self.channel else 0.0)
            for channel, beside in zip(Channel, self.beside, strict=True)
        )
        return elevator, throttle, rudder


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
