"""What ``wingbeat trim`` and ``wingbeat linearize`` share: vehicle, speed, climb, and the search for the trim."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from typing import NamedTuple

from rich.console import Console

from groundstation.command import options
from groundstation.command.sim import COMPILING, simulated
from groundstation.views.progress import ProgressBar
from sim_bridge.flight_mechanics.orbit import Orbit, trim
from sim_bridge.plant import Plant, physics_compiled
from sim_bridge.vehicles import SimulatedVehicle


class Asked(NamedTuple):
    """A steady flight that is looked for."""

    vehicle: SimulatedVehicle
    airspeed: float
    """m/s"""
    climb_rate: float
    """m/s"""


def add_steady(parser: argparse.ArgumentParser) -> None:
    """Offer the vehicle, ``--airspeed``, ``--climb`` and ``--aerodynamics``."""
    parser.add_argument("vehicle", metavar="VEHICLE", help="name or file of a vehicle, see wingbeat vehicles")
    parser.add_argument("--airspeed", type=options.positive, metavar="M/S", help="the vehicle's cruise by default")
    parser.add_argument("--climb", type=options.number, metavar="M/S", help="climb rate, up positive (its cruise's)")
    options.add_aerodynamics(parser)


def asked(chosen: argparse.Namespace) -> Asked:
    """What the command line asks for.

    Raises:
        BadInput: unknown vehicle or aerodynamic model, or a file that cannot be used.
    """
    vehicle = simulated(options.vehicle_files(chosen.vehicle)[0], chosen.aerodynamics)
    airspeed = vehicle.cruise.airspeed if chosen.airspeed is None else chosen.airspeed
    return Asked(vehicle, airspeed, vehicle.cruise.climb_rate if chosen.climb is None else chosen.climb)


def load_physics(vehicle: SimulatedVehicle) -> None:
    """Compile the physics where that has not been done, telling so on a terminal.

    Raises:
        BadInput: the vehicle's bodies make no vehicle.
    """
    plant = Plant(vehicle)
    if not physics_compiled():
        console = Console(stderr=True)
        with console.status(COMPILING) if console.is_terminal else nullcontext():
            plant.compile()


def trimmed(flight: Asked) -> Orbit:
    """The steady flight asked for, with a progress bar for a long search.

    Raises:
        BadInput: there is none, or not within what the vehicle can do.
    """
    load_physics(flight.vehicle)
    with ProgressBar("searching") as bar:
        return trim(*flight, told=lambda words: bar.show(0, 0, f"searching a steady flight at {words}"))
