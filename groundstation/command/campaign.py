"""``wingbeat campaign``: many flights of a sweep in one table."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.command import options
from groundstation.command.compiling import load_physics
from groundstation.views import campaign as words
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.campaigns.campaign import Campaign, flight_values, load_campaign
from logs.campaigns.cluster import dashboard_of, dask, existing_cluster, local_cluster, worker_memory
from logs.campaigns.journal import ENDING, Journal
from logs.campaigns.outcome import Outcome
from logs.campaigns.run import LOGS, MIN_FLIGHTS, Logs, ResourceUsage, fly_campaign, order_of
from logs.campaigns.single_flight import Recording, Row, fly_one
from logs.campaigns.table import arrow, read_table, write_table
from logs.names import RECORDINGS
from logs.new_files import why_not
from wingbeat.cores import available_cores
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat campaign docs/examples/gusts.toml",
    "wingbeat campaign my_sweep.toml --workers 8 --logs failed",
    "wingbeat campaign my_sweep.toml --scheduler tcp://10.0.0.5:8786",
    "wingbeat campaign my_sweep.toml --flight 17 --log flight-17.mcap",
    "wingbeat campaign report recordings/my_sweep.parquet --out my_sweep.html",
)
JSON_KEYS = {
    "name, file": "of the campaign; its file",
    "table": "path of the Parquet table, a row for each flight",
    "logs": "folder of the recordings, null without --logs",
    "flights, flown, failed": "how many there are, how many of them this run has flown, how many failed in all",
    "outcomes": f"how many of each: {', '.join(outcome.value for outcome in Outcome)}",
    "wall_time": "s; of this run",
    "memory": "{first_tenth, peak}: bytes; of the largest worker process in the first tenth of this run and in all of"
    " it, null if nothing was flown",
    f"time_of_{words.MANY}": f"s; of {words.MANY} flights at the rate of this run, null after fewer than"
    f" {MIN_FLIGHTS}",
    "with --flight": "file, flight, values (what entered it), row (as in the table), log",
}


LINE_EVERY = 10.0
"""s; between two lines without a terminal"""


class _Places(NamedTuple):
    """Paths of the files of a campaign."""

    table: Path
    journal: Path
    logs: Path


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Fly every flight of a campaign, a TOML file with a grid or a draw over vehicle values, gains, wind, faults"
        " and more (logs/campaigns/README.md), into a Parquet table. After an interruption the same command resumes."
        " wingbeat campaign report TABLE summarizes it."
    )
    parser = options.build_parser("campaign", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("file", type=Path, metavar="FILE.toml", help="the campaign")
    parser.add_argument(
        "--out", type=Path, metavar="TABLE.parquet", help="a new table (default: recordings/NAME.parquet)"
    )
    parser.add_argument(
        "--workers", type=_count, metavar="N", help="worker processes on this machine (default: cores)"
    )
    parser.add_argument("--scheduler", metavar="URL", help="Dask scheduler of a cluster to use")
    parser.add_argument("--logs", choices=LOGS, default="none", help="flights to record (default: none)")
    parser.add_argument("--flight", type=_count, metavar="N", help="run only this flight, in this process")
    parser.add_argument("--log", type=Path, metavar="FILE", help="a new recording of --flight (default: none)")
    options.add_json(parser)
    return parser


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or not 1 <= int(text) <= 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1")
    return int(text)


def run(arguments: Sequence[str]) -> int:
    """Run a campaign, or one flight of it, or report on one.

    Raises:
        InputError: an invalid campaign, an existing table of another one, a missing package, no cluster.
    """
    if arguments and arguments[0] == "report":
        from groundstation.command import campaign_report

        return campaign_report.run(arguments[1:])
    chosen = build_parser().parse_args(arguments)
    _check_options(chosen)
    campaign = load_campaign(chosen.file)
    if chosen.flight is not None:
        return _fly_one(chosen, campaign)
    arrow()
    dask()
    places = _places(chosen, campaign)
    if not places.table.exists():
        places.table.parent.mkdir(parents=True, exist_ok=True)
        return _fly(chosen, campaign, places)
    if read_table(places.table).about.digest != campaign.digest():
        raise InputError(f"{places.table} belongs to another campaign, or to this one before its files changed:"
                       " choose another --out")  # fmt: skip
    if chosen.logs != "none" and not places.logs.exists():
        print(words.too_late_for_logs(places.table), file=sys.stderr)
    return _report_done(chosen, campaign, places)


def _check_options(chosen: argparse.Namespace) -> None:
    if chosen.workers is not None and chosen.scheduler is not None:
        raise InputError("--workers and --scheduler exclude each other")
    if chosen.flight is None and chosen.log is not None:
        raise InputError("--log requires --flight; use --logs for a campaign")
    if chosen.flight is not None and (chosen.workers or chosen.scheduler or chosen.out or chosen.logs != "none"):
        raise InputError("--workers, --scheduler, --out and --logs do not apply to --flight")


def _places(chosen: argparse.Namespace, campaign: Campaign) -> _Places:
    table = chosen.out or RECORDINGS / f"{campaign.name}.parquet"
    if table.suffix != ".parquet":
        raise InputError(f"--out {table} must end in .parquet")
    if reason := why_not(table.parent, made=True):
        raise InputError(f"cannot write {table}: {reason}")
    return _Places(table, table.with_name(table.name + ENDING), table.with_suffix(""))


# --- all flights --------------------------------------------------------------------------------------------


def _fly(chosen: argparse.Namespace, campaign: Campaign, places: _Places) -> int:
    began, console = time.monotonic(), open_console(quiet=chosen.json)
    _check_folder(chosen, places)
    with Journal(places.journal, campaign.digest(), campaign.path) as journal:
        before = len(journal.rows)
        logs = _logs(chosen, places)
        if before:
            console.print(words.in_progress(before, campaign.size))
        load_physics(_first_vehicle(campaign), chosen.json)
        try:
            usage = _fly_rest(chosen, campaign, journal, logs)
        except KeyboardInterrupt:
            print(words.stopped(len(journal.rows), campaign.size), file=sys.stderr)
            raise
        write_table(places.table, campaign, journal.rows)
        journal.remove()
    usage = usage._replace(wall_time=time.monotonic() - began)
    _report(chosen, campaign, places, list(journal.rows.values()), usage)
    return 0


def _check_folder(chosen: argparse.Namespace, places: _Places) -> None:
    """Reject an existing folder for recordings if the campaign has no journal yet.

    Raises:
        InputError: recordings of another campaign may lie in it.
    """
    if chosen.logs != "none" and not places.journal.exists() and places.logs.exists():
        raise InputError(f"{places.logs} exists and may have recordings of another campaign; choose another --out")


def _logs(chosen: argparse.Namespace, places: _Places) -> Logs:
    """Return which flights are recorded, and where."""
    if chosen.logs != "none":
        places.logs.mkdir(exist_ok=True)
    return Logs(chosen.logs, places.logs)


def _first_vehicle(campaign: Campaign) -> Any:
    return next(iter(campaign.stock.vehicles.values())).world


def _fly_rest(chosen: argparse.Namespace, campaign: Campaign, journal: Journal, logs: Logs) -> ResourceUsage:
    """Run the remaining flights and store each result when it ends."""
    usage = ResourceUsage()
    left = [number for number in range(1, campaign.size + 1) if number not in journal.rows]
    if not left:
        return usage
    failed = sum(row["failed"] for row in journal.rows.values())
    with contextlib.ExitStack() as stack:
        bar = stack.enter_context(
            ProgressBar("flying", quiet=chosen.json, reporting=not chosen.json, every=LINE_EVERY)
        )
        bar.show(0, 0, "starting the workers")
        client = stack.enter_context(_cluster(chosen, len(left)))
        dashboard = dashboard_of(client)
        if dashboard and not chosen.json:
            print(f"dashboard {dashboard}", file=sys.stderr, flush=True)
        began, already = time.monotonic(), len(journal.rows)

        def show() -> None:
            done = len(journal.rows)
            pace = (time.monotonic() - began) / max(done - already, 1)
            remaining = pace * (campaign.size - done) if done > already else None
            bar.show(done, campaign.size, words.progress(done, campaign.size, failed, remaining))

        show()
        for row in fly_campaign(campaign, left, client, logs):
            journal.add(row)
            failed += row["failed"]
            usage = usage.with_flight(len(left), time.monotonic() - began, worker_memory(client))
            show()
    return usage


def _cluster(chosen: argparse.Namespace, flights: int) -> Any:
    if chosen.scheduler is not None:
        return existing_cluster(chosen.scheduler)
    return local_cluster(min(chosen.workers or available_cores(), flights))


def _report_done(chosen: argparse.Namespace, campaign: Campaign, places: _Places) -> int:
    """Report on an existing table."""
    columns = read_table(places.table).columns
    names = ("flight", "failed", "outcome", "reason")
    rows = [dict(zip(names, row, strict=True)) for row in zip(*(columns[n] for n in names), strict=True)]
    _report(chosen, campaign, places, rows, ResourceUsage())
    return 0


def _report(
    chosen: argparse.Namespace, campaign: Campaign, places: _Places, rows: Sequence[Row], usage: ResourceUsage
) -> None:
    outcomes = Counter(row["outcome"] for row in rows)
    failed = [row for row in rows if row["failed"]]
    if not chosen.json:
        console = open_console()
        console.print(words.summary(campaign.name, places.table, outcomes, usage))
        console.print(words.failures(failed), end="")
        return
    print_document(
        {
            "name": campaign.name,
            "file": campaign.path,
            "table": places.table,
            "logs": places.logs if places.logs.exists() else None,
            "flights": campaign.size,
            "flown": usage.flights,
            "failed": len(failed),
            "outcomes": {outcome.value: outcomes[outcome.value] for outcome in Outcome},
            "wall_time": usage.wall_time,
            "memory": {"first_tenth": usage.early_memory, "peak": usage.memory} if usage.memory else None,
            f"time_of_{words.MANY}": usage.time_of(words.MANY),
        }
    )


# --- one flight ---------------------------------------------------------------------------------------------


def _fly_one(chosen: argparse.Namespace, campaign: Campaign) -> int:
    """Repeat one flight bit for bit, and show its row."""
    values = flight_values(campaign, chosen.flight)
    if chosen.log is not None and chosen.log.exists():
        raise InputError(f"{chosen.log} exists: it is not overwritten")
    load_physics(_first_vehicle(campaign), chosen.json)
    row = fly_one(order_of(campaign, chosen.flight, chosen.log and Recording(chosen.log)))
    if chosen.json:
        told = {"file": campaign.path, "flight": chosen.flight, "values": values, "row": row, "log": chosen.log}
        print_document(told)
    else:
        open_console().print(words.one_flight(campaign.swept, values, row, chosen.log))
    return 0
