"""Common parts of ``wingbeat trim`` and ``wingbeat linearize``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from rich.console import RenderableType

from groundstation.command import options
from groundstation.command.compiling import load_physics
from groundstation.command.sim import simulated, unbuilt
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.steady_flight import flight_heading
from groundstation.views.terminal import open_console
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.flight_mechanics.stroke_map import check_memory, throttle_for
from sim_bridge.vehicles import SimulatedVehicle

STEADY_KEYS = {
    "vehicle, aerodynamics": "names",
    "airspeed, climb_rate": "m/s; asked for, and met within 1e-6",
    "inputs": "frequency Hz, amplitude rad (half the commanded stroke), elevator rad, throttle 0 to 1; null: none",
}


class TrimRequest(NamedTuple):
    """Requested steady flight."""

    vehicle: SimulatedVehicle
    airspeed: float
    """m/s"""
    climb_rate: float
    """m/s"""


class Answer(NamedTuple):
    """Result of a command about a steady flight."""

    document: dict[str, Any]
    """JSON content after `STEADY_KEYS`"""
    table: RenderableType
    """text output"""
    warnings: tuple[str, ...] = ()
    """lines for stderr"""


def steady_parser(name: str, summary: str, examples: Sequence[str], keys: Mapping[str, str]) -> options.Parser:
    """Build a parser with the vehicle, ``--airspeed``, ``--climb``, ``--aerodynamics`` and ``--json``."""
    parser = options.build_parser(name, summary, examples, keys)
    parser.add_argument("vehicle", metavar="VEHICLE", help="name, file or folder of a vehicle, see wingbeat vehicles")
    parser.add_argument("--airspeed", type=options.positive, metavar="M/S", help="airspeed (default: cruise)")
    parser.add_argument(
        "--climb", type=options.number, metavar="M/S", help="climb rate, up positive (default: that of the cruise)"
    )
    options.add_aerodynamics(parser)
    options.add_json(parser)
    return parser


def answer(chosen: argparse.Namespace, examined: Callable[[SimulatedVehicle, Orbit], Answer]) -> int:
    """Compute the requested steady flight and print the result of ``examined``.

    Raises:
        InputError: unknown vehicle or model, or no such flight within the limits of the vehicle.
    """
    flight = trim_request(chosen)
    orbit = trimmed(flight)
    found = examined(flight.vehicle, orbit)
    for line in found.warnings:
        print(f"warning: {line}", file=sys.stderr)
    if chosen.json:
        print_document(steady_document(flight, orbit) | found.document)
        return 0
    console = open_console()
    console.print(flight_heading(flight.vehicle, orbit))
    console.print(found.table)
    return 0


def trim_request(chosen: argparse.Namespace) -> TrimRequest:
    """Return the steady flight of the command line.

    Raises:
        InputError: unknown vehicle or aerodynamic model, one with a wake history, or an invalid file.
    """
    asked_for = options.vehicle_files(chosen.vehicle)[0], chosen.aerodynamics
    # Rejected before any compilation.
    check_memory(unbuilt(*asked_for))
    vehicle = simulated(*asked_for)
    airspeed = vehicle.cruise.airspeed if chosen.airspeed is None else chosen.airspeed
    return TrimRequest(vehicle, airspeed, vehicle.cruise.climb_rate if chosen.climb is None else chosen.climb)


def trimmed(flight: TrimRequest) -> Orbit:
    """Compute the requested steady flight, with a progress bar for a long search.

    Raises:
        InputError: there is none within the limits of the vehicle.
    """
    load_physics(flight.vehicle)
    with ProgressBar("searching") as bar:
        return trim(*flight, on_progress=lambda words: bar.show(0, 0, f"searching a steady flight at {words}"))


def steady_document(flight: TrimRequest, orbit: Orbit) -> dict[str, Any]:
    """Build the document of `STEADY_KEYS`."""
    vehicle = flight.vehicle
    throttle = {"servo": None, "crank": throttle_for(orbit.inputs.frequency, vehicle)}
    inputs = orbit.inputs._asdict() | {"throttle": throttle.get(vehicle.drive.kind, orbit.inputs.throttle)}
    if vehicle.drive.kind != "servo":
        inputs["amplitude"] = None
    return {
        "vehicle": vehicle.name,
        "aerodynamics": vehicle.aerodynamics.model,
        "airspeed": flight.airspeed,
        "climb_rate": flight.climb_rate,
        "inputs": inputs,
    }
