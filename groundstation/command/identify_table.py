"""``wingbeat identify TABLE --map MAP.toml``: identification from tables."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from groundstation.command.compiling import announced
from groundstation.command.identify_out import base_of, check_outputs, sha256, show_next_steps, show_written
from groundstation.views.json_document import print_document
from groundstation.views.progress import ProgressBar
from groundstation.views.table_identification import table_identification
from groundstation.views.terminal import open_console
from logs.identification.report.model_file import check_model, has_model, table_model, write_linear
from logs.identification.report.tables import Source, table_document, write_tables_report
from logs.identification.sources.table.config import load_map
from logs.identification.sources.table.run import TableIdentification, identify_tables
from wingbeat.errors import InputError


def run(files: Sequence[Path], what: str, chosen: argparse.Namespace) -> int:
    """Identify ``what`` from tables, print it, and write the requested files.

    Raises:
        InputError: an invalid table or map, an option of logs, or a file that exists or cannot be written.
    """
    _check(what, chosen)
    with announced(chosen.json):
        estimates = identify_tables(files, chosen.map, what, chosen.method)
    if chosen.json:
        print_document(table_document(estimates))
    else:
        open_console().print(table_identification(estimates))
    sys.stdout.flush()
    show_written(_written(files, what, chosen, estimates), chosen.json)
    show_next_steps(chosen, has_model(chosen.map, what))
    return 0


def _check(what: str, chosen: argparse.Namespace) -> None:
    """Check the options before the computation."""
    if chosen.elevator is not None:
        raise InputError("--elevator is for logs: the map tells it of a table")
    if chosen.vehicle is not None and chosen.model is None:
        raise InputError("--vehicle is for logs, and of a table for the bodies of --model: the map tells the rest")
    check_outputs(chosen)
    if chosen.model is not None:
        try:
            check_model(load_map(chosen.map), what)
        except InputError as error:
            raise InputError(f"{error} (map {chosen.map})") from None


def _written(
    files: Sequence[Path], what: str, chosen: argparse.Namespace, estimates: TableIdentification
) -> list[str]:
    """Write the page and the model; return lines about them."""
    lines: list[str] = []
    if chosen.report is None and chosen.model is None:
        return lines
    sources = tuple(Source(path.name, sha256(path)) for path in (*files, chosen.map))
    if chosen.report is not None:
        with ProgressBar("writing the report"):
            write_tables_report(chosen.report, sources, estimates)
        lines.append(f"written {chosen.report}")
    if chosen.model is not None:
        digests = " ".join(one.sha256 for one in sources[: len(files)])
        told = table_model(load_map(chosen.map), estimates, what, digests)
        base = None if chosen.vehicle is None else base_of(chosen.vehicle)
        with ProgressBar("linearising what was not identified") as bar:
            written = write_linear(chosen.model, told.model, base, bar.show)
        paths = " and ".join(str(path) for path in written.paths)
        lines += [f"written {paths}", *told.notes, *written.notes]
        if len(written.paths) == 1:
            lines.append(f"wingbeat tune {chosen.model} needs --vehicle V too: whose gains are designed")
    return lines
