"""``wingbeat identify``: drives, modes and coefficients from logs or tables."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from avionics import topics
from avionics.vehicles import load_vehicle
from groundstation.command import identify_table, options
from groundstation.command.compiling import announced
from groundstation.command.damage import damage_notices
from groundstation.command.foreign_log import SUFFIXES, opened_log, recorded_elevator
from groundstation.command.identify_markers import MARKERS, identified_by_markers
from groundstation.command.identify_out import (
    add_outputs,
    check_outputs,
    names_of,
    show_next_steps,
    show_written,
    write_outputs,
)
from groundstation.views.identification import identification_table
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from logs.attached import aircraft_of, airframe_of, flight_vehicle, simulated_vehicle
from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.maneuvers import holdout_sample
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.estimators.registry import methods
from logs.identification.findings import note
from logs.identification.report import SUBJECTS, Identification, document, identify
from logs.identification.sources.flight import flight_data
from logs.identification.sources.table.config import ALL, FORMER_SUBJECTS, example_map
from logs.identification.sources.table.config import SUBJECTS as TABLE_SUBJECTS
from logs.identification.sources.topic_table import ElevatorFromField, joined_flights
from logs.reader import Log
from logs.truth import known_truths, throttle_truths
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles import load_vehicle as load_bodies
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

EXAMPLES = (
    "wingbeat identify recordings/flight.mcap",
    "wingbeat identify recordings/flight.mcap modes --json",
    "wingbeat identify recordings/flight.mcap aero",
    "wingbeat identify recordings/monday.mcap recordings/tuesday.mcap modes   # one aircraft, one fit",
    "wingbeat identify monday.mcap tuesday.mcap modes --validate friday.mcap  # not fitted: predicted",
    "wingbeat identify recordings/flight.mcap path        # biases of gyros and accelerometers",
    "wingbeat identify flight.ulg modes --vehicle my_bird/                # PX4; also .bin and .tlog",
    "wingbeat identify recordings/imported.mcap modes --elevator /dataflash/RCOU.C2 0.001",
    "wingbeat identify recordings/flight.mcap --report flight.html --model my_bird.toml  # then: wingbeat tune",
    "wingbeat identify capture.mcap markers --map places.toml  # motion by markers, and the wings' coefficients",
    "wingbeat identify --map-example > map.toml           # then: what your columns are, and what to fit",
    "wingbeat identify --map-example stroke > map.toml    # the same for coefficients of up- and down-stroke",
    "wingbeat identify flight.csv --map map.toml          # docs/identify_csv.md has every key and two examples",
)
UNKNOWN = "aircraft unknown: IMU assumed at the center of mass, span 1 m; --vehicle gives both and the tail's lag"
"""text for a log without a vehicle file"""
JSON_KEYS = {
    "torque, power": "estimates: list of {name, unit, value, standard_error, low, high, truth}; unidentified;"
    " findings: list of {code, severity, subject, value, limit, text}, as of load, frequency and each model of aero;"
    " truth of power: the same regression on this flight's noise-free drive, which varies with the flight",
    "load": "estimates of the wings' torque constant and inertia; unidentified",
    "frequency": "estimates of flapping against throttle; unidentified, centre_throttle, centre_voltage V, residual"
    " Hz, segments: list of {begin, end s, throttle, frequency Hz, strokes, voltage V}",
    "modes": "methods: list of {method, frequency, damping, period, time_to_half, cycles, time_constants, phugoid,"
    " eigenvalues, divergence: times of two real eigenvalues of which one grows, derivatives, unidentified};"
    " agree, statement, manoeuvres, wing_period s,"
    " reference, notes: assumptions on what the log does not contain; held_out: null, or {flights,"
    " predictions: list of {flight, manoeuvres, output, unit, rms, theil: {coefficient, bias, variance, covariance}},"
    " failure}",
    "aero": "models: list of {name, terms, estimates, unidentified, steps, r_squared, samples} of C_L, C_T, C_m;"
    " records, notes",
    "path": "estimates of the IMU's biases (SI), unidentified, records, notes",
    "markers": "vehicle, records: list of {name, noise m, frames, told, left_out share, never_seen, low_pass Hz,"
    " time s, quaternion w first, coordinates: list of {name, unit, values, standard_errors}, speeds: list of"
    " {names, time, values, rates}}, notes; aero beside it where the map asks for it",
    "missing": "list of {name, reason}: subjects without a result",
    "with --map": "files; manoeuvres: {fitted, held_out}; fits: list of {subject, method, equations, converged,"
    " failure, estimates: list of {name, unit, value, standard_error, low, high, start}, modes of a lateral model:"
    " {estimates, unidentified}, unidentified: list of {name,"
    " reason}, findings: list of {code, severity, subject, value, limit, text},"
    " fixed, correlated: list of {first, second, correlation}, outputs: list of {experiment, output, unit,"
    " held_out, samples, r_squared, rms, theil, white}, samples, steps, notes}; modes: as above or null; missing:"
    " list of {name, reason}; delays: list of {name, unit, value, standard_error, low, high} of [prepare]; findings:"
    " as of a fit; notes: their texts",
}


MAPS = (*TABLE_SUBJECTS, MARKERS)
"""subjects of `--map-example`"""
KNOWN = tuple(dict.fromkeys((*SUBJECTS, *TABLE_SUBJECTS, MARKERS)))
TABLE_USAGE = (
    f"wingbeat identify TABLE [TABLE ...] --map MAP.toml [{'|'.join(TABLE_SUBJECTS)}]"
    " [--report OUT.html] [--model OUT.toml] [--json]"
)
FILES = (
    f"MCAP log (latest: the newest of recordings/) or {', '.join(SUFFIXES)}, several logs for their modes;"
    " with --map one or several tables"
)
TABLE_SUFFIXES = (".csv", ".txt", ".dat", ".asc", ".tsv")


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Identify servo torque and power, the short-period mode, wing coefficients or sensor errors from a log;"
        " modes, aerodynamic coefficients, sensor errors, load-cell and bench runs from tables described by a map."
    )
    parser = options.build_parser("identify", summary, EXAMPLES, JSON_KEYS)
    parser.usage = (
        f"wingbeat identify FILE [{'|'.join(SUBJECTS)}] [options]\n       {TABLE_USAGE}"
        "\n       wingbeat identify CAPTURE markers --map MAP.toml [--report OUT.html] [--json]"
    )
    parser.add_argument(
        "file",
        nargs="*",
        metavar="FILE",
        help=FILES,
    )
    parser.add_argument("--map", type=Path, metavar="MAP.toml", help="columns of the tables, and what to fit")
    parser.add_argument("--map-example", action="store_true", help=f"print an example map of {', '.join(MAPS)}")
    parser.add_argument(
        "--vehicle",
        metavar="V|PATH",
        help="name or file of the vehicle, for a log of another program without vehicle files",
    )
    parser.add_argument(
        "--elevator",
        nargs=2,
        metavar=("TOPIC.FIELD", "RAD"),
        help="elevator command to use if no deflection was recorded, and its scale in rad per unit",
    )
    parser.add_argument(
        "--method",
        choices=methods("modes"),
        metavar="METHOD",
        help=f"modes by one method alone: {', '.join(methods('modes'))}",
    )
    parser.add_argument(
        "--validate",
        action="append",
        type=Path,
        default=[],
        metavar="LOG",
        help="log reserved for validation of the modes, scored by Theil's inequality coefficient (repeatable)",
    )
    parser.add_argument(
        "--validate-share",
        type=float,
        metavar="SHARE",
        help="fraction of the logs reserved for validation; the draw is always the same",
    )
    add_outputs(parser)
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Identify, and print the table.

    Raises:
        InputError: not an MCAP log, or one without the requested estimates; an unknown vehicle, or one given in
            addition to the log's own.
    """
    chosen = build_parser().parse_intermixed_args(arguments)
    chosen.file = [FORMER_SUBJECTS.get(word, word) for word in chosen.file]
    if chosen.map_example:
        sys.stdout.write(_example(chosen.file))
        return 0
    files, what = _split(chosen.file)
    asked = bool(chosen.validate) or chosen.validate_share is not None
    tables = any(file.suffix.lower() in TABLE_SUFFIXES for file in files)
    if chosen.method is not None and what in (MARKERS, *SUBJECTS) and what not in ("modes", ALL):
        raise InputError(f"--method is of modes, not of {what}")
    if what == MARKERS:
        _show(chosen, *identified_by_markers(files, tables, chosen))
        return 0
    if chosen.map is None and len(files) > 1 and not files[-1].suffix:
        raise InputError(f"cannot identify {files[-1].name!r}; known: {', '.join(KNOWN)}")
    if chosen.map is not None and asked:
        raise InputError("--validate and --validate-share are for logs: use [maneuvers] of the map for tables")
    if chosen.map is not None:
        return identify_table.run(files, what, chosen)
    if (len(files) > 1 or asked) and not tables:
        return _run_together(files, what, chosen)
    if len(files) > 1 or files[0].suffix.lower() in TABLE_SUFFIXES:
        raise InputError(f"{files[0]}: tables need --map MAP.toml (wingbeat identify --map-example prints one)")
    if what not in SUBJECTS:
        raise InputError(f"a log gives {', '.join(SUBJECTS)}; {what} is of tables, which need --map MAP.toml")
    check_outputs(chosen)
    with opened_log(files[0]) as log, announced(chosen.json), damage_notices([log], "identified"):
        estimates = identified(log, what, chosen.vehicle, chosen.elevator, method=chosen.method)
        _show(chosen, estimates, lambda: write_outputs([log], estimates, chosen.report, chosen.model, chosen.vehicle))
    return 0


