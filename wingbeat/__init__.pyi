from wingbeat.api.campaigns import campaign as campaign
from wingbeat.api.flights import Flight as Flight
from wingbeat.api.flights import fly as fly
from wingbeat.api.flights import open_log as open_log
from wingbeat.api.simulation import Simulation as Simulation
from wingbeat.api.steady import LinearMotion as LinearMotion
from wingbeat.api.steady import SteadyFlight as SteadyFlight
from wingbeat.api.steady import linearize as linearize
from wingbeat.api.steady import trim as trim
from wingbeat.api.vehicles import Vehicle as Vehicle
from wingbeat.api.vehicles import load_vehicle as load_vehicle
from wingbeat.api.vehicles import vehicle_names as vehicle_names

__all__ = [
    "Flight",
    "LinearMotion",
    "Simulation",
    "SteadyFlight",
    "Vehicle",
    "campaign",
    "fly",
    "linearize",
    "load_vehicle",
    "open_log",
    "trim",
    "vehicle_names",
]
