"""Vehicles: the simulation model and the configuration of the flight computer."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.names import vehicle_files
from sim_bridge.mechanism import total_mass
from sim_bridge.vehicles import SimulatedVehicle, models_of
from sim_bridge.vehicles import load_vehicle as load_world
from sim_bridge.vehicles import vehicle_names as world_names

__all__ = ["Vehicle", "load_vehicle", "vehicle_names"]


class Vehicle(NamedTuple):
    """A vehicle: what is simulated and what the flight computer assumes."""

    name: str
    world: SimulatedVehicle
    """bodies, wings, drive, battery, sensors"""
    computer: FlightVehicle
    """gains, limits and calibrations"""

    @property
    def mass(self) -> float:
        """Total mass in kg."""
        return total_mass(self.world)

    @property
    def aerodynamic_models(self) -> tuple[str, ...]:
        """Names of the aerodynamic models that the vehicle file has a section for."""
        return tuple(models_of(self.world))

    def __repr__(self) -> str:
        wing = self.world.wing
        return (
            f"Vehicle {self.name}: {self.mass:.3f} kg, span {2.0 * wing.semispan:.2f} m,"
            f" aerodynamics {self.world.aerodynamics.model} (of {', '.join(self.aerodynamic_models)})"
        )


def vehicle_names() -> tuple[str, ...]:
    """Return the names of the vehicles that come with the package."""
    return tuple(world_names())


def load_vehicle(vehicle: str | Path) -> Vehicle:
    """Load a vehicle by its name or its folder (``world.toml`` and ``avionics.toml``).

    Raises:
        InputError: unknown name, or a file that is not valid.
    """
    world, computer = vehicle_files(str(vehicle))
    return Vehicle(Path(str(vehicle)).name, load_world(world), load_flight_vehicle(computer))
