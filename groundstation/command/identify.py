"""``wingbeat identify``: drives, modes and the wings' coefficients from a log, or from tables that a map explains."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

from avionics import topics
from avionics.quantities import BadInput
from avionics.vehicles import load_vehicle
from groundstation.command import identify_table, options
from groundstation.command.identify_out import add_outputs, check_outputs, write_outputs
from groundstation.views.identification import identification_table
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from logs.attached import aircraft_of, airframe_of, flight_vehicle, simulated_vehicle
from logs.identification.data import Aircraft
from logs.identification.report import SUBJECTS, Identification, document, identify
from logs.identification.sources.elevator import MadeElevator
from logs.identification.tables.map import EXAMPLE
from logs.identification.tables.subjects import SUBJECTS as TABLE_SUBJECTS
from logs.reader import Log, open_log
from logs.truth import known_truths, throttle_truths
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_bodies

EXAMPLES = (
    "wingbeat identify recordings/flight.mcap",
    "wingbeat identify recordings/flight.mcap modes --json",
    "wingbeat identify recordings/flight.mcap aero",
    "wingbeat identify recordings/imported.mcap modes --vehicle my_bird/",
    "wingbeat identify recordings/imported.mcap modes --elevator /dataflash/RCOU.C2 0.001",
    "wingbeat identify recordings/flight.mcap --report flight.html --model my_bird.toml  # then: wingbeat tune",
    "wingbeat identify --map-example > map.toml           # then: what your columns are, and what to fit",
    "wingbeat identify flight.csv --map map.toml          # docs/identify_csv.md has every key and two examples",
)
UNKNOWN = "aircraft: not told; the IMU counts as at the centre of mass (--vehicle tells its place and the tail's lag)"
"""what is said of a log without a vehicle's file"""
JSON_KEYS = {
    "torque, power": "estimates: list of {name, unit, value, standard_error, low, high, truth}; unidentified; truth"
    " of power: the same regression on this flight's noise-free drive, which varies with the flight",
    "load": "estimates of the wings' torque constant and inertia; unidentified",
    "frequency": "estimates of flapping against throttle; unidentified, centre_throttle, centre_voltage V, residual"
    " Hz, segments: list of {begin, end s, throttle, frequency Hz, strokes, voltage V}",
    "modes": "methods: list of {method, frequency, damping, period, time_to_half, cycles, time_constants, phugoid,"
    " eigenvalues, derivatives, unidentified}; agree, statement, manoeuvres, wing_period s,"
    " reference, notes: what the log does not tell and was taken from elsewhere",
    "aero": "models: list of {name, terms, estimates, unidentified, steps, r_squared, samples} of C_L, C_T, C_m;"
    " records, notes",
    "missing": "list of {name, reason}: what the log does not give",
    "with --map": "files; manoeuvres: {fitted, held_out}; fits: list of {subject, method, equations, converged,"
    " failure, estimates: list of {name, unit, value, standard_error, low, high, start}, unidentified: list of {name,"
    " reason}, fixed, correlated: list of {first, second, correlation}, outputs: list of {experiment, output, unit,"
    " held_out, samples, r_squared, rms, theil, white}, samples, steps, notes}; modes: as above or null; missing:"
    " list of {name, reason}; notes",
}


