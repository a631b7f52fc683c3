"""``wingbeat trim``: the steady flight at an airspeed and a climb rate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from groundstation.command import options
from groundstation.command.steady import STEADY_KEYS, Answer, answer, steady_parser
from groundstation.views.steady_flight import draws_current, trim_table
from logs.model_range import range_findings
from sim_bridge.flight_mechanics.excursions import excursions, figures
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.similarity import orbit_excesses
from sim_bridge.vehicles import SimulatedVehicle

EXAMPLES = (
    "wingbeat trim robo_raven_ii_d",
    "wingbeat trim arizona_100cm --airspeed 9 --climb 0.5",
    "wingbeat trim robo_raven_ii_d --aerodynamics blade_element --json",
)
JSON_KEYS = STEADY_KEYS | {
    "means": "over a stroke: airspeed, climb_rate m/s, pitch, angle_of_attack rad, current A, electrical_power,"
    " mechanical_power W, torque N m, flap_amplitude rad, flap_rate rad/s;"
    " null where the vehicle has no drive, its wings' motion being prescribed",
    "excursions": "of the fuselage over a stroke, [least, greatest]: heave_speed m/s, pitch rad, pitch_rate rad/s,"
    " vertical_acceleration m/s^2; altitude m peak to peak",
    "figures": "strouhal, reduced_frequency, cost_of_transport, endurance s, range m; null as above, or without end",
    "residual": "largest difference between start and end of a stroke",
    "findings": "list of {code, severity, subject, value, limit, text}: what is outside the range of the model",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Find the steady flapping flight of a vehicle: drive, elevator, attitude, power."
    return steady_parser("trim", summary, EXAMPLES, JSON_KEYS)


def run(arguments: Sequence[str]) -> int:
    """Compute the trim and print it.

    Raises:
        InputError: unknown vehicle or model, or no such flight within the limits of the vehicle.
    """
    return answer(build_parser().parse_args(arguments), examined)


def examined(vehicle: SimulatedVehicle, orbit: Orbit) -> Answer:
    """Return the figures of the flight as document and tables."""
    moved, numbers = excursions(vehicle, orbit), figures(vehicle, orbit)
    rest: dict[str, Any] = {"means": orbit.means, "excursions": moved, "figures": numbers, "residual": orbit.residual}
    findings = range_findings(orbit_excesses(vehicle, orbit))
    rest["findings"] = [one.document() for one in findings]
    if not draws_current(vehicle):
        cost = dict.fromkeys(("cost_of_transport", "endurance", "range"))
        rest |= {
            "means": orbit.means._asdict()
            | dict.fromkeys(("current", "electrical_power", "mechanical_power", "torque")),
            "figures": numbers._asdict() | cost,
        }
    return Answer(rest, trim_table(vehicle, orbit, moved, numbers), tuple(one.text for one in findings))
