"""Vehicle files (TOML) of the flight computer, and their loader."""

from avionics.vehicles.loader import FOLDER, FlightVehicle, load_vehicle, vehicle_names

__all__ = ["FOLDER", "FlightVehicle", "load_vehicle", "vehicle_names"]
