"""Missions: lists of items with positions in meters from home."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple


class ItemKind(IntEnum):
    """Kinds of mission items; values are MAV_CMD numbers of MAVLink.

    Private values start at 53000.
    """

    WAYPOINT = 16
    LOITER = 17
    """unlimited circle at a position"""
    CIRCLE = 18
    """circle at a position for a number of turns, for a time, or until an altitude"""
    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    JUMP = 177
    """continue with another item, a limited number of times"""
    HOLD = 53001
    """hold altitude and heading for a duration"""
    EXCITE = 53000
    """identification input, see `Excitation`"""
    SPEED = 178
    """change of the airspeed for the following items"""
    LAND_START = 189
    """marker of the start of the landing sequence"""
    SKIP = 53002
    """unsupported command that keeps its index and is skipped, see `MissionItem.skipped`"""


class Channel(IntEnum):
    """Control channel of an excitation."""

    ELEVATOR = 0
    THROTTLE = 1
    RUDDER = 2


class Shape(IntEnum):
    """Shape of an excitation."""

    DOUBLET = 0
    MULTISTEP_3211 = 1
    LINEAR_SWEEP = 2
    """frequency linear in time"""
    LOGARITHMIC_SWEEP = 3
    """frequency exponential in time: equal time for each octave"""
    MULTISINE = 4
    """sum of sines with one common period, disjoint between channels, see `multisine`"""


class Excitation(NamedTuple):
    """Identification input, with the loops frozen at their trim or active.

    If frozen, these are the altitude and pitch loops, and the roll loop if the rudder is excited.
    """

    channel: Channel
    """-; excited channel"""
    shape: Shape
    """-; shape of the input over time"""
    amplitude: float
    """rad (elevator, rudder) or - (throttle); peak amplitude"""
    width: float
    """s; duration of one step or of a whole sweep, or period of a multisine"""
    settle: float
    """s; settling time before and after the input, with the loops as during the input"""
    repeats: int
    """-; number of repetitions, separated by a settling time"""
    low: float = 0.0
    """Hz; initial frequency of a sweep, or lowest frequency of a multisine"""
    high: float = 0.0
    """Hz; final frequency of a sweep, or highest frequency of a multisine"""
    other_amplitudes: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, -, rad; amplitudes of a multisine on elevator, throttle and rudder in addition to ``channel``"""
    loops: int = 0
    """-; 1 if the loops stay active, 0 if they are frozen"""

    def amplitudes(self) -> tuple[float, float, float]:
        """Return the peak amplitudes of elevator (rad), throttle (-) and rudder (rad)."""
        elevator, throttle, rudder = self.other_amplitudes
        if self.channel == Channel.ELEVATOR:
            return elevator + self.amplitude, throttle, rudder
        if self.channel == Channel.THROTTLE:
            return elevator, throttle + self.amplitude, rudder
        return elevator, throttle, rudder + self.amplitude


class MissionItem(NamedTuple):
    """Mission item; fields that its kind does not use are 0."""

    kind: ItemKind
    """-; kind of the item"""
    north: float = 0.0
    """m; from home (WAYPOINT, LOITER, CIRCLE, LAND); stored but not used for a TAKEOFF"""
    east: float = 0.0
    """m; from home (WAYPOINT, LOITER, CIRCLE, LAND); stored but not used for a TAKEOFF"""
    altitude: float = 0.0
    """m; above home (TAKEOFF, WAYPOINT, LOITER, CIRCLE, HOLD)"""
    heading: float = 0.0
    """rad; heading (HOLD) or course of the final approach (LAND)"""
    duration: float = 0.0
    """s; hold time (HOLD), circle time (CIRCLE), circle time before the next item (WAYPOINT)"""
    excitation: Excitation | None = None
    """-; identification input (EXCITE)"""
    radius: float = 0.0
    """m; positive clockwise, negative counterclockwise, 0 for the default of the vehicle (LOITER, CIRCLE)"""
    turns: float = 0.0
    """-; number of turns (CIRCLE); without turns and duration the circle ends at its altitude"""
    jump_to: int = 0
    """-; index of the next item, from 0 (JUMP)"""
    repeats: int = 0
    """-; number of jumps, -1 for no limit (JUMP)"""
    skipped: tuple[float, ...] = ()
    """-; MAV_FRAME, MAV_CMD, four parameters, x, y and z as received (SKIP, SPEED, LAND_START)"""
    here: int = 0
    """-; 1 if the position is that of the vehicle at the start of the item (WAYPOINT, LOITER, CIRCLE, LAND)"""
    airspeed: float = 0.0
    """m/s; setpoint, 0 for the default of the vehicle (SPEED)"""


Mission = tuple[MissionItem, ...]

INSTANT = (ItemKind.SPEED, ItemKind.LAND_START, ItemKind.SKIP)
"""kinds of items without duration"""


_APPROACH = (ItemKind.WAYPOINT, ItemKind.CIRCLE, *INSTANT)


def landing_sequence(mission: Mission) -> int | None:
    """Return the index of the first LAND_START of a landing sequence, or None.

    A landing sequence leads from LAND_START by waypoints and circles to a LAND item.
    """
    for start, marked in enumerate(mission):
        if marked.kind == ItemKind.LAND_START:
            onward = next((item for item in mission[start:] if item.kind not in _APPROACH), None)
            if onward is not None and onward.kind == ItemKind.LAND:
                return start
    return None


def channel_names(excitation: Excitation) -> str:
    """Return the names of the channels that an excitation uses, for events."""
    used = zip(Channel, excitation.amplitudes(), strict=True)
    return " and ".join(channel.name.lower() for channel, amplitude in used if amplitude)


def describe(item: MissionItem) -> str:
    """Return a short description of an item for events.

    Units: position in m from home, heading in deg, altitude in m.
    """
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


_COMPLETED: Final = {
    ItemKind.CIRCLE: "completed",
    ItemKind.EXCITE: "completed",
    ItemKind.SPEED: "completed",
    ItemKind.LAND_START: "started",
    ItemKind.JUMP: "completed",
    ItemKind.SKIP: "skipped",
}


def completion_text(number: int, item: MissionItem) -> str:
    """Return the event text of a completed item; ``number`` counts from 0."""
    return f"waypoint {number} {_COMPLETED.get(item.kind, 'reached')} ({describe(item)})"


class RallyPoint(NamedTuple):
    """Alternative to home as the goal of a return."""

    north: float
    """m; from home"""
    east: float
    """m; from home"""
    altitude: float
    """m; altitude of the circle at the rally point, above home"""


Rally = tuple[RallyPoint, ...]


class Zone(NamedTuple):
    """Zone of a fence: circle or polygon, for inclusion or exclusion."""

    keep_in: int
    """-; 1 for an inclusion zone, 0 for an exclusion zone"""
    places: tuple[tuple[float, float], ...]
    """m; north and east of home: the center of a circle, or the corners of a polygon in order"""
    radius: float = 0.0
    """m; radius of a circle, 0 for a polygon"""


class Fence(NamedTuple):
    """Limits of a plan in addition to those of the vehicle: zones and altitudes."""

    zones: tuple[Zone, ...] = ()
    floor: float = 0.0
    """m; above home, 0 for none; active from the climb above it until an approach"""
    ceiling: float = 0.0
    """m; above home, 0 for none"""


NO_FENCE: Final = Fence()


class FlightPlan(NamedTuple):
    """Content of a plan file."""

    mission: Mission = ()
    fence: Fence = NO_FENCE
    rally: Rally = ()
    notes: tuple[str, ...] = ()
    """-; notices about unsupported content of the file"""
