"""``wingbeat log import``: logs of other programs."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.views.imported import print_imported
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from logs.importing.mapping import EXAMPLE
from wingbeat.errors import InputError

SUMMARY = (
    "Import an ArduPilot dataflash log (.bin), a PX4 ULog (.ulg), a MAVLink telemetry log (.tlog), a capture of a"
    " Razor's serial line, motion capture (C3D; CSV of OptiTrack Motive or Vicon Nexus), or any table of columns"
    " with a mapping (--map). What has the same meaning becomes the topics of a flown log, in SI and radians;"
    " everything is kept under topics named after the source. Every row is checked; what is dropped is told."
)
CLOCKS = ("vehicle", "ground")


def add_verb(verbs: Any) -> None:
    """Add ``import``."""
    lines = "\n".join(f"  {line}".rstrip() for line in EXAMPLE.splitlines())
    one = verbs.add_parser(
        "import",
        help="make one of a log of another program",
        description=textwrap.fill(SUMMARY, 100),
        epilog=f"a mapping, column by column:\n{lines}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    one.add_argument("file", type=Path, metavar="FILE")
    one.add_argument("--to", type=Path, metavar="OUT.mcap", help="new log (default: FILE with extension .mcap)")
    one.add_argument("--map", type=Path, metavar="MAP.toml", help="mapping of the columns of a table, see below")
    one.add_argument(
        "--clock", choices=CLOCKS, default="vehicle", help="clock of the times of a .tlog (default: vehicle)"
    )
    one.add_argument(
        "--onboard",
        type=Path,
        metavar="LOG.mcap",
        help="log of the same flight; the new log is aligned to its clock by the angular rate",
    )
    one.add_argument(
        "--wing", metavar="TOPIC", help="topic of the source with the wing's counts, speed, frequency or phase"
    )
    one.add_argument("--counts", type=options.positive, default=0.0, metavar="N", help="encoder counts per turn")
    one.add_argument(
        "--gear",
        type=options.positive,
        default=1.0,
        metavar="R",
        help="turns or pulses per stroke (default: 1)",
    )
    options.add_json(one)


def run_verb(chosen: argparse.Namespace) -> None:
    """Import, and report the result.

    Raises:
        InputError: the file cannot be read or has an unknown format, or the new log exists; nothing is written then.
    """
    from logs.importing.log_import import Choice, import_log  # its readers are heavy
    from logs.importing.wing import WingSource

    if chosen.file.is_dir():
        raise InputError(f"cannot read {chosen.file}: it is a folder")
    target = chosen.to or chosen.file.with_suffix(".mcap")
    with ProgressBar(f"importing {chosen.file.name}") as bar:
        wing = WingSource(chosen.wing or "", chosen.counts, chosen.gear)
        report = import_log(Choice(chosen.file, target, chosen.map, chosen.clock, chosen.onboard, wing), bar.show)
    if chosen.json:
        print_document(report)
    else:
        print_imported(report)
