"""``wingbeat log``: inspect, view, export, import and repair logs."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from groundstation.command import log_check, log_import, log_vibration, options
from groundstation.command.live import add_address, follow
from groundstation.views import tables, wording
from groundstation.views.flight_report import flight_metrics_table
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.chunks import MAX_CHUNK_SIZE
from logs.export import BAG, EACH, FORMS, Part, export, undecodable_lines
from logs.info import flight_summary, is_long, summary
from logs.new_files import numbered
from logs.reader import Log, open_log
from logs.recover import recover
from wingbeat.errors import InputError
from wingbeat.message import Severity
from wingbeat.text import pluralize

if TYPE_CHECKING:
    from logs.summary import FlightSummary
    from logs.view.page import Page

EXAMPLES = (
    "wingbeat log info recordings/flight.mcap",
    "wingbeat log view recordings/flight.mcap --open",
    "wingbeat log live recordings/flight.mcap      # of avionics, sim or gcs, while they record it",
    "wingbeat log export recordings/flight.mcap --to flight.npz --topic /attitude/ahrs",
    "wingbeat log export recordings/flight.mcap --to flight.mat --start 20 --end 40",
    "wingbeat log export recordings/flight.mcap --to folder --format parquet",
    "wingbeat log export recordings/flight.mcap --to bag --format rosbag2    # ROS 2: ros2 bag play bag",
    "wingbeat log export recordings/flight.mcap --to flight.csv --rate 100 --topic /main/wing --topic /power/state",
    "wingbeat log export recordings/flight.mcap --to flight.rrd    # then: rerun flight.rrd",
    "wingbeat log import flight.bin --to recordings/flight.mcap",
    "wingbeat log import stand.csv --map stand.toml",
    "wingbeat log check flight.ulg",
    "wingbeat log vibration latest",
    "wingbeat log vibration flight.mcap --fit robo_raven_ii_d --out my_raven",
    "wingbeat log recover recordings/flight.mcap",
)
JSON_KEYS = {
    "info": "file, complete, damage, incomplete: {recording: its damage}, vehicle, start_epoch_ns, duration,"
    " messages, dropped, flight: as of wingbeat fly or null, topics, events, attachments, metadata,"
    " undecodable: {topic: messages}",
    "view": "path: of the page, bytes, panels: titles, events: how many, missing: what the log does not have",
    "live": "file: the recording, when it is over",
    "export": "files: what was written; left_out: topics and messages that cannot be decoded, and why",
    "import": "file (the new log), source, format, sha256, importer, vehicle, messages, topics: list of {topic,"
    " source, messages}, events, parameters, damage, dropped: list of {topic, reason, rows},"
    " later_boots: the same for later boots in the file",
    "check": "files, format, duration, findings: list of {code, severity: error, warning or info, topic, start and"
    " end in s since the first message, value, text, remedy}",
    "vibration": "file, start, end, rate, strokes, stroke_frequency, ringing, clipped, bands, frequency,"
    " axes: {axis: unit, harmonics, bands, broadband, quiet, by_phase, density}, quiet_start,"
    " advice: list of {code, severity, value, text}, fit: {vibration, modes} or null, files",
    "recover": "messages, damage, torn, torn_bytes, joined: recordings that were joined to the file",
}
TEXTS = {
    "info": "what it holds",
    "view": "write the flight as one HTML page: track, vehicle, plots, events",
    "live": "serve it to Foxglove and Lichtblick while it is recorded",
    "export": f"write it as {', '.join(FORMS)}",
    "recover": "repair it, or join the recordings of a killed flight (NAME.world.mcap, NAME.avionics.mcap)",
}
EVENTS_SHOWN = 20


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Inspect a log, view it as a page, export it, import one of another program, or repair it."
    parser = options.build_parser("log", summary, EXAMPLES, JSON_KEYS)
    verbs = parser.add_subparsers(
        dest="verb",
        required=True,
        metavar="info|view|live|export|import|check|vibration|recover",
        parser_class=options.VerbParser,
    )
    for verb, text in TEXTS.items():
        one = verbs.add_parser(verb, help=text, description=text)
        one.add_argument(
            "file", type=options.recording_file, metavar="FILE", help="path, or latest: the newest of recordings/"
        )
        options.add_json(one)
        if verb in ("info", "view", "export", "recover"):
            one.add_argument(
                "--max-chunk-size",
                type=options.positive,
                default=MAX_CHUNK_SIZE / 1e6,
                metavar="MB",
                help=f"decompress chunks of up to this size (default: {MAX_CHUNK_SIZE / 1e6:.0f})",
            )
        if verb == "view":
            one.add_argument(
                "--to", "--out", type=Path, metavar="PAGE.html", help="a new file (FILE.html, or FILE-2.html ...)"
            )
            one.add_argument("--open", action="store_true", help="show the page in the browser")
        if verb == "info":
            one.add_argument("--flight", action="store_true", help="summarize the flight of a long log too")
        if verb == "live":
            add_address(one)
        if verb == "export":
            _add_export(one)
    log_import.add_verb(verbs)
    log_check.add_verb(verbs)
    log_vibration.add_verb(verbs)
    return parser


def _add_export(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--to",
        type=Path,
        metavar="PATH",
        help="file whose extension sets the format, or folder for rosbag2 or a CSV or Parquet file per topic",
    )
    parser.add_argument("--format", choices=FORMS, help="format if not set by the extension (default: csv)")
    parser.add_argument(
        "--topic",
        action="append",
        metavar="NAME",
        help="only this topic, with --rate also NAME.FIELD (repeatable)",
    )
    parser.add_argument("--start", type=options.number, metavar="S", help="from so many seconds since boot on")
    parser.add_argument("--end", type=options.number, metavar="S", help="to so many seconds since boot")
    parser.add_argument(
        "--rate", type=options.positive, metavar="HZ", help="one table of all topics at multiples of 1/HZ"
    )


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Raises:
        InputError: not an MCAP log, a damaged part, an existing output, an unknown topic.
    """
    chosen = build_parser().parse_args(arguments)
    VERBS[chosen.verb](chosen)
    return 0


