"""``wingbeat gcs URL arm|disarm|mode|takeoff|goto|return|land``: orders, until the vehicle shows that it obeys."""

from __future__ import annotations

import argparse
import math
from typing import Any

from avionics.link.mission_codec import to_degrees
from avionics.quantities import BadInput
from groundstation.command import options
from groundstation.command.gcs_session import Session, Verb
from groundstation.link import orders
from groundstation.link.answers import NoAnswer

JSON_KEYS = {"arm, disarm, mode, takeoff, goto, return, land": "done, mode, armed"}


def add_verbs(verbs: Any) -> None:
    """The orders."""
    verbs.add_parser("arm", help="let the wings move")
    disarm = verbs.add_parser("disarm", help="stop the wings")
    disarm.add_argument("--force", action="store_true", help="even in flight: it falls")
    verbs.add_parser("mode", help="change the flight mode").add_argument("name", metavar="NAME")
    takeoff = verbs.add_parser("takeoff", help="climb from the ground or the hand; it has to be armed")
    takeoff.add_argument(
        "--altitude", type=options.positive, default=20.0, metavar="M", help="above home, to climb to (20)"
    )
    _add_goto(verbs.add_parser("goto", help="fly to a place and circle there"))
    verbs.add_parser("return", help="come back home")
    verbs.add_parser("land", help="land")


def _add_goto(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("latitude", nargs="?", type=options.number, metavar="LAT", help="degrees")
    parser.add_argument("longitude", nargs="?", type=options.number, metavar="LON", help="degrees")
    parser.add_argument("--north", type=options.number, metavar="M", help="of home, instead of LAT and LON")
    parser.add_argument("--east", type=options.number, metavar="M", help="of home, instead of LAT and LON")
    parser.add_argument("--altitude", type=options.number, metavar="M", help="above home (as it is)")
    parser.add_argument("--radius", type=options.positive, metavar="M", help="of the circle (the vehicle's own)")


def prepare(chosen: argparse.Namespace) -> None:
    """Check the place before the vehicle is spoken to.

    Raises:
        BadInput: none, half of one, two, or none on the globe.
    """
    if chosen.verb != "goto":
        return
    on_globe, from_home = (
        _whole(pair) for pair in ((chosen.latitude, chosen.longitude), (chosen.north, chosen.east))
    )
    if on_globe == from_home:
        raise BadInput("goto needs LAT LON, or --north and --east")
    if on_globe:
        _check_on_globe(chosen.latitude, chosen.longitude)


def _check_on_globe(latitude: float, longitude: float) -> None:
    if not (-90.0 <= latitude <= 90.0 and -180.0 <= longitude <= 180.0):
        raise BadInput(f"{latitude:g}, {longitude:g} is no place on the globe")


def arm(session: Session) -> None:
    """Arm or disarm, until the heartbeat shows it.

    Raises:
        NoAnswer: refused, or not shown.
    """
    arming = session.chosen.verb == "arm"
    force = bool(getattr(session.chosen, "force", False))
    session.ask(orders.arm(session.target) if arming else orders.disarm(session.target, force), session.chosen.verb)
    session.connection.listen(3.0, lambda state: state.armed == arming)
    if session.state.armed != arming:
        raise NoAnswer(f"the vehicle accepted to {session.chosen.verb}, but its heartbeat does not show it")
    session.done("armed" if arming else "disarmed")


def mode(session: Session) -> None:
    """Change the mode, until the heartbeat shows it."""
    session.connection.know_modes(session.ask_mode_names())
    change = orders.change_to(session.connection, session.chosen.name)
    wanted = orders.canonical(session.chosen.name)
    session.ask(change, f"mode {wanted}")
    session.done(f"mode {wanted}")


def takeoff(session: Session) -> None:
    """Climb; the altitude counts from home whatever the autopilot counts from."""
    home = session.home() if orders.counts_from_the_sea(session.state) else None
    session.ask(orders.takeoff(session.connection, session.chosen.altitude, home), "takeoff")
    session.done("takeoff accepted")


def goto(session: Session) -> None:
    """Fly to a place, given on the globe or from home.

    Raises:
        BadInput: metres from home that lead to no place on the globe.
        NoAnswer: refused, or home is needed and not known.
    """
    chosen = session.chosen
    latitude, longitude = chosen.latitude, chosen.longitude
    if latitude is None:
        latitude, longitude = to_degrees(session.home(), chosen.north, chosen.east)
        _check_on_globe(latitude, longitude)
    session.connection.listen(3.0, lambda state: chosen.altitude is not None or state.altitude is not None)
    altitude = session.state.altitude if chosen.altitude is None else chosen.altitude
    if altitude is None:
        raise NoAnswer("the vehicle does not say how high it is: give an --altitude")
    home = session.home() if orders.counts_from_the_sea(session.state) else None
    place = orders.Place(latitude, longitude, altitude, math.nan if chosen.radius is None else chosen.radius)
    session.ask(orders.go_to(session.connection, place, home), "goto")
    session.done(f"goto {latitude:.6f} {longitude:.6f} at {altitude:.0f} m accepted")


def _whole(pair: tuple[float | None, float | None]) -> bool:
    """Whether both are given.

    Raises:
        BadInput: one is given without the other.
    """
    if (pair[0] is None) != (pair[1] is None):
        raise BadInput("goto needs both: LAT and LON, or --north and --east")
    return pair[0] is not None


def return_home(session: Session) -> None:
    """Come back."""
    session.ask(orders.return_home(session.connection), "return")
    session.done("return accepted")


def land(session: Session) -> None:
    """Land."""
    session.ask(orders.land(session.connection), "land")
    session.done("land accepted")


VERBS: dict[str, Verb] = {
    "arm": arm,
    "disarm": arm,
    "mode": mode,
    "takeoff": takeoff,
    "goto": goto,
    "return": return_home,
    "land": land,
}
