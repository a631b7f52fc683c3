"""``wingbeat trim``: the steady flight at an airspeed and a climb rate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from groundstation.command import options
from groundstation.command.steady import Asked, add_steady, asked, trimmed
from groundstation.views.json_document import print_document
from groundstation.views.steady_flight import flight_heading, trim_table
from groundstation.views.terminal import open_console
from sim_bridge.flight_mechanics.excursions import excursions, figures
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import throttle_for

EXAMPLES = (
    "wingbeat trim robo_raven_ii_d",
    "wingbeat trim arizona_100cm --airspeed 9 --climb 0.5",
    "wingbeat trim robo_raven_ii_d --aerodynamics blade_element --json",
)
STEADY_KEYS = {
    "vehicle, aerodynamics": "names",
    "airspeed, climb_rate": "m/s; asked for, and met within 1e-6",
    "inputs": "frequency Hz, amplitude rad (half the commanded stroke), elevator rad, throttle 0 to 1; null: none",
}
JSON_KEYS = STEADY_KEYS | {
    "means": "over a stroke: airspeed, climb_rate m/s, pitch, angle_of_attack rad, current A, electrical_power,"
    " mechanical_power W, torque N m, flap_amplitude rad, flap_rate rad/s",
    "excursions": "of the fuselage over a stroke, [least, greatest]: heave_speed m/s, pitch rad, pitch_rate rad/s,"
    " vertical_acceleration m/s^2; altitude m peak to peak",
    "figures": "strouhal, reduced_frequency, cost_of_transport, endurance s, range m",
    "residual": "largest difference between start and end of a stroke",
}


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    summary = "Find the steady flapping flight of a vehicle: drive, elevator, attitude, power."
    parser = options.build_parser("trim", summary, EXAMPLES, JSON_KEYS)
    add_steady(parser)
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Search the trim and print it.

    Raises:
        BadInput: unknown vehicle or model, or no such flight within what the vehicle can do.
    """
    chosen = build_parser().parse_args(arguments)
    flight = asked(chosen)
    orbit = trimmed(flight)
    moved, numbers = excursions(flight.vehicle, orbit), figures(flight.vehicle, orbit)
    if chosen.json:
        rest = {"means": orbit.means, "excursions": moved, "figures": numbers, "residual": orbit.residual}
        print_document(steady_document(flight, orbit) | rest)
        return 0
    console = open_console()
    console.print(flight_heading(flight.vehicle, orbit))
    console.print(trim_table(flight.vehicle, orbit, moved, numbers))
    return 0


def steady_document(flight: Asked, orbit: Orbit) -> dict[str, Any]:
    """The keys of `STEADY_KEYS`."""
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
