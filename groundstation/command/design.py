"""``wingbeat design``: identification inputs and their predicted accuracy."""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from avionics.missions.excitations import SHAPES
from avionics.vehicles import FlightVehicle
from avionics.vehicles import load_vehicle as load_flight_vehicle
from groundstation.command import options
from groundstation.command.foreign_log import opened_log
from groundstation.command.identify_out import write_outputs
from groundstation.command.tune import linearised
from groundstation.views.input_design import plan_view
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.attached import airframe_of, span_of
from logs.identification.data.flight import Aircraft
from logs.identification.estimators.flight_modes import LARGE_PITCH, OUTPUT_ERROR
from logs.identification.input_design.autopilots import FORMATS, autopilot_file
from logs.identification.input_design.design import (
    DesignSpec,
    InputDesign,
    Limits,
    combined_error,
    command_line,
    design_input,
    mission_item,
)
from logs.identification.input_design.prediction import (
    MODE_UNITS,
    Gust,
    Prior,
    inflation,
    prior_of,
    residuals_of,
    sensor_noise,
)
from logs.identification.models.modes import ModesResult
from logs.identification.models.stroke_averaged import LONGITUDINAL
from logs.importing.excitation import FULL_DEFLECTION
from logs.new_files import check_new
from sim_bridge.tuning.model import LinearModel, is_model_file, load_model
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_world
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat design robo_raven_ii_d",
    "wingbeat design my_model.toml --input multisine --duration 20 --json",
    "wingbeat design robo_raven_ii_d --input doublet --frequency-error 1 --out excite.toml",
    "wingbeat design --from recordings/flight.mcap --want elevator,short_period --accuracy 5 --out excite.toml",
    "wingbeat design --from flight.bin --vehicle my_bird/ --out excite.lua --format ardupilot",
)
JSON_KEYS = {
    "model": "where the prior model comes from",
    "input": "shape, amplitude rad, width s (of a step, a sweep, the period of a multisine), low, high Hz, settle s,"
    " repeats",
    "predicted": "list of {name, unit, value, standard_error, today, together}: the mode, then every derivative,"
    " after all repeats; today: standard error that the flight of the model left, or null; together: of both",
    "noise": "q rad/s, a_x, a_z m/s^2 of one sample; rate Hz",
    "gust_factor": "the frequency's predicted error over that without gusts",
    "limits, reached": "elevator, pitch, alpha rad, load m/s^2, airspeed m/s: greatest changes from the trim",
    "bound_by": "the limit that set the amplitude, empty where it was given",
    "flight_time": "s; of all repeats",
    "mission_item, command": "how it is flown",
}
MARGIN = 0.8
"""-; fraction of the vehicle's envelope whose limits end a maneuver"""
ALPHA, LOAD = 0.15, 8.0
"""rad, m/s^2; default validity limits of a linear model"""
GROUPS = {"elevator": ("M_delta",), "short_period": tuple(MODE_UNITS)}
"""names of ``--want`` for several parameters"""
ACCURACY = 10.0
"""%; default relative standard error of ``--want``"""
TRAVEL = 0.35
"""rad; default elevator amplitude"""
STEPS = {
    "wingbeat": "",
    "ardupilot": "ArduPlane: copy the script to APM/scripts, set SCR_ENABLE 1, RCx_OPTION 300: a switch starts it.",
    "px4": "PX4: fly level in MANUAL with COM_RC_IN_MODE 1, and run the script: python3 FILE udpin:0.0.0.0:14550"
    " THROTTLE.",
}
"""how a file of each format is flown"""