def _show(chosen: argparse.Namespace, estimates: Identification, write: Callable[[], Sequence[str]]) -> None:
    """Print the document or the table, then ``write`` the files: a write error does not lose the estimates."""
    if chosen.json:
        print_document(document(estimates))
    else:
        open_console().print(identification_table(estimates))
    sys.stdout.flush()
    show_written(write(), chosen.json)
    show_next_steps(chosen, estimates.modes is not None)


def _run_together(files: Sequence[Path], what: str, chosen: argparse.Namespace) -> int:
    """Identify the modes of one aircraft from several of its flights.

    Raises:
        InputError: another subject is requested, or the logs are not of one aircraft.
    """
    if what != "modes":
        raise InputError(
            f"several logs give their modes together (wingbeat identify {' '.join(map(str, files))} modes);"
            f" {what} is of one log at a time"
        )
    every, validation = _held_out(files, chosen.validate, chosen.validate_share)
    check_outputs(chosen)
    with contextlib.ExitStack() as stack:
        stack.enter_context(announced(chosen.json))
        logs = [stack.enter_context(opened_log(file)) for file in every]
        stack.enter_context(damage_notices(logs, "identified"))
        estimates = identified_together(logs, chosen.vehicle, chosen.elevator, validation, chosen.method)
        _show(chosen, estimates, lambda: write_outputs(logs, estimates, chosen.report, chosen.model, chosen.vehicle))
    return 0