def _open(chosen: argparse.Namespace) -> Log:
    return open_log(chosen.file, _chunk_limit(chosen))


def _chunk_limit(chosen: argparse.Namespace) -> int:
    limit: float = chosen.max_chunk_size
    return round(limit * 1e6)


def _info(chosen: argparse.Namespace) -> None:
    with _open(chosen) as log:
        flights, long = flight_summary(log, chosen.flight), is_long(log)
        document = summary(log, flights)
        undecodable = undecodable_lines(log)
    if chosen.json:
        print_document(document)
    else:
        _print_info(document, chosen.file, flights)
        for line in undecodable:
            print(f"omitted: {line}", file=sys.stderr)
        if long and not chosen.flight:
            print("long log: use --flight for a summary of the flight")


def _print_info(document: dict[str, Any], file: Path, flights: FlightSummary | None) -> None:
    console = open_console()
    console.print(
        Text.assemble(
            (wording.one_line(document["vehicle"] or "unknown vehicle"), "bold"),
            f"   {wording.duration(document['duration'])}   {pluralize(document['messages'], 'message')}   "
            f"{wording.size(file.stat().st_size)}",
        )
    )
    if document["dropped"]:
        lost = f"{pluralize(document['dropped'], 'message')} dropped while recording: disk too slow"
        console.print(lost, style="yellow")
    for name, damage in document["incomplete"].items():
        console.print(f"{name} ended early: {damage}", style="yellow")
    for line in document["damage"]:
        console.print(f"damaged: {line} (wingbeat log recover {file})", style="yellow")
    if flights is not None:
        console.print(flight_metrics_table(flights))
    table = tables.plain_table(
        ("topic", ""), ("messages", "right"), ("rate", "right"), ("gaps", "right"), ("message", tables.SPARE)
    )
    for row in document["topics"]:
        rate = "" if row["rate"] is None else f"{row['rate']:.4g} Hz"
        gaps = "" if not row["gaps"] else f"{row['gaps']}, up to {row['longest_gap']:.3g} s"
        table.add_row(
            wording.one_line(row["topic"]), str(row["messages"]), rate, gaps, row["message"].rpartition(".")[2]
        )
    if document["topics"]:
        console.print(table)
    events = [event for event in document["events"] if event["severity"] != Severity.DEBUG.name]
    for event in events[-EVENTS_SHOWN:]:
        console.print(f"  {wording.clock(event['time'])}  {wording.one_line(event['text'])}")


