"""Metadata of a recording about the start of the flight."""

from __future__ import annotations

import json
import math
from importlib.metadata import version
from typing import TYPE_CHECKING

from avionics import parameters
from avionics.guidance.mission import Mission
from avionics.recorder import Recorder
from avionics.vehicles import FlightVehicle
from logs.names import AERODYNAMICS, AUTOPILOT, FLIGHT_VEHICLE, MISSION, PARAMETERS, WORLD, WORLD_VEHICLE
from logs.settings import mission_document
from sim_bridge.flight.faults import Fault

if TYPE_CHECKING:
    # A flight computer records its inputs without the physics and their compiler.
    from sim_bridge.flight.world import Scenario
    from sim_bridge.vehicles import SimulatedVehicle


def exact_fault(fault: Fault) -> str:
    """Return a fault in command-line notation with exact times."""
    end = f"-{fault.until!r}" if math.isfinite(fault.until) else ""
    return f"{fault.name}@{fault.at!r}{end}"


def note_scenario(recorder: Recorder, vehicle: SimulatedVehicle, scenario: Scenario) -> None:
    """Record the settings of the world: vehicle file, aerodynamic model, seed, wind, home, version."""
    recorder.attach(WORLD_VEHICLE, "application/toml", vehicle.text.encode())
    values = {
        "version": version("wingbeat"),
        "vehicle": vehicle.name,
        AERODYNAMICS: vehicle.aerodynamics.model,
        "seed": str(scenario.seed),
        "wind_speed": repr(scenario.wind_speed),
        "wind_from": repr(scenario.wind_from),
        "turbulence": scenario.turbulence,
        "vibration": repr(scenario.vibration),
        "duration": repr(scenario.duration),
        "faults": " ".join(map(exact_fault, scenario.faults)),
        "throw": " ".join(map(repr, scenario.throw)),
        "sensor_corner": repr(scenario.sensor_corner),
        "home_latitude": repr(scenario.home.latitude),
        "home_longitude": repr(scenario.home.longitude),
        "home_altitude": repr(scenario.home.altitude),
    }
    recorder.note(WORLD, values)


def note_autopilot(recorder: Recorder, vehicle: FlightVehicle, values: dict[str, str]) -> None:
    """Record the foreign autopilot, the assignment of its outputs, and the flight vehicle file."""
    recorder.note(AUTOPILOT, {"version": version("wingbeat"), "vehicle": vehicle.name, **values})
    recorder.attach(FLIGHT_VEHICLE, "application/toml", vehicle.file.text.encode())


def note_inputs(recorder: Recorder, vehicle: FlightVehicle, mission: Mission) -> None:
    """Record the initial inputs of the flight: vehicle file, mission, parameters, version."""
    recorder.note("wingbeat.avionics", {"version": version("wingbeat"), "vehicle": vehicle.name})
    recorder.attach(FLIGHT_VEHICLE, "application/toml", vehicle.file.text.encode())
    recorder.attach(MISSION, "application/json", json.dumps(mission_document(mission), indent=1).encode())
    table = parameters.parameter_table(vehicle.gains)
    recorder.note(PARAMETERS, {name: repr(parameters.get(vehicle.gains, p)) for name, p in table.items()})
