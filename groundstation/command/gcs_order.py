"""``wingbeat gcs URL arm|mode|takeoff|...``: commands confirmed by the heartbeat.

The heartbeat has whether it is armed, and the mode that an order leads to: where the vehicle's modes have one of the
names that autopilots give it, an order that does not lead there within `SHOWN` has failed. Else, and where it was in
such a mode before, the acknowledgement is all that there is.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

from avionics.link.mission_codec import to_degrees
from groundstation.command import options
from groundstation.command.gcs_session import Session, Verb
from groundstation.link import modes, orders, parameters
from groundstation.link.answers import NoAnswer
from groundstation.link.exchange import Exchange
from groundstation.link.vehicle_state import VehicleState, is_wingbeat_vehicle
from wingbeat.errors import InputError

ALTITUDE = 20.0
"""m; default takeoff altitude above home, if the vehicle's plan has none either"""
SHOWN = 5.0
"""s; timeout for a heartbeat to show an acknowledged command: three heartbeats can be lost"""
LOWEST = 1.0
"""m; above home; least altitude at which a vehicle may stay without a requested altitude: below, it is on the ground
"""
JSON_KEYS = {"arm, disarm, mode, takeoff, goto, return, land": "done, mode, armed"}


def add_verbs(verbs: Any) -> None:
    """Add the commands."""
    verbs.add_parser("arm", help="let the wings move")
    disarm = verbs.add_parser("disarm", help="stop the wings")
    disarm.add_argument("--force", action="store_true", help="force disarm in flight: wings stop, the vehicle falls")
    verbs.add_parser("mode", help="change the flight mode").add_argument("name", metavar="NAME")
    takeoff = verbs.add_parser("takeoff", help="climb after launch; requires an armed vehicle")
    takeoff.add_argument(
        "--altitude",
        type=options.positive,
        metavar="M",
        help="altitude above home (default: that of its mission; PX4, copters: 20; ArduPlane: TKOFF_ALT)",
    )
    _add_goto(verbs.add_parser("goto", help="fly to a place and circle there"))
    verbs.add_parser("return", help="come back home")
    verbs.add_parser("land", help="land")


