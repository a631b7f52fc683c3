"""``wingbeat validate``: published and computed figures."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.command import options
from groundstation.command.compiling import announced
from groundstation.views.json_document import print_document
from groundstation.views.lattice_pictures import draw_lattice
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from groundstation.views.validation import summary_line, validation_table
from logs.wake_scene import write_wake
from sim_bridge.validation.grauer import draw_plots
from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.row import OUTCOMES, Check, Row
from sim_bridge.validation.yeo_lattice import wake_course, wing
from wingbeat.errors import InputError

EXAMPLES = (
    "wingbeat validate",
    "wingbeat validate --only yeo",
    "wingbeat validate --only gerdes --studies",
    "wingbeat validate --only grauer --plots pictures",
    "wingbeat validate --only lattice --plots pictures",
    "wingbeat validate --only lattice --scene wake.mcap",
    "wingbeat validate --only lattice --studies",
    "wingbeat validate --json",
)
MissionItemView = Callable[[float, str], None]
SCENE_EVERY = 4
"""number of lattice steps per step of the scene: 82 a second"""
PICTURES: dict[str, Callable[[Path, Callable[[float], None]], list[Path]]] = {
    "grauer": lambda folder, on_progress: draw_plots(folder),
    "lattice": draw_lattice,
}
"""functions by paper that draw its figures into a folder and report the completed fraction"""
JSON_KEYS = {
    "papers": "list of {name, title, rows}",
    "rows": "of a paper: list of {where, quantity, unit, published [least, greatest], ours, difference, limit,"
    " verdict, why}; difference: ours less the nearest published value; limit: the greatest allowed; null: none",
    "left_out": "list of {paper, study}: rows that take minutes and are computed with --studies alone",
    "counts": "of rows by verdict: " + "; ".join(f"{name}: {text}" for name, text in OUTCOMES.items()),
    "plots": "with --plots: paths of the pictures",
    "scene": "with --scene: path of the recording, else null",
}


def build_parser() -> options.Parser:
    """Build the parser of the subcommand."""
    summary = "Compute every published figure and compare it with the paper; nothing is stored or tuned."
    parser = options.build_parser("validate", summary, EXAMPLES, JSON_KEYS)
    parser.add_argument("--only", choices=PAPERS, metavar="PAPER", help=f"one paper: {', '.join(PAPERS)}")
    parser.add_argument("--studies", action="store_true", help="also compute the rows that take minutes")
    parser.add_argument(
        "--plots",
        type=Path,
        metavar="DIR",
        help="also draw pictures into DIR: grauer, the polar plots of Fig. 8; lattice, a wake and lift over a stroke",
    )
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="FILE",
        help="with lattice: also record the flapping wing's wake for Foxglove or Lichtblick in a new FILE.mcap",
    )
    options.add_json(parser)
    return parser


def run(arguments: Sequence[str]) -> int:
    """Compute the rows and print the table.

    Raises:
        InputError: an unknown paper or one without figures, an existing figure or scene, matplotlib missing for
            pictures.
    """
    chosen = build_parser().parse_args(arguments)
    names = list(PAPERS) if chosen.only is None else [chosen.only]
    with announced(quiet=chosen.json, live=False):
        return _validated(names, chosen)


def _validated(names: Sequence[str], chosen: argparse.Namespace) -> int:
    if chosen.scene is not None:
        record_scene(names, chosen.scene)
    plots = [] if chosen.plots is None else drawn(names, chosen.plots)
    results = computed(names, chosen.studies, announce=not chosen.json)
    missing = [] if chosen.studies else left_out(names)
    if chosen.json:
        print_document(document(results) | {"left_out": missing, "plots": plots, "scene": chosen.scene})
        return 0
    console = open_console()
    console.print(validation_table(results))
    console.print(summary_line(results))
    if missing:
        named = "; ".join(f"{one['paper']}, {one['study']}" for one in missing)
        console.print(f"not computed, minutes: {named} (--studies)", style="dim")
    for path in plots:
        console.print(f"drawn: {path}", soft_wrap=True)
    if chosen.scene is not None:
        console.print(f"recorded: {chosen.scene}", soft_wrap=True)
    return 0


def drawn(names: Sequence[str], folder: Path) -> list[Path]:
    """Draw the figures of papers by name into ``folder``; return their paths.

    Raises:
        InputError: none of them has any, a figure exists, or matplotlib is missing.
    """
    having = [name for name in names if name in PICTURES]
    if not having:
        raise InputError(f"{names[0]} has no pictures; {' and '.join(PICTURES)} have")
    with ProgressBar("drawing") as bar:
        return [
            path
            for name in having
            for path in PICTURES[name](folder, lambda share: bar.show(share, 1.0, "drawing the wake"))
        ]


def record_scene(names: Sequence[str], path: Path) -> None:
    """Record the wake of Yeo's wing into a new file.

    Raises:
        InputError: the lattice is not among the papers, or the file exists or cannot be written.
    """
    if "lattice" not in names:
        raise InputError(f"{names[0]} has no scene; only lattice has one")
    if path.exists():
        raise InputError(f"{path} exists: it is not overwritten")
    with ProgressBar("recording") as bar:
        course = wake_course(SCENE_EVERY, lambda share: bar.show(share, 1.0, "recording the wake"))
    write_wake(path, wing(), course)


class Task(NamedTuple):
    """Computation of rows."""

    paper: str
    title: str
    rows: Callable[[MissionItemView], list[Row]]
    lasting: str
    """duration as text; empty for a short one"""


def tasks(names: Sequence[str], studies: bool) -> list[Task]:
    """Return the computations for papers by name, with or without ``studies``."""
    results = []
    for name in names:
        for check in PAPERS[name].checks:
            results.append(Task(name, check.title, _silent(check), "a while" if check.slow else ""))
        if studies:
            results += [Task(name, study.title, study.rows, "minutes") for study in PAPERS[name].studies]
    return results


def _silent(check: Check) -> Callable[[MissionItemView], list[Row]]:
    return lambda on_progress: check.rows()


def computed(names: Sequence[str], studies: bool, announce: bool) -> dict[str, list[Row]]:
    """Compute the rows of papers by name; long computations are announced on stderr, on a terminal by a progress
    bar.
    """
    results: dict[str, list[Row]] = {name: [] for name in names}
    todo = tasks(names, studies)
    with ProgressBar("validating") as bar:
        for done, task in enumerate(todo):
            label = f"{task.paper}: {task.title}"
            if task.lasting and announce and not sys.stderr.isatty():
                print(f"{label}, which takes {task.lasting}", file=sys.stderr, flush=True)

            def on_progress(share: float, words: str, done: int = done, label: str = label) -> None:
                bar.show(done + share, len(todo), f"{label}: {words}")

            bar.show(done, len(todo), label)
            results[task.paper] += task.rows(on_progress)
    return results


def left_out(names: Sequence[str]) -> list[dict[str, str]]:
    """Return the studies of papers by name, with the keys of `JSON_KEYS`."""
    return [{"paper": name, "study": study.title} for name in names for study in PAPERS[name].studies]


def document(results: dict[str, list[Row]]) -> dict[str, Any]:
    """Build the document of `JSON_KEYS`, without the figures."""
    papers = [
        {"name": name, "title": PAPERS[name].title, "rows": list(map(_row, rows))} for name, rows in results.items()
    ]
    every = [row for rows in results.values() for row in rows]
    return {"papers": papers, "counts": {name: sum(row.outcome == name for row in every) for name in OUTCOMES}}


def _row(row: Row) -> dict[str, Any]:
    printed = row.figure
    return {
        "where": printed.where,
        "quantity": printed.quantity,
        "unit": printed.unit,
        "published": [printed.low, printed.high],
        "ours": row.computed,
        "difference": row.difference,
        "limit": row.limit,
        "verdict": row.outcome,
        "why": row.why,
    }
