"""``wingbeat replay``: recorded sensors through the flight code."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from avionics.estimation.ahrs import AhrsGains
from avionics.link.vehicle import load_identity
from groundstation.command import options
from groundstation.command.damage import damage_notices
from groundstation.command.replay_link import Playing, play
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.reader import open_log
from logs.replay.comparison import FieldDifference, TopicDifference
from logs.replay.flight import Replayed, replay_flight
from logs.replay.imu import METHODS, ImuScore, recordings, replay_imu
from logs.replay.player import Player
from logs.replay.recorded_flight import recorded_flight
from wingbeat.errors import InputError
from wingbeat.text import pluralize

EXAMPLES = (
    "wingbeat replay recordings/flight.mcap",
    "wingbeat replay recordings/flight.mcap --set pitch.proportional=0.5 --start 30 --end 60",
    "wingbeat replay recordings/flight.mcap --mavlink udpout:127.0.0.1:14550 --speed 2 --start 30",
    "wingbeat replay --imu tests/data/broad",
    "wingbeat replay --imu trial_16.npz --method razor --json",
)
JSON_KEYS = {
    "of a flight": "start, end (s since boot), ticks, same (every bit), late (a line where the file begins in flight,"
    " else empty), topics: list of {topic, recorded, replayed, differing (messages), first (s), fields: list of"
    " {field, unit, differing, largest, at, rms, rounding (in the last bits alone)}}",
    "with --imu": "list of {file, total_deg, heading_deg, inclination_deg}: RMS angle between estimate and reference,"
    " of its part about the vertical, of its part about a horizontal axis",
}
SHOWN = 3
"""-; number of fields of a topic on a line, those with the most differing messages"""


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Replay a recorded flight through the flight code and list the differences, or replay IMU recordings with a"
        " reference attitude (BROAD .npz) through the attitude filter."
    )
    parser = options.build_parser("replay", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument(
        "file",
        nargs="?",
        type=options.recording_file,
        metavar="FILE",
        help="a log of a Wingbeat flight computer, or latest: the newest of recordings/",
    )
    _add_flight(parser)
    options.add_identity(parser)
    _add_filter(parser)
    options.add_json(parser)
    return parser


def _add_flight(parser: options.Parser) -> None:
    """Add the options of a flight replay: range, gains, and links."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=setting,
        metavar="GAIN=VALUE",
        help="gain to change, by section.key or parameter name (repeatable)",
    )
    parser.add_argument(
        "--start",
        type=options.not_negative,
        metavar="S",
        help="start in s since boot; replay begins at the last snapshot before it",
    )
    parser.add_argument("--end", type=options.positive, metavar="S", help="s since boot")
    parser.add_argument(
        "--mavlink",
        action="append",
        default=[],
        metavar="URL",
        help="play it to ground stations on this link, such as udpout:127.0.0.1:14550 (repeatable)",
    )
    parser.add_argument(
        "--speed", type=options.positive, metavar="X", help="playback speed, multiple of real time (default: 1)"
    )


def _add_filter(parser: options.Parser) -> None:
    """Add the options of the attitude filter replay."""
    parser.add_argument(
        "--imu", action="append", default=[], type=Path, metavar="FILE|DIR", help="IMU recordings (repeatable)"
    )
    parser.add_argument(
        "--method",
        choices=tuple(METHODS),
        default="averages",
        help="method of the filter: averages (as in flight) or the DCM of the Razor",
    )


def setting(text: str) -> tuple[str, float]:
    """Parse a gain and its value from ``GAIN=VALUE``.

    Raises:
        argparse.ArgumentTypeError: invalid setting.
    """
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not GAIN=VALUE, such as pitch.proportional=0.5") from None


def run(arguments: Sequence[str]) -> int:
    """Replay a flight and print the differences, or replay IMU recordings and print their errors.

    Raises:
        InputError: no such file, not such a recording, or an unknown gain.
    """
    chosen = build_parser().parse_args(arguments)
    if bool(chosen.file) == bool(chosen.imu):
        raise InputError("specify a log FILE or --imu (see wingbeat replay --help)")
    if chosen.imu:
        _replay_imu(chosen)
    elif chosen.mavlink:
        _play(chosen)
    else:
        _replay_flight(chosen)
    return 0


