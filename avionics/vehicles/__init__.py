"""What the flight computer believes of each vehicle, as TOML files, and their reader."""

from avionics.vehicles.loader import FlightVehicle, load_vehicle, vehicle_names

__all__ = ["FlightVehicle", "load_vehicle", "vehicle_names"]
