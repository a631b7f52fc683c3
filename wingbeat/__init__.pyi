from wingbeat.api.campaigns import campaign as campaign
from wingbeat.api.flights import Flight as Flight
from wingbeat.api.flights import fly as fly
from wingbeat.api.flights import open_log as open_log
from wingbeat.api.identification import Identification as Identification
from wingbeat.api.identification import identify as identify
from wingbeat.api.logs import LogReport as LogReport
from wingbeat.api.logs import check_log as check_log
from wingbeat.api.logs import import_log as import_log
from wingbeat.api.simulation import Simulation as Simulation
from wingbeat.api.steady import LinearMotion as LinearMotion
from wingbeat.api.steady import SteadyFlight as SteadyFlight
from wingbeat.api.steady import linearize as linearize
from wingbeat.api.steady import trim as trim
from wingbeat.api.tuning import Tuning as Tuning
from wingbeat.api.tuning import new_bird as new_bird
from wingbeat.api.tuning import tune as tune
from wingbeat.api.tunnel import TunnelForces as TunnelForces
from wingbeat.api.tunnel import tunnel as tunnel
from wingbeat.api.vehicles import Vehicle as Vehicle
from wingbeat.api.vehicles import load_vehicle as load_vehicle
from wingbeat.api.vehicles import vehicle_names as vehicle_names

__all__ = [
    "Flight",
    "Identification",
    "LinearMotion",
    "LogReport",
    "Simulation",
    "SteadyFlight",
    "Tuning",
    "TunnelForces",
    "Vehicle",
    "campaign",
    "check_log",
    "fly",
    "identify",
    "import_log",
    "linearize",
    "load_vehicle",
    "new_bird",
    "open_log",
    "trim",
    "tune",
    "tunnel",
    "vehicle_names",
]