def _view(chosen: argparse.Namespace) -> None:
    from logs.view.page import write_page  # brings the vehicles, which the other verbs need not wait for

    # A chosen page must be new; by default each page gets a free name.
    path = chosen.to or next(path for path in numbered(chosen.file.with_suffix(".html")) if not path.exists())
    with _open(chosen) as log, ProgressBar("viewing", quiet=chosen.json) as bar:
        page = write_page(log, path, lambda done, note: bar.show(done, 1.0, note))
    if chosen.json:
        print_document(page)
    else:
        _print_view(page)
    if chosen.open:
        webbrowser.open(page.path.resolve().as_uri())


def _print_view(page: Page) -> None:
    print(f"{page.path}   {wording.size(page.bytes)}")
    if page.missing:
        print(f"not in this log: {', '.join(page.missing)}")


def _live(chosen: argparse.Namespace) -> None:
    follow(chosen.file, chosen.at)
    if chosen.json:
        print_document({"file": str(chosen.file)})


def _export(chosen: argparse.Namespace) -> None:
    target = chosen.to or chosen.file.with_suffix(
        "" if chosen.format in (*EACH, BAG) else f".{chosen.format or 'npz'}"
    )
    part = Part(chosen.topic, chosen.start, chosen.end, chosen.rate)
    with _open(chosen) as log, ProgressBar("exporting", quiet=chosen.json) as bar:
        _check_window(log, chosen.start, chosen.end)
        done = export(log, target, part, chosen.format, bar.show)
    if chosen.json:
        print_document({"files": [str(file) for file in done.files], "left_out": done.left_out})
        return
    for file in done.files:
        print(file)
    for line in done.left_out:
        print(f"omitted: {line}", file=sys.stderr)


def _check_window(log: Log, start: float | None, end: float | None) -> None:
    first, last = ((moment - log.boot_ns) * 1e-9 for moment in (log.start_ns, log.end_ns))
    begin, stop = first if start is None else start, last + 1.0 if end is None else end
    if begin >= stop or begin > last or stop <= first:
        raise InputError(f"no data between {begin:g} and {stop:g} s: the log covers {first:.3f} to {last:.3f} s")


def _recover(chosen: argparse.Namespace) -> None:
    done = recover(chosen.file, _chunk_limit(chosen))
    if chosen.json:
        print_document(done)
        return
    if done.joined:
        print(f"joined {' and '.join(part.name for part in done.joined)} to {chosen.file}")
    elif not done.damage:
        print(f"{chosen.file} is complete: {pluralize(done.messages, 'message')}; not changed")
        return
    for line in done.damage:
        print(f"repaired: {line}")
    kept = f"; {wording.size(done.torn_bytes)} unreadable data are in {done.torn}" if done.torn else ""
    print(f"{pluralize(done.messages, 'message')} kept{kept}")


VERBS: dict[str, Callable[[argparse.Namespace], None]] = {
    "info": _info,
    "view": _view,
    "live": _live,
    "export": _export,
    "import": log_import.run_verb,
    "check": log_check.run_verb,
    "vibration": log_vibration.run_verb,
    "recover": _recover,
}
