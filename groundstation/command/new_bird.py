"""``wingbeat new-bird``: a vehicle folder of a new ornithopter from eight numbers."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.command.compiling import load_physics
from groundstation.views.json_document import print_document
from groundstation.views.new_bird import new_bird_table, next_lines
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.new_files import check_new
from sim_bridge.flight.new_vehicle import REFERENCE, NewVehicle, design_vehicle, write_vehicle
from sim_bridge.flight.tuning.vehicle_file import AVIONICS, WORLD
from sim_bridge.vehicles import load_vehicle
from sim_bridge.vehicles.scaling import NewBird, checked_bird
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat new-bird my_bird --mass 0.35 --span 1.0 --area 0.2 --stroke 69 --rate 5 --tail-area 0.04 --tail-arm 0.4"
    " --cells 2 --capacity 0.8",
    "wingbeat new-bird my_bird --interactive",
)
JSON_KEYS = {
    "name, reference": "of the vehicle; vehicle that was scaled",
    "written": "names of the files",
    "cruise": "airspeed m/s, power W (electrical), endurance s, range m, pitch, elevator rad, throttle; each"
    " predicted number with its relative standard error as airspeed_error, power_error",
    "efficiency": "mechanical power of the wings over electrical power; above 0.85 the predicted power is too low",
    "short_period": "list of {airspeed m/s, natural_frequency rad/s, damping}: at the cruise and its error limits",
    "remarks": "list of {code, value, low, high, unusual}; wing_loading N/m^2, lift_coefficient, strouhal,"
    " tail_volume",
    "flies": "whether the proof flight in light gusts completed its holds",
    "flight": "null, or figures of the proof flight as of tune",
}
FAILED = 1
"""exit code: the proof flight did not complete its holds; the files are written"""
METAVARS = {"stroke": "DEG", "cells": "N", "capacity": "AH"}
QUESTIONS = {
    "mass": "all-up mass in kg",
    "span": "span from tip to tip in m",
    "area": "area of both wings in m^2",
    "stroke": "stroke from the lowest to the highest wing position in degrees",
    "rate": "flapping rate in cruise in Hz",
    "tail_area": "area of the horizontal tail in m^2",
    "tail_arm": "distance from the center of mass to the tail in m",
    "cells": "lithium-polymer cells in series",
    "capacity": "battery capacity in A h",
}
"""by option"""
FIELDS = {"rate": "frequency"}
"""field of `NewBird` by option, where they differ"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Make the vehicle folder of a new ornithopter with one motor on a crank: each value given, scaled or default,"
        " trimmed, tuned, and flown before it is written."
    )
    parser = options.build_parser("new-bird", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("name", metavar="NAME", help="new folder; its last part is the name of the vehicle")
    for option, text in QUESTIONS.items():
        metavar = METAVARS.get(option, text.rpartition(" in ")[2].upper())
        parser.add_argument(f"--{option.replace('_', '-')}", type=options.positive, metavar=metavar, help=text)
    parser.add_argument("--chord", type=options.positive, metavar="M", help="mean chord in m, instead of --area")
    parser.add_argument(
        "--airspeed", type=options.positive, metavar="M/S", help="cruise airspeed (default: from the Strouhal number)"
    )
    parser.add_argument("--interactive", action="store_true", help="ask for each number that is not given")
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Design the vehicle, write its folder and print what is predicted.

    Raises:
        InputError: a number is missing or out of range, the folder has these files already, or the numbers are of no
            vehicle that can be trimmed and tuned.
    """
    chosen = build_parser().parse_args(arguments)
    folder = Path(chosen.name)
    for name in (WORLD, AVIONICS):
        check_new(folder / name, made=True)
    if chosen.area is None and chosen.chord is not None and chosen.span is not None:
        chosen.area = chosen.chord * chosen.span
    interactive = chosen.interactive or (
        sys.stdin.isatty() and all(getattr(chosen, one) is None for one in QUESTIONS)
    )
    if interactive:
        _prompt(chosen)
    bird = _bird(chosen)
    load_physics(load_vehicle(REFERENCE), quiet=chosen.json)
    with ProgressBar("designing") as bar:
        vehicle = design_vehicle(bird, folder.resolve().name, chosen.airspeed, bar.show)
    where = write_vehicle(vehicle, folder)
    written = [path for path in (where.world, where.avionics) if path is not None]
    if chosen.json:
        print_document(_document(vehicle, written))
    else:
        console = open_console()
        console.print(new_bird_table(vehicle))
        console.print(next_lines(folder, vehicle.flies), soft_wrap=True)
    return 0 if vehicle.flies else FAILED


def _prompt(chosen: argparse.Namespace) -> None:
    """Ask on the terminal for the numbers that are missing.

    Raises:
        InputError: the input ends, or an answer is not a positive number.
    """
    for option, text in QUESTIONS.items():
        if getattr(chosen, option) is not None:
            continue
        print(f"{text}: ", end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline()
        try:
            setattr(chosen, option, options.positive(answer.strip()))
        except argparse.ArgumentTypeError as error:
            raise InputError(f"{text}: {error}") from None


def _bird(chosen: argparse.Namespace) -> NewBird:
    """Return the given numbers in SI.

    Raises:
        InputError: one is missing or out of range.
    """
    missing = [f"--{option.replace('_', '-')}" for option in QUESTIONS if getattr(chosen, option) is None]
    if missing:
        raise InputError(f"missing: {', '.join(missing)} (or --interactive; see wingbeat new-bird --help)")
    values: dict[str, Any] = {FIELDS.get(option, option): getattr(chosen, option) for option in QUESTIONS}
    values["stroke"] = math.radians(chosen.stroke) / 2.0
    if chosen.cells != int(chosen.cells):
        raise InputError(f"--cells {chosen.cells:g} is not a whole number")
    values["cells"] = int(chosen.cells)
    return checked_bird(NewBird(**values))


def _document(vehicle: NewVehicle, written: Sequence[Path]) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`."""
    means, inputs = vehicle.cruise.means, vehicle.cruise.inputs
    return {
        "name": vehicle.world.name,
        "reference": REFERENCE,
        "written": list(written),
        "cruise": {
            "airspeed": means.airspeed,
            "airspeed_error": vehicle.prediction.airspeed_error,
            "power": means.electrical_power,
            "power_error": vehicle.prediction.power_error,
            "endurance": vehicle.endurance,
            "range": vehicle.endurance * means.airspeed,
            "pitch": means.pitch,
            "elevator": inputs.elevator,
            "throttle": vehicle.throttle,
        },
        "efficiency": vehicle.efficiency,
        "short_period": vehicle.short_period,
        "remarks": [one._asdict() | {"unusual": one.unusual} for one in vehicle.remarks],
        "flies": vehicle.flies,
        "flight": vehicle.flight,
    }