class _Subject(NamedTuple):
    """Inputs from the command line."""

    model: LinearModel
    aircraft: Aircraft
    vehicle: FlightVehicle | None
    world: SimulatedVehicle | None
    flight: ModesResult | None = None
    """of ``--from``"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Plan an elevator input for identification from a linear model: the errors that white sensor noise will leave"
        " in the short period and every derivative, the greatest amplitude within limits, and how to fly it."
    )
    parser = options.build_parser("design", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument(
        "subject", nargs="?", metavar="MODEL|VEHICLE", help="file of a linear model, or vehicle to linearize"
    )
    parser.add_argument(
        "--from", dest="log", type=options.recording_file, metavar="LOG", help="identify the model from this flight"
    )
    parser.add_argument(
        "--want",
        type=_parameter_names,
        default=(),
        metavar="NAME,...",
        help="what --accuracy is required of: elevator (M_delta), short_period (frequency and damping), or symbols"
        " such as M_q",
    )
    parser.add_argument(
        "--accuracy",
        type=options.positive,
        metavar="%",
        help="required relative standard error of --want, together with what the model's flight left (default: 10)",
    )
    parser.add_argument("--vehicle", metavar="V|DIR", help="vehicle with the sensors and tail for a MODEL")
    parser.add_argument(
        "--airspeed", type=options.positive, metavar="M/S", help="airspeed of a VEHICLE's trim (default: cruise)"
    )
    parser.add_argument("--input", choices=tuple(SHAPES), default="3211", help="shape of the input (default: 3211)")
    parser.add_argument(
        "--amplitude", type=options.positive, metavar="DEG", help="amplitude (default: from the limits)"
    )
    parser.add_argument(
        "--duration", type=options.positive, metavar="S", help="width of a step, duration of a sweep, or period"
    )
    parser.add_argument("--repeats", type=_count, metavar="N", help="number of repetitions (default: 1)")
    parser.add_argument(
        "--frequency-error",
        type=options.positive,
        metavar="%",
        help="required standard error of the short-period frequency",
    )
    parser.add_argument(
        "--damping-error", type=options.positive, metavar="X", help="required standard error of the damping ratio"
    )
    parser.add_argument(
        "--settle", type=options.not_negative, metavar="S", help="pause before and after (default: from the damping)"
    )
    limits = parser.add_argument_group("limits, as changes from the trim")
    for name, unit, words in (
        ("--elevator", "DEG", "maximum elevator (default: 20)"),
        ("--pitch", "DEG", "maximum change of the pitch angle (default: 0.8 of the vehicle's envelope)"),
        ("--load", "M/S2", f"maximum change of a_z at the IMU (default: {LOAD:g})"),
        ("--alpha", "DEG", "maximum change of the angle of attack (default: 8.6)"),
        ("--speed-change", "M/S", "maximum change of the airspeed (default: 0.8 of the vehicle's envelope)"),
    ):
        limits.add_argument(name, type=options.positive, metavar=unit, help=words)
    parser.add_argument(
        "--noise", nargs=3, type=options.positive, metavar=("Q", "AX", "AZ"),
        help="noise of one sample, rad/s and m/s^2 (default: the vehicle's sensors)",
    )  # fmt: skip
    parser.add_argument("--rate", type=options.positive, default=0.0, metavar="HZ", help="sample rate (default: 200)")
    parser.add_argument("--gust", type=options.positive, metavar="M/S", help="gusts of this standard deviation")
    parser.add_argument("--out", type=Path, metavar="FILE", help="new file for the mission item")
    parser.add_argument(
        "--format",
        choices=FORMATS,
        help=f"of --out: mission item ({FORMATS[0]}, default), Lua script of ArduPlane, MAVLink script for PX4",
    )
    options.add_json(parser)
    return parser


def _parameter_names(text: str) -> tuple[str, ...]:
    names = tuple(name for word in text.split(",") for name in GROUPS.get(word.strip(), (word.strip(),)))
    known = (*MODE_UNITS, *LONGITUDINAL)
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None:
        raise argparse.ArgumentTypeError(f"{unknown!r} is not one of {', '.join((*GROUPS, *known))}")
    return names


def _count(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 100:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to 100")
    return int(text)


def run(arguments: Sequence[str]) -> int:
    """Design the input, print its predicted accuracy, write its mission item.

    Raises:
        InputError: no model, no sensors, an infeasible or uninformative input, or ``--out`` exists or
            cannot be written.
    """
    chosen = build_parser().parse_args(arguments)
    if chosen.out is not None:
        check_new(chosen.out)
    if (chosen.subject is None) == (chosen.log is None):
        raise InputError("specify a MODEL or VEHICLE, or --from LOG")
    if chosen.accuracy is not None and not chosen.want:
        raise InputError("--accuracy goes with --want")
    if chosen.format is not None and chosen.out is None:
        raise InputError("--format goes with --out FILE")
    subject = _subject(chosen) if chosen.log is None else _identified(chosen)
    noise = tuple(chosen.noise) if chosen.noise else _noise(subject)
    prior = _with_flight(prior_of(subject.model, subject.aircraft, noise, chosen.rate), subject.flight)
    requested = _request(chosen, subject, prior)
    with ProgressBar("designing") as bar:
        designs = design_input(prior, requested, bar.show)
    if chosen.out is not None:
        with chosen.out.open("x", encoding="utf-8") as file:
            file.write(_file_text(chosen, subject, requested, designs))
    if chosen.json:
        print_document(_document(subject, prior, requested, designs))
    else:
        steps = "" if chosen.out is None or chosen.format is None else STEPS[chosen.format]
        console = open_console()
        console.print(plan_view(subject.model, prior, requested, designs, steps))
        if chosen.out is not None:
            console.print(f"written {chosen.out}", markup=False)
    return 0


def _file_text(chosen: argparse.Namespace, subject: _Subject, requested: DesignSpec, designs: InputDesign) -> str:
    """Return the text of ``--out``."""
    if chosen.format in (None, "wingbeat"):
        return mission_item(designs.excitation)
    travel = FULL_DEFLECTION if subject.world is None else subject.world.tail_servo.travel
    return autopilot_file(
        chosen.format, designs.excitation, travel, requested.fade, requested.pause, Path(chosen.out)
    )


def _identified(chosen: argparse.Namespace) -> _Subject:
    """Identify the model from the log, as `wingbeat identify LOG modes --model` does.

    Raises:
        InputError: the log does not identify the model, or ``--airspeed`` is given.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        flight = write_identified(chosen.log, chosen.vehicle, path)
        return _subject(argparse.Namespace(**vars(chosen) | {"subject": str(path)}))._replace(flight=flight)