def _held_out(files: Sequence[Path], validate: Sequence[Path], share: float | None) -> tuple[list[Path], list[int]]:
    """Return all logs, those for validation last, and their indices.

    Raises:
        InputError: a log is named twice, all are reserved, or a ``share`` is given in addition to names.
    """
    for named in (files, validate):
        twice = [one for place, one in enumerate(named) if one.resolve() in {o.resolve() for o in named[:place]}]
        if twice:
            raise InputError(f"{twice[0]} is named twice: one flight counts once")
    asked = {one.resolve() for one in validate}
    fitted = [one for one in files if one.resolve() not in asked]
    if not fitted:
        raise InputError("every log is held out for validation: none is left to fit (--validate)")
    if share is None:
        return [*fitted, *validate], list(range(len(fitted), len(fitted) + len(validate)))
    if validate:
        raise InputError("--validate-share draws what is held out: name none beside it with --validate")
    if not 0 < share < 1 or len(fitted) < 2:
        raise InputError(f"--validate-share {share:g}: it is between 0 and 1, of two logs or more")
    chosen = holdout_sample(sorted(str(one) for one in fitted), share)
    every = [*(one for one in fitted if str(one) not in chosen), *(one for one in fitted if str(one) in chosen)]
    return every, list(range(len(fitted) - len(chosen), len(fitted)))


def identified_together(
    logs: Sequence[Log],
    vehicle: str | None = None,
    elevator: Sequence[str] | None = None,
    validation: Sequence[int] = (),
    method: str | None = None,
) -> Identification:
    """Identify the modes from the maneuvers of all ``logs``, with the mean of the truths.

    Arguments as of `identified`. The logs with indices ``validation`` are predicted, not fitted.

    Raises:
        InputError: a log has no manoeuvre's data, or they are not of one aircraft.
    """
    aircraft = [_aircraft(log, vehicle) for log in logs]
    if any(one._replace(imu=aircraft[0].imu) != aircraft[0] for one in aircraft):
        told = " and ".join(str(log.path) for log in logs)
        raise InputError(f"{told} are of different aircraft: identify each alone")
    made = [_made(log, elevator) for log in logs]
    sources = [one or log for one, log in zip(made, logs, strict=True)]
    flights = tuple(flight_data(source, one.imu) for source, one in zip(sources, aircraft, strict=True))
    names = names_of(logs)
    held_out = tuple(names[place] for place in validation)
    modes = identify_modes(joined_flights(flights, names), aircraft[0], held_out=held_out, method=method)
    unknown = vehicle is None and any(flight_vehicle(log) is None for log in logs)
    notes = (*dict.fromkeys(one.note for one in made if one), *((UNKNOWN,) if unknown else ()))
    fitted = [place for place in range(len(logs)) if place not in validation]
    truths = _mean_truths([logs[place] for place in fitted], [flights[place] for place in fitted])
    return Identification(modes=modes._replace(findings=(*modes.findings, *map(note, notes))), truths=truths)


