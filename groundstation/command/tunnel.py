"""``wingbeat tunnel``: recorded wing angles through an aerodynamic model, body fixed in an air stream."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.command.compiling import announced
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from groundstation.views.tunnel import forces_page, forces_table, forces_text
from logs.model_range import range_findings
from logs.pages.render import refuse_existing, write_page, write_text
from sim_bridge.flight_mechanics.recorded_motion import load_motion
from sim_bridge.flight_mechanics.tunnel import (
    DENSITY,
    AirStream,
    TunnelForces,
    measured_means,
    tunnel_forces,
    tunnel_subject,
)
from sim_bridge.vehicles import load_vehicle

EXAMPLES = (
    "wingbeat tunnel flapping.csv --vehicle robo_raven_ii_d --aerodynamics strip_theory --frequency 4",
    "wingbeat tunnel dragonfly_motion.toml --wing dragonfly_wings.toml --aerodynamics quasi_steady"
    " --airspeed 0.54 --climb 0.468",
    "wingbeat tunnel flapping.csv --vehicle arizona_100cm --frequency 5 --out forces.csv --report forces.html",
)
FILES = """
KINEMATICS is a table (.csv) with a column time (s) or phase (strokes) and columns WING.stroke, WING.deviation,
WING.feathering, WING.twist in rad, or with the suffix _deg; WING. is omitted for the only wing, and the wings of a
vehicle are named wing. Columns lift and thrust are measured forces in N. Or it is a file (.toml) with frequency (Hz)
and tables [motion.WING] of Fourier coefficients in rad: mean, then cosine and sine of each harmonic; [measured] has
mean forces. stroke turns the span in the stroke plane, positive up or aft; deviation leaves it, positive forward and
up; feathering 0 is a chord across the plane, positive raises the leading edge or tips it aft; twist is that of the
tip. A wing file has sections [wings.WING] and those of aerodynamic models, as a vehicle file.
"""
JSON_KEYS = {
    "vehicle, aerodynamics": "title of the wings, name of the model",
    "airspeed, climb_rate, pitch, density": "of the stream: m/s, m/s, rad, kg/m^3",
    "frequency": "Hz; of the stroke",
    "mean, minimum, maximum": "lift, thrust, side N, pitch_moment N m of all wings; lift vertical, thrust horizontal",
    "measured": "lift, thrust N: means of the file; empty without",
    "wings": "by name: lift, thrust N (means), advance_ratio, reynolds, reduced_frequency, aspect_ratio; null:"
    " infinite",
    "findings": "list of {code, severity, subject, value, limit, text}: what is outside the range of the model",
    "files": "paths written",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Compute the forces of recorded wing motion in an air stream, beside measured ones." + "\n" + FILES
    parser = options.build_parser("tunnel", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("kinematics", type=Path, metavar="KINEMATICS", help="recorded wing angles, .csv or .toml")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--vehicle", metavar="V|PATH", help="wings of a vehicle: name, file or folder")
    source.add_argument("--wing", type=Path, metavar="FILE", help="wings of a wing file")
    parser.add_argument(
        "--aerodynamics", metavar="MODEL", help="aerodynamic model (default: that of the vehicle; needed with --wing)"
    )
    parser.add_argument(
        "--airspeed", type=options.not_negative, metavar="M/S", help="airspeed (default: cruise; needed with --wing)"
    )
    parser.add_argument("--climb", type=options.number, default=0.0, metavar="M/S", help="climb rate (default: 0)")
    parser.add_argument(
        "--pitch", type=options.number, default=0.0, metavar="RAD", help="pitch of the body, nose up (default: 0)"
    )
    parser.add_argument(
        "--density", type=options.positive, default=DENSITY, metavar="KG/M3", help=f"air density (default: {DENSITY})"
    )
    parser.add_argument(
        "--frequency", type=options.positive, metavar="HZ", help="flapping frequency of a table that repeats itself"
    )
    parser.add_argument(
        "--harmonics", type=_count, metavar="N", help="harmonics fitted to a table (default: 8, fewer for few rows)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write time, lift, thrust, side, moment to a new CSV"
    )
    parser.add_argument("--report", type=Path, metavar="FILE", help="write a new page of plots (.html)")
    options.add_json(parser)
    return parser


def _count(text: str) -> int:
    """Parse a number of harmonics for argparse."""
    if not text.isdigit() or not 1 <= int(text) <= 100:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from 1 to 100")
    return int(text)


def run(arguments: Sequence[str]) -> int:
    """Compute the forces, print and write them.

    Raises:
        InputError: unknown vehicle or model, a file that cannot be read, or one to write that exists.
    """
    chosen = build_parser().parse_args(arguments)
    for path in (chosen.out, chosen.report):
        if path is not None:
            refuse_existing(path)
    vehicle = None if chosen.vehicle is None else load_vehicle(options.vehicle_files(chosen.vehicle)[0])
    wings, model, airspeed = tunnel_subject(vehicle, chosen.wing, chosen.aerodynamics, chosen.airspeed)
    stream = AirStream(airspeed, chosen.climb, chosen.pitch, chosen.density)
    motion = load_motion(chosen.kinematics, list(wings.wings), chosen.frequency, chosen.harmonics)
    with announced(quiet=chosen.json):
        forces = tunnel_forces(wings, motion, model, stream)
    findings = range_findings(forces.excesses)
    for one in findings:
        print(f"warning: {one.text}", file=sys.stderr)
    files = []
    if chosen.out is not None:
        write_text(chosen.out, forces_text(forces))
        files.append(chosen.out)
    if chosen.report is not None:
        title, facts = f"{wings.title}: {model}", (f"{airspeed:g} m/s", str(chosen.kinematics))
        write_page(chosen.report, title, facts, forces_page(forces, motion, model, findings))
        files.append(chosen.report)
    if chosen.json:
        rest = {"frequency": motion.stroke_rate, "measured": measured_means(motion)}
        findings_keys = {"findings": [one.document() for one in findings], "files": files}
        print_document(
            {"vehicle": wings.title, "aerodynamics": model}
            | stream._asdict()
            | rest
            | summary(forces)
            | findings_keys
        )
        return 0
    console = open_console()
    console.print(forces_table(wings.title, model, stream, motion, forces))
    for path in files:
        console.print(f"written: {path}", soft_wrap=True)
    return 0


def summary(forces: TunnelForces) -> dict[str, Any]:
    """Return mean, minimum and maximum of all wings, and the values of each."""
    columns = {name: getattr(forces, name) for name in ("lift", "thrust", "side", "pitch_moment")}
    found: dict[str, Any] = {
        "mean": {name: float(values.mean()) for name, values in columns.items()},
        "minimum": {name: float(values.min()) for name, values in columns.items()},
        "maximum": {name: float(values.max()) for name, values in columns.items()},
    }
    found["wings"] = {
        name: {"lift": lift, "thrust": thrust} | forces.numbers[name]._asdict()
        for name, (lift, thrust) in forces.by_wing.items()
    }
    return found