def write_identified(log: Path, vehicle: str | None, path: Path) -> ModesResult | None:
    """Identify the modes of a log, write their model and return them.

    Raises:
        InputError: the log does not identify the model.
    """
    from groundstation.command.identify import identified

    with opened_log(log) as source:
        estimates = identified(source, "modes", vehicle)
        write_outputs([source], estimates, None, path, vehicle)
    return estimates.modes


def _with_flight(prior: Prior, flight: ModesResult | None) -> Prior:
    """Return the prior with the residuals that its model left in the flight."""
    result = next((one for one in flight.results if one.method == OUTPUT_ERROR), None) if flight else None
    residuals = None if result is None else residuals_of(result)
    if flight is None or result is None or residuals is None:
        return prior
    prior = prior._replace(residuals=residuals)
    errors = {one.name: one.standard_error for one in result.estimates}
    return prior._replace(inflation=inflation(prior, flight.maneuvers, errors))


def _subject(chosen: argparse.Namespace) -> _Subject:
    path = Path(chosen.subject)
    if not is_model_file(path):
        if chosen.vehicle is not None:
            raise InputError("--vehicle goes with a MODEL only")
        world = load_world(options.vehicle_files(chosen.subject)[0])
        vehicle = _flight_vehicle(chosen.subject)
        return _Subject(linearised(world, chosen.airspeed), _aircraft(vehicle, world), vehicle, world)
    if chosen.airspeed is not None:
        raise InputError("--airspeed goes with a VEHICLE only; a MODEL has its own trim")
    model = load_model(path)
    name = chosen.vehicle or model.vehicle
    if not name and not chosen.noise:
        raise InputError(f"{path} names no vehicle: specify --vehicle for its sensors, or --noise")
    if not name:
        return _Subject(model, Aircraft(tail_time_constant=0.0), None, None)
    try:
        world = load_world(options.vehicle_files(name)[0])
    except InputError:
        if not chosen.noise or chosen.vehicle:
            raise
        return _Subject(model, Aircraft(tail_time_constant=0.0), None, None)
    vehicle = _flight_vehicle(name)
    return _Subject(model, _aircraft(vehicle, world), vehicle, world)


