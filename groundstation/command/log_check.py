"""``wingbeat log check``: faults of a log, before anybody identifies from it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from groundstation.command import options
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.new_files import check_new
from wingbeat.text import pluralize

if TYPE_CHECKING:
    from logs.checks.run import LogReport

SUMMARY = (
    "Check the clocks, sensors, drive and content of a log: of Wingbeat, PX4 (.ulg), ArduPilot (.bin), MAVLink"
    " (.tlog) or tables (.csv). Several tables are topics of one log. A finding has a code, time, size and remedy."
)
STYLES = {"error": "red", "warning": "yellow", "info": "dim"}


def add_verb(verbs: Any) -> None:
    """Add ``check``."""
    one = verbs.add_parser("check", help="find faults of clocks, sensors and drive", description=SUMMARY)
    one.add_argument(
        "file",
        nargs="+",
        type=options.recording_file,
        metavar="FILE",
        help="path, or latest: the newest of recordings/; several tables with a common clock",
    )
    one.add_argument(
        "--map", type=Path, metavar="MAP.toml", help="columns of a table, see wingbeat log import --help"
    )
    one.add_argument("--report", type=Path, metavar="OUT.html", help="write a page with findings and signals")
    options.add_json(one)


def run_verb(chosen: argparse.Namespace) -> None:
    """Check and report.

    Raises:
        InputError: a file cannot be read, or has no data.
    """
    from logs.checks.run import check_log  # its readers are heavy

    if chosen.report is not None:
        check_new(chosen.report)
    with ProgressBar("checking", quiet=chosen.json):
        report = check_log(chosen.file, chosen.map)
    if chosen.report is not None:
        from logs.checks.page import write

        write(chosen.report, report)
    if chosen.json:
        print_document(_document(chosen, report))
        return
    _print(report)
    if chosen.report is not None:
        print(f"written {chosen.report}")


def _document(chosen: argparse.Namespace, report: LogReport) -> dict[str, Any]:
    return {
        "files": [str(path) for path in chosen.file],
        "format": report.log.kind,
        "duration": report.log.duration,
        "findings": [one._asdict() | {"remedy": one.remedy} for one in report.findings],
    }


def _print(report: LogReport) -> None:
    console = open_console()
    counts = [
        pluralize(sum(one.severity == severity for one in report.findings), severity)
        for severity in ("error", "warning")
    ]
    console.print(f"{report.log.name}   {report.log.kind}   {report.log.duration:.1f} s   {', '.join(counts)}")
    if not report.findings:
        return
    table = tables.plain_table(("", ""), ("code", ""), ("topic", ""), ("s", "right"), ("finding", tables.SENTENCES))
    for one in report.findings:
        times = f"{one.start:.2f}" if one.end - one.start < 0.01 else f"{one.start:.2f} to {one.end:.2f}"
        row = (one.severity, one.code, one.topic, times, f"{one.text}: {one.remedy}")
        table.add_row(*(Text(cell, STYLES[one.severity]) for cell in row))
    console.print(table)