def _play(chosen: argparse.Namespace) -> None:
    """Play a flight to ground stations.

    Raises:
        InputError: options that a player does not have.
    """
    if chosen.set or chosen.end or chosen.json:
        raise InputError("--set, --end and --json do not apply to --mavlink")
    identity = load_identity(chosen.identity)
    with open_log(chosen.file) as log:
        flight = recorded_flight(log)
    if flight.late:
        print(flight.late, file=sys.stderr)
    play(Player(flight, chosen.speed or 1.0), Playing(chosen.mavlink, chosen.start or 0.0, identity))


def _replay_flight(chosen: argparse.Namespace) -> None:
    with (
        open_log(chosen.file) as log,
        damage_notices([log], "replayed"),
        ProgressBar("replaying", quiet=chosen.json) as bar,
    ):
        end = math.inf if chosen.end is None else chosen.end
        done = replay_flight(log, dict(chosen.set), chosen.start or 0.0, end, bar.show)
    if chosen.json:
        print_document(_document(done))
    else:
        _print_flight(done)


def _document(done: Replayed) -> dict[str, Any]:
    topics = [each._asdict() | {"fields": [field._asdict() for field in each.fields]} for each in done.differences]
    told = {"start": done.start, "end": done.end, "ticks": done.ticks, "same": done.same, "late": done.late}
    return told | {"topics": topics}


def _print_flight(done: Replayed) -> None:
    console = open_console()
    messages = sum(each.recorded for each in done.differences)
    if done.late:
        console.print(done.late, highlight=False)
    span = f"{pluralize(done.ticks, 'tick')} from {done.start:.3f} to {done.end:.3f} s since boot"
    if done.same:
        said = f"identical in every bit: {pluralize(messages, 'message')}"
        console.print(f"{span}: {said} of {pluralize(len(done.differences), 'topic')}", highlight=False)
        return
    console.print(span, highlight=False)
    table = tables.plain_table(
        ("topic", ""),
        ("messages", "right"),
        ("differ", "right"),
        ("from", "right"),
        ("largest difference", "text"),
    )
    for each in (each for each in done.differences if not each.same):
        first = "" if each.first is None else f"{each.first:.3f} s"
        count = str(each.recorded) if each.recorded == each.replayed else f"{each.replayed} of {each.recorded}"
        table.add_row(
            each.topic, count, str(each.differing or ""), first, "; ".join(map(_difference_text, _foremost(each)))
        )
    console.print(table)
    alike = sum(each.same for each in done.differences)
    console.print(f"{alike} of {pluralize(len(done.differences), 'topic')} identical in every bit", highlight=False)


def _foremost(each: TopicDifference) -> list[FieldDifference]:
    return sorted(each.fields, key=lambda field: -field.differing)[:SHOWN]


def _difference_text(field: FieldDifference) -> str:
    unit = "" if field.unit == "-" else f" {field.unit}"
    if field.rounding:
        return f"{field.field} in the last bits alone, {field.largest:+.1g}{unit}"
    return f"{field.field} {field.largest:+.3g}{unit} at {field.at:.1f} s"


def _replay_imu(chosen: argparse.Namespace) -> None:
    files = recordings(chosen.imu)
    done: list[ImuScore] = []
    with ProgressBar("replaying", quiet=chosen.json) as bar:

        def scored(score: ImuScore) -> None:
            done.append(score)
            bar.show(len(done), len(files), score.file)

        gains = AhrsGains(method=METHODS[chosen.method])
        scores = replay_imu(files, gains, scored=scored)
    if chosen.json:
        print_document(scores)
    else:
        _print_scores(scores)


def _print_scores(scores: Sequence[ImuScore]) -> None:
    table = tables.plain_table(
        ("orientation error, RMS", ""), ("total", "right"), ("heading", "right"), ("inclination", "right")
    )
    for score in scores:
        angles = (score.total_deg, score.heading_deg, score.inclination_deg)
        table.add_row(score.file, *(f"{angle:.2f}°" for angle in angles))
    open_console().print(table)
