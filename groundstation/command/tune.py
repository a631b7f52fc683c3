"""``wingbeat tune``: gains from a linear model, margins, comparison flights."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from groundstation.command import options
from groundstation.command.steady import TrimRequest, trimmed
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from groundstation.views.tuning import (
    axes_table,
    comparison_line,
    design_heading,
    design_table,
    proof_table,
    unwritten_line,
    withheld_line,
    written_line,
)
from logs.new_files import check_new, write_text
from sim_bridge.bridge.foreign.parameters import Parameter
from sim_bridge.flight.tuning.autopilots import FIRMWARE, AxisLoop, design_axes
from sim_bridge.flight.tuning.cascade import Design, Loop, design
from sim_bridge.flight.tuning.proof import SCENARIO, Comparison, FlightQuality, Proof, fly_quality
from sim_bridge.flight.tuning.vehicle_file import Places, places, write
from sim_bridge.flight_mechanics.averaged import stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.stroke_map import check_memory
from sim_bridge.tuning.margins import LIMITS
from sim_bridge.tuning.model import LinearModel, is_model_file, load_model, model_of
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_world
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat tune robo_raven_ii_d",
    "wingbeat tune my_bird --airspeed 7 --out my_tuned_bird",
    "wingbeat tune my_model.toml --vehicle my_bird --no-fly --json",
    "wingbeat tune my_model.toml --format ardupilot --out my_bird.param",
    "wingbeat tune my_model.toml --format px4 --out my_bird.params",
)
FLOWN_KEYS = (
    "holds, airtime s, touched, altitude_rms m, heading_rms, pitch_rms, roll_rms rad, elevator_rate, rudder_rate"
    " rad/s, throttle_rms, power W"
)
JSON_KEYS = {
    "vehicle, model": "what is tuned; where the linear model comes from",
    "airspeed, frequency": "of the model: m/s, Hz of flapping",
    "limits": "gain_margin dB, phase_margin rad that every loop must keep",
    "loops": "list of {name, before, after}; each {gains by section.key and the airspeed m/s they are for,"
    " gain_margin dB, phase_margin rad, crossover, bandwidth rad/s, sensitivity, stable, keeps}",
    "flights": "null, or {before, after}; each {" + FLOWN_KEYS + "}",
    "comparison": "null, or how the flight after compares: better, same, worse; files that fly worse need --force",
    "error_ratio": "null, or geometric mean of altitude, heading, pitch and roll errors after, over those before",
    "written": "names of the files",
    "parameters": "with --format ardupilot or px4: {name: value}; loops are then those of the autopilot, {name,"
    " before: null, after: as above, with the gains by parameter name}, and nothing is flown",
}


NOT_WRITTEN = 1
"""exit code: the design performs worse than the present gains, and no file was written"""


class _Chosen(NamedTuple):
    """Inputs from the command line."""

    model: LinearModel
    vehicle: FlightVehicle
    world: SimulatedVehicle | None
    """None without a simulated vehicle"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Design the gains of every loop on the stroke-averaged linear model of a vehicle: at least"
        f" {LIMITS.gain_margin_db:g} dB and 45 degrees a loop; write them, and fly before and after."
    )
    parser = options.build_parser("tune", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument(
        "subject", metavar="VEHICLE|MODEL", help="name or folder of a vehicle, or file of a linear model"
    )
    parser.add_argument(
        "--vehicle", metavar="V|DIR", help="vehicle of the gains for a MODEL (default: the one it names)"
    )
    parser.add_argument(
        "--airspeed", type=options.positive, metavar="M/S", help="airspeed of the trim (default: cruise)"
    )
    options.add_aerodynamics(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new folder for world.toml and avionics.toml, or new FILE.toml; with --format a new parameter file",
    )
    parser.add_argument(
        "--format",
        choices=("wingbeat", *FIRMWARE),
        default="wingbeat",
        help="gains of Wingbeat's loops, or of the attitude loops of ArduPlane or PX4 as their parameter file"
        " (default: wingbeat)",
    )
    parser.add_argument("--force", action="store_true", help="write the files even if the flight after is worse")
    parser.add_argument("--no-fly", action="store_true", help="leave out the flights before and after")
    parser.add_argument(
        "--seed",
        type=options.seed,
        default=SCENARIO.seed,
        metavar="N",
        help="random seed of the flights (default: 1)",
    )
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Design, show, fly and write the gains.

    Raises:
        InputError: unknown vehicle, one without a file for the flight computer, no trim, an invalid model, no gains
            within the limits, or files that exist already or cannot be written.
    """
    chosen = build_parser().parse_args(arguments)
    if chosen.format in FIRMWARE:
        return _run_autopilot(chosen, arguments)
    where = None if chosen.out is None else _places(chosen.out)
    subject = _subject(chosen)
    for line in options.name_warnings(subject.vehicle.file, *([] if subject.world is None else [subject.world])):
        print(line, file=sys.stderr)
    with ProgressBar("designing") as bar:
        designs = design(subject.model, subject.vehicle, bar.show)
    console = open_console(quiet=chosen.json)
    console.print(design_heading(subject.vehicle, designs))
    console.print(design_table(designs))
    proof = None
    if not chosen.no_fly and subject.world is not None:
        proof = _proof(subject, subject.world, designs, chosen.seed)
        console.print(proof_table(proof))
        console.print(comparison_line(proof))
    written: list[Path] = []
    withheld = proof is not None and proof.comparison is Comparison.WORSE and not chosen.force
    if where is not None and withheld:
        console.print(withheld_line(arguments), soft_wrap=True)
    elif where is not None:
        write(where, subject.vehicle, designs, None if subject.world is None else subject.world.text)
        written = [path for path in where if path is not None and path.exists()]
        console.print(written_line(written))
    else:
        console.print(unwritten_line(arguments), soft_wrap=True)
    if chosen.json:
        print_document(_document(subject, designs, proof, written))
    return NOT_WRITTEN if where is not None and withheld else 0


def _run_autopilot(chosen: argparse.Namespace, arguments: Sequence[str]) -> int:
    """Design, show and write the parameters of another autopilot; nothing is flown."""
    if chosen.out is not None:
        check_new(chosen.out, made=True)
    chosen.no_fly = True
    subject, firmware = _subject(chosen), FIRMWARE[chosen.format]
    with ProgressBar("designing") as bar:
        designs = design(subject.model, subject.vehicle, bar.show)
        loops = design_axes(firmware, subject.model, subject.vehicle)
    parameters = firmware.parameters(subject.model, subject.vehicle.gains, designs, loops)
    console = open_console(quiet=chosen.json)
    console.print(design_heading(subject.vehicle, designs))
    console.print(axes_table(firmware, loops))
    written: list[Path] = []
    if chosen.out is None:
        console.print(unwritten_line(arguments, "FILE writes these parameters"), soft_wrap=True)
    else:
        command = shlex.join(["wingbeat", "tune", *arguments])
        title = f"{firmware.title}, attitude loops for {subject.vehicle.title}: {command}. {MAPPING}"
        write_text(chosen.out, firmware.file(title, parameters))
        written = [chosen.out]
        console.print(written_line(written))
    if chosen.json:
        print_document(_autopilot_document(subject, loops, parameters, written))
    return 0


MAPPING = (
    "Full pitch output is the elevator travel of the flight vehicle file, full roll output its tail.rudder_share."
    " section.key is of that file."
)


def _autopilot_document(
    subject: _Chosen, loops: list[AxisLoop], parameters: list[Parameter], written: list[Path]
) -> dict[str, Any]:
    values = {one.name: one.value for one in parameters}
    return _heading_document(subject) | {
        "loops": [
            {
                "name": loop.name,
                "before": None,
                "after": _loop(Loop(loop.name, loop.gains, loop.margins, loop.bandwidth)),
            }
            for loop in loops
        ],
        "flights": None,
        "comparison": None,
        "error_ratio": None,
        "written": written,
        "parameters": values,
    }


def _places(out: Path) -> Places:
    """Return the output files, checked before the computation.

    Raises:
        InputError: one exists, or cannot be written there.
    """
    where = places(out)
    for path in where:
        if path is not None:
            check_new(path, made=True)
    return where


def _subject(chosen: argparse.Namespace) -> _Chosen:
    """Return the model and the vehicle whose gains are designed.

    Raises:
        InputError: one of them is invalid.
    """
    path = Path(chosen.subject)
    if not is_model_file(path):
        if chosen.vehicle is not None:
            raise InputError("--vehicle applies to a MODEL only")
        vehicle = _flight_vehicle(chosen.subject)
        world = _world(chosen.subject, chosen.aerodynamics)
        return _Chosen(linearised(world, chosen.airspeed), vehicle, world)
    if chosen.airspeed is not None or chosen.aerodynamics is not None:
        raise InputError("--airspeed and --aerodynamics go with a VEHICLE only; a MODEL has its own trim")
    model = load_model(path)
    name = chosen.vehicle or model.vehicle
    if not name:
        raise InputError(f"{path} names no vehicle: specify --vehicle")
    vehicle = _flight_vehicle(name)
    try:
        return _Chosen(model, vehicle, _world(name, None))
    except InputError:
        if chosen.no_fly:
            return _Chosen(model, vehicle, None)
        raise


def _flight_vehicle(name: str) -> FlightVehicle:
    """Return the flight computer configuration of a vehicle.

    Raises:
        InputError: unknown vehicle, or one without a configuration.
    """
    world, avionics = options.vehicle_files(name)
    try:
        return load_flight_vehicle(avionics)
    except InputError as error:
        if world == avionics:
            load_world(world)  # refuses a vehicle that nobody knows in its own words
            raise InputError(f"{name} has no file for the flight computer, so there are no gains to tune") from None
        raise error


def _world(name: str, aerodynamics: str | None) -> SimulatedVehicle:
    from groundstation.command.sim import simulated, unbuilt

    file = options.vehicle_files(name)[0]
    check_memory(unbuilt(file, aerodynamics))  # before anything is compiled for it
    return simulated(file, aerodynamics)


def linearised(world: SimulatedVehicle, airspeed: float | None) -> LinearModel:
    """Compute the stroke-averaged model in level flight (default: at cruise airspeed), with a progress bar.

    Raises:
        InputError: there is no such flight.
    """
    orbit = trimmed(TrimRequest(world, world.cruise.airspeed if airspeed is None else airspeed, 0.0))
    with ProgressBar("linearising") as bar:
        averaged = stroke_averaged_model(world, orbit, lambda done, of: bar.show(done, of + 2))
        return model_of(world, orbit, axes_model(world, orbit, averaged))


def _proof(subject: _Chosen, world: SimulatedVehicle, designs: Design, seed: int) -> Proof:
    scenario = SCENARIO._replace(seed=seed)
    with ProgressBar("flying") as bar:
        bar.show(0, 2, "flying with the gains before")
        before = fly_quality(world, subject.vehicle, subject.vehicle.gains, scenario)
        bar.show(1, 2, "flying with the gains after")
        return Proof(before, fly_quality(world, subject.vehicle, designs.gains, scenario))


def _document(subject: _Chosen, designs: Design, proof: Proof | None, written: list[Path]) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`."""
    return _heading_document(subject) | {
        "loops": [
            {"name": before.name, "before": _loop(before), "after": _loop(after)}
            for before, after in zip(designs.before, designs.after, strict=True)
        ],
        "flights": None
        if proof is None
        else {"before": _comparison_flights(proof.before), "after": _comparison_flights(proof.after)},
        "comparison": None if proof is None else proof.comparison.value,
        "error_ratio": None if proof is None else proof.error_ratio,
        "written": written,
    }


def _heading_document(subject: _Chosen) -> dict[str, Any]:
    return {
        "vehicle": subject.vehicle.name,
        "model": subject.model.origin,
        "airspeed": subject.model.airspeed,
        "frequency": subject.model.frequency,
        "limits": {"gain_margin": LIMITS.gain_margin_db, "phase_margin": LIMITS.phase_margin},
    }


def _loop(loop: Loop) -> dict[str, Any]:
    margins = loop.margins
    return {
        "gains": loop.gains,
        "gain_margin": margins.gain_db,
        "phase_margin": margins.phase,
        "crossover": margins.crossover,
        "bandwidth": loop.bandwidth,
        "sensitivity": margins.sensitivity,
        "stable": margins.stable,
        "keeps": margins.keeps(LIMITS),
    }


def _comparison_flights(flight: FlightQuality) -> dict[str, Any]:
    fields = flight._asdict()
    return {"holds": fields.pop("completed_legs")} | fields
