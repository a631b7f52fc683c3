"""Commands of a user as transactions, shared by command line and screen."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home
from groundstation.link import modes
from groundstation.link.commands import CommandExchange
from groundstation.link.connection import Connection
from groundstation.link.exchange import Exchange, Target
from groundstation.link.mode_change import ModeChange, change_mode
from groundstation.link.vehicle_state import VehicleState
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

FORCE = 21196.0
"""MAVLink's magic number to disarm in flight"""
AUTOLAND = "AUTOLAND"
TAKEOFF_ALTITUDE = "TKOFF_ALT"
"""ArduPlane parameter, m above the takeoff position"""
CHANGE_MODE = 1.0
"""MAV_DO_REPOSITION_FLAGS: change to the mode that flies to a position"""


def arm(target: Target) -> CommandExchange:
    """Arm: enable the wings."""
    return CommandExchange(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0))


def disarm(target: Target, force: bool = False) -> CommandExchange:
    """Disarm: stop the wings; with ``force`` even in flight."""
    return CommandExchange(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, FORCE if force else 0.0))


def kill(target: Target) -> CommandExchange:
    """Stop the wings at once, also in flight."""
    return disarm(target, force=True)


def return_home(connection: Connection) -> Exchange:
    """Return home by the command, which every autopilot supports."""
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)


def land(connection: Connection) -> Exchange:
    """Land; an ArduPilot airplane, which lacks the command, by its mode AUTOLAND, else RTL."""
    if flies_by_modes(connection.state):
        return change_to(connection, landing_mode(connection.state))
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_LAND)


def change_to(connection: Connection, name: str) -> ModeChange:
    """Change to a mode by name, case-insensitive, with blanks, dashes or underscores.

    Raises:
        InputError: the vehicle has no such mode; the message lists its modes.
    """
    state = connection.state
    number = modes.mode_numbers(state).get(modes.canonical(name))
    if number is None:
        names = sorted(modes.known_modes(state))
        told = ", ".join(names) or "none it names"
        raise InputError(
            f"the vehicle has no mode {name!r}{did_you_mean(modes.canonical(name), names)}; it has {told}"
        )
    return change_mode(connection.target, number, modes.uses_main_and_sub(state))


class Order(NamedTuple):
    """Command that a screen offers as a key or a button."""

    build: Callable[[Connection], Exchange]
    done: str
    """-; notice of its execution"""
    question: str
    """-; of the confirmation"""
    warning: str = ""
    """-; consequence, in the confirmation"""


ORDERS = {
    "arm": Order(lambda link: arm(link.target), "armed", "Arm?", "The wings may move at once."),
    "disarm": Order(lambda link: disarm(link.target), "disarmed", "Disarm?", "A vehicle in flight denies it."),
    "kill": Order(lambda link: kill(link.target), "killed", "Kill?", "The wings stop at once. In flight it falls."),
    "return": Order(return_home, "returning", "Return home?"),
    "land": Order(land, "landing", "Land?"),
}
"""commands of the screens by label"""


class Place(NamedTuple):
    """Target position."""

    latitude: float
    """degrees; WGS-84"""
    longitude: float
    """degrees; WGS-84"""
    altitude: float
    """m; above home"""
    radius: float = math.nan
    """m; loiter radius, NaN for the vehicle's default"""


def counts_from_the_sea(state: VehicleState) -> bool:
    """Return whether commands use altitudes above sea level, as PX4 does regardless of the frame."""
    return state.autopilot == modes.PX4


def flies_by_modes(state: VehicleState) -> bool:
    """Return whether takeoff and landing are modes instead of commands: for an ArduPlane without hover rotors."""
    fixed = state.vehicle_type == mavlink.MAV_TYPE_FIXED_WING
    return fixed and state.autopilot == modes.ARDUPILOT and not state.is_wingbeat


def landing_mode(state: VehicleState) -> str:
    """Return the landing mode of an ArduPlane; versions before 4.6 lack AUTOLAND and announce no modes."""
    announced = {number for number, _ in state.mode_names}
    return AUTOLAND if modes.mode_numbers(state).get(AUTOLAND) in announced else "RTL"


RESULTING: dict[str, tuple[str, ...]] = {
    "takeoff": ("TAKEOFF", "AUTO", "GUIDED"),
    "goto": ("LOITER", "GUIDED"),
    "return": ("RETURN", "RTL"),
    "land": ("LAND", AUTOLAND),
}
"""modes that result from a command, by their names on the autopilots: one of them shows its execution"""


def resulting_modes(state: VehicleState, verb: str) -> frozenset[int]:
    """Return the custom modes that show the execution of a command; empty if the vehicle has none of them."""
    known = modes.mode_numbers(state)
    wanted = (landing_mode(state),) if verb == "land" and flies_by_modes(state) else RESULTING[verb]
    return frozenset(known[name] for name in wanted if name in known)


def takeoff(connection: Connection, altitude: float, home: Home | None) -> Exchange:
    """Take off to ``altitude`` (m above home, NaN for the planned one); ``home`` if altitudes are above sea level.

    An ArduPilot airplane uses its mode TAKEOFF, to the altitude of its parameter `TAKEOFF_ALTITUDE`.
    """
    if flies_by_modes(connection.state):
        return change_to(connection, "TAKEOFF")
    if home is None:
        return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 6 + (altitude,))
    here = (0.0, 0.0, 0.0, math.nan, math.nan, math.nan, home.altitude + altitude)
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_TAKEOFF, here)


def go_to(connection: Connection, place: Place, home: Home | None) -> CommandExchange:
    """Fly to ``place`` and loiter; ``home`` is used if altitudes are above sea level."""
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT if home is None else mavlink.MAV_FRAME_GLOBAL
    altitude = place.altitude + (0.0 if home is None else home.altitude)
    x, y = (float(round(1e7 * angle)) for angle in (place.latitude, place.longitude))
    # ArduPilot accepts no NaN for radius or direction of a loiter; 0 is its default.
    ardupilot = connection.state.autopilot == modes.ARDUPILOT
    radius = 0.0 if ardupilot and math.isnan(place.radius) else place.radius
    heading = 0.0 if ardupilot else math.nan
    parameters = (-1.0, CHANGE_MODE, radius, heading, x, y, altitude)
    return CommandExchange(connection.target, mavlink.MAV_CMD_DO_REPOSITION, parameters, frame=frame)