def _flight_vehicle(name: str) -> FlightVehicle | None:
    """Return the flight computer's configuration; None for a vehicle without one."""
    world, avionics = options.vehicle_files(name)
    try:
        return load_flight_vehicle(avionics)
    except InputError:
        if world == avionics:
            return None
        raise


def _aircraft(vehicle: FlightVehicle | None, world: SimulatedVehicle) -> Aircraft:
    if vehicle is not None:
        return airframe_of(vehicle, world)
    return Aircraft(tail_time_constant=world.tail_servo.time_constant, span=span_of(world))


def _noise(subject: _Subject) -> tuple[float, float, float]:
    if subject.world is None:
        raise InputError("sensor noise unknown: specify --noise")
    return sensor_noise(subject.world)


def _request(chosen: argparse.Namespace, subject: _Subject, prior: Prior) -> DesignSpec:
    envelope = None if subject.vehicle is None else subject.vehicle.gains.excitation
    pacing = {} if envelope is None else {"fade": envelope.fade, "pause": envelope.recovery + envelope.spread / 2.0}
    return DesignSpec(
        SHAPES[chosen.input],
        _limits(chosen, subject, prior),
        None if chosen.amplitude is None else math.radians(chosen.amplitude),
        chosen.duration,
        chosen.repeats,
        None if chosen.frequency_error is None else chosen.frequency_error / 100.0,
        chosen.damping_error,
        chosen.settle,
        gust=None if chosen.gust is None else Gust(chosen.gust),
        required=dict.fromkeys(chosen.want, (chosen.accuracy or ACCURACY) / 100.0),
        known=_known(subject.model),
        **pacing,
    )


def _known(model: LinearModel) -> dict[str, float]:
    """Return the standard errors of the flight that the model is from."""
    values = () if model.identified is None else model.identified.values
    return {one.name: one.standard_error for one in values if one.standard_error > 0.0}


def _limits(chosen: argparse.Namespace, subject: _Subject, prior: Prior) -> Limits:
    """Return the requested limits, else those of the vehicle's envelope and of the linear model."""
    pitch = speed = math.inf
    if subject.flight is not None:
        pitch = LARGE_PITCH / 2.0
    if subject.vehicle is not None:
        envelope, airspeed = subject.vehicle.gains.excitation, prior.reference.airspeed
        pitch = min(pitch, MARGIN * envelope.pitch_max)
        speed = MARGIN * min(airspeed - envelope.airspeed_min, envelope.airspeed_max - airspeed)
        if speed <= 0.0 and chosen.speed_change is None and chosen.amplitude is None:
            raise InputError(f"{airspeed:.3g} m/s is outside the vehicle's envelope for identification inputs")
    degrees = (math.nan if v is None else math.radians(v) for v in (chosen.elevator, chosen.pitch, chosen.alpha))
    elevator, pitch_asked, alpha = degrees
    return Limits(
        TRAVEL if math.isnan(elevator) else elevator,
        pitch if math.isnan(pitch_asked) else pitch_asked,
        chosen.load or LOAD,
        ALPHA if math.isnan(alpha) else alpha,
        chosen.speed_change or speed,
    )


def _document(subject: _Subject, prior: Prior, requested: DesignSpec, designs: InputDesign) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`."""
    flown = designs.excitation
    keys = ("amplitude", "width", "low", "high", "settle", "repeats")
    return {
        "model": subject.model.origin,
        "input": {"shape": flown.shape.name.lower(), **{key: getattr(flown, key) for key in keys}},
        "predicted": [
            one._asdict()
            | {
                "today": requested.known.get(one.name),
                "together": combined_error(one.standard_error, requested.known.get(one.name)),
            }
            for one in designs.predicted
        ],
        "noise": dict(zip(("q", "a_x", "a_z"), prior.noise, strict=True)) | {"rate": 1.0 / prior.step},
        "gust_factor": designs.gust_factor,
        "limits": requested.limits._asdict(),
        "reached": designs.reached._asdict(),
        "bound_by": designs.bound_by,
        "flight_time": designs.flight_time,
        "mission_item": mission_item(flown),
        "command": command_line(flown),
    }