def _add_goto(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("latitude", nargs="?", type=options.number, metavar="LAT", help="degrees")
    parser.add_argument("longitude", nargs="?", type=options.number, metavar="LON", help="degrees")
    parser.add_argument(
        "--north", type=options.number, metavar="M", help="distance from home, instead of LAT and LON"
    )
    parser.add_argument("--east", type=options.number, metavar="M", help="distance from home, instead of LAT and LON")
    parser.add_argument("--altitude", type=options.number, metavar="M", help="altitude above home (default: current)")
    parser.add_argument(
        "--radius", type=options.positive, metavar="M", help="radius of the circle (default: the vehicle's)"
    )


def prepare(chosen: argparse.Namespace) -> None:
    """Check the position before the vehicle is contacted.

    Raises:
        InputError: missing, incomplete, duplicate, or outside the globe.
    """
    if chosen.verb != "goto":
        return
    on_globe, from_home = (
        _whole(pair) for pair in ((chosen.latitude, chosen.longitude), (chosen.north, chosen.east))
    )
    if on_globe == from_home:
        raise InputError("goto needs LAT LON, or --north and --east")
    if on_globe:
        _check_on_globe(chosen.latitude, chosen.longitude)


def _check_on_globe(latitude: float, longitude: float) -> None:
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise InputError(f"{latitude:g}, {longitude:g} is not a position on the globe")
    # MAVLink uses integers of 1e-7 degrees, of which two zeros mean the present position.
    if round(1e7 * latitude) == 0 == round(1e7 * longitude):
        raise InputError("goto 0 0: latitude and longitude 0 mean the current position")


def arm(session: Session) -> None:
    """Arm or disarm, until the heartbeat shows it.

    Raises:
        NoAnswer: denied, or not shown.
    """
    arming = session.chosen.verb == "arm"
    force = bool(getattr(session.chosen, "force", False))
    session.run_exchange(
        orders.arm(session.target) if arming else orders.disarm(session.target, force), session.chosen.verb
    )
    session.connection.listen(SHOWN, lambda state: state.armed == arming)
    if session.state.armed != arming:
        raise NoAnswer(f"{session.chosen.verb} accepted, but not confirmed by the heartbeat")
    session.done("armed" if arming else "disarmed")


def mode(session: Session) -> None:
    """Change the mode, until the heartbeat shows it."""
    know_modes(session)
    change = orders.change_to(session.connection, session.chosen.name)
    wanted = modes.canonical(session.chosen.name)
    session.run_exchange(change, f"mode {wanted}")
    session.done(f"mode {wanted}")


def takeoff(session: Session) -> None:
    """Take off to an altitude above home, regardless of the autopilot's reference.

    Raises:
        NoAnswer: denied, not shown, or home is required and unknown.
    """
    know_modes(session)
    altitude = session.chosen.altitude
    if orders.flies_by_modes(session.state) and altitude is not None:
        _set_takeoff_altitude(session, altitude)
    home = session.home() if orders.counts_from_the_sea(session.state) else None
    if altitude is None:
        altitude = math.nan if is_wingbeat_vehicle(session.state) else ALTITUDE
    obey(session, orders.takeoff(session.connection, altitude, home), "takeoff")


def _set_takeoff_altitude(session: Session, altitude: float) -> None:
    session.request_version()
    encoding, name = parameters.is_bytewise(session.state), orders.TAKEOFF_ALTITUDE
    read = session.run_exchange(parameters.ParameterRead(session.target, name, encoding), name)
    assert read.value is not None
    session.run_exchange(parameters.ParameterWrite(session.target, read.value, altitude, encoding), name)


def know_modes(session: Session) -> None:
    """Request the autopilot type and the names of its modes, which determine the form of commands."""
    session.identify_vehicle()
    session.connection.know_modes(session.read_mode_names())


def obey(session: Session, order: Exchange, verb: str, where: str = "") -> None:
    """Send a command, and wait until the heartbeat shows the resulting mode.

    Raises:
        NoAnswer: denied, or not shown.
    """
    wanted = orders.resulting_modes(session.state, verb)
    before = session.state.custom_mode
    session.run_exchange(order, verb)
    beats = session.state.beats

    def shown(state: VehicleState) -> bool:
        if state.custom_mode == before or not wanted:
            # Only a heartbeat after the acknowledgement shows the effect of the command.
            return state.beats > beats and (not wanted or before in wanted)
        return state.custom_mode in wanted

    session.connection.listen(SHOWN, shown)
    if wanted and session.state.custom_mode not in wanted:
        mode = modes.mode_name(session.state)
        raise NoAnswer(f"{verb} accepted, but the heartbeat shows {mode}")
    session.done(f"{verb}{where} accepted")


def goto(session: Session) -> None:
    """Fly to a global position or one relative to home.

    Raises:
        InputError: a position outside the globe, or no altitude for a vehicle on the ground.
        NoAnswer: denied, or home is required and unknown.
    """
    know_modes(session)
    chosen = session.chosen
    latitude, longitude = chosen.latitude, chosen.longitude
    if latitude is None:
        latitude, longitude = to_degrees(session.home(), chosen.north, chosen.east)
        _check_on_globe(latitude, longitude)
    session.connection.listen(3.0, lambda state: chosen.altitude is not None or state.altitude is not None)
    altitude = session.state.altitude if chosen.altitude is None else chosen.altitude
    if altitude is None:
        raise NoAnswer("altitude unknown: specify --altitude")
    if chosen.altitude is None and altitude < LOWEST:
        raise InputError(f"the vehicle is {altitude:.1f} m above home, too low for a circle: specify --altitude")
    home = session.home() if orders.counts_from_the_sea(session.state) else None
    place = orders.Place(latitude, longitude, altitude, math.nan if chosen.radius is None else chosen.radius)
    where = f" {latitude:.6f} {longitude:.6f} at {altitude:.0f} m"
    obey(session, orders.go_to(session.connection, place, home), "goto", where)


def _whole(pair: tuple[float | None, float | None]) -> bool:
    """Return whether both coordinates are given.

    Raises:
        InputError: one is given without the other.
    """
    if (pair[0] is None) != (pair[1] is None):
        raise InputError("goto needs both: LAT and LON, or --north and --east")
    return pair[0] is not None


def return_home(session: Session) -> None:
    """Return home."""
    know_modes(session)
    obey(session, orders.return_home(session.connection), "return")


def land(session: Session) -> None:
    """Land."""
    know_modes(session)
    by_mode = orders.flies_by_modes(session.state)
    if by_mode and (mode := orders.landing_mode(session.state)) != orders.AUTOLAND:
        print(f"the vehicle has no mode {orders.AUTOLAND}: {mode}", file=sys.stderr)
    obey(session, orders.land(session.connection), "land")


VERBS: dict[str, Verb] = {
    "arm": arm,
    "disarm": arm,
    "mode": mode,
    "takeoff": takeoff,
    "goto": goto,
    "return": return_home,
    "land": land,
}
