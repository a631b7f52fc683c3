"""``wingbeat replay``: recorded sensors through the flight code."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from avionics.estimation.ahrs import AhrsGains
from groundstation.command import options
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.replay.imu import METHODS, ImuScore, recordings, replay_imu

EXAMPLES = (
    "wingbeat replay --imu tests/data/broad",
    "wingbeat replay --imu tests/data/broad --method razor",
    "wingbeat replay --imu trial_16.npz --json",
)
JSON_KEYS = {
    "file": "name of the recording (the document is a list of rows)",
    "total_deg": "RMS angle between estimate and reference",
    "heading_deg": "RMS of its part about the vertical",
    "inclination_deg": "RMS of its part about a horizontal axis",
}


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    summary = "Run IMU recordings with a reference orientation (BROAD's .npz) through the flight's attitude filter."
    parser = options.build_parser("replay", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument(
        "--imu", action="append", required=True, type=Path, metavar="FILE|DIR", help="recordings; may be repeated"
    )
    parser.add_argument(
        "--method",
        choices=tuple(METHODS),
        default="averages",
        help="corrections of the filter: averages over time, as flown, or the classic ones of the Razor, to compare",
    )
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Replay, and print the orientation error of each recording.

    Raises:
        BadInput: no such file, or not such a recording.
    """
    chosen = build_parser().parse_args(arguments)
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
    return 0


def _print_scores(scores: Sequence[ImuScore]) -> None:
    table = tables.plain_table(
        ("orientation error, RMS", ""), ("total", "right"), ("heading", "right"), ("inclination", "right")
    )
    for score in scores:
        angles = (score.total_deg, score.heading_deg, score.inclination_deg)
        table.add_row(score.file, *(f"{angle:.2f}°" for angle in angles))
    open_console().print(table)
