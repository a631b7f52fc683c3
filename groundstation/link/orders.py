"""Commands of a user as transactions, shared by command line and screen."""

from __future__ import annotations

import math
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
"""MAVLink's magic number that disarms in flight"""
AUTOLAND = "AUTOLAND"
TAKEOFF_ALTITUDE = "TKOFF_ALT"
"""ArduPlane's parameter, m above where it takes off"""
CHANGE_MODE = 1.0
"""MAV_DO_REPOSITION_FLAGS: change into the mode that flies to a place"""


def arm(target: Target) -> CommandExchange:
    """Let the wings move."""
    return CommandExchange(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0))


def disarm(target: Target, force: bool = False) -> CommandExchange:
    """Stop the wings; with ``force`` even in flight."""
    return CommandExchange(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, FORCE if force else 0.0))


def kill(target: Target) -> CommandExchange:
    """Stop the wings wherever they are."""
    return disarm(target, force=True)


def return_home(connection: Connection) -> Exchange:
    """Come back: the command, which every autopilot has."""
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)


def land(connection: Connection) -> Exchange:
    """Land here; an aeroplane of ArduPilot's, which takes no such command, by its mode AUTOLAND, else RTL."""
    if flies_by_modes(connection.state):
        return change_to(connection, landing_mode(connection.state))
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_LAND)


def change_to(connection: Connection, name: str) -> ModeChange:
    """Change to a mode by its name, in any case, with spaces, dashes or underscores.

    Raises:
        InputError: the vehicle has no such mode; the text says which it has.
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


class Place(NamedTuple):
    """Where to fly."""

    latitude: float
    """degrees; WGS-84"""
    longitude: float
    """degrees; WGS-84"""
    altitude: float
    """m; above home"""
    radius: float = math.nan
    """m; of the circle there, NaN for the vehicle's own"""


def counts_from_the_sea(state: VehicleState) -> bool:
    """Whether commands give altitudes above the sea, as PX4 takes them whatever the frame says."""
    return state.autopilot == modes.PX4


def flies_by_modes(state: VehicleState) -> bool:
    """Whether takeoff and landing are modes and no commands: of an ArduPlane without rotors to hover on."""
    fixed = state.vehicle_type == mavlink.MAV_TYPE_FIXED_WING
    return fixed and state.autopilot == modes.ARDUPILOT and not state.is_wingbeat


def landing_mode(state: VehicleState) -> str:
    """The mode that an ArduPlane lands in; those before 4.6 know no AUTOLAND, and announce no modes either."""
    announced = {number for number, _ in state.mode_names}
    return AUTOLAND if modes.mode_numbers(state).get(AUTOLAND) in announced else "RTL"


RESULTING: dict[str, tuple[str, ...]] = {
    "takeoff": ("TAKEOFF", "AUTO", "GUIDED"),
    "goto": ("LOITER", "GUIDED"),
    "return": ("RETURN", "RTL"),
    "land": ("LAND", AUTOLAND),
}
"""modes that an order leads to, by their names with the autopilots: an order is obeyed when the vehicle is in one"""


def resulting_modes(state: VehicleState, verb: str) -> frozenset[int]:
    """Custom modes, one of which the vehicle shows when it obeys an order; empty where it has none of their names."""
    known = modes.mode_numbers(state)
    wanted = (landing_mode(state),) if verb == "land" and flies_by_modes(state) else RESULTING[verb]
    return frozenset(known[name] for name in wanted if name in known)


def takeoff(connection: Connection, altitude: float, home: Home | None) -> Exchange:
    """Climb to ``altitude`` (m above home, NaN for what is planned); ``home`` for who counts from the sea.

    An aeroplane of ArduPilot's does it by its mode TAKEOFF, to the altitude of its parameter `TAKEOFF_ALTITUDE`.
    """
    if flies_by_modes(connection.state):
        return change_to(connection, "TAKEOFF")
    if home is None:
        return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_TAKEOFF, (0.0,) * 6 + (altitude,))
    here = (0.0, 0.0, 0.0, math.nan, math.nan, math.nan, home.altitude + altitude)
    return CommandExchange(connection.target, mavlink.MAV_CMD_NAV_TAKEOFF, here)


def go_to(connection: Connection, place: Place, home: Home | None) -> CommandExchange:
    """Fly to ``place`` and circle there; ``home`` for who counts from the sea."""
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT if home is None else mavlink.MAV_FRAME_GLOBAL
    altitude = place.altitude + (0.0 if home is None else home.altitude)
    x, y = (float(round(1e7 * angle)) for angle in (place.latitude, place.longitude))
    # ArduPilot takes no NaN for a radius or a direction of circling; 0 is its own.
    ardupilot = connection.state.autopilot == modes.ARDUPILOT
    radius = 0.0 if ardupilot and math.isnan(place.radius) else place.radius
    heading = 0.0 if ardupilot else math.nan
    parameters = (-1.0, CHANGE_MODE, radius, heading, x, y, altitude)
    return CommandExchange(connection.target, mavlink.MAV_CMD_DO_REPOSITION, parameters, frame=frame)
