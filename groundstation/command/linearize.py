"""``wingbeat linearize``: Floquet modes and stroke-averaged A and B."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.command.steady import STEADY_KEYS, Answer, answer, steady_parser
from groundstation.views.linear_motion import linear_tables
from groundstation.views.progress import ProgressBar
from logs.new_files import check_new
from sim_bridge.flight_mechanics.averaged import AveragedModel, stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.linear import Linearization, averaged_modes, warnings
from sim_bridge.flight_mechanics.modes import Mode, aliases, modes
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.tuning.model import model_of, save_model
from sim_bridge.vehicles import SimulatedVehicle

EXAMPLES = (
    "wingbeat linearize robo_raven_ii_d",
    "wingbeat linearize arizona_100cm --airspeed 9 --climb 0.5 --json",
    "wingbeat linearize robo_raven_ii_d --out raven_model.toml",
)
MODE_KEYS = "name, eigenvalue [re, im] 1/s, natural_frequency rad/s, damping, period s, time_to_half s (< 0: double)"
JSON_KEYS = STEADY_KEYS | {
    "floquet": "modes of the stroke map, list of {" + MODE_KEYS + ", lateral, body_share, aliased}",
    "averaged": "a, b of (u m/s, w m/s, q rad/s, theta rad) and elevator rad; unexplained: variance of u', w', q'"
    " that they leave; modes: as above",
    "warnings": "list of sentences",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Linearize a vehicle about a steady flight: Floquet modes of the stroke, stroke-averaged A and B."
    parser = steady_parser("linearize", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("--out", type=Path, metavar="FILE", help="new TOML file of the model of all axes, for tune")
    return parser


def run(arguments: Sequence[str]) -> int:
    """Compute the trim, linearize about it, print modes and matrices.

    Raises:
        InputError: unknown vehicle or model, no such flight within the limits of the vehicle, or ``--out`` exists or
            cannot be written.
    """
    chosen = build_parser().parse_args(arguments)
    if chosen.out is not None:
        check_new(chosen.out)
    return answer(chosen, lambda vehicle, orbit: examined(vehicle, orbit, chosen.out, chosen.vehicle))


def examined(vehicle: SimulatedVehicle, orbit: Orbit, out: Path | None = None, name: str = "") -> Answer:
    """Return document and tables of the linear models; write that of all axes to ``out``, with the vehicle's name.

    Raises:
        InputError: the file exists.
    """
    linear = linearized(vehicle, orbit)
    if out is not None:
        saved = model_of(vehicle, orbit, axes_model(vehicle, orbit, linear.averaged))
        save_model(out, saved._replace(vehicle=name))
    return Answer(document(linear, orbit), linear_tables(linear, orbit))


def linearized(vehicle: SimulatedVehicle, orbit: Orbit) -> Linearization:
    """Compute both linear models of an orbit, with a progress bar."""
    with ProgressBar("linearising") as bar:
        found = modes(vehicle, orbit)
        bar.show(1, 4)
        averaged = stroke_averaged_model(vehicle, orbit, lambda done, of: bar.show(1 + done, 1 + of))
        return Linearization(found, averaged)


def document(linear: Linearization, orbit: Orbit) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`, to follow that of the trim."""
    frequency = orbit.inputs.frequency
    floquet = [
        _mode(mode) | {"lateral": mode.lateral, "body_share": mode.body_share, "aliased": aliases(mode, frequency)}
        for mode in linear.floquet
    ]
    return {"floquet": floquet, "averaged": _averaged(linear.averaged), "warnings": warnings(linear, orbit)}


def _averaged(model: AveragedModel) -> dict[str, Any]:
    found = [_mode(mode) for mode in averaged_modes(model)]
    return {"a": model.a, "b": model.b, "unexplained": model.unexplained, "modes": found}


def _mode(mode: Mode) -> dict[str, Any]:
    return {
        "name": mode.name,
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "natural_frequency": mode.natural_frequency,
        "damping": mode.damping,
        "period": mode.period,
        "time_to_half": mode.time_to_half,
    }
