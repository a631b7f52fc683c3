"""``wingbeat validate``: every published figure beside ours."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.command import options
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from groundstation.views.validation import summary_line, validation_table
from sim_bridge.validation.grauer import draw_plots
from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.row import VERDICTS, Row

EXAMPLES = (
    "wingbeat validate",
    "wingbeat validate --only yeo",
    "wingbeat validate --only grauer --plots pictures",
    "wingbeat validate --json",
)
JSON_KEYS = {
    "papers": "list of {name, title, rows}",
    "rows": "of a paper: list of {where, quantity, unit, published [least, greatest], ours, difference, limit,"
    " verdict, why}; difference: ours less the nearest published value; limit: the greatest allowed; null: none",
    "counts": "of rows by verdict: " + "; ".join(f"{name}: {text}" for name, text in VERDICTS.items()),
    "plots": "with --plots: paths of the pictures",
}


def build_parser() -> options.Parser:
    """The subcommand's parser."""
    summary = "Compute every published figure and print it beside the paper's; nothing is stored or tuned."
    parser = options.build_parser("validate", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("--only", choices=PAPERS, metavar="PAPER", help=f"one paper: {', '.join(PAPERS)}")
    parser.add_argument(
        "--plots",
        type=Path,
        metavar="DIR",
        help="also draw the polar plots of Grauer Fig. 8 into DIR",
    )
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Compute the rows, print the table.

    Raises:
        BadInput: no such paper, a picture that exists, matplotlib missing for pictures.
    """
    chosen = build_parser().parse_args(arguments)
    plots = [] if chosen.plots is None else draw_plots(chosen.plots)
    names = list(PAPERS) if chosen.only is None else [chosen.only]
    found = computed(names, announce=not chosen.json)
    if chosen.json:
        print_document(document(found) | {"plots": plots})
        return 0
    console = open_console()
    console.print(validation_table(found))
    console.print(summary_line(found))
    for path in plots:
        console.print(f"drawn: {path}", markup=False, highlight=False, soft_wrap=True)
    return 0


def computed(names: Sequence[str], announce: bool) -> dict[str, list[Row]]:
    """The rows of papers by name; what takes long is announced on stderr, by a progress bar on a terminal."""
    checks = [(name, check) for name in names for check in PAPERS[name].checks]
    found: dict[str, list[Row]] = {name: [] for name in names}
    with ProgressBar("validating") as bar:
        for done, (name, check) in enumerate(checks):
            if check.slow and announce and not sys.stderr.isatty():
                print(f"{name}: {check.title}, which takes a while", file=sys.stderr, flush=True)
            bar.show(done, len(checks), f"{name}: {check.title}")
            found[name] += check.rows()
    return found


def document(found: dict[str, list[Row]]) -> dict[str, Any]:
    """The keys of `JSON_KEYS`, without the pictures."""
    papers = [
        {"name": name, "title": PAPERS[name].title, "rows": list(map(_row, rows))} for name, rows in found.items()
    ]
    every = [row for rows in found.values() for row in rows]
    return {"papers": papers, "counts": {name: sum(row.verdict == name for row in every) for name in VERDICTS}}


def _row(row: Row) -> dict[str, Any]:
    printed = row.figure
    return {
        "where": printed.where,
        "quantity": printed.quantity,
        "unit": printed.unit,
        "published": [printed.low, printed.high],
        "ours": row.ours,
        "difference": row.difference,
        "limit": row.limit,
        "verdict": row.verdict,
        "why": row.why,
    }
