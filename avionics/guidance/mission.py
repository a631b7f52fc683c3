"""What a mission is: a list of items, in metres from home."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple


class ItemKind(IntEnum):
    """What an item asks for; the values are MAVLink's MAV_CMD numbers (private ones from 53000)."""

    WAYPOINT = 16
    LOITER = 17
    """circle at a place without end"""
    CIRCLE = 18
    """circle at a place for some turns, for a time, or up or down to an altitude"""
    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    JUMP = 177
    """go on with another item, some times"""
    HOLD = 53001
    """hold altitude and heading for a duration"""
    EXCITE = 53000
    """identification input, see `Excitation`"""
    SPEED = 178
    """change the airspeed from here on"""
    LAND_START = 189
    """mark of the place where the landing sequence begins"""
    SKIP = 53002
    """a command that is kept in its place and passed over, see `MissionItem.skipped`"""


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
    other_amplitudes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, -, rad; of a multisine on elevator, throttle and rudder beside that on ``channel``"""
    loops: int = 0
    """-; 1 when the loops fly on, 0 when they are frozen"""

    def amplitudes(self) -> tuple[float, float, float]:
        """Greatest excursion of elevator (rad), throttle (-) and rudder (rad)."""
        elevator, throttle, rudder = self.other_amplitudes
        if self.channel == Channel.ELEVATOR:
            return elevator + self.amplitude, throttle, rudder
        if self.channel == Channel.THROTTLE:
            return elevator, throttle + self.amplitude, rudder
        return elevator, throttle, rudder + self.amplitude


class MissionItem(NamedTuple):
    """One item; fields that its kind does not use are 0."""

    kind: ItemKind
    """-; what to do"""
    north: float = 0.0
    """m; from home (WAYPOINT, LOITER, CIRCLE, LAND); of a TAKEOFF kept for who planned it, not flown to"""
    east: float = 0.0
    """m; from home (WAYPOINT, LOITER, CIRCLE, LAND); of a TAKEOFF kept for who planned it, not flown to"""
    altitude: float = 0.0
    """m; above home (TAKEOFF, WAYPOINT, LOITER, CIRCLE, HOLD)"""
    heading: float = 0.0
    """rad; to hold (HOLD), or of the final approach (LAND)"""
    duration: float = 0.0
    """s; to hold (HOLD), to circle (CIRCLE), to circle before the next item (WAYPOINT)"""
    excitation: Excitation | None = None
    """-; what to fly (EXCITE)"""
    radius: float = 0.0
    """m; positive clockwise, negative the other way, 0 for the vehicle's own (LOITER, CIRCLE)"""
    turns: float = 0.0
    """-; to fly (CIRCLE); without turns and duration the circle ends at its altitude"""
    jump_to: int = 0
    """-; number of the item to go on with, from 0 (JUMP)"""
    repeats: int = 0
    """-; how often it is jumped, -1 for ever (JUMP)"""
    skipped: tuple[float, ...] = ()
    """-; MAV_FRAME, MAV_CMD, four parameters, x, y and z as they were sent (SKIP, SPEED, LAND_START)"""
    here: int = 0
    """-; 1 where the place is that of the aircraft when the item begins (WAYPOINT, LOITER, CIRCLE, LAND)"""
    airspeed: float = 0.0
    """m/s; setpoint, 0 for the vehicle's own (SPEED)"""


Mission = tuple[MissionItem, ...]

INSTANT = (ItemKind.SPEED, ItemKind.LAND_START, ItemKind.SKIP)
"""kinds that take no time"""


_APPROACH = (ItemKind.WAYPOINT, ItemKind.CIRCLE, *INSTANT)


def landing_sequence(mission: Mission) -> int | None:
    """Number of the first LAND_START that waypoints and circles lead on to a landing; None if there is none."""
    for start, marked in enumerate(mission):
        if marked.kind == ItemKind.LAND_START:
            onward = next((item for item in mission[start:] if item.kind not in _APPROACH), None)
            if onward is not None and onward.kind == ItemKind.LAND:
                return start
    return None


def channel_names(excitation: Excitation) -> str:
    """Names of the channels that an excitation uses, for events."""
    used = zip(Channel, excitation.amplitudes(), strict=True)
    return " and ".join(channel.name.lower() for channel, amplitude in used if amplitude)


def describe(item: MissionItem) -> str:
    """Short description of an item for events: position in m from home, heading in deg, altitude in m."""
    position = "" if item.here else f"{item.north:.0f} m N, {item.east:.0f} m E, "
    altitude = f"{item.altitude:.0f} m"
    descriptions = {
        ItemKind.WAYPOINT: f"{position}{altitude}",
        ItemKind.LOITER: f"loiter {position}{altitude}",
        ItemKind.CIRCLE: f"circle {position}{altitude}",
        ItemKind.TAKEOFF: f"takeoff {altitude}",
        ItemKind.HOLD: f"hold {math.degrees(item.heading) % 360.0:.0f} deg, {altitude}",
        ItemKind.EXCITE: "excitation" if item.excitation is None else f"{channel_names(item.excitation)} input",
        ItemKind.SPEED: f"airspeed {item.airspeed:g} m/s" if item.airspeed else "default airspeed",
        ItemKind.LAND_START: "landing sequence",
        ItemKind.JUMP: f"jump to item {item.jump_to}",
        ItemKind.RETURN: "return to launch",
        ItemKind.SKIP: f"command {item.skipped[1]:.0f}" if item.skipped else "command",
    }
    return descriptions.get(item.kind, item.kind.name.lower())


_COMPLETED = {
    ItemKind.CIRCLE: "completed",
    ItemKind.EXCITE: "completed",
    ItemKind.SPEED: "completed",
    ItemKind.LAND_START: "started",
    ItemKind.JUMP: "completed",
    ItemKind.SKIP: "skipped",
}


def completion_text(number: int, item: MissionItem) -> str:
    """Event text of a completed item; ``number`` counts from 0."""
    return f"waypoint {number} {_COMPLETED.get(item.kind, 'reached')} ({describe(item)})"


class RallyPoint(NamedTuple):
    """A place to return to instead of home."""

    north: float
    """m; from home"""
    east: float
    """m; from home"""
    altitude: float
    """m; above home, at which it is circled there"""


Rally = tuple[RallyPoint, ...]


class Zone(NamedTuple):
    """A part of a fence: a circle or a polygon to stay inside of, or to keep out of."""

    keep_in: int
    """-; 1 to stay inside, 0 to stay outside"""
    places: tuple[tuple[float, float], ...]
    """m; north and east of home: the centre of a circle, or the corners of a polygon in their order"""
    radius: float = 0.0
    """m; of a circle, 0 for a polygon"""


class Fence(NamedTuple):
    """Where to fly, beside the vehicle's own limits: inside of every zone and between the altitudes."""

    zones: tuple[Zone, ...] = ()
    floor: float = 0.0
    """m; above home, 0 for none; holds once it was passed on the way up, until an approach"""
    ceiling: float = 0.0
    """m; above home, 0 for none"""


NO_FENCE = Fence()


class FlightPlan(NamedTuple):
    """All that a plan file holds."""

    mission: Mission = ()
    fence: Fence = NO_FENCE
    rally: Rally = ()
    notes: tuple[str, ...] = ()
    """-; what of the file is not flown, for people"""