def _mean_truths(logs: Sequence[Log], flights: Sequence[FlightData]) -> dict[str, float]:
    """Return the mean of the truths of all logs, weighted by the duration of their maneuvers."""
    truths = [known_truths(log, modes=True) for log in logs]
    weights = [float(np.sum(flight.active > 0)) for flight in flights]
    shared = [name for name in truths[0] if all(name in one for one in truths)]
    return {name: float(np.average([one[name] for one in truths], weights=weights)) for name in shared}


def _example(words: Sequence[str]) -> str:
    """Return the example map of the subject.

    Raises:
        InputError: more than one, or one that cannot be identified from tables.
    """
    subject = words[0] if len(words) == 1 else ALL
    if len(words) > 1 or subject not in MAPS:
        guess = did_you_mean(words[-1], MAPS)
        raise InputError(f"no example map of {' '.join(words)!r}{guess}; known: {', '.join(MAPS)}")
    return example_map(subject)


def _split(words: Sequence[str]) -> tuple[list[Path], str]:
    """Return the files, and the subject, which may follow them.

    Raises:
        InputError: there is no file.
    """
    what = words[-1] if words and words[-1] in KNOWN else "all"
    files = [options.recording_path(word) for word in words if word not in KNOWN]
    if not files:
        raise InputError("which log or table? (see wingbeat identify --help)")
    return files, what


def identified(
    log: Log,
    what: str = "all",
    vehicle: str | None = None,
    elevator: Sequence[str] | None = None,
    wings: bool = True,
    method: str | None = None,
) -> Identification:
    """Identify ``what`` from an open log, with the truth if the flight was simulated.

    Args:
        log: log of the flight.
        what: one of `SUBJECTS`.
        vehicle: name or file of the vehicle, if the log has none.
        elevator: elevator command, ``topic.field``, and its scale in rad per unit, if the log has no angle.
        wings: whether all subjects include the wing coefficients.
        method: row of the registry that identifies the modes; all if not given.

    Raises:
        InputError: the log has no data for the subject, has a vehicle file in addition to the given one,
            or the elevator cannot be derived.
    """
    made = _made(log, elevator)
    bodies = _bodies(log, vehicle) if what == "aero" else None
    if what == "all" and wings:
        bodies = _bodies_if_given(log, vehicle)
    estimates = identify(
        made or log, what, _aircraft(log, vehicle), lambda modes: known_truths(log, modes), bodies, method
    )
    if estimates.modes is not None:
        unknown = vehicle is None and flight_vehicle(log) is None
        notes = ([made.note] if made else []) + ([UNKNOWN] if unknown else [])
        findings = (*estimates.modes.findings, *map(note, notes))
        estimates = estimates._replace(modes=estimates.modes._replace(findings=findings))
    if estimates.frequency is None:
        return estimates
    return estimates._replace(truths={**estimates.truths, **throttle_truths(log, estimates.frequency)})


def _aircraft(log: Log, vehicle: str | None) -> Aircraft:
    if vehicle is None:
        return aircraft_of(log)
    if flight_vehicle(log) is not None:
        raise InputError(f"{log.path} carries the file of its vehicle: --vehicle is for logs of other programs")
    return airframe_of(load_vehicle(options.vehicle_files(vehicle)[1]), _bodies_if_given(log, vehicle))


def _bodies(log: Log, vehicle: str | None) -> SimulatedVehicle | None:
    """Return masses, hinges and tail of the vehicle, from the log or from the given file."""
    return simulated_vehicle(log) if vehicle is None else load_bodies(options.vehicle_files(vehicle)[0])


def _bodies_if_given(log: Log, vehicle: str | None) -> SimulatedVehicle | None:
    """Return `_bodies`; None if the given vehicle has only a flight computer file."""
    if vehicle is None:
        return simulated_vehicle(log)
    world, avionics = options.vehicle_files(vehicle)
    try:
        return load_bodies(world)
    except InputError:
        if world != avionics and Path(world).exists():
            raise
        return None


def _made(log: Log, elevator: Sequence[str] | None) -> ElevatorFromField | None:
    """Return the source of the elevator's angle if the log does not record one."""
    recorded = None if elevator else recorded_elevator(log)
    elevator = elevator or recorded
    if elevator is None:
        return None
    (name, said), (topic, _, field) = elevator, elevator[0].rpartition(".")
    try:
        scale = float(said)
    except ValueError:
        scale = 0.0
    if not topic or not field or not scale or not math.isfinite(scale):
        raise InputError(f"--elevator {name} {said}: it takes TOPIC.FIELD and rad per unit of it, which is not 0")
    if topics.ACTUATORS.name in log.topics:
        raise InputError(f"{log.path} tells the elevator's angle: --elevator is for logs that do not")
    made = ElevatorFromField(log, topic, field, scale, assumed=recorded is not None)
    made.columns(topics.ACTUATORS)  # what is wrong with it is told before anything is identified
    return made
