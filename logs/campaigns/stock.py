"""Input files of a campaign, read once and sent to workers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from avionics.guidance.mission import FlightPlan
from avionics.missions.files import load_flight_plan
from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from avionics.vehicles import vehicle_names as flown_names
from logs.names import vehicle_files
from sim_bridge.flight.faults import Fault, mission_faults
from sim_bridge.sensors.transmitter import Script, load_script
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_world
from sim_bridge.vehicles import vehicle_names as world_names
from wingbeat.errors import InputError

DEFAULT_VEHICLE = "robo_raven_ii_d"
DEFAULT_MISSION = "circuit"


class Pair(NamedTuple):
    """A vehicle: its simulation model and its flight computer configuration."""

    world: SimulatedVehicle
    computer: FlightVehicle


class Planned(NamedTuple):
    """Content of one mission file."""

    plan: FlightPlan
    faults: tuple[Fault, ...]


class Stock(NamedTuple):
    """All input files of a campaign, by their names in the campaign file."""

    vehicles: dict[str, Pair]
    missions: dict[str, Planned]
    sticks: dict[str, Script]

    def texts(self) -> list[str]:
        """Return the texts of all files, for the digest of the campaign."""
        pairs = (text for name, pair in sorted(self.vehicles.items()) for text in _texts(name, pair))
        plans = (f"{name} {planned!r}" for name, planned in sorted(self.missions.items()))
        return [*pairs, *plans, *(f"{name} {script.text}" for name, script in sorted(self.sticks.items()))]


def _texts(name: str, pair: Pair) -> tuple[str, str, str]:
    return name, pair.world.text, pair.computer.file.text


def load_stock(folder: Path, vehicles: Iterable[str], missions: Iterable[str], sticks: Iterable[str]) -> Stock:
    """Read every file once; paths are relative to ``folder``, that of the campaign file.

    Raises:
        InputError: one cannot be used.
    """
    return Stock(
        {name: _pair(resolve_path(folder, name)) for name in vehicles},
        {name: _planned(resolve_path(folder, name)) for name in missions},
        {name: load_script(resolve_path(folder, name)) for name in sticks},
    )


def resolve_path(folder: Path, name: str) -> str:
    """Return the path of a file or folder relative to the campaign's, or the name itself."""
    beside = folder / name
    return str(beside) if name and beside.exists() else name


def _pair(vehicle: str) -> Pair:
    world, computer = vehicle_files(vehicle)
    if vehicle in world_names() and vehicle not in flown_names():
        raise InputError(f"{vehicle} has no flight-computer file: {' and '.join(flown_names())} can be flown")
    return Pair(load_world(world), load_flight_vehicle(computer))


def _planned(mission: str) -> Planned:
    return Planned(load_flight_plan(mission), mission_faults(mission))
