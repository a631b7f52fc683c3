"""``wingbeat campaign report``: statistics of a campaign as text and HTML page."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.views import campaign_report as words
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from logs.campaigns.campaign import load_campaign
from logs.campaigns.comparison import Comparison, comparisons
from logs.campaigns.journal import ENDING
from logs.campaigns.page import write
from logs.campaigns.statistics import Worst, chosen_metric, sensitivities, spreads, worst
from logs.campaigns.table import Table, read_table, unfinished_table
from logs.new_files import numbered
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat campaign report recordings/gusts.parquet",
    "wingbeat campaign report recordings/gusts.parquet --by touchdown_sink --worst 20 --out gusts.html",
    "wingbeat campaign report recordings/gusts.parquet --json",
)
JSON_KEYS = {
    "name, title, file": "of the campaign, and of its file",
    "flights, failed": "how many there are, and how many of them failed",
    "planned": "flights of a campaign that is not flown to its end, null where it is",
    "outcomes, reasons": "how many flights ended so; how many failed for each reason",
    "metrics": "list of {name, unit, flights, mean, sigma, least, low (5 %), median, high (95 %), greatest}; low and"
    " high null below 20 flights",
    "comparisons": "of each grid, list of {input, values, flights, failed, metrics: list of {metric, unit, groups (of"
    " each value {flights, low, median, high}: quartiles), pairs (of each value but the first, flights equal in all"
    " else: {value, first, pairs, better, worse, beyond_chance})}}",
    "sensitivities": "list of {input, metric, rank_correlation, flights, beyond_chance}, the strongest first",
    "worst": "list of {flight, why, value, command, values}: failed ones, then by the metric; command flies it again,"
    " values are what it was flown with",
    "by": "the metric by which flights are ordered, null where there is none",
    "changed": "why the commands would fly other flights now, empty if they would not",
    "page": "path of the page",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = (
        "Report of a campaign: outcomes, statistics, correlations, worst flights and the commands that repeat them."
    )
    parser = options.build_parser("campaign report", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("table", type=Path, metavar="TABLE.parquet", help="written by wingbeat campaign")
    parser.add_argument("--out", type=Path, metavar="PAGE.html", help="new page (default: next to the table)")
    parser.add_argument(
        "--by", metavar="METRIC", help="metric that ranks flights without failure (default: the first)"
    )
    parser.add_argument(
        "--worst", type=_count, default=10, metavar="N", help="number of listed flights (default: 10)"
    )
    options.add_json(parser)
    return parser


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit()) or int(text) > 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 10000")
    return int(text)


def run(arguments: Sequence[str]) -> int:
    """Print the report of a table, and write the page.

    Raises:
        InputError: no such table or metric, or the page exists.
    """
    chosen = build_parser().parse_args(arguments)
    if chosen.out is not None and chosen.out.exists():
        raise InputError(f"{chosen.out} exists: it is not overwritten")
    table = _table(chosen.table)
    by = chosen_metric(table, chosen.by)
    results = worst(table, by, chosen.worst)
    page = chosen.out or next(p for p in numbered(chosen.table.with_suffix(".html")) if not p.exists())
    write(page, table, results)
    changed = _changed(table)
    if chosen.json:
        print_document(_document(table, by, results) | {"changed": changed, "page": page})
    else:
        open_console().print(words.report(table, by, results, changed, page))
    return 0


def _table(path: Path) -> Table:
    """Return the table of a campaign, or that of its completed flights.

    Raises:
        InputError: neither exists.
    """
    if path.is_dir():
        raise InputError(f"{path} is a folder: specify the table, such as {path / 'CAMPAIGN.parquet'}")
    journal = path.with_name(path.name + ENDING)
    return unfinished_table(journal) if journal.exists() and not path.exists() else read_table(path)


def _changed(table: Table) -> str:
    """Return why the campaign's file now describes other flights than the table; empty if it does not."""
    try:
        same = load_campaign(Path(table.about.file)).digest() == table.about.digest
    except InputError as error:
        return f"the flights cannot be repeated: {error}"
    return (
        "" if same else f"{table.about.file}, or a file that it names, has changed: the commands give other flights"
    )


def _document(table: Table, by: str | None, results: Sequence[Worst]) -> dict[str, Any]:
    columns = table.columns
    pairs = zip(columns["failed"], columns["reason"], strict=True)
    return {
        "name": table.about.name,
        "title": table.about.title,
        "file": table.about.file,
        "flights": table.size,
        "planned": table.planned,
        "failed": sum(columns["failed"]),
        "outcomes": Counter(columns["outcome"]),
        "reasons": Counter(reason for failed, reason in pairs if failed),
        "metrics": spreads(table),
        "comparisons": [_compared(one) for one in comparisons(table)],
        "sensitivities": [one._asdict() | {"beyond_chance": one.beyond_chance} for one in sensitivities(table)],
        "worst": results,
        "by": by,
    }


def _compared(one: Comparison) -> dict[str, Any]:
    metrics = [
        each._asdict() | {"pairs": [pair._asdict() | {"beyond_chance": pair.beyond_chance} for pair in each.pairs]}
        for each in one.metrics
    ]
    return one._asdict() | {"metrics": metrics}