KNOWN = tuple(dict.fromkeys((*SUBJECTS, *TABLE_SUBJECTS)))
TABLE_USAGE = (
    f"wingbeat identify TABLE [TABLE ...] --map MAP.toml [{'|'.join(TABLE_SUBJECTS)}]"
    " [--report OUT.html] [--model OUT.toml] [--json]"
)
TOGETHER = (
    "to fit several flights together, write each as a table (wingbeat log export A.mcap --to a.csv --rate 100) and"
    " give all to one map: wingbeat identify a.csv b.csv --map MAP.toml"
)
TABLE_SUFFIXES = (".csv", ".txt", ".dat", ".asc", ".tsv")


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    summary = (
        "Identify the servo torque and power models, the short-period mode or the wings' coefficients from a log;"
        " modes and aerodynamic coefficients from tables of numbers that a map explains."
    )
    parser = options.build_parser("identify", summary, EXAMPLES, JSON_KEYS)
    parser.usage = f"wingbeat identify FILE [{'|'.join(SUBJECTS)}] [options]\n       {TABLE_USAGE}"
    parser.add_argument("file", nargs="*", metavar="FILE", help="an MCAP log, or with --map one table or several")
    parser.add_argument(
        "--map", type=Path, metavar="MAP.toml", help="what the columns of the tables are, and what to fit"
    )
    parser.add_argument("--map-example", action="store_true", help="print a map to begin with")
    parser.add_argument(
        "--vehicle",
        metavar="V|PATH",
        help="name or file of the vehicle, for a log of another program, which carries none",
    )
    parser.add_argument(
        "--elevator",
        nargs=2,
        metavar=("TOPIC.FIELD", "RAD"),
        help="what the elevator was told, where no angle was recorded, and rad per unit of it",
    )
    add_outputs(parser)
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Identify, and print the table.

    Raises:
        BadInput: not an MCAP log, or one that gives nothing of what was asked for; a vehicle that is unknown, or
            given beside the log's own.
    """
    chosen = build_parser().parse_intermixed_args(arguments)
    if chosen.map_example:
        sys.stdout.write(EXAMPLE)
        return 0
    files, what = _split(chosen.file)
    if chosen.map is None and len(files) > 1 and not files[-1].suffix:
        raise BadInput(f"cannot identify {files[-1].name!r}; known: {', '.join(KNOWN)}")
    if chosen.map is not None:
        return identify_table.run(files, what, chosen)
    if len(files) > 1 and not any(file.suffix.lower() in TABLE_SUFFIXES for file in files):
        raise BadInput(f"{len(files)} logs, but one is identified at a time; {TOGETHER}")
    if len(files) > 1 or files[0].suffix.lower() in TABLE_SUFFIXES:
        raise BadInput(f"{files[0]}: tables need --map MAP.toml (wingbeat identify --map-example prints one)")
    if what not in SUBJECTS:
        raise BadInput(f"a log gives {', '.join(SUBJECTS)}; {what} is of tables, which need --map MAP.toml")
    check_outputs(chosen)
    with open_log(files[0]) as log:
        found = identified(log, what, chosen.vehicle, chosen.elevator)
        written = write_outputs(chosen, log, found)
    if chosen.json:
        print_document(document(found))
    else:
        open_console().print(identification_table(found))
        for line in written:
            open_console().print(line, highlight=False, soft_wrap=True)
    return 0


def _split(words: Sequence[str]) -> tuple[list[Path], str]:
    """The files, and what is to be identified, which may stand behind them.

    Raises:
        BadInput: there is no file.
    """
    what = words[-1] if words and words[-1] in KNOWN else "all"
    files = [Path(word) for word in words if word not in KNOWN]
    if not files:
        raise BadInput("which log or table? (see wingbeat identify --help)")
    return files, what


def identified(
    log: Log, what: str = "all", vehicle: str | None = None, elevator: Sequence[str] | None = None
) -> Identification:
    """Identify ``what`` from an open log, beside the truth where the flight was simulated.

    Args:
        log: what was flown.
        what: one of `SUBJECTS`.
        vehicle: name or file of the one that flew, where the log does not carry it.
        elevator: what it was told, ``topic.field``, and rad per unit of it, where the log has no angle.

    Raises:
        BadInput: the log gives nothing of what was asked for, carries a vehicle file beside the one given, or the
            elevator cannot be made so.
    """
    made = _made(log, elevator) if elevator else None
    bodies = _bodies(log, vehicle) if what == "aero" else None
    found = identify(made or log, what, _aircraft(log, vehicle), bodies=bodies)
    if found.modes is not None:
        unknown = vehicle is None and flight_vehicle(log) is None
        notes = ([made.note] if made else []) + ([UNKNOWN] if unknown else [])
        found = found._replace(modes=found.modes._replace(notes=(*found.modes.notes, *notes)))
    known = known_truths(log, modes=found.modes is not None)
    if found.frequency is not None:
        known |= throttle_truths(log, found.frequency)
    return found._replace(truths={**found.truths, **known})


def _aircraft(log: Log, vehicle: str | None) -> Aircraft:
    if vehicle is None:
        return aircraft_of(log)
    if flight_vehicle(log) is not None:
        raise BadInput(f"{log.path} carries the file of its vehicle: --vehicle is for logs of other programs")
    return airframe_of(load_vehicle(options.vehicle_files(vehicle)[1]))


def _bodies(log: Log, vehicle: str | None) -> SimulatedVehicle | None:
    """Masses, hinges and tail of the vehicle: the log's, or those of the file given."""
    return simulated_vehicle(log) if vehicle is None else load_bodies(options.vehicle_files(vehicle)[0])


def _made(log: Log, elevator: Sequence[str]) -> MadeElevator:
    (name, said), (topic, _, field) = elevator, elevator[0].rpartition(".")
    try:
        scale = float(said)
    except ValueError:
        scale = 0.0
    if not topic or not field or not scale or not math.isfinite(scale):
        raise BadInput(f"--elevator {name} {said}: it takes TOPIC.FIELD and rad per unit of it, which is not 0")
    made = MadeElevator(log, topic, field, scale)
    made.columns(topics.ACTUATORS)  # what is wrong with it is told before anything is identified
    return made
