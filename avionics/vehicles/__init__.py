"""What the flight computer believes of each vehicle, as TOML files, and their reader."""

from avionics.vehicles.loader import FOLDER, FlightVehicle, load_vehicle, vehicle_names

__all__ = ["FOLDER", "FlightVehicle", "load_vehicle", "vehicle_names"]
